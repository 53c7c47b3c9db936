"""What data give no calibration to be trusted: each kind has a sentence of its own that says what to do."""

from __future__ import annotations

from enum import StrEnum

import numpy as np
from numpy.typing import NDArray

from ribbonhost.errors import CalibrationError


class Reason(StrEnum):
    """The kinds of bad data."""

    LOST_SCANS = "lost_scans"
    RESTARTED = "restarted"
    DEAD_SLOT = "dead_slot"
    STUCK_SENSOR = "stuck_sensor"
    SATURATED = "saturated"
    TEMPERATURE = "temperature"
    MOTION = "motion"
    TOO_FEW = "too_few_attitudes"
    ONE_AXIS = "one_axis"
    DISTURBED_FIELD = "disturbed_field"
    WRONG_FIELD = "wrong_field"
    SENSOR_DISAGREES = "sensor_disagrees"
    NOT_FLAT = "not_flat"
    BENT_BAR = "bent_bar"
    TWISTED_RIBBON = "twisted_ribbon"
    UNEXPLAINED = "unexplained"
    UNCERTAIN = "uncertain"
    OTHER_RIBBON = "other_ribbon"
    NOT_BETTER = "not_better"
    NOT_CALIBRATED = "not_calibrated"


class RefusedError(CalibrationError):
    """Data that are refused; nothing that a device holds has changed.

    Attributes:
        reason: which kind of bad data.
    """

    def __init__(self, reason: Reason, message: str) -> None:
        super().__init__(message)
        self.reason = reason


def slot_name(slot: int) -> str:
    """What a message calls a slot."""
    return f"slot {slot} ({'magnetometer' if slot % 2 else 'accelerometer'} {slot // 2 + 1})"


def listed(noun: str, numbers: NDArray[np.int64]) -> str:
    """`poses 3, 5 and 9`."""
    words = [str(int(number)) for number in numbers]
    if len(words) == 1:
        return f"{noun} {words[0]}"
    return f"{noun}s {', '.join(words[:-1])} and {words[-1]}"
