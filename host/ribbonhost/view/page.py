"""The controls around the picture, and what they tell in numbers."""

from collections.abc import Callable, Sequence
from html import escape
from typing import Any, Protocol

import numpy as np
import viser
import viser.uplot
from numpy.typing import NDArray

from ribbonhost.errors import RibbonError
from ribbonhost.view.layout import Float64, Layout
from ribbonhost.view.playhead import Playhead
from ribbonhost.view.plots import NAMES, WINDOW_S, Plots
from ribbonhost.view.scene import BRIDGED, REGION, RIBBON, TRUTH
from ribbonhost.view.settings import SURFACES, Settings
from ribbonhost.view.shading import ERROR, PLAIN_COLOUR, QUANTITIES

LINES = ("#f0f0f4", "#ffb000", "#fe6100", "#dc267f", "#785ef0", "#648fff", "#2ec4b6")
"""Told apart by all eyes (IBM's palette)."""

SPEEDS = ("0.1", "0.25", "0.5", "1", "2", "4")
VIEWS: dict[str, tuple[float, float, float]] = {
    "overview": (0.92, -1.42, 0.95),
    "top": (0.0, -0.02, 2.2),
    "front": (0.0, -2.2, 0.15),
    "side": (2.2, 0.0, 0.15),
}
"""Where the camera stands, from the middle of the picture, in lengths of a ribbon."""

FIELD_OF_VIEW_RAD = 0.75
"""Up and down; wider would bend what is near."""

RECORD, STOP = "Record", "Stop recording"
PAUSE = "pause / play"


class Recording(Protocol):
    """What the record button moves."""

    @property
    def is_running(self) -> bool: ...

    def begin(self) -> None:
        """Raises RibbonError if it cannot."""

    def end(self) -> None: ...

    def status(self) -> str:
        """What is or was recorded, in a sentence."""


