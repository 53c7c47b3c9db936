"""What a recording says of the ribbons of a stream."""

import time
from collections.abc import Mapping
from dataclasses import replace
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
    return Header(
        ribbons=recorded_ribbons(arrangement, channels, calibrations),
        comb=comb.to_toml() if comb else "",
        rate_hz=rate_hz,
        method=method,
        motion=motion,
        wall_offset_ns=time.time_ns() - time.monotonic_ns(),
        host_version=version("ribbonhost"),
        wire_version=wire.WIRE_VERSION,
        schema_hash=wire.SCHEMA_HASH,
    )


def recorded_ribbons(
    arrangement: Arrangement, channels: Mapping[Device, int], calibrations: Mapping[str, wire.Calibration]
) -> tuple[RecordedRibbon, ...]:
    """What the header says of the ribbons, as it is known now; see header_of."""
    ribbons = []
    for place in arrangement.places:
        device = place.device
        ribbon = RecordedRibbon(
            label=place.label,
            serial=place.serial,
            channel=channels[device] if device else None,
            node_count=place.node_count,
            pitch_m=place.pitch_m,
        )
        if device and (info := device.info):
            ribbon = replace(
                ribbon,
                port=device.name,
                firmware=".".join(str(number) for number in info.firmware_version),
                calibration=(info.calibration_sequence, info.calibration_crc32),
                calibration_record=used.pack() if (used := calibrations.get(place.serial)) else b"",
            )
        ribbons.append(ribbon)
    return tuple(ribbons)
