"""Animated glTF binary: the surface as a mesh with one morph target a frame, y up as glTF wants it."""

from pathlib import Path

import numpy as np

from ribbonhost.errors import MissingExtraError, UsageError
from ribbonhost.export.animation import Animation, grid_normals, grid_triangles

MAX_RATE_HZ = 30.0
"""Each frame is a whole morph target: beyond this rate files grow and viewers stall."""


def write_glb(animation: Animation, path: Path) -> None:
    """Raises UsageError without a surface, MissingExtraError without pygltflib."""
    if not animation.has_surface:
        raise UsageError(".glb holds a surface, and single ribbons span none: export .csv, .npz or .bvh")
    try:
        import pygltflib as gl
    except ImportError as error:
        raise MissingExtraError(".glb", "pygltflib", "export") from error
    if animation.rate_hz > MAX_RATE_HZ * 1.01:
        animation = animation.at_rate(MAX_RATE_HZ)
    animation = animation.with_up("y")
    frames, u, w, _ = animation.surface_m.shape
    positions = animation.surface_m.reshape(frames, -1, 3)
    normals = grid_normals(animation.surface_m).reshape(frames, -1, 3)
    gltf = gl.GLTF2()
    gltf.asset = gl.Asset(version="2.0", generator="ribbonhost")
    blob = bytearray()

    def accessor(data: np.ndarray, kind: str, component: int, target: int | None = None) -> int:
        while len(blob) % 4:
            blob.append(0)
        raw = data.tobytes()
        gltf.bufferViews.append(
            gl.BufferView(buffer=0, byteOffset=len(blob), byteLength=len(raw), target=target)
        )
        blob.extend(raw)
        flat = data.reshape(len(data), -1)
        gltf.accessors.append(
            gl.Accessor(
                bufferView=len(gltf.bufferViews) - 1, componentType=component, count=len(data), type=kind,
                min=flat.min(axis=0).tolist(), max=flat.max(axis=0).tolist(),
            )
        )  # fmt: skip
        return len(gltf.accessors) - 1

    index = accessor(grid_triangles(u, w).ravel(), "SCALAR", gl.UNSIGNED_INT, gl.ELEMENT_ARRAY_BUFFER)
    attributes = gl.Attributes(
        POSITION=accessor(positions[0], "VEC3", gl.FLOAT, gl.ARRAY_BUFFER),
        NORMAL=accessor(normals[0], "VEC3", gl.FLOAT, gl.ARRAY_BUFFER),
    )
    targets = [
        {
            "POSITION": accessor(positions[f] - positions[0], "VEC3", gl.FLOAT, gl.ARRAY_BUFFER),
            "NORMAL": accessor(normals[f] - normals[0], "VEC3", gl.FLOAT, gl.ARRAY_BUFFER),
        }
        for f in range(1, frames)
    ]
    # A metal without surroundings to mirror is drawn black.
    surface = gl.PbrMetallicRoughness(
        metallicFactor=0.0, roughnessFactor=0.6, baseColorFactor=[0.3, 0.5, 0.8, 1.0]
    )
    gltf.materials = [gl.Material(name="surface", pbrMetallicRoughness=surface, doubleSided=True)]
    gltf.meshes = [
        gl.Mesh(
            name="surface",
            primitives=[
                gl.Primitive(attributes=attributes, indices=index, material=0, targets=targets or None)
            ],
            weights=[0.0] * len(targets) or None,
        )
    ]
    gltf.nodes = [gl.Node(name="surface", mesh=0)]
    gltf.scenes = [gl.Scene(nodes=[0])]
    gltf.scene = 0
    if targets:
        weights = np.zeros((frames, frames - 1), np.float32)
        weights[np.arange(1, frames), np.arange(frames - 1)] = 1.0
        times = (animation.t_s - animation.t_s[0]).astype(np.float32)
        sampler = gl.AnimationSampler(
            input=accessor(times, "SCALAR", gl.FLOAT),
            output=accessor(weights.ravel(), "SCALAR", gl.FLOAT),
            interpolation="LINEAR",
        )
        channel = gl.AnimationChannel(sampler=0, target=gl.AnimationChannelTarget(node=0, path="weights"))
        gltf.animations = [gl.Animation(name="motion", samplers=[sampler], channels=[channel])]
    gltf.buffers = [gl.Buffer(byteLength=len(blob))]
    gltf.set_binary_blob(bytes(blob))
    gltf.save_binary(str(path))
