"""The motion estimator follows ribbons through emulated sensors, firmware and packets."""

import dataclasses
import json

import numpy as np
import pytest
import typer
from ribbonhil.ribbon import Device, EmulatedRibbon
from ribbonhil.truth import RibbonTruth
from ribbonhost import wire
from ribbonhost.bench.motion import motion
from ribbonhost.bench.motion_cases import Goal
from ribbonhost.bench.motion_chain import record, run_ribbon
from ribbonhost.bench.motion_results import Result, error_percent, evaluate
from ribbonhost.bench.motion_truth import Case
from ribbonhost.motion import LiveMotion, MotionParams, Samples, Status, recording, smooth_recording
from ribbonhost.motion.live import update_each
from ribbonhost.motion.scans import Timing
from ribbonhost.motion.sharing import Helpers

SECONDS = 3.0


def result_of(scene: str, period_s: float, seconds: float = SECONDS, **settings: object) -> Result:
    case = Case("test", scene, period_s, seconds, **settings)  # type: ignore[arg-type]
    return evaluate(Goal(case))


@pytest.fixture(scope="module")
def wing() -> tuple[Samples, MotionParams, object]:
    """The wing at 2 s a period, in motion from the first sample."""
    recording = record(Case("test", "wing", 2.0, SECONDS))
    return recording.samples, recording.params, recording.truth


@pytest.mark.parametrize("starts", ["rest", "motion"])
@pytest.mark.parametrize(("scene", "period_s"), [("wing", 2.0), ("breath", 1.0)])
def test_motion_is_followed_within_a_twentieth_of_a_percent(scene: str, period_s: float, starts: str) -> None:
    result = result_of(scene, period_s, starts=starts)
    assert result.mean("live") <= 0.05
    assert result.mean("two_sided") <= 0.02
    assert result.mean("level") > 10 * result.mean("live")
    assert result.restarts == 0


@pytest.mark.parametrize(("scene", "period_s"), [("wing", 1.0), ("breath", 0.5)])
def test_motion_at_nine_tenths_of_g_is_followed_from_its_midst(scene: str, period_s: float) -> None:
    result = result_of(scene, period_s)
    assert result.mean("live") <= 0.3
    assert result.mean("two_sided") <= 0.1
    # From the level reading, wrong by several percent, to a tenth within half a second.
    assert result.live[(result.t_s > 0.5) & (result.t_s < 0.7)].mean() <= 0.2


def test_dead_and_magnetised_nodes_are_done_without() -> None:
    result = result_of("breath", 2.0, trouble=("dead nodes", "magnetised nodes"))
    assert result.mean("live") <= 0.15
    assert result.mean("level") > 0.5


def test_calibrated_two_axis_parts_that_are_tilted_are_followed() -> None:
    result = result_of("wing", 2.0, seconds=4.0, seed=2, is_calibrated=True)
    assert result.mean("live") <= 0.12
    assert result.mean("level") > 5 * result.mean("live")


def test_a_surface_that_curls_is_followed_better_than_read_as_a_level() -> None:
    result = result_of("sea", 20.0, seconds=6.0, starts="rest")
    assert result.mean("live") <= 0.06
    assert result.mean("level") > 1.3 * result.mean("live")


def test_nothing_is_made_of_rest() -> None:
    result = result_of("wing", 2.0, seconds=6.0, starts="never")
    assert result.mean("live") <= 0.012


def test_taps_do_no_harm() -> None:
    result = result_of("wing", 2.0, trouble=("taps",))
    assert result.largest("live") <= 0.2


def test_a_hole_in_the_stream_is_bridged(wing: tuple[Samples, MotionParams, object]) -> None:
    samples, params, truth = wing
    kept = (samples.t_s < 1.5) | (samples.t_s > 1.8)
    holed = Samples(**{f.name: getattr(samples, f.name)[kept] for f in dataclasses.fields(samples)})
    motion = LiveMotion(params).update(holed)
    assert motion is not None
    error = error_percent(motion.position_m, truth, holed.t_s)  # type: ignore[arg-type]
    assert error[holed.t_s > 2.3].mean() <= 0.1
    assert (motion.status[holed.t_s > 1.8] == Status.TRACKING).all()


