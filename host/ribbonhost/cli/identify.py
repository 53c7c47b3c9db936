"""`ribbonhost identify`: lets a ribbon blink, so that it can be told from others."""

import json
from pathlib import Path

from ribbonhost import wire
from ribbonhost.cli.naming import open_named
from ribbonhost.errors import UsageError


def run_identify(name: str, seconds: float, *, comb: Path | None, baud: int, as_json: bool) -> None:
    """Starts the blinking and does not wait for its end. Raises UsageError, LinkError and DeviceError."""
    limit_s = wire.IDENTIFY_MAX_MS / 1000
    if not 0 <= seconds <= limit_s:
        raise UsageError(f"--seconds {seconds:g} is not between 0 and {limit_s:g}")
    device = open_named(name, baud=baud, comb=comb)
    try:
        device.command(wire.CommandCode.IDENTIFY, round(seconds * 1000))
        serial = device.serial
    finally:
        device.close()
    if as_json:
        print(json.dumps({"identify": {"serial": serial, "port": device.name, "seconds": seconds}}))
    elif seconds:
        print(f"Ribbon {serial} on {device.name} blinks for {seconds:g} s.")
    else:
        print(f"Ribbon {serial} on {device.name} no longer blinks.")
