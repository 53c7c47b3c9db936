"""`ribbonhost devices`: which ribbons are on the ports of this machine."""

import json
from collections.abc import Sequence

from rich.text import Text

from ribbonhost import wire
from ribbonhost.cli.printing import count_names, name_of, plain_table, print_table
from ribbonhost.device.discovery import PORTS_VARIABLE, FoundPort, PortState, candidate_urls, probe_ports


def run_devices(urls: Sequence[str], baud: int, as_json: bool) -> None:
    """Asks all serial ports, and those given, who they are, and prints it."""
    ports = probe_ports([*urls, *candidate_urls()], baud=baud)
    ribbons = [port for port in ports if port.info]
    others = [port for port in ports if not port.info]
    if as_json:
        print(
            json.dumps(
                {
                    "ribbons": [ribbon_facts(port) for port in ribbons],
                    "others": [{"port": p.url, "state": p.state.value, "what": p.what} for p in others],
                }
            )
        )
        return
    if ribbons:
        table = plain_table("serial", "port", "board", "firmware", "wire", "slots", "parts", "rate")
        for port in ribbons:
            table.add_row(*_row(ribbon_facts(port)))
        print_table(table)
    else:
        print(
            f"No ribbon was found on {len(ports)} ports: plug one in, or name its port "
            f"(`ribbonhost devices socket://HOST:PORT`, or {PORTS_VARIABLE})."
        )
    if others:
        table = plain_table("port", "", "")
        table.show_header = False
        for port in others:
            style = "" if port.state is PortState.OTHER else "yellow"
            table.add_row(Text(port.url), Text(port.state.value, style), Text(port.what))
        print_table(table)


def ribbon_facts(port: FoundPort) -> dict[str, object]:
    """What a ribbon says of itself, in plain words; keys of `devices --json`."""
    info = port.info
    assert info is not None  # only ports with a ribbon come here
    parts = [name_of(wire.Part, int(part)) for part in info.slots.part]
    return {
        "serial": port.serial,
        "port": port.url,
        "board": name_of(wire.Board, info.board),
        "firmware": ".".join(map(str, info.firmware_version)),
        "wire_version": info.wire_version,
        "slots": len(parts),
        "slots_found": len(parts) - parts.count("none"),
        "parts": count_names([part for part in parts if part != "none"]),
        "nodes": info.node_count,
        "rate_hz": info.rate_hz,
        "rate_max_hz": info.rate_max_hz,
        "mode": str(info.mode.name or "quiet").lower(),
        "calibrated": info.calibration_sequence > 0,
    }


def _row(facts: dict[str, object]) -> list[str]:
    parts = facts["parts"]
    assert isinstance(parts, dict)
    return [
        str(facts["serial"]),
        str(facts["port"]),
        str(facts["board"]),
        str(facts["firmware"]),
        str(facts["wire_version"]),
        f"{facts['slots_found']} of {facts['slots']}",
        ", ".join(f"{count} {part}" for part, count in parts.items()) or "none",
        f"{facts['rate_hz']} of {facts['rate_max_hz']} Hz",
    ]