def test_batches_do_not_matter(wing: tuple[Samples, MotionParams, object]) -> None:
    samples, params, _ = wing
    at_once = LiveMotion(params).update(samples[:150])
    one = LiveMotion(params)
    pieces = [one.update(samples[i : i + 7]) for i in range(0, 150, 7)]
    assert at_once is not None
    joined = np.concatenate([piece.q_world_node for piece in pieces if piece is not None])
    np.testing.assert_allclose(joined[:150], at_once.q_world_node[: len(joined)], atol=1e-12)


def test_ribbons_estimated_together_are_as_alone(wing: tuple[Samples, MotionParams, object]) -> None:
    samples, params, _ = wing
    parts = [samples[:60], samples[100:160]]
    alone = [LiveMotion(params).update(part) for part in parts]
    ribbons = [LiveMotion(params) for _ in parts]
    names = [f.name for f in dataclasses.fields(Samples)]
    helpers = Helpers(1)
    for k in range(60):
        both = Samples(
            **{name: np.concatenate([getattr(p, name)[k : k + 1] for p in parts]) for name in names}
        )
        together = update_each(ribbons, both, np.zeros(2), helpers)
        for row, one in enumerate(alone):
            assert one is not None
            assert together.status[row] == one.status[k]
            np.testing.assert_allclose(together.q_world_node[row], one.q_world_node[k], atol=1e-9)
            np.testing.assert_allclose(together.sigma_rad[row], one.sigma_rad[k], rtol=1e-6)
    with pytest.raises(ValueError, match="increasing times"):
        update_each(ribbons, both, np.zeros(2), helpers)


def test_motion_is_carried_on_from_the_readings(wing: tuple[Samples, MotionParams, object]) -> None:
    samples, params, truth = wing
    ahead_s, error = np.array([0.017]), []
    ribbon, helpers = LiveMotion(params), Helpers(0)
    for k in range(len(samples)):
        motion = update_each([ribbon], samples[k : k + 1], ahead_s, helpers)
        assert motion.t_s[0] == samples.t_s[k] + 0.017
        error.append(error_percent(motion.position_m, truth, motion.t_s)[0])
    assert np.mean(error[100:]) <= 0.04
    moved = error_percent(motion.position_m, truth, motion.t_s - 0.017)
    assert moved > 0.5


def test_a_lag_makes_estimates_later_and_better(wing: tuple[Samples, MotionParams, object]) -> None:
    samples, params, truth = wing
    prompt = LiveMotion(params).update(samples)
    late = LiveMotion(params, lag_samples=10).update(samples)
    assert prompt is not None
    assert late is not None
    assert len(late.t_s) == len(samples) - 10
    np.testing.assert_array_equal(late.t_s, samples.t_s[:-10])
    counted = late.t_s > 1.0
    errors = [
        error_percent(motion.position_m, truth, motion.t_s)[: len(counted)][counted].mean()  # type: ignore[arg-type]
        for motion in (prompt, late)
    ]
    assert errors[1] < errors[0]


def test_windows_of_a_recording_join_without_a_step(
    wing: tuple[Samples, MotionParams, object], monkeypatch: pytest.MonkeyPatch
) -> None:
    samples, params, _ = wing
    monkeypatch.setattr(recording, "LEARNING", 100)
    whole = smooth_recording(samples, params)
    monkeypatch.setattr(recording, "WINDOW", 50)
    monkeypatch.setattr(recording, "OVERLAP", 100)
    windows = smooth_recording(samples, params)
    np.testing.assert_array_equal(windows.t_s, whole.t_s)
    # Two hundredths of a percent of the length.
    np.testing.assert_allclose(windows.position_m[50:], whole.position_m[50:], atol=1.6e-4)


def test_velocity_and_acceleration_are_the_derivatives_of_position(
    wing: tuple[Samples, MotionParams, object],
) -> None:
    samples, params, _ = wing
    motion = smooth_recording(samples, params)
    middle = slice(100, 200)
    velocity = np.gradient(motion.position_m, motion.t_s, axis=0)
    acceleration = np.gradient(motion.velocity_mps, motion.t_s, axis=0)
    speed = np.abs(motion.velocity_mps[middle]).max()
    np.testing.assert_allclose(motion.velocity_mps[middle], velocity[middle], atol=0.02 * speed)
    force = np.abs(motion.acceleration_mps2[middle]).max()
    np.testing.assert_allclose(motion.acceleration_mps2[middle], acceleration[middle], atol=0.2 * force)


