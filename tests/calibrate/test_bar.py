"""A ribbon with the errors of real parts is calibrated from what it sends while hands turn it on a bar."""

from dataclasses import replace

import numpy as np
import pytest
from calibrate.handled import BAR, PITCH_M, calibrate, calibrated, devices, recorded, stays
from ribbonhil.ribbon import EmulatedRibbon
from ribbonhil.scenes import load_scene
from ribbonhil.stm32f405.session import Session
from ribbonhil.truth import Field, quaternions
from ribbonhil.world import world_truth
from ribbonhost import wire
from ribbonhost.bench.calibration import true_values
from ribbonhost.calibrate.coverage import coverage_of
from ribbonhost.calibrate.record import parameters_of
from ribbonhost.calibrate.refusals import Reason, RefusedError
from ribbonhost.calibrate.stillness import average
from ribbonhost.reconstruct import RibbonSolver


def test_parameters_and_orientations_are_found_as_well_as_is_said() -> None:
    result = calibrated()
    errors = devices()[0].errors
    assert errors is not None
    true = np.append(true_values(errors, 2), np.radians(62.0))
    assert np.abs((result.solution.values - true) / result.solution.sigma).max() < 4.0
    assert result.sigma_deg.max() < 0.5
    assert result.old_deg > 5.0
    assert result.new_deg < 0.05
    assert result.held_out >= 3
    for axis in "xyz":
        of_axis = np.array([name.endswith(f"mounting_{axis}") for name in result.solution.names])
        off_deg = np.degrees((result.solution.values - true)[of_axis].mean())
        assert abs(off_deg) < 0.2, "what is common to all sensors is told by the poses on the table"


def test_firmware_that_is_told_the_calibration_says_true_orientations() -> None:
    """The record through the wire, another handling of the same ribbon, and what ORIENT says of it."""
    handling = replace(BAR, seed=77)
    truth = world_truth(handling, len(devices()) - 1, Field(), devices=devices())
    session = Session(EmulatedRibbon.from_truth(truth.ribbon(0), devices()[0]))
    session.wait_for_info()
    session.write_calibration(calibrated().record)
    turned_deg = []
    for pose in (0, 2):  # its normal up, then down
        session.run_for(handling.holds_s()[pose, 1] - 0.2 - session.ribbon.now_s)
        packet = wire.decode(session.orients[-1])[0]
        assert isinstance(packet, wire.Orient)
        assert packet.nodes.valid.all()
        row = round(packet.t_us * 1e-6 / truth.period_s * len(truth.r_world_node))
        q = quaternions(truth.r_world_node[row, 0, 1::2])
        cosine = np.abs(np.sum(q * packet.nodes.q_world_node, axis=1))
        turned_deg.append(2 * np.degrees(np.arccos(np.clip(cosine, 0, 1))))
    assert np.sqrt(np.mean(np.square(turned_deg))) < 0.5


def error_percent(record: wire.Calibration | None) -> float:
    """Mean E of the ribbon's curve on wing, against where its nodes truly are."""
    truth = world_truth(load_scene("wing"), 2, Field(), devices=devices()[:3])
    session = Session(EmulatedRibbon.from_truth(truth.ribbon(0), devices()[0]))
    session.wait_for_info()
    if record:
        session.write_calibration(record)
    session.run_for(1.0)
    session.orients.clear()
    for _ in range(8):
        session.run_for(0.5)
    solver = RibbonSolver(PITCH_M, 16)
    off_m = []
    for packet in session.orients[::10]:
        orient = wire.decode(packet)[0]
        assert isinstance(orient, wire.Orient)
        node_m = solver.solve(orient.nodes.q_world_node, orient.nodes.valid)
        true_m = truth.node_from_anchor_m(np.array([orient.t_us * 1e-6]))[0, 0]
        off_m.append(np.linalg.norm(node_m - true_m, axis=1).mean())
    return float(100 * np.mean(off_m) / (31 * PITCH_M))


def test_a_curve_is_off_by_percents_before_and_by_tenths_of_a_percent_after() -> None:
    before, after = error_percent(None), error_percent(calibrated().record)
    print(f"E {before:.2f} % before calibration, {after:.3f} % after")
    assert before > 2.0
    assert after < 0.3


def test_record_gives_the_parameters_back() -> None:
    result = calibrated()
    back = parameters_of(wire.Calibration.unpack(result.record.pack()))
    found = result.solution.parameters
    assert back.accel_matrix == pytest.approx(found.accel_matrix, abs=1e-6)
    assert back.field_matrix == pytest.approx(found.field_matrix, abs=1e-6)
    assert back.field_bias_ut == pytest.approx(found.field_bias_ut, abs=1e-5)
    assert back.dip_rad == pytest.approx(found.dip_rad, abs=1e-6)
    assert result.record.mag_axes == 2


def test_a_calibration_no_better_than_the_one_in_use_is_not_written() -> None:
    with pytest.raises(RefusedError, match="that one stays") as refused:
        calibrate(recorded()[1], calibrated().record)
    assert refused.value.reason is Reason.NOT_BETTER


def test_stillness_finds_each_pose_once_and_knows_a_table_from_hands() -> None:
    readings = recorded()[1]
    assert len(stays()) == 24
    assert all(stay.still for stay in stays())
    assert [index for index, stay in enumerate(stays()) if stay.lying] == [0, 1, 10, 11]
    holds_s = BAR.holds_s()
    offset_s = np.median([readings.t_s[stay.first] for stay in stays()] - holds_s[:, 0])
    for stay, (start_s, end_s) in zip(stays()[1:], holds_s[1:], strict=True):
        middle_s = readings.t_s[(stay.first + stay.last) // 2] - offset_s
        assert start_s - 0.5 < middle_s < end_s + 0.5


def test_coverage_says_what_is_missing() -> None:
    readings = recorded()[1]
    poses = average(readings, stays(), 48.0, 2, 0.025)
    field_ut = np.array([readings.field_ut[stay.first : stay.last].mean(axis=(0, 1)) for stay in stays()])
    done = coverage_of(poses, field_ut)
    assert done.complete
    assert done.next_step == "All attitudes are done."
    steps = [coverage_of(poses.part(np.arange(count)), field_ut[:count]) for count in range(25)]
    assert "on a table" in steps[0].next_step
    assert "end for end" in steps[1].next_step
    assert steps[12].next_step.startswith("Hold the bar with its far end up")
    assert steps[17].next_step.startswith("Hold the bar with its connector end up")
    shares = [step.share for step in steps]
    assert shares == sorted(shares)
