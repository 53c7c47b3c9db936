"""Errors of parts: drawn from the ranges, read by the emulated sensors as their definition says."""

import json
from dataclasses import replace

import numpy as np
import pytest
from numpy.typing import NDArray
from ribbonhil.comb_spec import parse_url
from ribbonhil.emulated_device import PARTS, Device, drawn_device
from ribbonhil.emulator import EmulatedComb
from ribbonhil.part_errors import PartErrors, drawn_errors, no_errors
from ribbonhil.part_errors_command import show_part_errors
from ribbonhil.part_ranges import ASSEMBLY, CUT_OFF_SIGMAS, MG_MPS2, RANGES
from ribbonhil.ribbon import EmulatedRibbon
from ribbonhil.rotations import rotation_matrices, rotation_vectors
from ribbonhil.scenes import load_scene
from ribbonhil.truth import Field, RibbonTruth, comb_truth
from ribbonhil.world import world_truth
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.wire import Command, CommandCode, Info, Mode, Raw, decode, encode

Array = NDArray[np.float64]
FORCE_MPS2 = np.array([3.0, -5.0, 7.5])
FIELD_UT = np.array([12.0, 30.0, -28.0])


def readings(errors: PartErrors | None, **device: float) -> Array:
    """(32, 3) what the slots read, in SI units, of FORCE_MPS2 and FIELD_UT on a ribbon of little noise."""
    felt = [np.broadcast_to(v, (2, 32, 3)) for v in (FORCE_MPS2, FIELD_UT)]
    made = replace(Device(noise=0.1, errors=errors), **device)
    ribbon = EmulatedRibbon.from_truth(RibbonTruth(*felt, step_s=1.0), made)
    ribbon.run_until(0.5)
    command = Command(tag=1, command=CommandCode.SET_MODE, argument=Mode.RAW, data=b"")
    ribbon.write(encode_frame(encode(command)))
    ribbon.run_until(2.0)
    packets = [decode(packet)[0] for packet in Deframer().feed(ribbon.read())]
    info = next(packet for packet in packets if isinstance(packet, Info))
    raw = [packet for packet in packets if isinstance(packet, Raw)][-1]
    counts = np.stack([raw.accels.counts, raw.mags.counts], axis=1).reshape(32, 3)
    return np.asarray(counts * np.asarray(info.slots.lsb)[:, None], dtype=np.float64)


def is_read(errors: PartErrors, found: Array, at: float = 0.0) -> bool:
    """Whether all slots read what their errors say, to a count or two of their parts."""
    felt = np.array([FORCE_MPS2, FIELD_UT] * 16)
    sensed = np.einsum("sij,sj->si", errors.matrix, felt) * (1 + errors.scale_per_c * at)
    off = np.abs(found - sensed - errors.total_bias - errors.bias_per_c * at)
    return bool(off[0::2].max() < 0.006 and off[1::2].max() < 0.05)


@pytest.mark.parametrize("seed", range(3))
def test_drawn_errors_keep_to_the_ranges(seed: int) -> None:
    errors = drawn_errors(seed, 1, PARTS)
    for name in ("bias", "scale", "cross_axis", "scale_per_c", "bias_per_c"):
        of_a_sigma = np.array([getattr(RANGES[part], name) for part in PARTS])
        assert np.all(np.abs(getattr(errors, name)) <= CUT_OFF_SIGMAS * of_a_sigma[:, None])
    assert np.abs(errors.hard_iron_ut[1::2]).max() > ASSEMBLY.hard_iron_ut
    assert not errors.hard_iron_ut[0::2].any()
    assert not errors.soft_iron[0::2].any()
    assert np.array_equal(errors.soft_iron, errors.soft_iron.swapaxes(-1, -2))
    spread_mg = errors.bias[0::2].std() / MG_MPS2
    assert 12 < spread_mg < 28, "16 accelerometers of 20 mg each"
    assert json.loads(json.dumps(errors.to_dict()))["slots"][3]["matrix"] == errors.matrix[3].tolist()


def test_a_seed_gives_every_ribbon_its_own_errors() -> None:
    first, again, other = (drawn_errors(5, index, PARTS) for index in (1, 1, 2))
    assert np.array_equal(first.matrix, again.matrix)
    assert np.array_equal(first.total_bias, again.total_bias)
    assert np.all(first.total_bias != other.total_bias)


