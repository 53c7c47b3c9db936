"""The loop as a whole: rates, the link that is too slow, commands and their limits, the parts it may meet."""

from __future__ import annotations

import dataclasses

import numpy as np
import pytest
from firmware.calibration_records import record
from firmware.running_ribbon import NODES, RIBBON, RunningRibbon, wing
from ribbonhil.ribbon import EmulatedRibbon, drawn_device
from ribbonhil.truth import RibbonTruth
from ribbonhost import wire
from ribbonhost.framing import Deframer, crc32, encode_frame
from ribbonhost.wire import (
    Ack,
    AckCode,
    Axes,
    Calibration,
    Command,
    CommandCode,
    Info,
    Mode,
    Orient,
    Part,
    Raw,
    SlotCalibrationArray,
)
from scipy.spatial.transform import Rotation

LIS2DW12, MMC5983MA, HMC5983 = Part.LIS2DW12, Part.MMC5983MA, Part.HMC5983


def test_first_packet_is_an_info_that_knows_the_parts():
    """Within 0.2 s, when the sensors were looked for; scans follow with every node valid."""
    ribbon = EmulatedRibbon("wing", 1, seed=1, ribbons=3)
    ribbon.run_until(0.5)
    first, *rest = [wire.decode(p)[0] for p in Deframer().feed(ribbon.read())]
    assert isinstance(first, Info)
    assert first.slots.part.tolist() == [LIS2DW12, MMC5983MA] * NODES
    assert first.slots.axes.tolist() == [Axes.X | Axes.Y | Axes.Z, Axes.X | Axes.Y] * NODES
    assert (first.rate_hz, first.mode, first.calibration_sequence) == (100, Mode.ORIENT, 0)
    orients = [p for p in rest if isinstance(p, Orient)]
    assert all(p.nodes.valid.all() for p in orients)
    assert len(orients) >= 30
    assert [p.sequence for p in orients] == list(range(len(orients)))


@pytest.mark.parametrize("rate_hz", [1, 2, 3, 7, 30, 99, 128, 200])
def test_any_rate_is_kept_and_every_node_stays_valid(rate_hz):
    """No overrun, mean error below 0.4 deg; spacing of scans within 0.3 ms."""
    ribbon = RunningRibbon(mode=Mode.ORIENT)
    assert ribbon.accepted(CommandCode.SET_RATE, rate_hz).value == rate_hz
    ribbon.run_until(1.0 + 2 / rate_hz)
    seen = ribbon.watch(ribbon.ribbon.now_s + max(1.0, 5 / rate_hz))
    device_s = np.diff(seen.t_orient_s)
    assert device_s == pytest.approx(1 / rate_hz, abs=3e-4)
    assert np.isfinite(seen.error_deg).all()
    assert seen.error_deg.mean() < 0.4
    status = ribbon.status()
    assert (status.overruns, status.rate_hz) == (0, rate_hz)
    assert (status.slots.reason == 0).all()


