"""Which device stands at which place of a comb, and whether it can."""

from collections.abc import Sequence
from dataclasses import dataclass

from ribbonhost import wire
from ribbonhost.comb import Comb
from ribbonhost.device import Device
from ribbonhost.errors import DeviceError, UsageError
from ribbonhost.reconstruct import CombLayout

PITCH_TOLERANCE_M = 1e-5


@dataclass(frozen=True)
class Place:
    """One ribbon of a stream.

    Attributes:
        label: what to call it.
        serial: its serial number.
        device: None if no device with this serial number is there.
        pitch_m, node_count: of the ribbon; 0 if it is not there.
    """

    label: str
    serial: str
    device: Device | None
    pitch_m: float = 0.0
    node_count: int = 0


@dataclass(frozen=True)
class Arrangement:
    """The ribbons of a stream, the reference first if there is a comb.

    Attributes:
        places: the ribbons in the order of the reconstruction.
        layout: where they start on the reference; None if there is no comb, just curves.
        notes: what the user should know, a sentence each.
        unused: devices that are in no place.
    """

    places: tuple[Place, ...]
    layout: CombLayout | None
    notes: tuple[str, ...]
    unused: tuple[Device, ...]

    @property
    def devices(self) -> list[Device]:
        """The devices that are there."""
        return [place.device for place in self.places if place.device]


def arrange_comb(devices: Sequence[Device], comb: Comb) -> Arrangement:
    """Finds the place of each device, all of which have answered their handshake.

    A device that is missing or unlike what the comb says leaves its place empty, with a note. Raises
    UsageError if a device is there twice, CombFileError if a ribbon starts beyond the reference's end, and
    DeviceError if it is the reference that is missing or different.
    """
    by_serial = _by_serial(devices)
    reference = by_serial.get(comb.reference)
    if reference is None:
        answered = ", ".join(f"{d.serial} on {d.name}" for d in devices) or "none"
        raise DeviceError(f"the reference ribbon {comb.reference} is not there; answered: {answered}")
    info = _info_of(reference)
    if unlike := _unlike(info, comb, len(info.slots)):
        raise DeviceError(f"the reference ribbon on {reference.name} has {unlike}")
    for ribbon in comb.ribbons:
        comb.check_start(ribbon, len(info.slots))
    notes = []
    places = []
    for serial in comb.serials:
        label, device = comb.label(serial), by_serial.pop(serial, None)
        if device is None:
            notes.append(f"ribbon {serial} ({label}) is not there: the surface bridges its place")
        elif unlike := _unlike(_info_of(device), comb, len(info.slots)):
            notes.append(f"ribbon {serial} ({label}) is left out: it has {unlike}")
            by_serial[serial], device = device, None
        places.append(_place(label, serial, device))
    notes += [
        f"ribbon {serial} on {device.name} is not in the comb file: left out"
        for serial, device in by_serial.items()
        if serial not in comb.serials
    ]
    layout = CombLayout(comb.pitch_m, info.node_count, tuple(ribbon.start_m for ribbon in comb.ribbons))
    return Arrangement(tuple(places), layout, tuple(notes), tuple(by_serial.values()))


def arrange_curves(devices: Sequence[Device]) -> Arrangement:
    """Places for ribbons that belong to no comb. Raises UsageError if a device is there twice."""
    by_serial = _by_serial(devices)
    return Arrangement(
        tuple(_place(device.name, serial, device) for serial, device in by_serial.items()),
        None,
        ("no comb is described (--comb FILE): curves only, each from its own origin, and no surface",),
        (),
    )


def _place(label: str, serial: str, device: Device | None) -> Place:
    info = device.info if device else None
    return Place(label, serial, device, info.pitch_m if info else 0.0, info.node_count if info else 0)


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


def _unlike(info: wire.Info, comb: Comb, reference_slots: int) -> str:
    """What of a device differs from the comb; empty if nothing does."""
    if abs(info.pitch_m - comb.pitch_m) > PITCH_TOLERANCE_M:
        return f"a pitch of {info.pitch_m:g} m where the comb file says {comb.pitch_m:g} m"
    if comb.slots is not None and len(info.slots) != comb.slots:
        return f"{len(info.slots)} slots where the comb file says {comb.slots}"
    if len(info.slots) != reference_slots:
        return f"{len(info.slots)} slots where the reference has {reference_slots}"
    parts = {_part_name(int(part)) for part in info.slots.part} - {"none"}
    if comb.parts is not None and (others := sorted(parts - comb.parts)):
        return f"{', '.join(others)} where the comb file says {', '.join(sorted(comb.parts))}"
    return ""


def _part_name(part: int) -> str:
    try:
        return wire.Part(part).name.lower()
    except ValueError:
        return f"an unknown part ({part})"
