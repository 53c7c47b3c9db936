"""What the shell offers for an argument. No port is opened for this: to open one restarts some boards."""

from importlib.util import find_spec

import typer

SCENES = ("wing", "sea", "breath")
TARGETS = ("ndjson", "ws://127.0.0.1:8765", "tcp://127.0.0.1:8766", "osc://127.0.0.1:9000", "lsl")


def ribbons(ctx: typer.Context, incomplete: str) -> list[tuple[str, str]]:
    """Ports, and where a comb file was typed before, the names and serial numbers in it."""
    offered = _of_comb(ctx) + _ports()
    return [(value, what) for value, what in offered if value.startswith(incomplete)]


def scenes(incomplete: str) -> list[str]:
    """Surfaces of the emulator."""
    return [scene for scene in SCENES if scene.startswith(incomplete) and find_spec("ribbonhil")]


def targets(incomplete: str) -> list[str]:
    """Of `--out`, each with a usual port."""
    return [target for target in TARGETS if target.startswith(incomplete)]


def _ports() -> list[tuple[str, str]]:
    from serial.tools import list_ports

    from ribbonhost.device.discovery import extra_urls

    listed = [(str(port.device), str(port.description or "")) for port in list_ports.comports()]
    return sorted(listed) + [(url, "named by RIBBONHOST_PORTS") for url in extra_urls()]


def _of_comb(ctx: typer.Context) -> list[tuple[str, str]]:
    from ribbonhost.comb import load_comb
    from ribbonhost.errors import RibbonError

    path = ctx.params.get("comb")
    if not path:
        return []
    try:
        comb = load_comb(path)
    except RibbonError:
        return []  # the command will say what is wrong with it
    named = [(ribbon.name, ribbon.serial) for ribbon in comb.ribbons if ribbon.name]
    return [("reference", comb.reference), *named, *((s, comb.label(s)) for s in comb.serials)]