@pytest.mark.parametrize(
    "parts", [(LIS2DW12, HMC5983) * NODES, (LIS2DW12, MMC5983MA, LIS2DW12, HMC5983) * (NODES // 2)]
)
@pytest.mark.parametrize("rate_hz", [50, 200])
def test_other_magnetometers_work_alone_and_mixed(parts, rate_hz):
    """HMC5983: ten times the noise of an MMC5983MA; mean error below 1 deg, no slot in error."""
    device = dataclasses.replace(drawn_device(4, RIBBON), parts=parts)
    ribbon = RunningRibbon(device, mode=Mode.ORIENT)
    ribbon.accepted(CommandCode.SET_RATE, rate_hz)
    ribbon.run_until(1.0)
    seen = ribbon.watch(2.0)
    assert np.isfinite(seen.error_deg).all()
    assert seen.error_deg.mean() < 1.0
    assert (ribbon.status().slots.reason == 0).all()


def test_link_slower_than_the_frames_loses_frames_and_no_scan():
    """57,600 baud carry some 47 of 200 ORIENT frames a second: the others are dropped and counted."""
    ribbon = RunningRibbon(dataclasses.replace(drawn_device(5, RIBBON), baud=57_600), mode=Mode.ORIENT)
    ribbon.accepted(CommandCode.SET_RATE, 200)
    before = ribbon.status()
    packets = ribbon.run_until(ribbon.ribbon.now_s + 3.0)
    sequence = np.array([p.sequence for p in packets if isinstance(p, Orient)])
    after = ribbon.status()
    assert after.overruns == before.overruns
    assert after.scans - before.scans == pytest.approx(200 * 3.1, abs=8)
    assert (np.diff(sequence) >= 1).all(), "in order"
    missing = int(np.sum(np.diff(sequence) - 1))
    assert missing > 300
    assert after.frames_dropped - before.frames_dropped == pytest.approx(missing, abs=25)


def test_commands_are_answered_on_a_link_that_is_full():
    ribbon = RunningRibbon(dataclasses.replace(drawn_device(5, RIBBON), baud=57_600))
    ribbon.accepted(CommandCode.SET_RATE, 200)
    for _ in range(20):
        ribbon.accepted(CommandCode.GET_STATUS)


def test_identity_blinks_no_longer_than_asked():
    ribbon = RunningRibbon(mode=0)
    ribbon.accepted(CommandCode.IDENTIFY, 500)
    ribbon.run_until(ribbon.ribbon.now_s + 1.0)
    assert ribbon.accepted(CommandCode.IDENTIFY, 0).code == AckCode.OK


@pytest.mark.parametrize(
    ("code", "argument", "data", "answer"),
    [
        (CommandCode.SET_RATE, 0, b"", AckCode.BAD_ARGUMENT),
        (CommandCode.SET_RATE, 201, b"", AckCode.BAD_ARGUMENT),
        (CommandCode.SET_RATE, 65_636, b"", AckCode.BAD_ARGUMENT),
        (CommandCode.SET_RATE, 1, b"", AckCode.OK),
        (CommandCode.SET_RATE, 200, b"", AckCode.OK),
        (CommandCode.SET_MODE, 3, b"", AckCode.BAD_ARGUMENT),
        (CommandCode.SET_MODE, 8, b"", AckCode.BAD_ARGUMENT),
        (CommandCode.SET_MODE, 6, b"", AckCode.OK),
        (CommandCode.IDENTIFY, 60_001, b"", AckCode.BAD_ARGUMENT),
        (CommandCode.IDENTIFY, 60_000, b"", AckCode.OK),
        (CommandCode.SET_PHASE, 2**32 - 1, b"", AckCode.OK),
        (CommandCode.CALIBRATION_READ, 2**32 - 1, b"", AckCode.OK),
        (CommandCode.CALIBRATION_WRITE, 0, b"", AckCode.BAD_ARGUMENT),
        (CommandCode.CALIBRATION_WRITE, 1556 - 191, bytes(192), AckCode.BAD_ARGUMENT),
        (CommandCode.CALIBRATION_WRITE, 1556 - 192, bytes(192), AckCode.OK),
        (CommandCode.CALIBRATION_WRITE, 2**32 - 1, bytes(2), AckCode.BAD_ARGUMENT),
        (CommandCode.CALIBRATION_COMMIT, 12345, b"", AckCode.BAD_CRC),
        (CommandCode.ENTER_DFU, 0x21554644, b"", AckCode.UNSUPPORTED),
        (0, 0, b"", AckCode.UNKNOWN_COMMAND),
        (11, 0, b"", AckCode.UNKNOWN_COMMAND),
        (255, 0, b"", AckCode.UNKNOWN_COMMAND),
    ],
)
def test_limits_of_commands_are_those_of_the_schema(code, argument, data, answer):
    ack, _ = RunningRibbon(mode=0).command(code, argument, data)
    assert (ack.code, ack.command) == (answer, code)


def test_every_command_of_the_schema_is_known():
    ribbon = RunningRibbon(mode=0)
    for code in CommandCode:
        assert ribbon.command(code)[0].code != AckCode.UNKNOWN_COMMAND


@pytest.mark.parametrize("count", [4, 5, 8])
def test_command_cut_short_is_a_bad_length(count):
    ribbon = RunningRibbon(mode=0)
    packet = wire.encode(Command(tag=99, command=CommandCode.SET_RATE, argument=50, data=b""))
    ribbon.ribbon.write(encode_frame(packet[:count]))
    acks = [p for p in ribbon.run_until(ribbon.ribbon.now_s + 0.05) if isinstance(p, Ack)]
    assert [(a.tag, a.code) for a in acks] == [(99, AckCode.BAD_LENGTH)]
    assert ribbon.status().rate_hz == 100


def test_hostile_bytes_are_counted_and_survived():
    """100 kB of noise, truncated and unknown packets: the device counts them and goes on."""
    rng = np.random.default_rng(1)
    ribbon = RunningRibbon()
    before = ribbon.status()
    for _ in range(25):
        ribbon.ribbon.write(rng.integers(0, 256, 4000, dtype=np.uint8).tobytes())
        ribbon.run_until(ribbon.ribbon.now_s + 0.05)
    for packet in (b"\x63abc", b"\x12\x01", b"\x10\x01", b"\x02" + bytes(50)):
        ribbon.ribbon.write(b"\0" + encode_frame(packet))
    after = ribbon.status()
    assert after.rx_crc_errors + after.rx_malformed > before.rx_crc_errors + before.rx_malformed + 200
    assert after.rx_unknown - before.rx_unknown >= 2
    assert after.overruns == before.overruns
    assert (after.slots.reason == 0).all()


def commit(ribbon: RunningRibbon, data: bytes) -> Ack:
    for offset in range(0, len(data), 192):
        ribbon.accepted(CommandCode.CALIBRATION_WRITE, offset, data[offset : offset + 192])
    return ribbon.accepted(CommandCode.CALIBRATION_COMMIT, crc32(data))


def read_record(ribbon: RunningRibbon) -> bytes:
    record = b""
    while data := ribbon.accepted(CommandCode.CALIBRATION_READ, len(record)).data:
        record += bytes(data)
    return record


def test_committed_calibration_is_used_at_once_and_read_back():
    ribbon = RunningRibbon()
    wanted = record(1)
    assert commit(ribbon, wanted).value == 1
    assert read_record(ribbon) == wanted
    ribbon.run_until(ribbon.ribbon.now_s + 0.5)
    seen = ribbon.watch(ribbon.ribbon.now_s + 0.5)
    assert seen.error_deg.mean() > 3, "random matrices turn the ribbon"


@pytest.mark.parametrize(("mag_axes", "axes"), [(2, Axes.X | Axes.Y), (3, Axes.X | Axes.Y | Axes.Z)])
def test_axes_and_pitch_follow_the_calibration(mag_axes, axes):
    """INFO tells them, and a level ribbon is as good with either: mean error below 0.4 deg on the wing."""
    ribbon = RunningRibbon()
    values = Calibration.unpack(read_record(ribbon))
    commit(ribbon, dataclasses.replace(values, mag_axes=mag_axes, pitch_m=0.0213, created_s=1).pack())
    _, packets = ribbon.command(CommandCode.GET_INFO)
    info = next(p for p in packets if isinstance(p, Info))
    assert info.slots.axes.tolist() == [Axes.X | Axes.Y | Axes.Z, axes] * NODES
    assert info.pitch_m == pytest.approx(0.0213)
    ribbon.run_until(ribbon.ribbon.now_s + 0.5)
    seen = ribbon.watch(ribbon.ribbon.now_s + 1.0)
    assert np.isfinite(seen.error_deg).all()
    assert seen.error_deg.mean() < 0.4


def test_two_axes_of_parts_mounted_askew_are_used_along_their_own_normals():
    """Magnetometers turned by 5 deg, each about its own axis, and a calibration that says so: the mean error
    on the wing is that of a ribbon without tilt, within 0.1 deg; nothing is implausible."""
    turns = tilts(5.0)
    ribbon = RunningRibbon(truth=with_magnetometers_turned(turns))
    values = Calibration.unpack(read_record(ribbon))
    matrix = values.slots.matrix.copy()
    matrix[1::2] = turns.reshape(-1, 9)
    slots = SlotCalibrationArray(offset=values.slots.offset, matrix=matrix)
    straight = RunningRibbon()
    commit(ribbon, dataclasses.replace(values, mag_axes=2, slots=slots).pack())
    commit(straight, dataclasses.replace(values, mag_axes=2).pack())
    seen = []
    for each in (ribbon, straight):
        each.run_until(each.ribbon.now_s + 0.5)
        seen.append(each.watch(each.ribbon.now_s + 1.0))
        assert not seen[-1].reasons.any()
    assert seen[0].error_deg.mean() < seen[1].error_deg.mean() + 0.1


def tilts(degrees: float) -> np.ndarray:
    """(N, 3, 3) rotations by that angle, each about its own level axis: part to node frame."""
    rng = np.random.default_rng(31)
    direction = rng.uniform(0, 2 * np.pi, NODES)
    axis = np.stack([np.cos(direction), np.sin(direction), np.zeros(NODES)], axis=1)
    return Rotation.from_rotvec(np.radians(degrees) * axis).as_matrix()


def with_magnetometers_turned(turns: np.ndarray) -> RibbonTruth:
    """The ribbon on the wing whose magnetometers are mounted turned; turns (N, 3, 3): part to node."""
    truth = wing().ribbon(RIBBON)
    field_ut = np.array(truth.field_ut)
    field_ut[:, 1::2] = np.einsum("nij,tni->tnj", turns, field_ut[:, 1::2])
    return dataclasses.replace(truth, field_ut=field_ut)


def test_raw_is_what_the_parts_read():
    """Counts times lsb: gravity within 2 %, the field within 3 %, with the bridge's offset cancelled."""
    ribbon = RunningRibbon()
    _, packets = ribbon.command(CommandCode.GET_INFO)
    info = next(p for p in packets if isinstance(p, Info))
    ribbon.run_until(1.0)
    raws = [p for p in ribbon.run_until(1.2) if isinstance(p, Raw)]
    assert len(raws) >= 19
    for raw in raws:
        force = np.linalg.norm(raw.accels.counts * info.slots.lsb[0::2, None], axis=1)
        field = np.linalg.norm(raw.mags.counts * info.slots.lsb[1::2, None], axis=1)
        assert force == pytest.approx(9.80665, rel=0.02)
        assert field == pytest.approx(48.0, rel=0.03)
