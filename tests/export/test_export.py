"""What is exported reads the same in other people's libraries."""

from pathlib import Path

import imageio.v2 as imageio
import numpy as np
import pandas as pd
import pygltflib
import pytest
import trimesh
from pxr import Usd, UsdGeom
from ribbonhost.errors import UsageError
from ribbonhost.export import FORMATS, Animation, Options, export
from ribbonhost.export.animation import grid_triangles, surface_grid
from ribbonhost.reconstruct import CombLayout, CombSolver
from scipy.spatial.transform import Rotation

TOLERANCE_M = 1e-6
FRAMES, NODES = 12, 16

# imageio-ffmpeg leaves the pipes of the encoder that it runs to the garbage collector.
LIBRARY_LEAVES_PIPES_OPEN = pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")


@pytest.fixture(scope="module")
def animation() -> Animation:
    """A comb of three ribbons that bend up and down."""
    solver = CombSolver(CombLayout(0.025, NODES, (0.0, 0.15, 0.3)))
    t_s = np.arange(FRAMES) / 20
    s = np.linspace(0, 1, NODES)
    q, node_m, patches = [], [], []
    for t in t_s:
        bend = Rotation.from_euler("z", 90, degrees=True) * Rotation.from_rotvec(
            np.outer(0.5 * np.sin(5 * t) * s, [0, -1, 0])
        )
        ribbon = bend.as_quat(scalar_first=True)
        reference = np.tile([1.0, 0.0, 0.0, 0.0], (NODES, 1))
        q.append(np.stack([reference, ribbon, ribbon, ribbon]))
        frame = solver.solve(q[-1])
        node_m.append(frame.node_m)
        patches.append(frame.vertices_m)
    return Animation(
        t_s=t_s,
        node_m=np.array(node_m),
        q_world_node=np.array(q),
        valid=np.ones((FRAMES, 4, NODES), bool),
        names=("reference", "left", "middle", "right"),
        surface_m=surface_grid(np.array(patches)),
    )


def test_the_grid_passes_through_the_nodes(animation: Animation) -> None:
    inner = 8 - 1
    for ribbon in range(3):
        on_grid = animation.surface_m[:, ::inner, ribbon * inner]
        assert np.abs(on_grid - animation.node_m[:, 1 + ribbon]).max() < TOLERANCE_M


@pytest.mark.parametrize("suffix", [".usda", ".usdc", ".usdz"])
def test_usd_stage_holds_surface_and_curves(suffix: str, animation: Animation, tmp_path: Path) -> None:
    path = tmp_path / f"x{suffix}"
    export(animation, path)
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Z"
    assert UsdGeom.GetStageMetersPerUnit(stage) == 1.0
    mesh = UsdGeom.Mesh(stage.GetPrimAtPath("/ribbons/surface"))
    curve = UsdGeom.BasisCurves(stage.GetPrimAtPath("/ribbons/ribbon_2"))
    for frame in (0, 5, FRAMES - 1):
        points = np.array(mesh.GetPointsAttr().Get(frame))
        assert np.abs(points - animation.surface_m[frame].reshape(-1, 3)).max() < TOLERANCE_M
        nodes = np.array(curve.GetPointsAttr().Get(frame))
        assert np.abs(nodes - animation.node_m[frame, 2]).max() < TOLERANCE_M
    assert stage.GetEndTimeCode() == pytest.approx(FRAMES - 1)
    assert stage.GetTimeCodesPerSecond() == pytest.approx(20)


def test_usd_in_centimetres_with_y_up(animation: Animation, tmp_path: Path) -> None:
    path = tmp_path / "x.usdc"
    export(animation, path, Options(up="y", scale=100))
    stage = Usd.Stage.Open(str(path))
    assert UsdGeom.GetStageUpAxis(stage) == "Y"
    assert UsdGeom.GetStageMetersPerUnit(stage) == pytest.approx(0.01)
    points = np.array(UsdGeom.Mesh(stage.GetPrimAtPath("/ribbons/surface")).GetPointsAttr().Get(3))
    x, y, z = 100 * animation.surface_m[3].reshape(-1, 3).T
    assert np.abs(points - np.stack([x, z, -y], axis=1)).max() < 100 * TOLERANCE_M


