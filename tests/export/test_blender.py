"""Blender opens what is exported, where its Python module is installed (`pip install bpy`)."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from export.made_up import NODES, RIBBONS, made_up
from ribbonhost.export import Animation, export

FRAMES = 8
TOLERANCE_M = 1e-6

bpy: Any = pytest.importorskip("bpy", reason="Blender's module is optional: pip install bpy")


@pytest.fixture
def animation() -> Animation:
    return made_up(FRAMES, seed=6)


def points_m(name: str) -> np.ndarray:
    """Vertices of an object, or points of its curve, in the world, as Blender shows them now."""
    shown = bpy.data.objects[name].evaluated_get(bpy.context.evaluated_depsgraph_get())
    data = shown.data
    if hasattr(data, "vertices"):
        local = np.array([vertex.co[:] for vertex in data.vertices])
    elif hasattr(data, "splines"):
        local = np.array([point.co[:3] for spline in data.splines for point in spline.points])
    else:
        local = np.array([point.position[:] for point in data.points])
    world = np.array(shown.matrix_world)
    return local @ world[:3, :3].T + world[:3, 3]


def test_blender_shows_surface_and_ribbons_where_they_were(animation: Animation, tmp_path: Path) -> None:
    export(animation, tmp_path / "motion.usdc")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert bpy.ops.wm.usd_import(filepath=str(tmp_path / "motion.usdc")) == {"FINISHED"}
    scene = bpy.context.scene
    assert (scene.frame_start, scene.frame_end) == (0, FRAMES - 1)
    for frame in range(FRAMES):
        scene.frame_set(frame)
        assert np.abs(points_m("surface") - animation.surface_m[frame].reshape(-1, 3)).max() < TOLERANCE_M
        for ribbon in range(RIBBONS):
            shown = points_m(f"ribbon_{ribbon}")
            assert np.abs(shown - animation.node_m[frame, ribbon]).max() < TOLERANCE_M


# Blender leaves the file to the garbage collector.
@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
def test_blender_reads_the_joints_of_a_bvh(animation: Animation, tmp_path: Path) -> None:
    export(animation, tmp_path / "motion.bvh")
    bpy.ops.wm.read_factory_settings(use_empty=True)
    assert bpy.ops.import_anim.bvh(filepath=str(tmp_path / "motion.bvh")) == {"FINISHED"}
    armatures = [thing for thing in bpy.data.objects if thing.type == "ARMATURE"]
    assert sum(len(armature.data.bones) for armature in armatures) >= RIBBONS * (NODES - 1)
