"""What a ribbon says of its sensors: those not used, and those that their calibration does not fit."""

from dataclasses import dataclass

from ribbonhost.wire import Misfit, SlotReason, Status

LISTED_MAX = 2  # more than that are counted, not told one by one
UNKNOWN_PERMILLE = -128
IMPLAUSIBLE = (SlotReason.OUT_OF_RANGE, SlotReason.NOISY)


@dataclass(frozen=True)
class Unfit:
    """A slot that something is wrong with.

    reason: why it is not used; OK if it is. misfit: what its calibration does not explain. length_percent: by
        how much |a| at rest exceeds g, or |B| the local field; None where that is not known.
    """

    slot: int
    reason: SlotReason | int
    misfit: Misfit
    length_percent: float | None

    @property
    def is_magnetometer(self) -> bool:
        """Of the two kinds, which take turns."""
        return self.slot % 2 == 1

    @property
    def needs_calibration(self) -> bool:
        """Whether a calibration may help."""
        return self.reason in IMPLAUSIBLE or self.reason == SlotReason.OK

    def as_json(self) -> dict[str, object]:
        """The object that `stream --json` prints."""
        names = [bit.name.lower() for bit in Misfit if bit in self.misfit and bit.name]
        return {
            "slot": self.slot,
            "reason": _name(self.reason),
            "misfit": names,
            "length_percent": self.length_percent,
        }

    def __str__(self) -> str:
        name = f"{'magnetometer' if self.is_magnetometer else 'accelerometer'} in slot {self.slot}"
        by = "" if self.length_percent is None else f" by {self.length_percent:+.1f} %"
        is_length = Misfit.LENGTH in self.misfit
        if self.reason != SlotReason.OK:
            return f"{name} is not used: {_name(self.reason).replace('_', ' ')}"
        if self.is_magnetometer:
            return f"{name} is off the field's {f'magnitude{by}' if is_length else 'dip'}"
        return f"{name} is off g{by} at rest" if is_length else f"{name} is not level with its neighbours"


def unfit_slots(status: Status | None) -> tuple[Unfit, ...]:
    """The slots that a STATUS finds fault with."""
    if status is None:
        return ()
    found = []
    told = zip(status.slots.reason, status.health.misfit, status.health.length_permille, strict=False)
    for slot, (reason, misfit, permille) in enumerate(told):
        if reason != SlotReason.OK or misfit:
            length_percent = None if permille == UNKNOWN_PERMILLE else round(int(permille) / 10, 1)
            known = SlotReason(int(reason)) if int(reason) in set(SlotReason) else int(reason)
            found.append(Unfit(slot, known, Misfit(int(misfit)), length_percent))
    return tuple(found)


def sentence(unfit: tuple[Unfit, ...], slots: int) -> str:
    """What is wrong and what to do, in a line; empty if nothing is."""
    if not unfit:
        return ""
    if len(unfit) <= LISTED_MAX:
        found = "; ".join(str(one) for one in unfit)
    elif all(one.reason == SlotReason.OK for one in unfit):
        found = f"{len(unfit)} of {slots} sensors do not fit the calibration"
    else:
        unused = sum(one.reason != SlotReason.OK for one in unfit)
        found = f"{unused} of {slots} sensors are not used"
        if len(unfit) > unused:
            found += f", {len(unfit) - unused} more do not fit the calibration"
    if not any(one.needs_calibration for one in unfit):
        return found
    is_magnetic = all(one.is_magnetometer for one in unfit)
    return f"{found}: calibrate it" + (", or take away what is magnetic" if is_magnetic else "")


def _name(reason: SlotReason | int) -> str:
    return reason.name.lower() if isinstance(reason, SlotReason) else f"reason {reason}"
