"""What a ribbon may be called where a port is asked for: its port, serial number, or name in a comb file."""

import os
import re
from collections.abc import Sequence
from pathlib import Path

from ribbonhost.comb import Comb, load_comb
from ribbonhost.device import Device, Observer, open_device
from ribbonhost.device.discovery import FoundPort, PortState, candidate_urls, probe_ports, ribbons_with
from ribbonhost.errors import LinkError, UsageError

PATIENT_S = 0.6
"""A ribbon that is named is there: it may take longer to answer than one that is looked for."""

SERIAL = re.compile(r"[0-9a-fA-F]{2,24}")


def open_named(name: str, *, baud: int, comb: Path | None = None, observer: Observer | None = None) -> Device:
    """Opens the ribbon with this name; `observer` is told of all traffic.

    Raises UsageError, LinkError and DeviceError.
    """
    (url,) = resolve([name], baud=baud, comb=load_comb(comb) if comb else None)
    return open_device(url, baud=baud, observer=observer)


def resolve(
    names: Sequence[str], *, baud: int, comb: Comb | None = None, missing: list[str] | None = None
) -> tuple[str, ...]:
    """The ports of the ribbons with these names; what reads like a port stays as it is.

    Ports are only asked if a name needs it. Raises UsageError if a name fits several ribbons, or two names
    one; LinkError if no ribbon found fits it. With `missing`, a ribbon of the comb that is not found does not
    end it as long as others are there: it is left out, and a sentence about it added.
    """
    prefixes = {name: prefix for name in names if (prefix := _serial_prefix(name, comb))}
    if not prefixes:
        return tuple(names)
    given = [name for name in names if name not in prefixes]
    ports = probe_ports([*given, *candidate_urls()], baud=baud, timeout_s=PATIENT_S)
    found: dict[str, str] = {}
    for name in names:
        try:
            found[name] = _find(name, prefixes[name], ports) if name in prefixes else name
        except LinkError as error:
            in_comb = comb and any(serial.startswith(prefixes[name]) for serial in comb.serials)
            if missing is None or not in_comb or (name == names[-1] and not found):
                raise
            missing.append(str(error))
    urls = tuple(found.values())
    for url in urls:
        if urls.count(url) > 1:
            both = " and ".join(name for name, other in found.items() if other == url)
            raise UsageError(f"{both} are one ribbon, on {url}: name it once")
    return urls


def probe(names: Sequence[str], *, baud: int, comb: Comb | None = None) -> list[FoundPort]:
    """Asks all ports of this machine, and those given, who is there.

    Where ribbons are named, only these and the ports given are returned. Raises as `resolve`.
    """
    prefixes = {name: prefix for name in names if (prefix := _serial_prefix(name, comb))}
    given = [name for name in names if name not in prefixes]
    urls = [*given, *candidate_urls()]
    if not prefixes:
        return probe_ports(urls, baud=baud)
    ports = probe_ports(urls, baud=baud, timeout_s=PATIENT_S)
    wanted = {*given, *(_find(name, prefix, ports) for name, prefix in prefixes.items())}
    return [port for port in ports if port.url in wanted]


def _serial_prefix(name: str, comb: Comb | None) -> str:
    """What the serial number starts with; empty for a port."""
    if "/" in name or "\\" in name or os.path.exists(name):
        return ""
    if comb:
        if name == "reference":
            return comb.reference
        for ribbon in comb.ribbons:
            if ribbon.name == name:
                return ribbon.serial
    return name.lower() if SERIAL.fullmatch(name) else ""


def _find(name: str, prefix: str, ports: Sequence[FoundPort]) -> str:
    fitting = ribbons_with(prefix, ports)
    if len(fitting) > 1:
        several = " and ".join(f"{serial} on {port.url}" for serial, port in fitting.items())
        raise UsageError(f"{name} fits ribbons {several}: type more digits")
    if not fitting:
        there = ", ".join(f"{port.serial} on {port.url}" for port in ports if port.info) or "none"
        unasked = [port.url for port in ports if port.state in (PortState.BUSY, PortState.FORBIDDEN)]
        hint = f"; {', '.join(unasked)} could not be asked (`ribbonhost devices` says why)" if unasked else ""
        raise LinkError(f"no ribbon {name} was found; ribbons here: {there}{hint}")
    return next(iter(fitting.values())).url
