"""What a device says of itself, and whether that can be; and what to tell where it says nothing."""

from ribbonhost import wire
from ribbonhost.device.counters import Counters
from ribbonhost.errors import DeviceError, WireVersionError
from ribbonhost.link import BAUD, Link


def refusal_of(name: str, info: wire.Info) -> DeviceError | None:
    """Why the device that sent this INFO cannot be used; None if it can."""
    if refusal := version_refusal(name, info.wire_version, info.oldest_host_version):
        return refusal
    if fault := _fault_of(info):
        return DeviceError(f"{name} says of itself what cannot be: {fault}")
    return None


def version_refusal(name: str, wire_version: int, oldest_host_version: int) -> DeviceError | None:
    """Why a device that speaks this version cannot be used; None if, as far as that goes, it can."""
    if oldest_host_version <= wire.WIRE_VERSION:
        return None
    return WireVersionError(
        f"{name} speaks wire version {wire_version} and needs a host that speaks at least "
        f"{oldest_host_version}; this one speaks {wire.WIRE_VERSION}: install a later ribbonhost"
    )


def silence(link: Link, counters: Counters, packets: int, timeout_s: float, asked: int) -> str:
    """What was tried in vain to learn who the device is, and what did come."""
    tried = f"{link.name} was asked {asked} times in {timeout_s:g} s who it is"
    if link.bytes_read == 0:
        return f"{tried} and sent nothing: is the ribbon powered and is this its port?"
    if packets == 0:
        return (
            f"{tried} and sent {link.bytes_read} bytes but no packet "
            f"({counters.crc_errors} CRC errors, {counters.malformed} malformed): "
            f"another kind of device, or another speed (--baud, {BAUD} unless given)"
        )
    return (
        f"{tried} and sent {packets} packets but never INFO ({counters.crc_errors} CRC errors): "
        "does the link carry bytes both ways?"
    )


def _fault_of(info: wire.Info) -> str:
    """What in an INFO cannot be; empty if all can."""
    if not 0.001 <= info.pitch_m <= 1.0:
        return f"a pitch of {info.pitch_m:g} m"
    if info.node_count < 2 or 2 * info.node_count > len(info.slots):
        return f"{info.node_count} nodes on {len(info.slots)} slots"
    if not 1 <= info.rate_hz <= info.rate_max_hz:
        return f"a rate of {info.rate_hz} Hz where at most {info.rate_max_hz} are possible"
    return ""
