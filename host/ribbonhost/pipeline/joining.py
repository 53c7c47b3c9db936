"""Whether a ribbon that was found may join a stream that runs, and what must be known of it before."""

from collections.abc import Callable

from ribbonhost import wire
from ribbonhost.device import Device
from ribbonhost.device.calibration import read_calibration
from ribbonhost.errors import DeviceError
from ribbonhost.pipeline.arrangement import Arrangement


class Admission:
    """Checks ribbons as they were checked at the start of the stream, and reads their calibrations."""

    def __init__(
        self,
        arrangement: Arrangement,
        rate_hz: int,
        calibrations: dict[str, wire.Calibration] | None,
        on_note: Callable[[Device, str], None],
    ) -> None:
        """calibrations: by serial number, added to; None if nobody needs them. on_note: told what the user
        should know of a device."""
        self._arrangement = arrangement
        self._rate_hz = rate_hz
        self._calibrations = calibrations
        self._on_note = on_note

    def admit(self, device: Device, found: Device) -> None:
        """`found`, which has said who it is, is to be the ribbon that `device` waits for.

        Raises DeviceError if it cannot be, LinkError if it is gone again.
        """
        info = found.info
        assert info is not None  # a device that was opened has answered
        who = f"ribbon {found.serial} on {found.name} is left out: it"
        if unlike := self._arrangement.unlike(info):
            raise DeviceError(f"{who} has {unlike}")
        if info.rate_max_hz < self._rate_hz:
            raise DeviceError(
                f"{who} scans at most {info.rate_max_hz} times a second, and the others {self._rate_hz}"
            )
        if device.info is None and self._calibrations is not None:
            try:
                self._calibrations[found.serial] = read_calibration(found).values
            except (DeviceError, wire.WireError) as error:
                self._on_note(device, f"{error}: it is taken as not calibrated")
