"""Still meshes of the surface: Wavefront OBJ, Stanford PLY and STL, one file a frame."""

from pathlib import Path

from ribbonhost.errors import MissingExtraError, UsageError
from ribbonhost.export.animation import Animation, grid_triangles


def write_meshes(animation: Animation, path: Path) -> list[Path]:
    """Writes one frame as `path`, several as path-00000.obj and so on; returns the files.

    Raises UsageError without a surface, MissingExtraError without trimesh.
    """
    if not animation.has_surface:
        raise UsageError(
            f"{path.suffix} holds a surface, and single ribbons span none: export .csv, .npz or .bvh"
        )
    try:
        import trimesh
    except ImportError as error:
        raise MissingExtraError(path.suffix, "trimesh", "export") from error
    frames, u, w, _ = animation.surface_m.shape
    triangles = grid_triangles(u, w)
    files = []
    for frame in range(frames):
        file = path if frames == 1 else path.with_name(f"{path.stem}-{frame:05d}{path.suffix}")
        mesh = trimesh.Trimesh(animation.surface_m[frame].reshape(-1, 3), triangles, process=False)
        mesh.export(file)
        files.append(file)
    return files
