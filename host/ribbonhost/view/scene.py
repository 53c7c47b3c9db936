"""The picture: what a moment looks like in the browser. Handles are made once and then only updated."""

import numpy as np
import trimesh
import viser
from numpy.typing import NDArray

from ribbonhost.view.layout import Layout, Moment
from ribbonhost.view.settings import SURFACES, Settings
from ribbonhost.view.shading import COLOURS, PLAIN, QUANTITIES, Scale, node_radius_m
from ribbonhost.view.surface import Kind, Surface
from ribbonhost.view.tubes import Tubes

RIBBON = (238, 238, 242)
BRIDGED = (255, 112, 67)
REGION = (120, 200, 255)
NODE = (40, 46, 60)
NODE_RADIUS_M = 0.0042
NODE_INVALID = (255, 64, 32)
TRUTH = (255, 64, 200)
FLOOR_STEP_M = 0.1
NAME_LIFT_M = 0.03

_NOTHING = np.zeros((3, 3), np.float32)
_NO_FACES = np.array([[0, 1, 2]], np.uint32)


class Scene:
    """Shows moments of one stream on a server; for one thread.

    Attributes:
        scale: of the colours; None if all is one colour.
    """

    def __init__(self, server: viser.ViserServer, layout: Layout) -> None:
        self.scale: Scale | None = None
        self._layout = layout
        self._server = server
        self._tubes = Tubes(layout)
        self._surface = Surface(layout) if layout.comb else None
        self._shown_known: NDArray[np.bool_] | None = None
        self._radius_m = np.zeros(layout.node_count)
        self._floor_m = np.inf
        scene = server.scene
        scene.set_up_direction("+z")
        scene.configure_default_lights(enabled=False)
        scene.configure_environment_map("studio", environment_intensity=0.25)
        scene.add_light_directional("/light/sun", intensity=1.1, position=(0.6, -1.0, 1.6), cast_shadow=False)
        scene.add_light_directional(
            "/light/fill", intensity=0.35, position=(-1.2, 0.8, 0.7), cast_shadow=False
        )
        scene.add_light_hemisphere(
            "/light/sky", sky_color=(214, 228, 255), ground_color=(70, 66, 60), intensity=0.6
        )
        self._bands = [self._mesh(f"/surface/{k}", colour) for k, colour in enumerate((*COLOURS, PLAIN))]
        self._ribbons = self._mesh("/ribbons/measured", RIBBON)
        self._bridged = self._mesh("/ribbons/bridged", BRIDGED)
        self._regions = self._mesh("/ribbons/uncertainty", REGION, opacity=0.28)
        nodes = layout.node_count
        ball = trimesh.creation.icosphere(subdivisions=1, radius=NODE_RADIUS_M)
        self._nodes = scene.add_batched_meshes_simple(
            "/nodes",
            np.asarray(ball.vertices, np.float32),
            np.asarray(ball.faces, np.uint32),
            np.tile([1.0, 0.0, 0.0, 0.0], (nodes, 1)),
            np.zeros((nodes, 3)),
            batched_colors=np.tile(np.array(NODE, np.uint8), (nodes, 1)),
            cast_shadow=False,
            receive_shadow=False,
        )
        self._frames = scene.add_batched_axes(
            "/frames",
            np.tile([1.0, 0.0, 0.0, 0.0], (nodes, 1)),
            np.zeros((nodes, 3)),
            axes_length=0.03,
            axes_radius=0.0012,
            visible=False,
        )
        segments = nodes - len(layout.labels)
        self._inner = np.concatenate([np.arange(s.start, s.stop - 1) for s in layout.slices])
        self._truth = scene.add_line_segments(
            "/truth",
            np.zeros((segments, 2, 3), np.float32),
            colors=TRUTH,
            thickness=2.5,
            thickness_units="screen",
            visible=False,
        )
        self._names = [
            scene.add_label(f"/names/{k}", label, font_screen_scale=0.8)
            for k, label in enumerate(layout.labels)
        ]
        self._floor: viser.GridHandle | None = None
        for name, tip in zip(("east", "north", "up"), 0.115 * np.eye(3), strict=True):
            scene.add_label(f"/world/{name}", name, position=tip, font_screen_scale=0.8)
        scene.add_frame("/world", axes_length=0.1, axes_radius=0.0022)

    def show(self, moment: Moment, settings: Settings, *, refresh: bool) -> None:
        """Shows a moment. refresh: also what changes slowly: colours, uncertainty, names."""
        refresh |= self._shown_known is None or not np.array_equal(self._shown_known, moment.known)
        q = moment.bridged(self._layout)
        there = moment.there(self._layout)
        with self._server.atomic():
            if refresh:
                self._refresh(moment, settings, there)
            self._show_ribbons(moment, q, settings)
            self._show_surface(moment, settings, refresh)
            node_m = np.nan_to_num(moment.node_m)
            if settings.nodes:
                self._nodes.batched_positions = node_m.astype(np.float32)
            if settings.frames:
                self._frames.batched_positions = node_m.astype(np.float32)
                self._frames.batched_wxyzs = q.astype(np.float32)
            if settings.truth and moment.truth_m is not None:
                truth_m = moment.truth_m.astype(np.float32)
                self._truth.points = np.stack([truth_m[self._inner], truth_m[self._inner + 1]], 1)
        self._shown_known = moment.known

    def _refresh(self, moment: Moment, settings: Settings, there: NDArray[np.bool_]) -> None:
        self._nodes.visible = settings.nodes
        self._frames.visible = settings.frames
        self._truth.visible = settings.truth and moment.truth_m is not None
        self._regions.visible = settings.uncertainty
        measured, bridged = moment.known & there, ~moment.known & there
        for mesh, nodes, wanted in (
            (self._ribbons, measured, settings.ribbons),
            (self._bridged, bridged, settings.ribbons),
            (self._regions, there, settings.uncertainty),
        ):
            mesh.visible = wanted and bool(nodes.any())
            if self._shown_known is None or not np.array_equal(self._shown_known, moment.known):
                mesh.faces = self._tubes.faces(nodes) if nodes.any() else _NO_FACES
        colours = np.where(moment.known[:, None], NODE, NODE_INVALID).astype(np.uint8)
        self._nodes.batched_colors = colours
        if settings.uncertainty:
            self._radius_m = np.nan_to_num(node_radius_m(self._layout, moment))
        for name, at in zip(self._names, self._layout.slices, strict=True):
            tip = moment.node_m[at.stop - 1]
            name.visible = settings.names and bool(np.isfinite(tip).all())
            if name.visible:
                name.position = tip + np.array([0.0, 0.0, NAME_LIFT_M])
        self._lay_floor(moment, settings)

    def _show_ribbons(self, moment: Moment, q: NDArray[np.float64], settings: Settings) -> None:
        if settings.ribbons:
            rings = self._tubes.rings(moment, q)
            for mesh in (self._ribbons, self._bridged):
                if mesh.visible:
                    mesh.vertices = rings
        if settings.uncertainty:
            self._regions.vertices = self._tubes.rings(moment, q, settings.magnify * self._radius_m)

    def _show_surface(self, moment: Moment, settings: Settings, refresh: bool) -> None:
        if self._surface is None or moment.comb is None:
            return
        if settings.surface == SURFACES[2]:
            if refresh:
                for mesh in self._bands:
                    mesh.visible = False
            return
        kind: Kind = "smooth" if settings.surface == SURFACES[0] else "nodes"
        if refresh:
            quantity = QUANTITIES.get(settings.colour)
            if quantity is None:
                self.scale = None
            elif self.scale is None or self.scale.quantity is not quantity:
                self.scale = Scale(quantity)
            self._cut = self._surface.cut(moment, kind, self.scale)
        points = self._cut.points(self._surface.vertices(moment, kind).reshape(-1, 3))
        for mesh, (at, faces) in zip(self._bands, self._cut.bands, strict=True):
            if refresh:
                mesh.visible = at.stop > at.start
                mesh.flat_shading = kind == "nodes"
            if at.stop > at.start:
                mesh.vertices = points[at]
                if refresh:
                    mesh.faces = faces

    def _lay_floor(self, moment: Moment, settings: Settings) -> None:
        """A grid of decimetres below all that was shown so far."""
        lowest = np.nanmin(moment.node_m[:, 2]) if np.isfinite(moment.node_m).any() else np.inf
        if lowest < self._floor_m:
            self._floor_m = FLOOR_STEP_M * (np.floor(lowest / FLOOR_STEP_M - 0.2))
            centre = np.round(np.nanmean(moment.node_m, axis=0) / FLOOR_STEP_M) * FLOOR_STEP_M
            size = 2 * FLOOR_STEP_M * np.ceil(1.2 * self._layout.length_m / FLOOR_STEP_M)
            self._floor = self._server.scene.add_grid(
                "/floor",
                width=size,
                height=size,
                cell_size=FLOOR_STEP_M,
                section_size=5 * FLOOR_STEP_M,
                cell_color=(70, 78, 92),
                section_color=(104, 116, 136),
                cell_thickness=0.8,
                section_thickness=1.2,
                shadow_opacity=0.0,
                plane_opacity=0.0,
                fade_distance=6.0,
                position=(float(centre[0]), float(centre[1]), float(self._floor_m)),
            )
        if self._floor:
            self._floor.visible = settings.floor

    def _mesh(
        self, name: str, colour: tuple[int, int, int], opacity: float | None = None
    ) -> viser.MeshHandle:
        return self._server.scene.add_mesh_simple(
            name,
            _NOTHING,
            _NO_FACES,
            color=colour,
            opacity=opacity,
            side="double",
            cast_shadow=False,
            receive_shadow=False,
            visible=False,
        )
