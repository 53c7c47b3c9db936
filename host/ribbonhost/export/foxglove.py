"""Frames as messages of the Foxglove schemas (protobuf): poses of nodes, and the surface in the scene."""

from typing import Any, Protocol

import numpy as np
from numpy.typing import NDArray

from ribbonhost.errors import MissingExtraError

Schema = tuple[str, str, bytes]
Message = tuple[str, Schema, bytes]
"""Topic, schema (name, encoding, data) and message."""

WORLD = "world"
RIBBON_WIDTH_M = 0.004


class Encode(Protocol):
    """Turns a frame into messages; ribbons that are not known are left out."""

    def __call__(
        self,
        t_unix_s: float,
        names: list[str],
        node_m: NDArray[np.float64],
        q_world_node: NDArray[np.float64],
        is_comb: bool,
    ) -> list[Message]:
        """names: of r ribbons, in a comb the reference first; node_m: (r, n, 3); q_world_node: (r, n, 4)."""


def foxglove_encoder() -> Encode:
    """Raises MissingExtraError without foxglove-sdk."""
    try:
        import foxglove.messages as fox
    except ImportError as error:
        raise MissingExtraError("finalise", "foxglove-sdk", "export") from error

    def schema_of(kind: Any) -> Schema:
        schema = kind.get_schema()
        return schema.name, schema.encoding, bytes(schema.data)

    poses_schema, scene_schema = schema_of(fox.PosesInFrame), schema_of(fox.SceneUpdate)

    def encode(
        t_unix_s: float,
        names: list[str],
        node_m: NDArray[np.float64],
        q_world_node: NDArray[np.float64],
        is_comb: bool,
    ) -> list[Message]:
        known = np.array([bool(np.isfinite(curve_m).all()) for curve_m in node_m])
        stamp = fox.Timestamp(int(t_unix_s), round(t_unix_s % 1.0 * 1e9) % 1_000_000_000)
        messages: list[Message] = []
        lines = []
        for index in np.flatnonzero(known):
            points_m, turned = node_m[index].tolist(), q_world_node[index].tolist()
            poses = [
                fox.Pose(
                    position=fox.Vector3(x=x, y=y, z=z), orientation=fox.Quaternion(w=w, x=qx, y=qy, z=qz)
                )
                for (x, y, z), (w, qx, qy, qz) in zip(points_m, turned, strict=True)
            ]
            packed = fox.PosesInFrame(timestamp=stamp, frame_id=WORLD, poses=poses)
            messages.append((f"/poses/{names[index]}", poses_schema, packed.encode()))
            lines.append(
                fox.LinePrimitive(
                    type=fox.LinePrimitiveLineType.LineStrip,
                    thickness=RIBBON_WIDTH_M,
                    points=[fox.Point3(x=x, y=y, z=z) for x, y, z in points_m],
                    color=fox.Color(r=0.75, g=0.25, b=0.13, a=1.0),
                )
            )
        entities = [
            fox.SceneEntity(
                timestamp=stamp, frame_id=WORLD, id="ribbons" if is_comb else names[0], lines=lines
            )
        ]
        rows = node_m[1:][known[1:]]
        if is_comb and len(rows) >= 2:
            corner = (
                np.arange(len(rows) - 1)[:, None] * rows.shape[1] + np.arange(rows.shape[1] - 1)
            ).ravel()
            right = corner + rows.shape[1]
            faces = np.stack([corner, right, right + 1, corner, right + 1, corner + 1], axis=1)
            surface = fox.TriangleListPrimitive(
                points=[fox.Point3(x=x, y=y, z=z) for x, y, z in rows.reshape(-1, 3).tolist()],
                indices=faces.ravel().tolist(),
                color=fox.Color(r=0.48, g=0.65, b=0.85, a=0.8),
            )
            entities.append(
                fox.SceneEntity(timestamp=stamp, frame_id=WORLD, id="surface", triangles=[surface])
            )
        messages.append(("/scene", scene_schema, fox.SceneUpdate(entities=entities).encode()))
        return messages

    return encode
