"""What `ribbonhost doctor` looks at: the machine, its ports, and each ribbon."""

import importlib
import os
import platform
import re
import shutil
import sys
import time
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from enum import StrEnum
from importlib import metadata
from importlib.util import find_spec
from pathlib import Path

from ribbonhost import wire
from ribbonhost.cli.info import status_of
from ribbonhost.cli.printing import name_of
from ribbonhost.device import open_device
from ribbonhost.device.discovery import FoundPort, PortState
from ribbonhost.errors import DeviceError, LinkError

DISK_BYTES = 1 << 30
"""Hours of recording of a comb; less is a matter of time."""

CLOCK_S = 1e-4
"""Ribbons are kept in step to 0.3 ms: a clock must take smaller steps than that."""

EXTRA = re.compile(r"""([\w.-]+).*;.*extra == ['"]([\w-]+)['"]""")
"""A requirement of an extra, as the installed package lists it."""

USB_DEVICES = Path("/sys/bus/usb/devices")
USB_SERIAL_CLASS = "02"

RESET_FAULTS = ("watchdog", "hard_fault", "brown_out")


class Verdict(StrEnum):
    """How a check ended."""

    OK = "ok"
    NOTE = "note"
    FAIL = "FAIL"


@dataclass(frozen=True)
class Check:
    """One line of the doctor.

    Attributes:
        name: what was looked at.
        verdict: how it is; a note is worth knowing and stops nothing.
        what: what was found, and, if it is not well, what to do.
    """

    name: str
    verdict: Verdict
    what: str


def machine_checks(folder: Path) -> Iterator[Check]:
    """Python, the compiled solver, extras, the emulator, clock, disk and drivers."""
    yield _python()
    yield _solver()
    yield from extras_checks(metadata.requires("ribbonhost") or [])
    yield _emulator()
    yield clock_check(_clock_step_s())
    yield disk_check(folder, shutil.disk_usage(folder).free)
    if platform.system() == "Linux":
        yield driver_check(USB_DEVICES)


def port_checks(ports: Sequence[FoundPort]) -> Iterator[Check]:
    """One for each port that could not be asked, and one for what was found on the others."""
    for port in ports:
        name = f"port {port.url}"
        match port.state:
            case PortState.FORBIDDEN | PortState.INCOMPATIBLE | PortState.FAILED:
                yield Check(name, Verdict.FAIL, port.what)
            case PortState.BUSY:
                yield Check(name, Verdict.NOTE, port.what)
            case PortState.OTHER:
                yield Check(name, Verdict.OK, f"no ribbon: {port.what}")
            case PortState.RIBBON:
                yield Check(name, Verdict.OK, f"ribbon {port.serial}")
    if not any(port.info for port in ports):
        yield Check(
            "ribbons",
            Verdict.NOTE,
            "none was found: plug one in (a cable for charging only has no data wires), or name its port; "
            "`ribbonhost stream --emulate wing` needs none",
        )


def permission_check(ports: Sequence[FoundPort]) -> Check:
    """Whether this user may open the serial ports; the command to type stands with each that is refused."""
    forbidden = [port.url for port in ports if port.state is PortState.FORBIDDEN]
    groups = _groups()
    mine = f"; your groups: {groups}" if groups else ""
    if forbidden:
        return Check("permissions", Verdict.FAIL, f"{', '.join(forbidden)} cannot be opened{mine}")
    return Check("permissions", Verdict.OK, f"no port is refused{mine}")


def ribbon_checks(port: FoundPort, baud: int) -> list[Check]:
    """Versions, last reset, slots and losses of a ribbon that answered."""
    name = f"ribbon {port.serial[:8]}"
    try:
        device = open_device(port.url, baud=baud)
    except (LinkError, DeviceError) as error:
        return [Check(name, Verdict.FAIL, str(error))]
    try:
        status = status_of(device)
    except (LinkError, DeviceError) as error:
        return [Check(name, Verdict.FAIL, str(error))]
    finally:
        device.close()
    info = device.info
    assert info is not None  # a device that was opened has answered
    return [
        version_check(name, info),
        calibration_check(name, info),
        reset_check(name, status),
        slots_check(name, info, status),
        losses_check(name, status),
    ]


def version_check(name: str, info: wire.Info) -> Check:
    """Whether device and host speak one schema."""
    firmware = ".".join(map(str, info.firmware_version))
    what = f"firmware {firmware}, wire version {info.wire_version}"
    if info.schema_hash == wire.SCHEMA_HASH:
        return Check(f"{name} firmware", Verdict.OK, what)
    behind = "firmware" if info.wire_version < wire.WIRE_VERSION else "ribbonhost"
    return Check(
        f"{name} firmware",
        Verdict.NOTE,
        f"{what}, with another schema than this host (wire version {wire.WIRE_VERSION}): they understand "
        f"each other, and a later {behind} makes them one",
    )


def calibration_check(name: str, info: wire.Info) -> Check:
    """Whether it was ever calibrated."""
    if info.calibration_sequence:
        what = f"number {info.calibration_sequence}, CRC {info.calibration_crc32:08x}"
        return Check(f"{name} calibration", Verdict.OK, what)
    what = "none: orientations are as far off as the parts are; calibrate it before you trust shapes"
    return Check(f"{name} calibration", Verdict.NOTE, what)


def reset_check(name: str, status: wire.Status) -> Check:
    """Why it last started."""
    cause = name_of(wire.ResetCause, status.reset_cause)
    what = f"last started by {cause}, up for {status.uptime_s} s"
    if status.fault_pc:
        registers = f"lr {status.fault_lr:#010x}, cfsr {status.fault_cfsr:#x}"
        what += f"; hard fault at {status.fault_pc:#010x} ({registers})"
    if status.fault_pc or cause in RESET_FAULTS:
        advice = (
            "check its supply" if cause == "brown_out" else "flash the latest firmware, and report this line"
        )
        return Check(f"{name} start", Verdict.FAIL, f"{what}: {advice}")
    return Check(f"{name} start", Verdict.OK, what)


