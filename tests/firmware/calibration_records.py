"""Calibration records to test with."""

from __future__ import annotations

import numpy as np
from ribbonhil._firmware import lib
from ribbonhost.wire import Calibration, SlotCalibrationArray

SLOTS: int = lib.RIBBON_SLOT_COUNT


def record(seed: int = 0, **changes: object) -> bytes:
    """A sound record with random numbers, packed; fields may be given."""
    rng = np.random.default_rng(seed)
    values: dict[str, object] = {
        "layout": 1,
        "mag_axes": 3,
        "created_s": 1_700_000_000 + seed,
        "pitch_m": 0.025,
        "field_horizontal_ut": 20.0 + seed % 7,
        "field_down_ut": 43.0,
        "slots": SlotCalibrationArray(
            offset=rng.normal(size=(SLOTS, 3)), matrix=np.eye(3).ravel() + 0.05 * rng.normal(size=(SLOTS, 9))
        ),
    }
    return Calibration(**{**values, **changes}).pack()  # type: ignore[arg-type]