def test_glb_holds_each_frame_as_a_morph_target(animation: Animation, tmp_path: Path) -> None:
    path = tmp_path / "x.glb"
    export(animation, path)
    gltf = pygltflib.GLTF2().load(str(path))
    blob = gltf.binary_blob()

    def vectors(index: int) -> np.ndarray:
        accessor = gltf.accessors[index]
        start = gltf.bufferViews[accessor.bufferView].byteOffset
        return np.frombuffer(blob, np.float32, 3 * accessor.count, start).reshape(-1, 3)

    primitive = gltf.meshes[0].primitives[0]
    assert len(primitive.targets) == FRAMES - 1
    base = vectors(primitive.attributes.POSITION)
    x, y, z = animation.surface_m[4].reshape(-1, 3).T
    found = base + vectors(primitive.targets[3]["POSITION"])
    assert np.abs(found - np.stack([x, z, -y], axis=1)).max() < TOLERANCE_M
    assert np.allclose(np.linalg.norm(vectors(primitive.attributes.NORMAL), axis=1), 1, atol=1e-5)
    assert gltf.materials[0].pbrMetallicRoughness.metallicFactor == 0
    scene = trimesh.load(path)
    assert len(scene.geometry) == 1


def read_bvh(path: Path) -> dict[str, np.ndarray]:
    """World positions (frames, 3) of all joints, from the file alone."""
    header, motion = path.read_text().split("MOTION")
    parents: list[int] = []
    names: list[str] = []
    stack: list[int] = []
    pending = -1
    for line in header.splitlines():
        words = line.split()
        if not words:
            continue
        if words[0] in ("ROOT", "JOINT"):
            pending = len(names)
            names.append(words[1])
            parents.append(stack[-1] if stack else -1)
        elif words[0] == "End":
            pending = -1
        elif words[0] == "{":
            stack.append(pending)
        elif words[0] == "}":
            stack.pop()
    lines = motion.strip().splitlines()
    assert lines[0] == f"Frames: {FRAMES}"
    values = np.array([[float(v) for v in line.split()] for line in lines[2:]]).reshape(FRAMES, -1, 6)
    world: dict[str, np.ndarray] = {}
    rotation: list[Rotation] = []
    position: list[np.ndarray] = []
    for joint, name in enumerate(names):
        local = Rotation.from_euler("ZXY", values[:, joint, 3:], degrees=True)
        offset = values[:, joint, :3]
        if parents[joint] < 0:
            position.append(offset)
            rotation.append(local)
        else:
            parent = parents[joint]
            position.append(position[parent] + rotation[parent].apply(offset))
            rotation.append(rotation[parent] * local)
        world[name] = position[-1]
    return world


def test_bvh_chains_lead_to_the_nodes(animation: Animation, tmp_path: Path) -> None:
    path = tmp_path / "x.bvh"
    export(animation, path)
    world = read_bvh(path)
    for ribbon, name in enumerate(animation.names):
        for node in range(NODES):
            assert np.abs(world[f"{name}_{node}"] - animation.node_m[:, ribbon, node]).max() < TOLERANCE_M


@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_have_a_row_a_node(suffix: str, animation: Animation, tmp_path: Path) -> None:
    path = tmp_path / f"x{suffix}"
    export(animation, path)
    table = pd.read_csv(path) if suffix == ".csv" else pd.read_parquet(path)
    assert len(table) == FRAMES * 4 * NODES
    positions = table[["x_m", "y_m", "z_m"]].to_numpy().reshape(animation.node_m.shape)
    assert np.abs(positions - animation.node_m).max() < TOLERANCE_M
    assert list(table["ribbon"].unique()) == list(animation.names)


def test_npz_holds_the_arrays(animation: Animation, tmp_path: Path) -> None:
    export(animation, tmp_path / "x.npz")
    with np.load(tmp_path / "x.npz") as arrays:
        assert np.array_equal(arrays["node_m"], animation.node_m)
        assert np.array_equal(arrays["q_world_node"], animation.q_world_node)