def slots_check(name: str, info: wire.Info, status: wire.Status) -> Check:
    """Whether all sensors read, and why those that do not are not used."""
    reasons: dict[str, list[int]] = {}
    for slot, reason in enumerate(status.slots.reason):
        if reason != wire.SlotReason.OK:
            reasons.setdefault(name_of(wire.SlotReason, int(reason)), []).append(slot)
    count = len(status.slots.reason)
    if len(info.slots) != count:
        what = f"STATUS tells of {count} slots and INFO of {len(info.slots)}: flash the latest firmware"
        return Check(f"{name} slots", Verdict.FAIL, what)
    if not reasons:
        return Check(f"{name} slots", Verdict.OK, f"all {count} read")
    found = "; ".join(f"{reason}: {', '.join(map(str, slots))}" for reason, slots in reasons.items())
    advice = "check the connectors and solder joints there"
    if reasons.keys() <= {"out_of_range", "saturated"}:
        advice = "move it away from magnets and iron, or calibrate it"
    bad = sum(map(len, reasons.values()))
    return Check(f"{name} slots", Verdict.FAIL, f"{bad} of {count} not used ({found}): {advice}")


def losses_check(name: str, status: wire.Status) -> Check:
    """What the device gave up since it started."""
    what = (
        f"{status.overruns} scans left out, {status.frames_dropped} frames dropped, "
        f"{status.rx_crc_errors} CRC errors received since its start"
    )
    if status.overruns or status.frames_dropped:
        return Check(f"{name} losses", Verdict.NOTE, f"{what}: `ribbonhost rate-test` finds a rate that fits")
    return Check(f"{name} losses", Verdict.OK, what)


def clock_check(step_s: float) -> Check:
    """Whether this machine's clock tells scans of different ribbons apart."""
    what = f"steps of {step_s * 1e6:.3g} us"
    if step_s <= CLOCK_S:
        return Check("clock", Verdict.OK, what)
    advice = (
        f"coarser than {CLOCK_S * 1e3:g} ms, ribbons cannot be kept in step: use another machine or system"
    )
    return Check("clock", Verdict.FAIL, f"{what}: {advice}")


def disk_check(folder: Path, free_bytes: int) -> Check:
    """Whether a recording has room."""
    what = f"{free_bytes / (1 << 30):.1f} GiB free in {folder}"
    if free_bytes >= DISK_BYTES:
        return Check("disk", Verdict.OK, what)
    return Check("disk", Verdict.FAIL, f"{what}: a recording needs room, free 1 GiB or record elsewhere")


def driver_check(usb_devices: Path) -> Check:
    """Whether each USB serial interface that the kernel sees has a driver."""
    without = []
    count = 0
    for file in sorted(usb_devices.glob("*/bInterfaceClass")):
        if file.read_text().strip() == USB_SERIAL_CLASS:
            count += 1
            if not (file.parent / "driver").exists():
                without.append(file.parent.name)
    if not without:
        return Check("drivers", Verdict.OK, f"{count} USB serial interfaces, each with its driver")
    what = f"USB serial interface {', '.join(without)} has no driver: type `sudo modprobe cdc_acm`"
    return Check("drivers", Verdict.FAIL, what)


def _python() -> Check:
    return Check(
        "python", Verdict.OK, f"{platform.python_version()} on {platform.system()} {platform.machine()}"
    )


def _solver() -> Check:
    try:
        importlib.import_module("ribbonhost.native._native")
    except ImportError as error:
        what = (
            f"cannot be loaded ({error}): type `{sys.executable} -m pip install --force-reinstall ribbonhost`"
        )
        return Check("solver", Verdict.FAIL, what)
    return Check("solver", Verdict.OK, "compiled and loaded")


def extras_checks(requirements: Sequence[str]) -> Iterator[Check]:
    """One check for each extra of these requirements: whether its libraries are installed."""
    extras: dict[str, list[str]] = {}
    for requirement in requirements:
        if match := EXTRA.match(requirement):
            extras.setdefault(match[2], []).append(match[1])
    for extra, libraries in extras.items():
        missing = [library for library in libraries if not _is_installed(library)]
        if missing:
            what = f'without {", ".join(missing)}: `pip install "ribbonhost[{extra}]"` if you need it'
            yield Check(f"extra {extra}", Verdict.NOTE, what)
        else:
            yield Check(f"extra {extra}", Verdict.OK, "installed")


def _is_installed(library: str) -> bool:
    try:
        metadata.version(library)
    except metadata.PackageNotFoundError:
        return False
    return True


def _emulator() -> Check:
    if find_spec("ribbonhil"):
        return Check("emulator", Verdict.OK, "installed")
    return Check("emulator", Verdict.NOTE, "not installed: --emulate and emulated:// need ribbonhil")


def _clock_step_s() -> float:
    """The smallest step that the clock of this machine takes, or is said to."""
    steps_s = []
    for _ in range(20):
        start_s = time.monotonic()
        while (now_s := time.monotonic()) == start_s:
            pass
        steps_s.append(now_s - start_s)
    return max(min(steps_s), time.get_clock_info("monotonic").resolution)


def _groups() -> str:
    """The groups of this process, which say what ports it may open; empty where there are none."""
    if os.name != "posix":
        return ""
    import grp

    names = []
    for number in sorted({os.getegid(), *os.getgroups()}):
        try:
            names.append(grp.getgrgid(number).gr_name)
        except KeyError:
            names.append(str(number))
    return ", ".join(names)
