"""Readings of all parts over and over: their noise, and which of them are the same."""

import math
import time

import hardware as hw
import parts
from identity import is_all

SCANS = 64
NEW_MIN = SCANS // 2
LIVELY_MIN = SCANS // 4
ALIKE_MIN = SCANS // 8
SAMPLES = 1.25  # of a part in a period, so that each scan finds a new one whatever its oscillator
PERIOD_US = max(int(1e6 * SAMPLES / part.sample_hz) for part in hw.PARTS if not part.measurement_us)


def bring_up(string, found):
    """Sets every part as the firmware does at its lowest rate; for each slot whether that can be read back.

    found: the part of each slot, or None.
    """
    string.walk([part.reset if part else None for part in found])
    time.sleep_us(max(part.reset_us for part in hw.PARTS))
    string.walk([part.config_write if part else None for part in found])
    string.walk([part.polarise if part else None for part in found])
    keeps = []
    answers = string.walk([_read_config(part) if part else None for part in found])
    for part, answer in zip(found, answers):
        wrong = 0
        if answer:
            for read, written, mask in zip(answer, part.config_write[1:], part.config_mask):
                wrong |= (read ^ written) & mask
        keeps.append(not wrong)
    return keeps


def _read_config(part):
    if not part.config_read_command:
        return None
    return bytes([part.config_read_command]) + bytes(len(part.config_mask))


def work_hard(string, found, after):
    """A walk in which every part does what takes most current: flip its bridge, or else measure or answer."""
    string.walk([part.polarise or part.trigger or burst(part) if part else None for part in found], after)


class Scanner:
    """Reads all parts of a string over and over, every PERIOD_US."""

    def __init__(self, string, found):
        self._string = string
        self._triggers = [part.trigger if part else None for part in found]
        self._bursts = [burst(part) if part else None for part in found]
        self._wait_us = max(part.measurement_us for part in hw.PARTS)
        self._due_us = time.ticks_us()

    def scan(self):
        """The burst of each slot, or None."""
        self._due_us = time.ticks_add(self._due_us, PERIOD_US)
        self._string.walk(self._triggers)
        time.sleep_us(self._wait_us)
        left_us = time.ticks_diff(self._due_us, time.ticks_us())
        if left_us > 0:
            time.sleep_us(left_us)
        else:
            self._due_us = time.ticks_us()
        return self._string.walk(self._bursts)


def burst(part):
    """The transaction that reads a sample."""
    return bytes([part.burst_command]) + bytes(part.burst_count)


class Readings:
    """What one slot gave in all scans."""

    def __init__(self, part):
        self.part = part
        self._bytes = bytearray(SCANS * part.burst_count)
        self.count = 0

    def add(self, answer):
        n = self.part.burst_count
        self._bytes[self.count * n : (self.count + 1) * n] = answer
        self.count += 1

    def counts(self, scan):
        """Counts of x, y and z in a scan, and whether they are new."""
        n = self.part.burst_count
        return parts.decode(self.part, self._bytes[scan * n : (scan + 1) * n])

    def _data(self, scan):
        n = self.part.burst_count
        first, end = parts.DATA[self.part.name]
        return self._bytes[scan * n + first : scan * n + end]

    def is_lively(self):
        """Whether the counts change at all."""
        return len({bytes(self._data(scan)) for scan in range(self.count)}) >= LIVELY_MIN

    def is_like(self, other):
        """Whether another slot gave the same counts more often than by chance (1 in 100 scans at most).

        Not always: a part may take a new sample between the two.
        """
        if other.part is not self.part:
            return False
        return sum(self._data(scan) == other._data(scan) for scan in range(self.count)) >= ALIKE_MIN

    def is_silent(self, scan):
        n = self.part.burst_count
        return is_all(self._bytes[scan * n : (scan + 1) * n], 0xFF)


class Statistics:
    """Noise of one part. new: scans that gave a new reading; silent: scans without any answer.

    sigma: of x, y and z in parts.UNITS, counted over the new readings; None if there are too few.
    """

    def __init__(self, readings):
        self.new = self.silent = 0
        self.sigma = None
        part = readings.part
        first = None
        sums, squares = [0, 0, 0], [0, 0, 0]
        for scan in range(readings.count):
            counts, is_new = readings.counts(scan)
            if readings.is_silent(scan):
                self.silent += 1
            elif is_new:
                self.new += 1
                first = first or counts
                for axis in range(3):
                    # Whole numbers: floats of the board have 24 bits.
                    difference = counts[axis] - first[axis]
                    sums[axis] += difference
                    squares[axis] += difference * difference
        if self.new >= NEW_MIN:
            n = self.new
            unit = part.lsb * parts.UNIT_SCALE[part.kind]
            variances = [(n * square - sum_ * sum_) / (n * (n - 1)) for sum_, square in zip(sums, squares)]
            self.sigma = [unit * math.sqrt(variance) for variance in variances]


def expected_sigma(part):
    """Standard deviation of a reading as the data sheet has it, with rounding to counts, in parts.UNITS."""
    return parts.UNIT_SCALE[part.kind] * math.sqrt(part.noise * part.noise + part.lsb * part.lsb / 12)


def measure(string, found):
    """Readings of each slot, or None."""
    scanner = Scanner(string, found)
    readings = [Readings(part) if part else None for part in found]
    for _ in range(SCANS):
        for slot, answer in zip(readings, scanner.scan()):
            if slot:
                slot.add(answer)
    return readings


def alike(readings):
    """Pairs of slots that read the same over and over, which two parts with noise of their own never do."""
    lively = [i for i, slot in enumerate(readings) if slot and slot.is_lively()]
    return [
        (min(i, j), max(i, j))
        for i in lively
        for j, slot in enumerate(readings)
        if i != j and (j > i or j not in lively) and slot and readings[i].is_like(slot)
    ]
