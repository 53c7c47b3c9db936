"""Motion of sensor ribbons without a gyroscope: live and over a recording."""

from ribbonhost.motion.live import LiveMotion
from ribbonhost.motion.model import Motion, MotionParams, Samples, Status
from ribbonhost.motion.recording import smooth_recording

__all__ = ["LiveMotion", "Motion", "MotionParams", "Samples", "Status", "smooth_recording"]