@pytest.mark.parametrize("suffix", [".obj", ".ply", ".stl"])
def test_meshes_one_file_a_frame(suffix: str, animation: Animation, tmp_path: Path) -> None:
    files = export(animation, tmp_path / f"x{suffix}", Options(start_s=0.1, end_s=0.2))
    assert len(files) == 3
    mesh = trimesh.load(files[1], process=False)
    true = animation.surface_m[3].reshape(-1, 3)
    assert mesh.area == pytest.approx(
        trimesh.Trimesh(true, grid_triangles(*animation.surface_m.shape[1:3]), process=False).area, rel=1e-5
    )
    assert np.abs(mesh.bounds - [true.min(axis=0), true.max(axis=0)]).max() < 1e-5


@LIBRARY_LEAVES_PIPES_OPEN
@pytest.mark.parametrize("suffix", [".mp4", ".gif"])
def test_films_have_frames_with_something_in_them(suffix: str, animation: Animation, tmp_path: Path) -> None:
    path = tmp_path / f"x{suffix}"
    export(animation, path, Options(rate_hz=10))
    with imageio.get_reader(path) as reader:
        frames = [np.asarray(frame)[..., :3] for frame in reader]
    assert len(frames) >= 5
    assert all(np.std(frame) > 5 for frame in frames)


def test_turning_y_up_turns_orientations_with_positions(animation: Animation) -> None:
    turned = animation.with_up("y")
    x, y, z = Rotation.from_quat(animation.q_world_node[4, 2], scalar_first=True).apply([1, 0, 0]).T
    after = Rotation.from_quat(turned.q_world_node[4, 2], scalar_first=True).apply([1, 0, 0])
    assert after == pytest.approx(np.stack([x, z, -y], axis=1), abs=1e-12)


def test_a_lower_rate_takes_the_nearest_frames(animation: Animation) -> None:
    assert animation.at_rate(10).t_s == pytest.approx(np.arange(0, 0.56, 0.1), abs=1e-9)
    assert len(animation.at_rate(1000).t_s) == FRAMES


@pytest.mark.parametrize(
    ("name", "options", "said"),
    [
        ("x.doc", Options(), "ending must be one of"),
        ("x.csv", Options(start_s=5.0), "no frame lies between"),
        ("x.csv", Options(rate_hz=0.0), "positive"),
        ("x.csv", Options(scale=-1.0), "positive"),
    ],
)
def test_mistakes_are_one_sentence_and_leave_no_file(
    name: str, options: Options, said: str, animation: Animation, tmp_path: Path
) -> None:
    with pytest.raises(UsageError, match=said):
        export(animation, tmp_path / name, options)
    assert list(tmp_path.iterdir()) == []


def test_single_ribbons_have_no_surface_to_export(animation: Animation, tmp_path: Path) -> None:
    bare = Animation(
        animation.t_s, animation.node_m, animation.q_world_node, animation.valid, animation.names,
        np.zeros((FRAMES, 0, 0, 3), np.float32),
    )  # fmt: skip
    for suffix in (".glb", ".obj"):
        with pytest.raises(UsageError, match="surface"):
            export(bare, tmp_path / f"x{suffix}")
    for suffix in (".csv", ".npz", ".bvh", ".usda"):
        assert export(bare, tmp_path / f"x{suffix}")


def test_a_failed_export_leaves_the_file_before_it(
    animation: Animation, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "x.csv"
    export(animation, path)
    before = path.read_bytes()

    def fail(*_: object) -> None:
        raise OSError("disk full")

    monkeypatch.setattr("ribbonhost.export.tables.write_csv", fail)
    with pytest.raises(OSError, match="disk full"):
        export(animation, path)
    assert path.read_bytes() == before
    assert [p.name for p in tmp_path.iterdir()] == ["x.csv"]


@LIBRARY_LEAVES_PIPES_OPEN
def test_every_format_is_written(animation: Animation, tmp_path: Path) -> None:
    short = animation.between(0.0, 0.1)
    for suffix in FORMATS:
        for file in export(short, tmp_path / f"y{suffix}"):
            assert file.stat().st_size > 0
