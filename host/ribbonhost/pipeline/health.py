"""What a ribbon says of its calibration: which of its sensors read what that does not explain."""

from dataclasses import dataclass

from ribbonhost.wire import Misfit, Status

LISTED_MAX = 2  # more than that are counted, not told one by one
UNKNOWN_PERMILLE = -128


@dataclass(frozen=True)
class Unfit:
    """A slot whose calibration does not fit.

    misfit: what does not, wire.Misfit. length_percent: by how much |a| at rest exceeds g, or |B| the local
        field; None where that is not known.
    """

    slot: int
    misfit: Misfit
    length_percent: float | None

    def as_json(self) -> dict[str, object]:
        """The object that `stream --json` prints."""
        names = [bit.name.lower() for bit in Misfit if bit in self.misfit and bit.name]
        return {"slot": self.slot, "misfit": names, "length_percent": self.length_percent}

    def __str__(self) -> str:
        by = "" if self.length_percent is None else f" by {self.length_percent:+.1f} %"
        is_length = Misfit.LENGTH in self.misfit
        if self.slot % 2 == 0:
            where = f"accelerometer in slot {self.slot}"
            return (
                f"{where} is off g{by} at rest" if is_length else f"{where} is not level with its neighbours"
            )
        what = f"magnitude{by}" if is_length else "dip"
        return f"magnetometer in slot {self.slot} is off the field's {what}"


def unfit_slots(status: Status | None) -> tuple[Unfit, ...]:
    """The slots that a STATUS finds fault with."""
    if status is None:
        return ()
    health = status.health
    return tuple(
        Unfit(
            slot,
            Misfit(int(misfit)),
            None if permille == UNKNOWN_PERMILLE else round(int(permille) / 10, 1),
        )
        for slot, (misfit, permille) in enumerate(zip(health.misfit, health.length_permille, strict=True))
        if misfit
    )


def sentence(unfit: tuple[Unfit, ...], slots: int) -> str:
    """What is wrong and what to do, in a line; empty if nothing is."""
    if not unfit:
        return ""
    if len(unfit) <= LISTED_MAX:
        found = "; ".join(str(one) for one in unfit)
    else:
        found = f"{len(unfit)} of {slots} sensors do not fit the calibration"
    is_magnetic = all(one.slot % 2 == 1 for one in unfit)
    return f"{found}: calibrate it" + (", or take away what is magnetic" if is_magnetic else "")
