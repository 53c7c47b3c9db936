"""What a recording says of the ribbons of a stream."""

import time
from collections.abc import Mapping
from importlib.metadata import version

from ribbonhost import wire
from ribbonhost.comb import Comb
from ribbonhost.device import Device
from ribbonhost.pipeline.arrangement import Arrangement
from ribbonhost.pipeline.poses import MotionMode
from ribbonhost.pipeline.readings import NO_CALIBRATIONS
from ribbonhost.reconstruct.comb import Method
from ribbonhost.record import Header, RecordedRibbon


def header_of(
    arrangement: Arrangement,
    channels: Mapping[Device, int],
    *,
    comb: Comb | None,
    rate_hz: int,
    method: Method,
    motion: MotionMode = "off",
    calibrations: Mapping[str, wire.Calibration] = NO_CALIBRATIONS,
) -> Header:
    """The header of a recording of these ribbons.

    channels: the number of each device in it. calibrations: the records that were read, by serial number.
    """
    ribbons = []
    for place in arrangement.places:
        info = place.device.info if place.device else None
        if place.device is None or info is None:
            ribbons.append(RecordedRibbon(place.label, place.serial, None))
            continue
        ribbons.append(
            RecordedRibbon(
                label=place.label,
                serial=place.serial,
                channel=channels[place.device],
                port=place.device.name,
                node_count=info.node_count,
                pitch_m=info.pitch_m,
                firmware=".".join(str(number) for number in info.firmware_version),
                calibration=(info.calibration_sequence, info.calibration_crc32),
                calibration_record=used.pack() if (used := calibrations.get(place.serial)) else b"",
            )
        )
    return Header(
        ribbons=tuple(ribbons),
        comb=comb.to_toml() if comb else "",
        rate_hz=rate_hz,
        method=method,
        motion=motion,
        wall_offset_ns=time.time_ns() - time.monotonic_ns(),
        host_version=version("ribbonhost"),
        wire_version=wire.WIRE_VERSION,
        schema_hash=wire.SCHEMA_HASH,
    )
