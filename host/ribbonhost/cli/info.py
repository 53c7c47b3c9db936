"""`ribbonhost info`: who a ribbon is and how it is."""

import json
import math
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

from ribbonhost import wire
from ribbonhost.cli.naming import open_named
from ribbonhost.cli.printing import count_names, name_of
from ribbonhost.device import Device
from ribbonhost.errors import DeviceError

STATUS_S = 1.0


def run_info(name: str, baud: int, comb: Path | None, as_json: bool) -> None:
    """Prints what the ribbon says of itself. Raises UsageError, LinkError and DeviceError."""
    device = open_named(name, baud=baud, comb=comb)
    try:
        status = status_of(device)
        facts = _facts(device, status)
    finally:
        device.close()
    if as_json:
        print(json.dumps({"info": facts}))
        return
    table = Table(show_header=False, box=None)
    for name, value in facts.items():
        table.add_row(name.replace("_", " "), _text(value))
    Console().print(table)


def status_of(device: Device) -> wire.Status:
    """How the device is at this moment. Raises LinkError and DeviceError."""
    before = device.status
    device.command(wire.CommandCode.GET_STATUS)
    deadline_s = time.monotonic() + STATUS_S
    while (status := device.status) is before or status is None:
        if time.monotonic() > deadline_s:
            raise DeviceError(
                f"{device.name} acknowledged get_status but sent no STATUS within {STATUS_S:g} s"
            )
        time.sleep(0.01)
    return status


def _facts(device: Device, status: wire.Status) -> dict[str, object]:
    """What INFO and STATUS say, in plain words; keys of `info --json`."""
    info = device.info
    assert info is not None  # a device that was opened has answered
    parts = [name_of(wire.Part, int(part)) for part in info.slots.part]
    return {
        "serial": device.serial,
        "board": name_of(wire.Board, info.board),
        "firmware": ".".join(str(number) for number in info.firmware_version),
        "wire_version": info.wire_version,
        "schema": f"{info.schema_hash:08x}"
        + ("" if device.same_schema else " (compatible, not this host's)"),
        "slots": len(parts),
        "parts": count_names(parts),
        "nodes": info.node_count,
        "pitch_m": round(info.pitch_m, 6),
        "rate_hz": info.rate_hz,
        "rate_max_hz": info.rate_max_hz,
        "mode": str(info.mode.name or "quiet").lower(),
        "calibration": f"number {info.calibration_sequence}" if info.calibration_sequence else "none",
        "uptime_s": status.uptime_s,
        "reset_cause": name_of(wire.ResetCause, status.reset_cause),
        "clock_source": name_of(wire.ClockSource, status.clock_source),
        "temperature_c": None if math.isnan(status.temperature_c) else round(status.temperature_c, 2),
        "scan_us": status.scan_us,
        "overruns": status.overruns,
        "frames_dropped": status.frames_dropped,
        "slots_not_ok": {
            str(slot): name_of(wire.SlotReason, int(reason))
            for slot, reason in enumerate(status.slots.reason)
            if reason != wire.SlotReason.OK
        },
    }


def _text(value: object) -> str:
    if isinstance(value, dict):
        return ", ".join(f"{key}: {item}" for key, item in value.items()) or "none"
    return "unknown" if value is None else str(value)