def test_a_turned_part_reads_by_the_transposed_rotation() -> None:
    turn_rad = np.zeros((2, 3))
    turn_rad[0] = 0.0, 0.0, np.pi / 2
    errors = replace(no_errors(2), mounting_rad=turn_rad)
    # Its x axis points along the node's y.
    assert errors.matrix[0] @ [0.0, 1.0, 0.0] == pytest.approx([1.0, 0.0, 0.0])
    assert errors.matrix[1] == pytest.approx(np.eye(3))


def test_hard_iron_is_sensed_like_any_field() -> None:
    errors = drawn_errors(2, 0, PARTS)
    field_ut = np.array([10.0, 20.0, 30.0])
    gain = errors.matrix @ np.linalg.inv(np.eye(3) + errors.soft_iron)
    around_ut = field_ut + errors.soft_iron @ field_ut + errors.hard_iron_ut
    sensed_ut = np.einsum("sij,sj->si", gain, around_ut) + errors.bias
    assert errors.matrix @ field_ut + errors.total_bias == pytest.approx(sensed_ut)


def test_rotation_vectors_undo_matrices() -> None:
    random = np.random.default_rng(1)
    axis = random.normal(size=(1000, 3))
    axis /= np.linalg.norm(axis, axis=1)[:, None]
    near_half_a_turn_rad = np.pi - random.uniform(0, 0.3, 500)
    angle_rad = np.concatenate([random.uniform(0, np.pi, 500), near_half_a_turn_rad])
    vectors = axis * angle_rad[:, None]
    assert np.abs(rotation_vectors(rotation_matrices(vectors)) - vectors).max() < 1e-12


def test_the_firmware_reads_what_the_errors_say() -> None:
    errors = drawn_errors(4, 2, PARTS)
    assert is_read(errors, readings(errors))
    assert is_read(no_errors(32), readings(None))
    assert not is_read(errors, readings(None))


def test_readings_drift_with_temperature() -> None:
    errors = drawn_errors(4, 2, PARTS)
    assert is_read(errors, readings(errors, temperature_c=45.0), at=20.0)
    warmed = readings(errors, warming_c=20.0, warming_s=0.01)
    assert is_read(errors, warmed, at=20.0), "after 80 time constants"


def test_drawn_errors_can_be_printed(capsys: pytest.CaptureFixture[str]) -> None:
    show_part_errors(5, 2, as_json=True)
    printed = json.loads(capsys.readouterr().out)
    assert (printed["seed"], printed["ribbon"]) == (5, 2)
    assert [slot["matrix"] for slot in printed["slots"]] == drawn_errors(5, 2, PARTS).matrix.tolist()
    show_part_errors(5, 2, as_json=False)
    assert capsys.readouterr().out.count(" mg ") == 16


def test_a_comb_has_the_errors_that_its_url_asks_for() -> None:
    errors = drawn_errors(6, 1, PARTS)
    with EmulatedComb("rest", 1, part_errors=6) as comb:
        assert "part_errors=6" in comb.urls[1]
        assert parse_url(comb.urls[1]).comb.part_errors == 6
        told = comb.devices[1].errors
        assert told is not None
        assert np.array_equal(told.total_bias, errors.total_bias)


def test_sensors_sit_where_their_errors_say() -> None:
    devices = [drawn_device(0, index, part_errors=8) for index in (0, 1)]
    offset_m = devices[1].errors.offset_m if devices[1].errors else np.zeros(32)
    assert 1e-4 < np.abs(offset_m).max() < 4e-3
    truth = comb_truth(load_scene("wing"), 1, Field())
    moved = world_truth(load_scene("wing"), 1, Field(), devices=devices)
    step_m = moved.position_m[0, 1] - truth.position_m[0, 1]
    along_m = np.einsum("si,si->s", step_m, truth.r_world_node[0, 1, :, :, 0])
    assert along_m == pytest.approx(offset_m, abs=2e-6)
    assert np.linalg.norm(moved.field_ut, axis=-1) == pytest.approx(48.0, abs=0.01)
