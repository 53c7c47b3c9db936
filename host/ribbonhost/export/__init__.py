"""Files that other tools open, one writer an extension; each is complete or not there at all."""

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from ribbonhost.errors import UsageError
from ribbonhost.export.animation import Animation, UpAxis

__all__ = ["FORMATS", "Animation", "Options", "UpAxis", "export"]

FORMATS: dict[str, str] = {
    ".csv": "table of nodes: spreadsheets, MATLAB, R",
    ".npz": "NumPy arrays",
    ".parquet": "table of nodes: pandas, Polars, DuckDB",
    ".bvh": "joint chains: Blender, Motive, Maya",
    ".glb": "animated mesh: browsers, Blender, Windows 3D viewer",
    ".usda": "animated mesh and curves, text: Blender, Omniverse, Houdini",
    ".usdc": "animated mesh and curves, binary: Blender, Omniverse, Houdini",
    ".usdz": "animated mesh and curves, packed: Quick Look",
    ".obj": "mesh of one frame, or one file a frame",
    ".ply": "mesh of one frame, or one file a frame",
    ".stl": "mesh of one frame, or one file a frame",
    ".html": "page that plays the motion: any browser, without a network",
    ".mp4": "film",
    ".gif": "film",
}


@dataclass(frozen=True)
class Options:
    """What to change on the way out.

    start_s, end_s: the part to export, seconds from the start. rate_hz: fewer frames; None: all.
    up: which axis is up in the file (glTF is always y up). scale: file units a metre.
    """

    start_s: float | None = None
    end_s: float | None = None
    rate_hz: float | None = None
    up: UpAxis = "z"
    scale: float = 1.0


def export(
    animation: Animation,
    path: Path,
    options: Options | None = None,
    progress: Callable[[int, int], None] = lambda done, all_: None,
) -> list[Path]:
    """Writes `path` in the format its extension names; returns the files written.

    Raises UsageError for an unknown extension or options that leave nothing, MissingExtraError when the
    library for the format is not installed, OSError when the file cannot be written. A file that stood there
    stays until the new one is complete.
    """
    options = options or Options()
    suffix = path.suffix.lower()
    if suffix not in FORMATS:
        raise UsageError(f'"{path.name}": the ending must be one of {" ".join(FORMATS)}')
    animation = animation.between(options.start_s, options.end_s)
    if options.rate_hz is not None:
        animation = animation.at_rate(options.rate_hz)
    animation = animation.scaled(options.scale)
    if suffix != ".glb":
        animation = animation.with_up(options.up)
    if suffix in (".obj", ".ply", ".stl"):
        from ribbonhost.export.meshes import write_meshes

        return write_meshes(animation, path)
    part = path.with_name(f".{path.stem}.part{suffix}")
    try:
        _write(animation, part, suffix, options, progress)
        os.replace(part, path)
    finally:
        part.unlink(missing_ok=True)
    return [path]


def _write(
    animation: Animation, path: Path, suffix: str, options: Options, progress: Callable[[int, int], None]
) -> None:
    # Each writer's library is loaded only when its format is asked for.
    match suffix:
        case ".csv" | ".npz" | ".parquet":
            from ribbonhost.export import tables

            {".csv": tables.write_csv, ".npz": tables.write_npz, ".parquet": tables.write_parquet}[suffix](
                animation, path
            )
        case ".bvh":
            from ribbonhost.export.bvh import write_bvh

            write_bvh(animation, path)
        case ".glb":
            from ribbonhost.export.gltf import write_glb

            write_glb(animation, path)
        case ".usda" | ".usdc" | ".usdz":
            from ribbonhost.export.usd import write_usd

            write_usd(animation, path, options.up, 1.0 / options.scale)
        case ".html":
            from ribbonhost.export.page import write_page

            write_page(animation, path, options.up)
        case _:
            from ribbonhost.export.video import write_video

            write_video(animation, path, progress)
