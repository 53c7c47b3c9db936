"""Writes what is true of an emulated comb to an NPZ file, for comparing with what was reconstructed."""

import contextlib
import json
import os
import tempfile
from pathlib import Path

import numpy as np
from ribbonhost.errors import RibbonError, UsageError

from ribbonhil.truth import GRAVITY_MPS2, CombTruth, Field

VALUES_MAX = 100_000_000  # 64-bit floats in one array

UNITS = {
    "t_s": "s since the start of the motion, (T,)",
    "slot_position_m": "m, world, (T, R + 1, S, 3); ribbon 0 is the reference, slot 0 its anchor",
    "q_world_slot": "unit quaternion w x y z, world from node frame, (T, R + 1, S, 4)",
    "node_position_m": "m, world, (T, R + 1, n, 3)",
    "q_world_node": "unit quaternion w x y z, world from node frame, (T, R + 1, n, 4)",
    "slot_s_m": "m, arc length of each slot, (S,)",
    "node_s_m": "m, arc length of each node, (n,)",
    "start_m": "m, arc length on the reference where ribbons 1 ... R start, (R,)",
    "period_s": "s, period of the motion",
    "gravity_mps2": "m/s^2, along -z",
    "field_world_ut": "uT, magnetic field in the world, (3,)",
    "scene": "name of the scene",
    "units": "this table as JSON",
}


def write_truth(
    path: Path, scene: str, truth: CombTruth, field: Field, rate_hz: float, seconds: float, *, replace: bool
) -> int:
    """Writes the truth at rate_hz from time 0; returns the number of instants. Keys and units: UNITS.

    The file appears whole or not at all. Raises UsageError if it is there already and not to be replaced, or
    would be too large, RibbonError if it cannot be written.
    """
    if path.exists() and not replace:
        raise UsageError(f"{path} is there already: give another name, or --force to replace it")
    t_s = np.arange(max(1, round(seconds * rate_hz))) / rate_hz
    _, ribbons, slots, _ = truth.position_m.shape
    if len(t_s) * ribbons * slots * 4 > VALUES_MAX:
        raise UsageError(
            f"{len(t_s)} instants of {ribbons * slots} sensors are too many for one file: "
            "take a lower --rate or fewer --seconds"
        )
    position_m, q_world_slot = truth.slot_m(t_s), truth.q_world_slot(t_s)
    slot_s_m = np.arange(slots) * truth.pitch_m
    content = {
        "t_s": t_s,
        "slot_position_m": position_m,
        "q_world_slot": q_world_slot,
        "node_position_m": position_m[:, :, 1::2],
        "q_world_node": q_world_slot[:, :, 1::2],
        "slot_s_m": slot_s_m,
        "node_s_m": slot_s_m[1::2],
        "start_m": np.array(truth.start_m),
        "period_s": np.array(truth.period_s),
        "gravity_mps2": np.array(GRAVITY_MPS2),
        "field_world_ut": field.world_ut(),
        "scene": np.array(scene),
        "units": np.array(json.dumps(UNITS)),
    }
    try:
        _write_whole(path, content)
    except OSError as error:
        raise RibbonError(f"{path} cannot be written: {error.strerror or error}") from error
    return len(t_s)


def _write_whole(path: Path, content: dict[str, np.ndarray]) -> None:
    handle, name = tempfile.mkstemp(dir=path.parent, prefix=f".{path.name}.", suffix=".part")
    try:
        with os.fdopen(handle, "wb") as file:
            np.savez(file, allow_pickle=False, **content)
        os.chmod(name, 0o666 & ~_umask())
        os.replace(name, path)
    except BaseException:
        with contextlib.suppress(OSError):
            os.unlink(name)
        raise


def _umask() -> int:
    mask = os.umask(0)
    os.umask(mask)
    return mask
