"""The live view: takes the newest moment at its own pace and shows it to any number of browsers."""

import math
import os
import sys
import threading
import time
from collections import deque
from collections.abc import Sequence
from dataclasses import replace
from html import escape

import numpy as np
import rich
from numpy.typing import NDArray

from ribbonhost.errors import UsageError
from ribbonhost.pipeline.arrangement import Arrangement
from ribbonhost.pipeline.report import Report
from ribbonhost.pipeline.solving import Solved
from ribbonhost.reconstruct.comb import Method
from ribbonhost.view.history import History
from ribbonhost.view.layout import Moment, layout_of
from ribbonhost.view.page import Page, Recording
from ribbonhost.view.playhead import Playhead
from ribbonhost.view.plots import Plots
from ribbonhost.view.scene import Scene
from ribbonhost.view.serving import open_server
from ribbonhost.view.settings import Settings
from ribbonhost.view.tables import events_list, ribbons_table, trouble_table

HOST = "127.0.0.1"
PORT = 8080
FRAMES_HZ = 60.0
REFRESH_S = 0.1
TABLES_S = 0.5
KEPT_FRAMES = 18_000
"""Of a stream: five minutes. Of a recording all, thinned out until it fits."""

EVENTS_KEPT = 8
BUSY_SHARE = 0.5
"""Of the time the view's thread works at most: on a slow machine it shows fewer moments."""


