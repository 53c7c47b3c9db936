"""The 3.3 V supply as the MCU sees it: its ADC measures the internal reference in units of the supply."""

import math
import time
from array import array

REFERENCE_V = 1.21  # typical
FACTORY_ADDRESS = 0x1FFF7A2A  # what the factory read of the reference (data sheet DS8626, 5.3.24)
FACTORY_V = 3.3
FACTORY_COUNTS = (1400, 1600)
FULL_SCALE = 4095
READINGS = 300
BETWEEN_US = 100  # 300 readings see ripple from 50 Hz up


class Supply:
    """Raises ImportError, AttributeError or ValueError where MicroPython has no ADC on the reference."""

    def __init__(self):
        from machine import ADC, mem16

        self._adc = ADC(ADC.CORE_VREF)
        factory = mem16[FACTORY_ADDRESS]
        is_known = FACTORY_COUNTS[0] < factory < FACTORY_COUNTS[1]
        self._volt_counts = factory * FACTORY_V if is_known else REFERENCE_V * FULL_SCALE
        self._counts = array("H", bytes(2 * READINGS))
        self._n = 0

    def is_full(self):
        return self._n == READINGS

    def sample(self):
        """Measures once, if not READINGS times already."""
        if not self.is_full():
            self._counts[self._n] = max(self._adc.read_u16() >> 4, 1)
            self._n += 1

    def rest(self):
        """Measures for READINGS * BETWEEN_US, while nothing else goes on."""
        for _ in range(READINGS):
            self.sample()
            time.sleep_us(BETWEEN_US)

    def take(self):
        """Mean and RMS ripple, V, of what was measured since the last call."""
        n = self._n
        mean = sum(self._volt_counts / self._counts[i] for i in range(n)) / n
        ripple = math.sqrt(sum((self._volt_counts / self._counts[i] - mean) ** 2 for i in range(n)) / n)
        self._n = 0
        return mean, ripple
