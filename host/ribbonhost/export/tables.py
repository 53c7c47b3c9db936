"""Tables of node positions and orientations: CSV, NPZ, Parquet."""

from pathlib import Path

import numpy as np

from ribbonhost.errors import MissingExtraError
from ribbonhost.export.animation import Animation

COLUMNS = ("t_s", "ribbon", "node", "x_m", "y_m", "z_m", "qw", "qx", "qy", "qz", "valid")


def _columns(animation: Animation) -> dict[str, np.ndarray]:
    """One row a frame, ribbon and node."""
    frames, ribbons, nodes, _ = animation.node_m.shape
    p = animation.node_m.reshape(-1, 3)
    q = animation.q_world_node.reshape(-1, 4)
    return {
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


def write_csv(animation: Animation, path: Path) -> None:
    """One row a frame, ribbon and node, a header line with units; nine decimals of a metre."""
    columns = _columns(animation)
    with path.open("w", encoding="utf-8", newline="\n") as file:
        file.write(",".join(COLUMNS) + "\n")
        rows = zip(*(columns[name].tolist() for name in COLUMNS), strict=True)
        file.writelines(
            f"{t:.6f},{ribbon},{node},{x:.9f},{y:.9f},{z:.9f},{w:.9f},{i:.9f},{j:.9f},{k:.9f},{int(valid)}\n"
            for t, ribbon, node, x, y, z, w, i, j, k, valid in rows
        )


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
        )


def write_parquet(animation: Animation, path: Path) -> None:
    """The rows of the CSV as Apache Parquet. Raises MissingExtraError without pyarrow."""
    try:
        import pyarrow as pa
        import pyarrow.parquet as pq
    except ImportError as error:
        raise MissingExtraError(".parquet", "pyarrow", "export") from error
    pq.write_table(pa.table(_columns(animation)), path)