class View:
    """A page on 127.0.0.1 that shows the ribbons of an arrangement.

    A thread of its own does all drawing; `on_solved` only leaves the newest result. The server sends each
    browser the newest state of each thing: one that is slow skips, and nothing piles up for it.

    Attributes:
        url: of the page.
        moments: shown so far.
    """

    def __init__(
        self,
        arrangement: Arrangement,
        *,
        method: Method,
        live: bool = True,
        truth: bool = False,
        port: int | None = None,
        recording: Recording | None = None,
        calibrated: Sequence[str] = (),
        start_s: float = 0.0,
        speed: float = 1.0,
    ) -> None:
        """live: moments come by `on_solved` as they happen; otherwise by `keep`, all at once.

        truth: whether it is known where the nodes truly are. port: to serve on; None: 8080 or the next
        that is free. calibrated: what is known of each ribbon's calibration. start_s, speed: of the replay
        of a recording. Raises UsageError if the port cannot be had.
        """
        rich.get_console().quiet = True  # viser has no other way to be silent on stdout
        self._server = open_server(HOST, PORT if port is None else port)
        if port and self._server.get_port() != port:
            self._server.stop()
            raise UsageError(f"--view-port {port}: something else listens there; give another, or none")
        self.url = f"http://{HOST}:{self._server.get_port()}"
        self.moments = 0
        self._arrangement = arrangement
        self._layout = layout_of(arrangement)
        self._calibrated = tuple(calibrated) or ("",) * len(self._layout.labels)
        self._newest: dict[int, Solved] = {}
        self._quality = np.zeros(self._layout.node_count, np.uint8)
        self._report: Report | None = None
        self._events: deque[tuple[float, str, str]] = deque(maxlen=EVENTS_KEPT)
        self._history = History(self._layout, KEPT_FRAMES, method, truth=truth, thins=not live)
        self._playhead = Playhead(self._history, live=live, start_s=start_s, speed=speed)
        self._plots = Plots(self._layout, thins=not live)
        self._scene = Scene(self._server, self._layout)
        self._page = Page(
            self._server,
            self._layout,
            self._playhead,
            self._plots,
            recording=recording,
            truth=truth,
            centre_m=self._centre_m,
        )
        self._server.on_client_connect(lambda client: self._page.look(client, "overview"))
        self._shown_s = math.nan
        self._refresh_s = 0.0
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._run, name="view", daemon=True)
        self._thread.start()

    def on_solved(self, solved: Solved) -> None:
        """Takes a frame of a stream; returns at once."""
        self._newest[solved.places[0]] = solved

    def keep(self, solved: Solved, t_s: float) -> None:
        """Takes a frame of a recording, at its time."""
        self._newest[solved.places[0]] = solved
        moment = self._moment()
        if moment and (self._layout.comb or solved.places[0] == 0):
            moment = replace(moment, t_s=t_s)
            self._history.add(moment)
            self._plots.add(moment)

    def report(self, report: Report) -> None:
        """How the stream stands."""
        self._report = report
        self._plots.report(report)

    def event(self, label: str, what: str) -> None:
        """Something that happened to a ribbon."""
        self._events.append((time.monotonic(), label, what))

    @property
    def settings(self) -> Settings:
        """What is shown; set `changed` with anything else."""
        return self._page.settings

    def seek(self, position_s: float) -> None:
        """Pauses at a position of the slider: seconds of a recording, or before now."""
        self._playhead.seek(position_s)

    @property
    def browsers(self) -> int:
        """How many look at it."""
        return len(self._server.get_clients())

    @property
    def busy_s(self) -> float:
        """Processor time of the view's threads so far; NaN where that cannot be told."""
        threads = (self._thread, self._server._websock_server._server_thread)
        if not hasattr(time, "pthread_getcpuclockid"):
            return math.nan
        idents = [thread.ident for thread in threads if thread and thread.is_alive() and thread.ident]
        return sum(time.clock_gettime(time.pthread_getcpuclockid(ident)) for ident in idents)

    def close(self) -> None:
        """Ends the page and all threads."""
        self._stopping.set()
        self._thread.join()
        self._server.stop()

    def _centre_m(self) -> NDArray[np.float64]:
        """(3,) the middle of what is shown; what cameras look at."""
        moment = self._history.at(self._playhead.t_s)
        if moment is None or not np.isfinite(moment.node_m).any():
            return np.zeros(3)
        return np.asarray(np.nanmean(moment.node_m, axis=0))

    def _run(self) -> None:
        due_s = tables_s = before_s = time.monotonic()
        while not self._stopping.is_set():
            begun_s = time.monotonic()
            newest = self._take() if self._playhead.live else None
            self._playhead.advance(begun_s - before_s)
            before_s = begun_s
            if self.browsers:
                self._show(newest, begun_s)
                if begun_s >= tables_s:
                    tables_s = begun_s + TABLES_S
                    self._tell()
            now_s = time.monotonic()
            due_s = max(due_s + 1 / FRAMES_HZ, now_s + (now_s - begun_s) * (1 / BUSY_SHARE - 1))
            self._stopping.wait(due_s - now_s)

    def _take(self) -> Moment | None:
        """The newest moment of a stream, kept; None if there is none since the last."""
        moment = self._moment()
        if moment is None or moment.t_s <= self._history.span_s[1]:
            return None
        self._history.add(moment)
        self._plots.add(moment)
        return moment

    def _show(self, newest: Moment | None, now_s: float) -> None:
        """Draws what the playhead says, if it is not drawn already."""
        settings, t_s = self._page.settings, self._playhead.t_s
        follows = self._playhead.follows and newest is not None
        if not (follows or settings.changed or t_s != self._shown_s):
            return
        moment = newest if follows else self._history.at(t_s)
        if moment is None:
            return
        refresh = settings.changed or now_s >= self._refresh_s
        if refresh:
            settings.changed = False
            self._refresh_s = now_s + REFRESH_S
        self._shown_s = t_s
        self._scene.show(moment, settings, refresh=refresh)
        self.moments += 1

    def _moment(self) -> Moment | None:
        """Of the newest results; None before there is one of each."""
        layout, newest = self._layout, self._newest
        if layout.comb is None:
            return self._moment_of_curves()
        solved = newest.get(0)
        if solved is None or solved.comb is None:
            return None
        match = solved.match
        for ribbon, scan in match.scans.items():
            self._quality[layout.slices[ribbon]] = scan.quality
        return Moment(
            match.t_host_s,
            match.q_world_node.reshape(-1, 4),
            match.known.reshape(-1),
            match.valid.reshape(-1),
            match.sigma_rad.reshape(-1),
            self._quality.copy(),
            solved.comb.node_m.reshape(-1, 3),
            solved.comb.anchor_m,
            None if solved.truth_m is None else solved.truth_m.reshape(-1, 3),
            solved.comb,
            (solved,),
        )

    def _moment_of_curves(self) -> Moment | None:
        layout = self._layout
        parts = dict(self._newest)
        if not parts:
            return None
        q = np.tile([1.0, 0.0, 0.0, 0.0], (layout.node_count, 1))
        known, valid = np.zeros((2, layout.node_count), np.bool_)
        sigma_rad = np.full(layout.node_count, np.nan)
        node_m = np.full((layout.node_count, 3), np.nan)
        for ribbon, solved in parts.items():
            at, match = layout.slices[ribbon], solved.match
            q[at], known[at], valid[at] = match.q_world_node[0], match.known[0], match.valid[0]
            sigma_rad[at] = match.sigma_rad[0]
            node_m[at] = layout.origin_m[ribbon] + solved.node_m[0]
            for scan in match.scans.values():
                self._quality[at] = scan.quality
        t_s = max(solved.match.t_host_s for solved in parts.values())
        quality, origin_m = self._quality.copy(), layout.origin_m
        return Moment(t_s, q, known, valid, sigma_rad, quality, node_m, origin_m, parts=tuple(parts.values()))

    def _tell(self) -> None:
        page, report = self._page, self._report
        moment = self._history.at(self._playhead.t_s)
        scale = self._scene.scale
        page.tell(
            self._status(report),
            ribbons_table(report, self._calibrated) if report else "",
            trouble_table(self._layout, self._arrangement.places, moment) if moment else "",
            events_list(self._events, time.monotonic()),
            scale.legend() if scale else "",
        )
        page.show_time()
        page.show_plot()

    def _status(self, report: Report | None) -> str:
        playhead = self._playhead
        if playhead.live:
            mode = "live" if playhead.follows else "paused" if not playhead.playing else "looking back"
        else:
            mode = f"{playhead.t_s:.2f} s" + ("" if playhead.playing else ", paused")
        colour = "#3fb950" if playhead.follows or (not playhead.live and playhead.playing) else "#d29922"
        parts = [f'<b><span style="color:{colour}">●</span> {escape(mode)}</b>']
        if report:
            lost = sum(ribbon.counters.lost for ribbon in report.ribbons)
            parts.append(f"{len(report.ribbons)} ribbons, {report.rate_hz} Hz, {lost} lost")
            if not math.isnan(report.comb.latency_p50_s) and playhead.live:
                parts.append(f"latency {report.comb.latency_p50_s * 1e3:.1f} ms")
            if not math.isnan(report.comb.error_mean_percent):
                parts.append(f"error {report.comb.error_mean_percent:.3f} % of the length")
        return f'<div style="padding:6px 10px;line-height:1.5">{"<br>".join(parts)}</div>'


def has_display() -> bool:
    """Whether a browser can be opened here."""
    if sys.platform in ("darwin", "win32"):
        return True
    return bool(os.environ.get("DISPLAY") or os.environ.get("WAYLAND_DISPLAY"))


def open_browser(url: str) -> None:
    """Opens the page, in a thread: browsers take their time."""
    import webbrowser

    threading.Thread(target=lambda: webbrowser.open(url), name="browser", daemon=True).start()
