"""A page that plays the moving surface in any browser, alone: nothing is loaded from anywhere."""

from pathlib import Path
from typing import Any

import numpy as np

from ribbonhost.errors import MissingExtraError
from ribbonhost.export.animation import Animation, UpAxis, grid_triangles

MAX_RATE_HZ = 30.0
"""Browsers draw hardly more, and each frame is a whole mesh in the file."""

SURFACE_RGB = (122, 166, 216)
RIBBON_RGB = (192, 64, 32)


def write_page(animation: Animation, path: Path, up: UpAxis) -> None:
    """Writes the page, with viser's player: play, pause, scrub, turn. Raises MissingExtraError."""
    try:
        import rich
        import viser
    except ImportError as error:
        raise MissingExtraError(".html", "viser", "view") from error
    if animation.rate_hz > MAX_RATE_HZ * 1.01:
        animation = animation.at_rate(MAX_RATE_HZ)
    frames, u, w, _ = animation.surface_m.shape
    surface = animation.surface_m.reshape(frames, -1, 3)
    lines = np.stack([animation.node_m[:, :, :-1], animation.node_m[:, :, 1:]], axis=3)
    lines = np.nan_to_num(lines.reshape(frames, -1, 2, 3).astype(np.float32))
    pauses_s = np.append(np.diff(animation.t_s), 1.0 / (animation.rate_hz or 1.0))
    console, was_quiet = rich.get_console(), rich.get_console().quiet
    console.quiet = True  # viser has no other way to be silent on stdout
    # It serves nobody: only a server can write its scene to a file.
    server = viser.ViserServer(host="127.0.0.1", port=0, verbose=False)
    try:
        server.scene.set_up_direction("+z" if up == "z" else "+y")
        _look_at_all(server, animation, up)
        recorded = server.get_scene_serializer()
        ribbons = server.scene.add_line_segments(
            "/ribbons", lines[0], RIBBON_RGB, thickness=3.0, thickness_units="screen"
        )
        mesh = None
        if animation.has_surface:
            mesh = server.scene.add_mesh_simple(
                "/surface",
                surface[0],
                grid_triangles(u, w),
                color=SURFACE_RGB,
                side="double",
                cast_shadow=False,
                receive_shadow=False,
            )
        for frame in range(frames):
            with server.atomic():
                ribbons.points = lines[frame]
                if mesh is not None:
                    mesh.vertices = surface[frame]
            recorded.insert_sleep(float(pauses_s[frame]))
        path.write_text(recorded.as_html(), encoding="utf-8")
    finally:
        server.stop()
        console.quiet = was_quiet


def _look_at_all(server: Any, animation: Animation, up: UpAxis) -> None:
    """Puts the camera where the whole motion is in the picture, obliquely from above."""
    points = animation.node_m.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    centre, size = (low + high) / 2, max(float(np.linalg.norm(high - low)), 1e-3)
    towards = np.array([-0.7, -1.0, 0.8]) if up == "z" else np.array([-0.7, 0.8, 1.0])
    camera = server.initial_camera
    camera.look_at = tuple(centre)
    camera.position = tuple(centre + 1.1 * size * towards / np.linalg.norm(towards))
    camera.near, camera.far = 0.01 * size, 100.0 * size
