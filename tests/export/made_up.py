"""A motion that means nothing, for what is written of any."""

import numpy as np
from ribbonhost.export import Animation

RIBBONS, NODES, U, W = 3, 6, 9, 5


def made_up(frames: int, seed: int) -> Animation:
    """Nodes anywhere in a cube of 2 m, and a surface of (U, W) points, 20 frames a second."""
    random = np.random.default_rng(seed)
    q = random.normal(size=(frames, RIBBONS, NODES, 4))
    return Animation(
        t_s=np.arange(frames) / 20,
        node_m=random.uniform(-1, 1, (frames, RIBBONS, NODES, 3)),
        q_world_node=q / np.linalg.norm(q, axis=-1, keepdims=True),
        valid=np.ones((frames, RIBBONS, NODES), bool),
        names=("reference", "left", "right"),
        surface_m=random.uniform(-1, 1, (frames, U, W, 3)).astype(np.float32),
    )
