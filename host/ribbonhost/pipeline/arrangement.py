"""Which device stands at which place of a comb, and whether it can."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial

from ribbonhost import wire
from ribbonhost.comb import Comb
from ribbonhost.device import Device
from ribbonhost.errors import DeviceError, UsageError
from ribbonhost.reconstruct import CombLayout

PITCH_TOLERANCE_M = 1e-5

REFERENCE_ABSENT = "the others start on a straight line, and no surface counts"
"""What is shown while the reference of a comb is not there."""

Await = Callable[[str], Device]


@dataclass(frozen=True)
class Place:
    """One ribbon of a stream.

    Attributes:
        label: what to call it.
        expected_serial: its serial number, as far as it is known at the start.
        device: None if no device with this serial number is there or awaited.
        pitch_m, node_count: of the ribbon; 0 if there is no device.
    """

    label: str
    expected_serial: str
    device: Device | None
    pitch_m: float = 0.0
    node_count: int = 0

    @property
    def serial(self) -> str:
        """Its serial number; empty while it is absent and only its port is known."""
        return (self.device.serial if self.device else "") or self.expected_serial


@dataclass(frozen=True)
class Arrangement:
    """The ribbons of a stream, the reference first if there is a comb.

    Attributes:
        places: the ribbons in the order of the reconstruction.
        layout: where they start on the reference; None if there is no comb, just curves.
        notes: what the user should know, a sentence each.
        unused: devices that are in no place.
        unlike: what of a ribbon's INFO keeps it from joining the others; empty if nothing does.
    """

    places: tuple[Place, ...]
    layout: CombLayout | None
    notes: tuple[str, ...]
    unused: tuple[Device, ...]
    unlike: Callable[[wire.Info], str] = lambda info: ""

    @property
    def devices(self) -> list[Device]:
        """The devices that are there or awaited."""
        return [place.device for place in self.places if place.device]

    @property
    def present(self) -> list[Device]:
        """The devices that have said who they are."""
        return [device for device in self.devices if device.info]


def arrange_comb(devices: Sequence[Device], comb: Comb, await_ribbon: Await | None = None) -> Arrangement:
    """Finds the place of each device, all of which have answered their handshake.

    A device that is missing or unlike what the comb says leaves its place empty, with a note; those missing
    are awaited if `await_ribbon`, given a serial number, makes a device that waits. Raises UsageError if a
    device is there twice, CombFileError if a ribbon starts beyond the reference's end, and DeviceError if the
    reference is different, or missing and not awaited, or no ribbon of the comb is there.
    """
    by_serial = _by_serial(devices)
    reference = by_serial.get(comb.reference)
    if reference is None and (await_ribbon is None or not by_serial.keys() & set(comb.serials)):
        missing = (
            "no ribbon of the comb is" if await_ribbon else f"the reference ribbon {comb.reference} is not"
        )
        answered = ", ".join(f"{d.serial} on {d.name}" for d in devices) or "none"
        raise DeviceError(f"{missing} there; answered: {answered}")
    first = reference or next(by_serial[serial] for serial in comb.serials if serial in by_serial)
    info = _info_of(first)
    if unlike := _unlike(info, info, comb):
        which = "reference" if reference else "first"
        raise DeviceError(f"the {which} ribbon on {first.name} has {unlike}")
    for ribbon in comb.ribbons:
        comb.check_start(ribbon, len(info.slots))
    notes = []
    places = []
    for serial in comb.serials:
        label, device = comb.label(serial), by_serial.pop(serial, None)
        if device is None:
            device = await_ribbon(serial) if await_ribbon else None
            meanwhile = REFERENCE_ABSENT if serial == comb.reference else "the surface bridges its place"
            looked_for = " until it joins" if device else ""
            notes.append(f"ribbon {serial} ({label}) is not there: {meanwhile}{looked_for}")
        elif unlike := _unlike(_info_of(device), info, comb):
            notes.append(f"ribbon {serial} ({label}) is left out: it has {unlike}")
            by_serial[serial], device = device, None
        places.append(_place(label, serial, device, info))
    notes += [
        f"ribbon {serial} on {device.name} is not in the comb file: left out"
        for serial, device in by_serial.items()
        if serial not in comb.serials
    ]
    layout = CombLayout(comb.pitch_m, info.node_count, tuple(ribbon.start_m for ribbon in comb.ribbons))
    unlike_them = partial(_unlike, like=info, comb=comb)
    return Arrangement(tuple(places), layout, tuple(notes), tuple(by_serial.values()), unlike_them)


def arrange_curves(devices: Sequence[Device], awaited: Sequence[Device] = ()) -> Arrangement:
    """Places for ribbons that belong to no comb.

    awaited: devices that are not there yet, and taken to be like the first that is. Raises UsageError if a
    device is there twice.
    """
    by_serial = _by_serial(devices)
    like = _info_of(devices[0])
    return Arrangement(
        tuple(_place(device.name, device.serial, device, like) for device in (*by_serial.values(), *awaited)),
        None,
        (
            "no comb is described (--comb FILE): curves only, each from its own origin, and no surface",
            *(f"{device.lost}: it joins when it is" for device in awaited),
        ),
        (),
        partial(_unlike, like=like),
    )


def _place(label: str, serial: str, device: Device | None, like: wire.Info) -> Place:
    """A place; a device that is awaited is taken to be `like` another."""
    if device is None:
        return Place(label, serial, None)
    info = device.info or like
    return Place(label, serial, device, info.pitch_m, info.node_count)


def _by_serial(devices: Sequence[Device]) -> dict[str, Device]:
    by_serial: dict[str, Device] = {}
    for device in devices:
        if other := by_serial.get(device.serial):
            raise UsageError(
                f"{other.name} and {device.name} are both ribbon {device.serial}: give one of them"
            )
        by_serial[device.serial] = device
    return by_serial


def _info_of(device: Device) -> wire.Info:
    if device.info is None:
        raise DeviceError(f"{device.name} has not said who it is")
    return device.info


def _unlike(info: wire.Info, like: wire.Info, comb: Comb | None = None) -> str:
    """What of a ribbon differs from the comb, or from one that is there; empty if nothing does."""
    first = "the reference has" if comb and _serial_of(like) == comb.reference else "the first has"
    pitch_m, said = (comb.pitch_m, "the comb file says") if comb else (like.pitch_m, first)
    if abs(info.pitch_m - pitch_m) > PITCH_TOLERANCE_M:
        return f"a pitch of {info.pitch_m:g} m where {said} {pitch_m:g} m"
    if comb and comb.slots is not None and len(info.slots) != comb.slots:
        return f"{len(info.slots)} slots where the comb file says {comb.slots}"
    if len(info.slots) != len(like.slots):
        return f"{len(info.slots)} slots where {first} {len(like.slots)}"
    if info.node_count != like.node_count:
        return f"{info.node_count} nodes where {first} {like.node_count}"
    parts = {_part_name(int(part)) for part in info.slots.part} - {"none"}
    if comb and comb.parts is not None and (others := sorted(parts - comb.parts)):
        return f"{', '.join(others)} where the comb file says {', '.join(sorted(comb.parts))}"
    return ""


def _serial_of(info: wire.Info) -> str:
    return bytes(info.unique_id).hex()


def _part_name(part: int) -> str:
    try:
        return wire.Part(part).name.lower()
    except ValueError:
        return f"an unknown part ({part})"
