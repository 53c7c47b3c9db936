"""INFO: who the device is, and that it says so at the right moments."""

from __future__ import annotations

import dataclasses
import math

from ribbonhost.wire import (
    NODE_MAX,
    SCHEMA_HASH,
    SLOT_MAX,
    WIRE_VERSION,
    Ack,
    Axes,
    Board,
    CommandCode,
    Info,
    Mode,
    Part,
)

from ribbonhil.conformance.check import Group, NotObservedError, expect
from ribbonhil.conformance.checks.parts import (
    ACCELEROMETERS,
    COUNTS,
    FULL_SCALE,
    FULL_SCALE_TOLERANCE,
    MAGNETOMETERS,
)
from ribbonhil.conformance.checks.recordings import both, one_of
from ribbonhil.conformance.client import PATIENCE_S
from ribbonhil.conformance.device import Device

GROUP = Group("info")

PITCH_RANGE_M = (0.001, 1.0)


@GROUP.check("INFO")
def get_info_sends_info(device: Device) -> None:
    """get_info is answered by an ACK and then one INFO packet."""
    since = device.mark()
    device.accepted(CommandCode.GET_INFO)
    device.wait_for(lambda f: isinstance(f.packet, Info), since, PATIENCE_S)
    device.receive(0.05)
    kinds = [type(f.packet) for f in device.log[since:] if isinstance(f.packet, Ack | Info)]
    expect(kinds == [Ack, Info], "ACK, INFO", [kind.__name__.upper() for kind in kinds])


@GROUP.check("INFO")
def info_repeats(device: Device) -> None:
    """INFO says the same each time while nothing is changed."""
    first_frame, first = device.get_info()
    second_frame, second = device.get_info()
    expect(
        first_frame.content == second_frame.content,
        "two equal INFO packets",
        ", ".join(
            f"{f.name} {getattr(first, f.name)} then {getattr(second, f.name)}"
            for f in dataclasses.fields(Info)
            if str(getattr(first, f.name)) != str(getattr(second, f.name))
        ),
        first_frame,
        second_frame,
    )


@GROUP.check("Start")
def info_comes_at_start(device: Device) -> None:
    """The first packet after the device started is an INFO."""
    end_s = device.now_s() + 1.5
    _, status = device.get_status()
    first_uptime_s = status.uptime_s
    while status.uptime_s == first_uptime_s and device.now_s() < end_s:
        device.receive(0.005)
        _, status = device.get_status()
    started_s = device.now_s() - status.uptime_s
    before_s = device.link.opened_s - started_s
    if before_s > 0.0:
        raise NotObservedError(f"the device ran {before_s:.2f} s before the link was opened")
    first = device.log[0]
    expect(isinstance(first.packet, Info), "INFO first", type(first.packet).__name__, first)


@GROUP.check("INFO")
def info_comes_only_when_asked(device: Device) -> None:
    """After its start the device sends INFO only on get_info."""
    recording = both(device)
    for frame, _ in recording.of(Info):
        expect(False, "no INFO that was not asked for", "one", frame)


@GROUP.check("Compatibility")
def versions_are_consistent(device: Device) -> None:
    """wire_version is at least 1, and a host of the device's own version can work with it."""
    frame, info = device.get_info()
    expect(info.wire_version >= 1, "a wire_version of 1 or more", info.wire_version, frame)
    expect(
        1 <= info.oldest_host_version <= info.wire_version,
        f"1 <= oldest_host_version <= {info.wire_version}",
        info.oldest_host_version,
        frame,
    )


@GROUP.check("Compatibility")
def schema_hash_is_of_the_version(device: Device) -> None:
    """A device of this wire version has the hash of this schema."""
    frame, info = device.get_info()
    if info.wire_version != WIRE_VERSION:
        raise NotObservedError(
            f"the device speaks wire version {info.wire_version}, this suite {WIRE_VERSION}"
        )
    expect(
        info.schema_hash == SCHEMA_HASH, f"schema_hash {SCHEMA_HASH:08x}", f"{info.schema_hash:08x}", frame
    )


@GROUP.check("INFO")
def unique_id_is_unique(device: Device) -> None:
    """unique_id is not all 0x00 or all 0xFF, which is what erased or missing memory reads."""
    frame, info = device.get_info()
    value = bytes(info.unique_id)
    expect(len(set(value) - {0x00, 0xFF}) > 0, "an id of its own", value.hex(), frame)


@GROUP.check("INFO")
def info_rate_is_in_range(device: Device) -> None:
    """1 <= rate_hz <= rate_max_hz <= 200."""
    frame, info = device.get_info()
    expect(
        1 <= info.rate_hz <= info.rate_max_hz <= 200,
        "1 <= rate_hz <= rate_max_hz <= 200",
        f"rate_hz {info.rate_hz}, rate_max_hz {info.rate_max_hz}",
        frame,
    )


