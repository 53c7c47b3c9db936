"""What the parts of a string answer: identities, what they keep of their settings, readings."""

import math
import time

import hardware as hw
import parts

ROUNDS = 8
BETWEEN_ROUNDS_US = 10_000  # so that a bad contact is seen both ways
SCANS = 64
PERIOD_US = 25_000
SCALE_SIGMA = 12  # the variance of rounding is a twelfth

REGISTERS_MAX = 128  # of a part

FOUND, SILENT, LOW, UNKNOWN, CONTACT, CHANGING = range(6)


def identities(string):
    """The signatures of each slot in ROUNDS rounds, and of one place behind the last slot.

    A signature is what a place answers to the identity commands of all parts, one after the other.
    """
    places = [[] for _ in range(string.slots + 1)]
    for _ in range(ROUNDS):
        signatures = [b""] * len(places)
        for part in hw.PARTS:
            answers = string.walk([identify(part)] * len(places))
            string.release()
            signatures = [signature + answer for signature, answer in zip(signatures, answers)]
        for place, signature in zip(places, signatures):
            place.append(signature)
        time.sleep_us(BETWEEN_ROUNDS_US)
    return places


def idle_signature(string):
    """The signature of no slot at all, that is all 0xFF if every select is as it should be."""
    return b"".join([string.exchange(identify(part)) for part in hw.PARTS])


def always_selected(string):
    """The slots that sound, at length, as if none were selected: they are selected all the time.

    Such a part never sees a transaction end, and answers from wherever it has got to; where another part is
    selected too, the lower bits of both remain. Empty if that leaves nothing to compare.
    """
    at_length = bytes([hw.PARTS[0].identity_command]) + bytes(2 * REGISTERS_MAX)
    idle = _loudness(string.exchange(at_length))
    if idle == 0:
        return []
    return [
        slot
        for slot in range(string.slots)
        if _loudness(string.walk(_only(string, slot, at_length))[slot]) >= idle
    ]


def _loudness(answer):
    return sum(byte != 0 for byte in answer)


def identify(part):
    """The transaction that reads a part's identity."""
    return bytes([part.identity_command]) + bytes(len(part.identity))


def answers_of(signature):
    """What a signature has for each part in the order of hw.PARTS."""
    answers = []
    for part in hw.PARTS:
        answers.append(signature[: len(part.identity)])
        signature = signature[len(part.identity) :]
    return answers


def part_of(signature):
    """The part that has this signature, or None."""
    for part, answer in zip(hw.PARTS, answers_of(signature)):
        if answer == part.identity:
            return part
    return None


def is_all(answer, value):
    return all(byte == value for byte in answer)


def judge(signatures):
    """The part in a place, or None, and how the place answered: FOUND to CHANGING."""
    found = [part_of(signature) for signature in signatures]
    silent = [is_all(signature, 0xFF) for signature in signatures]
    if all(silent):
        return None, SILENT
    if all(signature == signatures[0] for signature in signatures):
        if found[0]:
            return found[0], FOUND
        return None, LOW if is_all(signatures[0], 0) else UNKNOWN
    part = next((part for part in found if part), None)
    return part, CONTACT if part and not _changes(signatures) else CHANGING


def _changes(signatures):
    """Whether an answer is not always the same, silence aside: a bad contact silences, noise changes bits."""
    for answers in zip(*[answers_of(signature) for signature in signatures]):
        if len({answer for answer in answers if not is_all(answer, 0xFF)}) > 1:
            return True
    return False


def second_part(string, slot):
    """The magnetometer that answers in a slot once an accelerometer there is told to be silent, or None.

    Two parts of different kinds that answer at once can be told from a part that holds MISO low only so: the
    accelerometer is made to answer on its data input, and after that as before.
    """
    silence = bytes([hw.LIS2DW12_CTRL2, hw.LIS2DW12_CTRL2_RESET | hw.LIS2DW12_CTRL2_SIM])
    as_before = bytes([hw.LIS2DW12_CTRL2, hw.LIS2DW12_CTRL2_RESET])
    string.walk(_only(string, slot, silence))
    signature = b"".join([string.walk(_only(string, slot, identify(part)))[slot] for part in hw.PARTS])
    string.walk(_only(string, slot, as_before))
    return part_of(signature)


def _only(string, slot, command):
    return [command if place == slot else None for place in range(string.slots)]


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
    """What one place gave in all scans."""

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
        return len({bytes(self._data(scan)) for scan in range(self.count)}) > SCANS // 4

    def is_like(self, other):
        """Whether another place gave the same counts in more than a quarter of the scans.

        Not in all: a part may take a new sample between the two.
        """
        if other.part is not self.part:
            return False
        return sum(self._data(scan) == other._data(scan) for scan in range(self.count)) > SCANS // 4

    def is_silent(self, scan):
        n = self.part.burst_count
        return is_all(self._bytes[scan * n : (scan + 1) * n], 0xFF)


class Statistics:
    """Noise of one part. new: scans that gave a new reading; silent: scans without any answer.

    sigma: of x, y and z in parts.UNITS, counted over the new readings; None if there are too few.
    """

    NEW_MIN = SCANS // 2

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
        if self.new >= self.NEW_MIN:
            n = self.new
            unit = part.lsb * parts.UNIT_SCALE[part.kind]
            variances = [(n * square - sum_ * sum_) / (n * (n - 1)) for sum_, square in zip(sums, squares)]
            self.sigma = [unit * math.sqrt(variance) for variance in variances]


def expected_sigma(part):
    """Standard deviation of a reading as the data sheet has it, with rounding to counts, in parts.UNITS."""
    return parts.UNIT_SCALE[part.kind] * math.sqrt(
        part.noise * part.noise + part.lsb * part.lsb / SCALE_SIGMA
    )


def measure(string, found):
    """Readings of each slot, or None."""
    scanner = Scanner(string, found)
    readings = [Readings(part) if part else None for part in found]
    for _ in range(SCANS):
        for place, answer in zip(readings, scanner.scan()):
            if place:
                place.add(answer)
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
