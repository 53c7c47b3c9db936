"""What is where in a recording: the names of its channels, and what its header says.

A recording is an MCAP file (mcap.dev) of uncompressed chunks. Its log times are host times (time.monotonic)
in nanoseconds; in a finalised one an offset, which its header names, makes them times since 1970. The
messages stand in the order in which the host used them; that order, not the log time, is the order of a
replay. Channels of ribbon i, counted in the order in which the ports were opened:

    /ribbon/i/received   intact packets, type byte and fields; log time: when the last byte was read
    /ribbon/i/sent       packets that the host sent: commands and clock pings
    /ribbon/i/spoiled    JSON: frames so far that were no packets: crc_errors, malformed
    /ribbon/i/lost       JSON: why the link is gone
    /ribbon/i/back       JSON: port; there is a new link, and the ribbon's clock and sequence start anew
    /events              JSON: ribbon (its label, or "recording"), what

Messages of a channel are numbered from 1, also those that were given up because the disk was too slow: so a
gap in the numbers is a gap in the recording. Number 0 marks what was copied from the part before.
"""

import json
from dataclasses import asdict, dataclass

from ribbonhost.errors import RecordingError

PROFILE = "ribbonhost"
VERSION = 1
HEADER = "ribbonhost"
"""Name of the metadata record of the header; later records of the name replace earlier ones: one is
written when a ribbon that was absent joins."""

EVENTS = "/events"
KINDS = ("received", "sent", "spoiled", "lost", "back")
COUNTING = "the stream counts from here"
"""The event at which all ribbons deliver: time 0 of a recording."""

NS = 1_000_000_000
RIBBONS_MAX = 64


def topic(ribbon: int, kind: str) -> str:
    """The channel of one of the KINDS."""
    return f"/ribbon/{ribbon}/{kind}"


def nanoseconds(t_s: float) -> int:
    """The whole number of nanoseconds that time.monotonic() made `t_s` of.

    Dividing it by 1e9 gives `t_s` again, exactly, for host times below 100 days.
    """
    t_ns = round(t_s * 1e9)
    return next((n for n in (t_ns, t_ns - 1, t_ns + 1) if n / 1e9 == t_s), t_ns)


@dataclass(frozen=True)
class RecordedRibbon:
    """One ribbon of a recording.

    Attributes:
        label: what it was called.
        serial: its serial number; node_count, pitch_m: as its INFO said.
        channel: number in the names of its channels; None if it was neither there nor awaited.
        port: what was opened.
        firmware: its version.
        calibration: number and CRC-32 of the calibration that it used; number 0: none.
        calibration_record: its calibration record; empty if it was not read.
    """

    label: str
    serial: str
    channel: int | None
    port: str = ""
    node_count: int = 0
    pitch_m: float = 0.0
    firmware: str = ""
    calibration: tuple[int, int] = (0, 0)
    calibration_record: bytes = b""

    @property
    def is_absent(self) -> bool:
        """Whether it was awaited and had not said who it is when the header was written."""
        return self.channel is not None and not self.firmware

    def to_json(self) -> dict[str, object]:
        """All of it, as in the header."""
        return asdict(self) | {"calibration_record": self.calibration_record.hex()}


@dataclass(frozen=True)
class Header:
    """What a recording says of itself.

    Attributes:
        ribbons: in the order of the reconstruction, the reference first if there is a comb.
        comb: text of the comb file; empty: curves only.
        rate_hz, method, motion: of the stream.
        wall_offset_ns: add it to a host time in nanoseconds for the time since 1970, UTC.
        host_version, wire_version, schema_hash: of the host that recorded.
        part: 1, or the number of the file after rotations.
        t_zero_ns: host time of time 0 if that lies in an earlier part.
        log_offset_ns: added to host times in log times: 0, or in a finalised recording wall_offset_ns.
    """

    ribbons: tuple[RecordedRibbon, ...]
    comb: str
    rate_hz: int
    method: str
    wall_offset_ns: int
    host_version: str
    wire_version: int
    schema_hash: int
    motion: str = "off"
    part: int = 1
    t_zero_ns: int | None = None
    log_offset_ns: int = 0

    def to_metadata(self) -> dict[str, str]:
        """The map of the metadata record HEADER."""
        return {
            "version": str(VERSION),
            "part": str(self.part),
            "rate_hz": str(self.rate_hz),
            "method": self.method,
            "motion": self.motion,
            "wall_offset_ns": str(self.wall_offset_ns),
            "host_version": self.host_version,
            "wire_version": str(self.wire_version),
            "schema_hash": f"{self.schema_hash:08x}",
            "t_zero_ns": "" if self.t_zero_ns is None else str(self.t_zero_ns),
            "log_offset_ns": str(self.log_offset_ns),
            "comb": self.comb,
            "ribbons": json.dumps([ribbon.to_json() for ribbon in self.ribbons]),
        }

    @classmethod
    def from_metadata(cls, values: dict[str, str]) -> "Header":
        """The header of a metadata record. Raises RecordingError if it is none that this host can read."""
        version = values.get("version", "")
        if version != str(VERSION):
            raise RecordingError(
                f"is a recording of version {version!a}, and this ribbonhost reads {VERSION}: "
                "install another ribbonhost"
            )
        try:
            entries = json.loads(values["ribbons"])
            ribbons = tuple(
                RecordedRibbon(
                    label=str(entry["label"]),
                    serial=str(entry["serial"]),
                    channel=None if entry["channel"] is None else int(entry["channel"]),
                    port=str(entry["port"]),
                    node_count=int(entry["node_count"]),
                    pitch_m=float(entry["pitch_m"]),
                    firmware=str(entry["firmware"]),
                    calibration=(int(entry["calibration"][0]), int(entry["calibration"][1])),
                    calibration_record=bytes.fromhex(entry.get("calibration_record", "")),
                )
                for entry in entries
            )
            header = cls(
                ribbons=ribbons,
                comb=values["comb"],
                rate_hz=int(values["rate_hz"]),
                method=values["method"],
                motion=values.get("motion", "off"),  # before there was a choice
                wall_offset_ns=int(values["wall_offset_ns"]),
                host_version=values["host_version"],
                wire_version=int(values["wire_version"]),
                schema_hash=int(values["schema_hash"], 16),
                part=int(values["part"]),
                t_zero_ns=int(values["t_zero_ns"]) if values["t_zero_ns"] else None,
                log_offset_ns=int(values.get("log_offset_ns", "0")),
            )
        except (KeyError, IndexError, TypeError, ValueError, OverflowError, RecursionError) as error:
            raise RecordingError("has a damaged header: it cannot be read") from error
        header._check()
        return header

    def _check(self) -> None:
        there = [ribbon for ribbon in self.ribbons if ribbon.channel is not None]
        channels = [ribbon.channel for ribbon in there]
        if (
            not there
            or len(self.ribbons) > RIBBONS_MAX
            or not 1 <= self.rate_hz <= 10_000
            or len(set(channels)) < len(channels)
            or any(not 2 <= r.node_count <= 255 or not 0.001 <= r.pitch_m <= 1.0 for r in there)
        ):
            raise RecordingError("has a header that describes no ribbons")


def topics_of(header: Header) -> set[str]:
    """All channels of a recording with this header."""
    there = [ribbon.channel for ribbon in header.ribbons if ribbon.channel is not None]
    return {EVENTS, *(topic(channel, kind) for channel in there for kind in KINDS)}
