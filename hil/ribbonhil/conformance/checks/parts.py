"""What the data sheets say of the parts."""

from __future__ import annotations

from ribbonhost.wire import Part

ACCELEROMETERS = (Part.LIS2DW12,)
MAGNETOMETERS = (Part.MMC5983MA, Part.HMC5983)
STANDARD_GRAVITY_MPS2 = 9.80665
# Counts on either side of zero, and smallest and largest full scale, of the data sheets. SI: m/s^2, uT.
COUNTS = {Part.LIS2DW12: 8192, Part.MMC5983MA: 131072, Part.HMC5983: 2048}
FULL_SCALE = {
    Part.LIS2DW12: (2 * STANDARD_GRAVITY_MPS2, 16 * STANDARD_GRAVITY_MPS2),
    Part.MMC5983MA: (800.0, 800.0),
    Part.HMC5983: (2048 / 1370 * 100.0, 2048 / 230 * 100.0),
}
FULL_SCALE_TOLERANCE = 0.05
