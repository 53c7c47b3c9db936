"""Films of the moving surface: MP4 and GIF, drawn off screen."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from ribbonhost.errors import MissingExtraError
from ribbonhost.export.animation import Animation

MAX_RATE_HZ = 25.0
SIZE_INCH = (6.4, 4.8)
DPI = 100


def write_video(animation: Animation, path: Path, progress: Callable[[int, int], None]) -> None:
    """Draws each frame from a fixed camera; at most 25 frames a second. Raises MissingExtraError."""
    try:
        import imageio.v2 as imageio
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError(path.suffix, "imageio[ffmpeg] and matplotlib", "export") from error
    if animation.rate_hz > MAX_RATE_HZ * 1.01:
        animation = animation.at_rate(MAX_RATE_HZ)
    figure = Figure(figsize=SIZE_INCH, dpi=DPI)
    canvas: Any = FigureCanvasAgg(figure)
    axes = figure.add_subplot(projection="3d")
    points = animation.node_m.reshape(-1, 3)
    points = points[np.isfinite(points).all(axis=1)]
    low, high = points.min(axis=0), points.max(axis=0)
    centre, half = (low + high) / 2, max(float((high - low).max()) / 2, 1e-3)
    options: dict[str, Any] = {"fps": max(animation.rate_hz, 1.0)}
    if path.suffix == ".gif":
        options = {"duration": 1000.0 / max(animation.rate_hz, 1.0), "loop": 0}
    writer: Any
    with imageio.get_writer(path, **options) as writer:
        for frame in range(len(animation.t_s)):
            axes.clear()
            for axis, set_limits in enumerate((axes.set_xlim, axes.set_ylim, axes.set_zlim)):
                set_limits(centre[axis] - half, centre[axis] + half)
            axes.set(xlabel="x (m)", ylabel="y (m)", zlabel="z (m)", title=f"{animation.t_s[frame]:.2f} s")
            axes.set_box_aspect((1, 1, 1))
            if animation.has_surface:
                x, y, z = np.moveaxis(animation.surface_m[frame], -1, 0)
                axes.plot_surface(x, y, z, rstride=3, cstride=3, color="#7aa6d8", alpha=0.8, linewidth=0)
            for curve in animation.node_m[frame]:
                axes.plot(*curve.T, "-o", markersize=2, linewidth=1, color="#c04020")
            canvas.draw()
            writer.append_data(np.asarray(canvas.buffer_rgba())[..., :3].copy())
            progress(frame + 1, len(animation.t_s))
