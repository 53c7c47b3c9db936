"""What the bursts of each part mean."""

import hardware as hw

UNITS = ("mm/s2", "uT")
UNIT_SCALE = (1000.0, 1.0)  # from m/s^2 and uT
KINDS = ("accelerometer", "magnetometer")


def kind_of_slot(slot):
    """Accelerometers sit at slots 0, 2, 4 ..., magnetometers at 1, 3, 5 ..."""
    return slot % 2


def _signed(value, bits):
    return value - (1 << bits) if value >> (bits - 1) else value


# Of each burst the bytes that hold the counts: from, to.
DATA = {
    "LIS2DW12": (hw.LIS2DW12_OUT_X_L - hw.LIS2DW12_STATUS, hw.LIS2DW12_OUT_Z_H - hw.LIS2DW12_STATUS + 1),
    "MMC5983MA": (hw.MMC5983MA_XOUT0, hw.MMC5983MA_XYZOUT2 + 1),
    "HMC5983": (hw.HMC5983_OUT_X_MSB, hw.HMC5983_OUT_Y_LSB + 1),
}


def _lis2dw12(burst):
    unused = 16 - hw.LIS2DW12_COUNT_BITS
    counts = [_signed(burst[i] | burst[i + 1] << 8, 16) >> unused for i in range(*DATA["LIS2DW12"], 2)]
    return counts, bool(burst[0] & hw.LIS2DW12_STATUS_DRDY)


def _mmc5983ma(burst):
    low = burst[hw.MMC5983MA_XYZOUT2]
    counts = []
    for axis in range(3):
        high, middle = burst[hw.MMC5983MA_XOUT0 + 2 * axis], burst[hw.MMC5983MA_XOUT1 + 2 * axis]
        counts.append(
            (high << 10 | middle << 2 | (low >> (6 - 2 * axis) & 3)) - hw.MMC5983MA_NULL_FIELD_COUNT
        )
    return counts, bool(burst[hw.MMC5983MA_STATUS] & hw.MMC5983MA_STATUS_MEAS_M_DONE)


def _hmc5983(burst):
    x, z, y = (_signed(burst[i] << 8 | burst[i + 1], 16) for i in range(*DATA["HMC5983"], 2))
    return [x, y, z], burst[hw.HMC5983_MODE] & hw.HMC5983_MODE_MD_MASK != hw.HMC5983_MODE_SINGLE


_DECODE = {"LIS2DW12": _lis2dw12, "MMC5983MA": _mmc5983ma, "HMC5983": _hmc5983}


def decode(part, burst):
    """Counts of x, y and z, and whether they were not read before."""
    return _DECODE[part.name](burst)
