"""One ribbon on a link: who it is, what it sends, what it is told, and what its clock says."""

from ribbonhost.device.absences import Absences
from ribbonhost.device.absent import absent_device
from ribbonhost.device.counters import Counters
from ribbonhost.device.device import Device, open_device
from ribbonhost.device.observer import Observer
from ribbonhost.device.recorded import RecordedDevice
from ribbonhost.device.scans import Scan
from ribbonhost.device.seeker import Seeker

__all__ = [
    "Absences",
    "Counters",
    "Device",
    "Observer",
    "RecordedDevice",
    "Scan",
    "Seeker",
    "absent_device",
    "open_device",
]