@GROUP.check("INFO")
def info_board_is_known(device: Device) -> None:
    """A device of this wire version names a board of the enumeration."""
    frame, info = device.get_info()
    if info.wire_version != WIRE_VERSION:
        raise NotObservedError(
            f"the device speaks wire version {info.wire_version}, this suite {WIRE_VERSION}"
        )
    expect(info.board in set(Board), one_of(Board), info.board, frame)


@GROUP.check("INFO")
def info_pitch_is_in_range(device: Device) -> None:
    """pitch_m is between 0.001 and 1 m."""
    frame, info = device.get_info()
    low_m, high_m = PITCH_RANGE_M
    expect(low_m <= info.pitch_m <= high_m, f"{low_m} to {high_m} m", info.pitch_m, frame)


@GROUP.check("INFO")
def info_follows_rate_and_mode(device: Device) -> None:
    """rate_hz and mode are those in use."""
    for rate_hz, mode in ((device.info.rate_max_hz, Mode.RAW), (1, Mode.ORIENT_COMPACT)):
        device.set(rate_hz, mode)
        frame, info = device.get_info()
        expect(
            (info.rate_hz, info.mode) == (rate_hz, mode),
            f"rate {rate_hz} Hz, mode {int(mode)}",
            f"rate {info.rate_hz} Hz, mode {int(info.mode)}",
            frame,
        )


@GROUP.check("INFO")
def slots_are_pairs(device: Device) -> None:
    """Two slots a node, at most slot_max: accelerometers at 0, 2, 4 ..., magnetometers at 1, 3, 5 ..."""
    frame, info = device.get_info()
    parts = info.slots.part.tolist()
    expect(0 < len(parts) <= SLOT_MAX, f"1 to {SLOT_MAX} slots", len(parts), frame)
    expect(
        info.node_count <= NODE_MAX and info.node_count == len(parts) // 2,
        f"{len(parts) // 2} nodes for {len(parts)} slots, at most {NODE_MAX}",
        info.node_count,
        frame,
    )
    for slot, part in enumerate(parts):
        wrong = MAGNETOMETERS if slot % 2 == 0 else ACCELEROMETERS
        expect(
            part not in wrong, f"no {'accelerometer' if slot % 2 else 'magnetometer'}", f"at {slot}", frame
        )


@GROUP.check("INFO")
def slot_parts_are_known(device: Device) -> None:
    """A device of this wire version names parts of the enumeration."""
    frame, info = device.get_info()
    if info.wire_version != WIRE_VERSION:
        raise NotObservedError(
            f"the device speaks wire version {info.wire_version}, this suite {WIRE_VERSION}"
        )
    for slot, part in enumerate(info.slots.part.tolist()):
        expect(part in set(Part), one_of(Part), f"part {part} in slot {slot}", frame)


@GROUP.check("INFO")
def slot_axes_are_legal(device: Device) -> None:
    """An accelerometer is used with all axes; all magnetometers with x and y, or all with three."""
    frame, info = device.get_info()
    legal = (Axes.X | Axes.Y, Axes.X | Axes.Y | Axes.Z)
    used_by_mags = set()
    for slot, (part, axes) in enumerate(zip(info.slots.part.tolist(), info.slots.axes.tolist(), strict=True)):
        if part in ACCELEROMETERS:
            expect(axes == legal[1], "x, y and z", f"axes {axes} in slot {slot}", frame)
        elif part in MAGNETOMETERS:
            expect(axes in legal, "x and y, or x, y and z", f"axes {axes} in slot {slot}", frame)
            used_by_mags.add(axes)
    expect(len(used_by_mags) <= 1, "the same axes of all magnetometers", sorted(used_by_mags), frame)


@GROUP.check("INFO")
def slot_lsb_fits_the_part(device: Device) -> None:
    """lsb times the counts of the part is a full scale it has; it is 0 where there is no part."""
    frame, info = device.get_info()
    for slot, (part, lsb) in enumerate(zip(info.slots.part.tolist(), info.slots.lsb, strict=True)):
        what = f"lsb {lsb:.6g} in slot {slot}"
        if part == Part.NONE:
            expect(lsb == 0.0, "0 where there is no part", what, frame)
        elif part in COUNTS:
            low, high = FULL_SCALE[Part(part)]
            scale = float(lsb) * COUNTS[Part(part)]
            fits = low * (1 - FULL_SCALE_TOLERANCE) <= scale <= high * (1 + FULL_SCALE_TOLERANCE)
            expect(
                math.isfinite(scale) and fits,
                f"{low / COUNTS[Part(part)]:.6g} to {high / COUNTS[Part(part)]:.6g}",
                what,
                frame,
            )
