"""`ribbonhost devices`: which ribbons are on the ports of this machine."""

import json
from collections.abc import Sequence
from pathlib import Path

from rich.text import Text

from ribbonhost import wire
from ribbonhost.cli.naming import probe
from ribbonhost.cli.printing import count_names, name_of, plain_table, print_table
from ribbonhost.comb import Comb, load_comb
from ribbonhost.device.discovery import PORTS_VARIABLE, FoundPort, PortState


def run_devices(names: Sequence[str], comb_path: Path | None, baud: int, as_json: bool) -> None:
    """Asks all serial ports, and those given, who they are, and prints it.

    With a comb file also what each ribbon is called there, and who of it is missing. Raises UsageError,
    LinkError if a ribbon that was named is not there.
    """
    comb = load_comb(comb_path) if comb_path else None
    ports = probe(names, baud=baud, comb=comb)
    ribbons = [ribbon_facts(port, comb) for port in ports if port.info]
    others = [port for port in ports if not port.info]
    there = {facts["serial"] for facts in ribbons}
    missing = {s: comb.label(s) for s in comb.serials if s not in there} if comb and not names else {}
    if as_json:
        facts: dict[str, object] = {
            "ribbons": ribbons,
            "others": [{"port": p.url, "state": p.state.value, "what": p.what} for p in others],
        }
        if comb:
            facts["missing"] = [{"serial": serial, "name": name} for serial, name in missing.items()]
        print(json.dumps(facts))
        return
    if ribbons:
        headings = ["serial", "port", "board", "firmware", "wire", "slots", "parts", "rate"]
        table = plain_table(*(["name"] if comb else []), *headings)
        for one in ribbons:
            table.add_row(*([str(one["name"] or "not in it")] if comb else []), *_row(one))
        print_table(table)
    else:
        print(
            f"No ribbon was found on {len(ports)} ports: plug one in, or name its port "
            f"(`ribbonhost devices socket://HOST:PORT`, or {PORTS_VARIABLE})."
        )
    for serial, name in missing.items():
        print(f"{name} ({serial}) of {comb_path} is not here.")
    if others:
        table = plain_table("port", "", "")
        table.show_header = False
        for port in others:
            style = "" if port.state is PortState.OTHER else "yellow"
            table.add_row(Text(port.url), Text(port.state.value, style), Text(port.what))
        print_table(table)


def ribbon_facts(port: FoundPort, comb: Comb | None = None) -> dict[str, object]:
    """What a ribbon says of itself, in plain words; keys of `devices --json`."""
    info = port.info
    assert info is not None  # only ports with a ribbon come here
    parts = [name_of(wire.Part, int(part)) for part in info.slots.part]
    named = {"name": comb.label(port.serial) if port.serial in comb.serials else None} if comb else {}
    return named | {
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