class Page:
    """The panels of one server. Its callbacks run in the server's threads and only set what they choose."""

    def __init__(
        self,
        server: viser.ViserServer,
        layout: Layout,
        playhead: Playhead,
        plots: Plots,
        *,
        recording: Recording | None,
        truth: bool,
        centre_m: Callable[[], NDArray[np.float64]],
    ) -> None:
        self.settings = Settings()
        self._plotted: tuple[int, ...] = ()
        self._plot: viser.GuiUplotHandle | None = None
        self._server = server
        self._layout = layout
        self._playhead = playhead
        self._plots = plots
        self._recording = recording
        self._centre_m = centre_m
        gui = server.gui
        gui.configure_theme(
            dark_mode=True, show_logo=False, show_share_button=False, brand_color=(38, 130, 142)
        )
        gui.main_panel.dock_right()
        gui.main_panel.set_width(310)
        self._status = gui.add_html("")
        if recording:
            self._add_recording(recording)
        self._add_time()
        self._add_picture(truth)
        self._add_camera()
        self._add_left(truth)

    def look(self, client: viser.ClientHandle, view: str) -> None:
        """Moves the camera of one browser."""
        centre = self._centre_m()
        with client.atomic():
            client.camera.fov = FIELD_OF_VIEW_RAD
            client.camera.up_direction = (0.0, 0.0, 1.0)
            client.camera.position = centre + self._layout.length_m * np.array(VIEWS[view])
            client.camera.look_at = centre

    def tell(self, status: str, ribbons: str, nodes: str, events: str, legend: str) -> None:
        """Shows texts (HTML); what did not change is not sent."""
        for handle, text in (
            (self._status, status),
            (self._ribbons, ribbons),
            (self._nodes, nodes),
            (self._events, events),
            (self._legend, legend),
        ):
            if handle.content != text:
                handle.content = text
        if self._recording:
            self._show_recording(self._recording)

    def show_time(self) -> None:
        """Moves the slider to where the playhead is."""
        low, high = self._playhead.range_s
        low, high = float(np.floor(low)), float(np.ceil(high * 10) / 10)
        slider = self._slider
        if (low, high) != (slider.min, slider.max) and high > low:
            slider.min, slider.max = low, high
        if self._playhead.playing:
            position_s = float(np.clip(self._playhead.position_s, slider.min, slider.max))
            slider.value = position_s  # type: ignore[misc]  # a property whose setter mypy does not find

    def show_plot(self) -> None:
        """Draws the lines anew; the plot is made anew when other ribbons have values."""
        t_s, lines = self._plots.lines(self._quantity.value, self._window_s)
        data, shown = (t_s, *lines.values()), tuple(lines)
        with self._server.atomic():
            if shown == self._plotted and self._plot:
                self._plot.data = data
                return
            if self._plot:
                self._plot.remove()
            self._plotted, self._plot = shown, None
            if shown:
                with self._plot_tab:
                    self._plot = self._make_plot(data, shown)

    def _make_plot(self, data: tuple[Float64, ...], ribbons: Sequence[int]) -> viser.GuiUplotHandle:
        labels = self._layout.labels
        series = [viser.uplot.Series(label="s")] + [
            viser.uplot.Series(label=labels[k], stroke=LINES[k % len(LINES)], width=1.5) for k in ribbons
        ]
        axis = viser.uplot.Axis(stroke="#c8ccd4", grid={"stroke": "#3a3f4a", "width": 1})
        return self._server.gui.add_uplot(
            data, tuple(series), scales={"x": viser.uplot.Scale(time=False)}, axes=(axis, axis), aspect=1.5
        )

    @property
    def _window_s(self) -> float | None:
        return WINDOW_S if self._playhead.live else None

    def _add_recording(self, recording: Recording) -> None:
        gui = self._server.gui
        self._record = gui.add_button(RECORD, icon=viser.Icon.PLAYER_RECORD_FILLED, color="red")
        self._recorded = gui.add_html("")

        @self._record.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonHandle]) -> None:
            try:
                if recording.is_running:
                    recording.end()
                else:
                    recording.begin()
            except RibbonError as error:
                if event.client:
                    event.client.add_notification("Not recorded", str(error), color="red")
            self._show_recording(recording)

    def _show_recording(self, recording: Recording) -> None:
        self._record.label = STOP if recording.is_running else RECORD
        status = recording.status()
        self._recorded.content = (
            f'<div style="padding:0 10px 4px;font-size:0.85em">{escape(status)}</div>' if status else ""
        )

    def _add_time(self) -> None:
        gui, playhead = self._server.gui, self._playhead
        with gui.add_folder("Time") as folder:
            self._slider = gui.add_slider(
                "s before now" if playhead.live else "s",
                min=-1.0 if playhead.live else 0.0,
                max=0.0 if playhead.live else 1.0,
                step=0.01,
                initial_value=0.0,
                hint="Drag to look back; the stream and its recording go on.",
            )
            move = gui.add_button_group(" ", (PAUSE, "live" if playhead.live else "from 0 s"))

        @self._slider.on_update
        def _(event: viser.GuiEvent[viser.GuiSliderHandle[float]]) -> None:
            if event.client:  # not what show_time does
                playhead.seek(event.target.value)

        @move.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
            if event.target.value == PAUSE:
                playhead.toggle()
            else:
                playhead.follow()

        if not playhead.live:
            nearest = min(SPEEDS, key=lambda speed: abs(float(speed) - playhead.speed))
            with folder:
                chosen = gui.add_dropdown("speed", SPEEDS, initial_value=nearest)

            @chosen.on_update
            def _(_: object) -> None:
                playhead.speed = float(chosen.value)

    def _add_picture(self, truth: bool) -> None:
        gui, settings = self._server.gui, self.settings
        colours = [name for name in QUANTITIES if truth or name != ERROR.name]
        with gui.add_folder("Picture"):
            if self._layout.comb:
                self._choice("surface", SURFACES, "surface")
                self._choice("colour", (*colours, PLAIN_COLOUR), "colour")
            self._legend = gui.add_html("")
            gui.add_html(_key(truth))
            self._toggle("ribbons", "ribbons")
            self._toggle("nodes", "nodes")
            self._toggle("names", "names")
            self._toggle("node frames", "frames", "x along the ribbon red, y across green, z normal blue")
            self._toggle("uncertainty", "uncertainty", "holds the ribbon with 95 % probability")
            magnify = gui.add_slider("magnified", min=1.0, max=20.0, step=1.0, initial_value=settings.magnify)
            if truth:
                self._toggle("truth", "truth", "where the emulator has the ribbons")
            self._toggle("floor, 0.1 m", "floor")

        @magnify.on_update
        def _(_: object) -> None:
            settings.magnify, settings.changed = magnify.value, True

    def _add_camera(self) -> None:
        views = self._server.gui.add_button_group("camera", tuple(VIEWS))

        @views.on_click
        def _(event: viser.GuiEvent[viser.GuiButtonGroupHandle]) -> None:
            if event.client:
                self.look(event.client, event.target.value)

    def _add_left(self, truth: bool) -> None:
        gui = self._server.gui
        panel = gui.add_panel()
        with panel.add_tab("Ribbons", viser.Icon.TABLE):
            self._ribbons = gui.add_html("")
            self._events = gui.add_html("")
        with panel.add_tab("Nodes", viser.Icon.ALERT_TRIANGLE):
            self._nodes = gui.add_html("")
        panel.dock_left()
        panel.set_width(440)
        below = gui.add_panel()
        self._plot_tab = below.add_tab("Plots", viser.Icon.CHART_LINE)
        with self._plot_tab:
            names = [name for name in NAMES if truth or "error" not in name]
            self._quantity = gui.add_dropdown("of each ribbon", names)
        below.dock_below(panel)

        @self._quantity.on_update
        def _(_: object) -> None:
            self.show_plot()

    def _choice(self, label: str, options: Sequence[str], name: str) -> None:
        handle = self._server.gui.add_dropdown(
            label, tuple(options), initial_value=getattr(self.settings, name)
        )
        self._bind(handle, name)

    def _toggle(self, label: str, name: str, hint: str | None = None) -> None:
        self._bind(self._server.gui.add_checkbox(label, getattr(self.settings, name), hint=hint), name)

    def _bind(self, handle: viser.GuiInputHandle[Any], name: str) -> None:
        @handle.on_update
        def _(_: object) -> None:
            setattr(self.settings, name, handle.value)
            self.settings.changed = True


def _key(truth: bool) -> str:
    """What the colours of ribbons mean."""
    meanings = [(RIBBON, "measured"), (BRIDGED, "invalid, bridged"), (REGION, "95 % region")]
    if truth:
        meanings.append((TRUTH, "truth"))
    spans = (f'<span><span style="color:rgb{colour}">●</span> {text}</span>' for colour, text in meanings)
    style = "padding:2px 10px 6px;font-size:0.85em;display:flex;flex-wrap:wrap;gap:2px 12px"
    return f'<div style="{style}">{"".join(spans)}</div>'
