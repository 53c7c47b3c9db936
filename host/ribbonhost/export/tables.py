"""Tables of node positions and orientations: CSV, NPZ, Parquet."""

from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np

from ribbonhost.errors import MissingExtraError
from ribbonhost.export.animation import Animation

MOTION_COLUMNS = ("vx_mps", "vy_mps", "vz_mps", "ax_mps2", "ay_mps2", "az_mps2", "sigma_rad", "radius_95_m")
"""Of recordings whose motion was estimated."""


def _columns(animation: Animation) -> dict[str, np.ndarray]:
    """One row a frame, ribbon and node."""
    frames, ribbons, nodes, _ = animation.node_m.shape
    p = animation.node_m.reshape(-1, 3)
    q = animation.q_world_node.reshape(-1, 4)
    columns = {
        "t_s": np.repeat(animation.t_s, ribbons * nodes),
        "ribbon": np.tile(np.repeat(np.array(animation.names), nodes), frames),
        "node": np.tile(np.arange(nodes), frames * ribbons),
        "x_m": p[:, 0],
        "y_m": p[:, 1],
        "z_m": p[:, 2],
        "qw": q[:, 0],
        "qx": q[:, 1],
        "qy": q[:, 2],
        "qz": q[:, 3],
        "valid": animation.valid.reshape(-1),
    }
    if m := animation.motion:
        vectors = (m.velocity_mps.reshape(-1, 3), m.acceleration_mps2.reshape(-1, 3))
        values = [*vectors[0].T, *vectors[1].T, m.sigma_rad.reshape(-1), m.radius_95_m.reshape(-1)]
        columns |= dict(zip(MOTION_COLUMNS, values, strict=True))
    return columns


def write_csv(animation: Animation, path: Path) -> None:
    """One row a frame, ribbon and node, a header line with units; nine decimals of a metre.

    What is not known is empty.
    """
    columns = _columns(animation)
    kinds = {"t_s": "{:.6f}", "ribbon": "{}", "node": "{}", "valid": "{:d}"}
    texts = [_texts(column, kinds.get(name, "{:.9f}")) for name, column in columns.items()]
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(columns) + "\n")
        file.writelines(",".join(row) + "\n" for row in zip(*texts, strict=True))


def _texts(column: np.ndarray, kind: str) -> Iterator[str]:
    """The values of a column as text; NaN is empty."""
    return (kind.format(value) if value == value else "" for value in column.tolist())


def write_npz(animation: Animation, path: Path) -> None:
    """The arrays of Animation under their own names."""
    with path.open("wb") as file:
        np.savez_compressed(
            file,
            t_s=animation.t_s,
            node_m=animation.node_m,
            q_world_node=animation.q_world_node,
            valid=animation.valid,
            names=np.array(animation.names),
            surface_m=animation.surface_m,
            **(asdict(animation.motion) if animation.motion else {}),
        )


def write_parquet(animation: Animation, path: Path) -> None:
    """The rows of the CSV as Apache Parquet. Raises MissingExtraError without pyarrow."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError(".parquet", "pyarrow", "export") from error
    pq.write_table(pa.table(_columns(animation)), path)
