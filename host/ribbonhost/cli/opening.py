"""The ribbons of a stream: those that are there are opened, those that are not are awaited."""

from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor

from ribbonhost import wire
from ribbonhost.cli.naming import resolve
from ribbonhost.cli.output import Output
from ribbonhost.comb import Comb
from ribbonhost.device import Device, absent_device, open_device
from ribbonhost.device.calibration import read_calibration
from ribbonhost.errors import DeviceError, LinkError, RibbonError, UsageError
from ribbonhost.pipeline.arrangement import Arrangement, arrange_comb, arrange_curves
from ribbonhost.pipeline.poses import MotionMode
from ribbonhost.pipeline.raw_link import why_not
from ribbonhost.record import Tape

RATE_HZ = 100


class Opened:
    """The ribbons of a stream.

    Attributes:
        devices: those that answered.
        absent: ports that were named and have no ribbon.
        channels: the number of each device in a recording.
    """

    def __init__(
        self, names: Sequence[str], baud: int, comb: Comb | None, output: Output, tape: Tape
    ) -> None:
        """Opens all ports at once. One that fails is noted; raises RibbonError if all fail."""
        self.devices: list[Device] = []
        self.absent: list[str] = []
        self.channels: dict[Device, int] = {}
        self._baud = baud
        self._tape = tape
        missing: list[str] = []
        urls = resolve(names, baud=baud, comb=comb, missing=missing)
        for what in missing:
            output.note(what)
        with ThreadPoolExecutor(len(urls)) as pool:
            taps = [tape.tap() for _ in urls]
            attempts = [
                pool.submit(open_device, url, baud=baud, observer=tap)
                for url, tap in zip(urls, taps, strict=True)
            ]
        for url, tap, attempt in zip(urls, taps, attempts, strict=True):
            error = attempt.exception()
            if error is None:
                device = attempt.result()
                self.devices.append(device)
                self.channels[device] = tap.channel
            elif isinstance(error, DeviceError | LinkError) and len(names) > 1:
                self.absent.append(url)
                output.note(str(error))
            else:
                self.close()
                raise error
        if not self.devices:
            raise RibbonError(f"none of the {len(names)} ports has a ribbon")
        for device in self.devices:
            if not device.same_schema and device.info:
                output.note(
                    f"{device.name} speaks wire version {device.info.wire_version} with another schema: "
                    "what this ribbonhost does not know is skipped and counted"
                )

    def close(self) -> None:
        """Closes all devices."""
        for device in self.channels:
            device.close()

    def arrange(self, comb: Comb | None, *, awaits: bool) -> Arrangement:
        """Gives each ribbon its place; absent ones are awaited, if `awaits`. Raises as arrange_comb."""
        if comb:
            return arrange_comb(self.devices, comb, self._await if awaits else None)
        return arrange_curves(self.devices, [self._await("", url) for url in self.absent] if awaits else ())

    def _await(self, serial: str, port: str = "") -> Device:
        tap = self._tape.tap()
        device = absent_device(serial, port, baud=self._baud, observer=tap)
        self.channels[device] = tap.channel
        return device


def calibrations_of(
    devices: Sequence[Device], motion: MotionMode, rate_hz: int, output: Output, *, all_of_them: bool
) -> dict[str, wire.Calibration]:
    """The calibration records, by serial number, of all devices whose motion can be estimated, or of all.

    One that cannot be read is noted.
    """
    records: dict[str, wire.Calibration] = {}
    devices = [d for d in devices if all_of_them or (motion != "off" and not why_not(d, rate_hz))]
    if not devices:
        return records
    with ThreadPoolExecutor(len(devices)) as pool:
        attempts = {device: pool.submit(read_calibration, device) for device in devices}
    for device, attempt in attempts.items():
        try:
            records[device.serial] = attempt.result().values
        except (DeviceError, LinkError, wire.WireError) as error:
            output.note(f"{error}: it is taken as not calibrated")
    return records


def rate_of(wanted_hz: int | None, devices: Sequence[Device], output: Output) -> int:
    """The scan rate of a stream of these devices. Raises UsageError for one that not all can."""
    slowest = min(devices, key=lambda device: device.info.rate_max_hz if device.info else 0)
    assert slowest.info is not None  # a device that was opened has answered
    limit_hz = slowest.info.rate_max_hz
    if wanted_hz is None:
        if limit_hz < RATE_HZ:
            output.note(f"{slowest.name} scans at most {limit_hz} times a second: all do")
        return min(RATE_HZ, limit_hz)
    if wanted_hz > limit_hz:
        raise UsageError(f"--rate {wanted_hz}: {slowest.name} scans at most {limit_hz} times a second")
    return wanted_hz