def test_nothing_finite_is_made_of_nothing(wing: tuple[Samples, MotionParams, object]) -> None:
    samples, params, _ = wing
    blind = dataclasses.replace(samples[:20], level_valid=np.zeros((20, 16), bool))
    motion = LiveMotion(params).update(blind)
    assert motion is not None
    assert (motion.status == Status.WAITING).all()
    assert np.isnan(motion.position_m).all()


def test_values_that_are_not_finite_count_as_not_valid(wing: tuple[Samples, MotionParams, object]) -> None:
    samples, params, truth = wing
    force = samples.force_mps2.copy()
    force[100:, 4] = np.nan
    force[150:160] = np.inf
    motion = LiveMotion(params).update(dataclasses.replace(samples, force_mps2=force))
    assert motion is not None
    assert np.isfinite(motion.position_m).all()
    assert error_percent(motion.position_m, truth, motion.t_s)[200:].mean() <= 0.1  # type: ignore[arg-type]


def test_parameters_and_times_that_cannot_be_are_refused(wing: tuple[Samples, MotionParams, object]) -> None:
    samples, params, _ = wing
    with pytest.raises(ValueError, match="6 to 32 nodes, not 3"):
        LiveMotion(MotionParams(node_count=3))
    with pytest.raises(ValueError, match="finite and positive"):
        LiveMotion(MotionParams(pitch_m=float("nan")))
    with pytest.raises(ValueError, match="increasing times"):
        LiveMotion(params).update(dataclasses.replace(samples, t_s=np.zeros_like(samples.t_s)))
    with pytest.raises(ValueError, match="force_mps2 has shape"):
        LiveMotion(MotionParams(node_count=8)).update(samples)


@pytest.mark.parametrize("rate_hz", [20, 100, 200])
def test_readings_are_as_old_as_raw_says(rate_hz: int) -> None:
    """A force and a field that rise steadily tell the true age of every reading."""
    step_s, per_s, seconds = 0.001, 0.5, 2.0
    rising = 1.0 + per_s * np.arange(0.0, seconds, step_s)
    ribbon = EmulatedRibbon.from_truth(
        RibbonTruth(
            np.multiply.outer(rising, np.tile([6.0, 0.0, 0.0], (32, 1))),
            np.multiply.outer(rising, np.tile([20.0, 0.0, 0.0], (32, 1))),
            step_s,
            periodic=False,
        ),
        Device(seed=3, noise=0.0),
    )
    packets = run_ribbon(ribbon, seconds, rate_hz)
    lsb = next(p for p in packets if isinstance(p, wire.Info)).slots.lsb
    raws = [p for p in packets if isinstance(p, wire.Raw)][rate_hz // 2 :]
    assert len(raws) > rate_hz / 2
    t_s = np.array([raw.t_us for raw in raws]) * 1e-6
    timing = Timing.of(raws[-1])
    for kind, at_zero, count, age_s in (
        ("accels", 6.0, lsb[0], timing.force_age_s),
        ("mags", 20.0, lsb[1], timing.field_age_s),
    ):
        counts = np.array([getattr(raw, kind).counts[:, 0] for raw in raws], np.float64)
        ages_s = t_s[:, None] - (counts * count / at_zero - 1.0) / per_s
        # A part's own clock runs in no fixed relation to the scans: over a second the mean is known so well.
        assert ages_s.mean() == pytest.approx(age_s, abs=0.0006), kind


def test_bench_prints_one_json_object(capsys: pytest.CaptureFixture[str]) -> None:
    motion(json_output=True, only="breath at rest")
    printed = json.loads(capsys.readouterr().out)
    assert [case["case"]["name"] for case in printed["cases"]] == ["breath at rest"]
    mean = printed["cases"][0]["mean_percent"]
    assert mean["two_sided"] <= mean["level"]
    assert mean["live"] <= 0.02
    assert printed["speed"]["times_reference"] > 1


def test_bench_says_when_no_case_has_that_name() -> None:
    with pytest.raises(typer.Exit) as exit_:
        motion(only="no such case")
    assert exit_.value.exit_code == 2
