"""`ribbonhost config`: keeps what a ribbon is set to in a file, and gives it back."""

import json
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path

from ribbonhost import wire
from ribbonhost.cli.config_file import DeviceConfig, config_text, load_config, mode_names
from ribbonhost.cli.files import write_whole
from ribbonhost.cli.naming import open_named
from ribbonhost.device import Device
from ribbonhost.device.calibration import read_calibration, write_calibration
from ribbonhost.errors import DeviceError, UsageError


def run_dump(
    name: str, path: Path | None, *, force: bool, comb: Path | None, baud: int, as_json: bool
) -> None:
    """Writes the file, or prints it. Raises UsageError, LinkError, DeviceError, RibbonError."""
    if path and path.exists() and not force:
        raise UsageError(f"{path} is there already: name another file, or give --force to replace it")
    device = open_named(name, baud=baud, comb=comb)
    try:
        stored = read_calibration(device)
        info = _info_of(device)
    finally:
        device.close()
    config = DeviceConfig(device.serial, info.rate_hz, info.mode, stored.values)
    text = config_text(config, info, port=device.name, version=version("ribbonhost"), now=datetime.now(UTC))
    if path:
        write_whole(path, text)
    if as_json:
        facts: dict[str, object] = {
            **_facts(device, info, stored.crc32),
            **({"file": str(path)} if path else {"toml": text}),
        }
        print(json.dumps({"dumped": facts}))
    elif path:
        print(f"{path}: ribbon {device.serial}, {_calibration(info)}, CRC {stored.crc32:08x}.")
    else:
        print(text, end="")


def run_restore(name: str, path: Path, *, force: bool, comb: Path | None, baud: int, as_json: bool) -> None:
    """Gives a ribbon what the file says. Raises UsageError, LinkError and DeviceError.

    All that can be checked is checked before anything is written.
    """
    config = load_config(path)
    device = open_named(name, baud=baud, comb=comb)
    try:
        _check_fit(config, device, path, force)
        stored = write_calibration(device, config.calibration)
        device.command(wire.CommandCode.SET_RATE, config.rate_hz)
        device.command(wire.CommandCode.SET_MODE, config.mode)
        info = device.handshake()
    finally:
        device.close()
    if (info.rate_hz, info.mode) != (config.rate_hz, config.mode):
        raise DeviceError(
            f"{device.name} has its calibration back, but scans {info.rate_hz} times a second with mode "
            f"{info.mode} where the file says {config.rate_hz} and {config.mode}"
        )
    if as_json:
        print(json.dumps({"restored": {**_facts(device, info, stored.crc32), "file": str(path)}}))
    else:
        print(
            f"Ribbon {device.serial} on {device.name} has back what {path} says: {_calibration(info)}, "
            f"CRC {stored.crc32:08x}, read back and equal; {info.rate_hz} Hz."
        )


def _check_fit(config: DeviceConfig, device: Device, path: Path, force: bool) -> None:
    info = _info_of(device)
    if config.serial != device.serial and not force:
        raise UsageError(
            f"{path} is of ribbon {config.serial}, and {device.name} is {device.serial}: "
            "its sensors are others; --force gives it the file's calibration all the same"
        )
    slots = len(config.calibration.slots)
    if slots != len(info.slots):
        raise UsageError(f"{path} has {slots} slots, and the ribbon on {device.name} has {len(info.slots)}")
    if not 1 <= config.rate_hz <= info.rate_max_hz:
        raise UsageError(
            f"{path} says {config.rate_hz} scans a second, and {device.name} does at most {info.rate_max_hz}"
        )
    if wire.Mode.ORIENT in config.mode and wire.Mode.ORIENT_COMPACT in config.mode:
        raise UsageError(f"{path}: mode holds orient and orient_compact, of which a ribbon sends one")


def _facts(device: Device, info: wire.Info, crc: int) -> dict[str, object]:
    return {
        "serial": device.serial,
        "port": device.name,
        "rate_hz": info.rate_hz,
        "mode": mode_names(info.mode),
        "calibration_sequence": info.calibration_sequence,
        "calibration_crc32": f"{crc:08x}",
    }


def _calibration(info: wire.Info) -> str:
    return f"calibration {info.calibration_sequence}" if info.calibration_sequence else "never calibrated"


def _info_of(device: Device) -> wire.Info:
    assert device.info is not None  # a device that was opened has answered
    return device.info
