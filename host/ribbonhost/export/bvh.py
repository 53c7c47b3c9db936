"""Biovision hierarchy: each ribbon as a chain of joints, for character animation tools."""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from ribbonhost.export.animation import Animation

Array = NDArray[np.float64]


def write_bvh(animation: Animation, path: Path) -> None:
    """Writes all ribbons as chains under one root; joint k is node k of a ribbon.

    Each joint carries its own position channels, relative to its parent: ribbons bend between nodes, so
    rigid bones of constant offset could not hold the positions. Rotations are ZXY in degrees, relative to
    the parent joint.
    """
    frames, ribbons, nodes, _ = animation.node_m.shape
    lines = ["HIERARCHY", "ROOT comb", "{", "  OFFSET 0 0 0", f"  CHANNELS 6 {_CHANNELS}"]
    rest = animation.node_m[0]
    for r in range(ribbons):
        name = "".join(c if c.isalnum() else "_" for c in animation.names[r])
        for k in range(nodes):
            pad = "  " * (k + 1)
            offset = rest[r, k] - (rest[r, k - 1] if k else 0.0)
            lines += [f"{pad}JOINT {name}_{k}", f"{pad}{{", f"{pad}  OFFSET {_numbers(offset)}"]
            lines.append(f"{pad}  CHANNELS 6 {_CHANNELS}")
        end = "  " * (nodes + 1)
        lines += [f"{end}End Site", f"{end}{{", f"{end}  OFFSET 0 0 0", f"{end}}}"]
        lines += ["  " * (k + 1) + "}" for k in reversed(range(nodes))]
    lines.append("}")
    step_s = 1.0 / animation.rate_hz if animation.rate_hz else 0.01
    lines += ["MOTION", f"Frames: {frames}", f"Frame Time: {step_s:.9f}"]

    r_world = _matrices(animation.q_world_node)
    parent = np.concatenate(
        [np.broadcast_to(np.eye(3), (frames, ribbons, 1, 3, 3)), r_world[:, :, :-1]], axis=2
    )
    delta = np.diff(animation.node_m, axis=2, prepend=np.zeros((frames, ribbons, 1, 3)))
    local_p = np.einsum("frkji,frkj->frki", parent, delta)
    local_r = np.einsum("frkji,frkjl->frkil", parent, r_world)
    channels = np.concatenate([local_p, np.degrees(_zxy(local_r))], axis=-1).reshape(frames, -1)
    motion = np.concatenate([np.zeros((frames, 6)), channels], axis=1)
    with path.open("w", encoding="ascii", newline="\n") as file:
        file.write("\n".join(lines) + "\n")
        np.savetxt(file, motion, fmt="%.9f")


_CHANNELS = "Xposition Yposition Zposition Zrotation Xrotation Yrotation"


def _numbers(v: Array) -> str:
    return " ".join(f"{x:.9f}" for x in v)


def _matrices(q: Array) -> Array:
    """Rotation matrices (..., 3, 3) of unit quaternions (..., 4)."""
    w, x, y, z = np.moveaxis(q, -1, 0)
    rows = [
        [1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)],
        [2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)],
        [2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)],
    ]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def _zxy(r: Array) -> Array:
    """Angles (z, x, y) in radians with R = Rz Rx Ry."""
    x = np.arcsin(np.clip(r[..., 2, 1], -1.0, 1.0))
    z = np.arctan2(-r[..., 0, 1], r[..., 1, 1])
    y = np.arctan2(-r[..., 2, 0], r[..., 2, 2])
    return np.stack([z, x, y], axis=-1)
