"""What was shown can be shown again, from a fixed amount of memory."""

from dataclasses import replace

import numpy as np
import pytest
from ribbonhost.view.history import History
from ribbonhost.view.playhead import Playhead
from ribbonhost.view.plots import NAMES, Plots
from view.combs import LAYOUT, moment


def history(capacity: int = 50, *, thins: bool = False) -> History:
    return History(LAYOUT, capacity, "spline", truth=True, thins=thins)


def test_a_kept_moment_comes_back_within_20_um() -> None:
    kept = history()
    for k in range(10):
        shown = moment(10.0 + k, radius_m=0.3 + 0.1 * k)
        shown.known[LAYOUT.slices[1].start + 3] = k != 5
        shown.valid[LAYOUT.slices[1].start + 4] = k != 5
        kept.add(replace(shown, truth_m=shown.node_m + 0.001))
    again = kept.at(15.4)
    assert again is not None
    assert again.t_s == 15.0
    assert np.flatnonzero(~again.known).tolist() == [LAYOUT.slices[1].start + 3]
    assert np.flatnonzero(~again.valid).tolist() == [LAYOUT.slices[1].start + 4]
    assert again.sigma_rad == pytest.approx(moment().sigma_rad, rel=1e-3)
    true = moment(15.0, radius_m=0.8)
    others = np.delete(np.arange(80), LAYOUT.slices[1])
    assert np.abs(again.node_m - true.node_m)[others].max() < 20e-6
    assert again.truth_m is not None
    assert again.truth_m - again.node_m == pytest.approx(0.001, rel=1e-3)


def test_a_full_history_of_a_stream_forgets_its_oldest() -> None:
    kept = history(50)
    for k in range(120):
        kept.add(moment(float(k)))
    assert kept.span_s == (70.0, 119.0)
    assert [kept.at(t).t_s for t in (0.0, 70.5, 100.0, 500.0)] == [70.0, 70.0, 100.0, 119.0]  # type: ignore[union-attr]


def test_a_full_history_of_a_recording_becomes_coarser_and_keeps_its_ends() -> None:
    kept = history(50, thins=True)
    for k in range(330):
        kept.add(moment(float(k)))
    first, last = kept.span_s
    assert first == 0.0
    assert last > 320
    gaps = np.diff([kept.at(float(t)).t_s for t in range(320)])  # type: ignore[union-attr]
    assert gaps.max() <= 8.0


def test_an_empty_history_shows_nothing() -> None:
    kept = history()
    assert kept.at(0.0) is None
    assert np.isnan(kept.span_s).all()
    playhead = Playhead(kept, live=True)
    playhead.advance(0.1)
    assert playhead.range_s == (0.0, 0.0)


def test_a_stream_is_followed_paused_scrubbed_and_followed_again() -> None:
    kept = history()
    playhead = Playhead(kept, live=True)
    for k in range(40):
        kept.add(moment(100.0 + 0.1 * k))
    playhead.advance(0.0)
    assert playhead.t_s == pytest.approx(103.9)
    assert playhead.range_s == pytest.approx((-3.9, 0.0))
    playhead.seek(-2.0)
    kept.add(moment(104.0))
    playhead.advance(5.0)
    assert playhead.t_s == pytest.approx(101.9), "paused, whatever comes"
    playhead.toggle()
    playhead.advance(0.5)
    assert playhead.t_s == pytest.approx(102.4), "plays on from there"
    playhead.follow()
    playhead.advance(0.0)
    assert playhead.t_s == 104.0
    playhead.seek(-1e9)
    playhead.advance(0.0)
    assert playhead.t_s == 100.0


def test_a_recording_plays_at_its_speed_and_begins_anew_at_its_end() -> None:
    kept = history()
    for k in range(41):
        kept.add(moment(0.1 * k))
    playhead = Playhead(kept, live=False, start_s=1.0, speed=2.0)
    playhead.advance(0.5)
    assert playhead.t_s == pytest.approx(2.0)
    assert playhead.range_s == pytest.approx((0.0, 4.0))
    playhead.advance(5.0)
    assert playhead.t_s == 0.0


def test_plots_hold_the_last_minute_of_a_stream_in_a_few_hundred_points() -> None:
    plots = Plots(LAYOUT, thins=False)
    shown = moment()
    for k in range(800):
        height_m = np.full_like(shown.node_m, 0.001 * k)
        plots.add(replace(shown, t_s=0.1 * k, node_m=height_m))
    t_s, lines = plots.lines(NAMES[0], 60.0)
    assert list(lines) == [0, 1, 2, 3, 4]
    assert 100 < len(t_s) <= 400
    assert t_s[0] >= -60
    assert np.all(np.diff(t_s) > 0)
    assert lines[1][-1] == pytest.approx(799 - 2, abs=2.1)


def test_a_plotted_line_stays_level_where_nothing_is_known() -> None:
    plots = Plots(LAYOUT, thins=False)
    for k in range(30):
        shown = moment(0.1 * k)
        shown.node_m[LAYOUT.slices[1]] = np.nan if k < 5 or 10 <= k < 20 else k
        shown.node_m[LAYOUT.slices[2]] = np.nan
        plots.add(shown)
    t_s, lines = plots.lines(NAMES[0], None)
    assert list(lines) == [0, 1, 3, 4]
    assert len(t_s) == 30
    assert lines[1][:5] == pytest.approx(5000.0)
    assert lines[1][10:20] == pytest.approx(9000.0)
    assert plots.lines(NAMES[2], None)[1] == {}
