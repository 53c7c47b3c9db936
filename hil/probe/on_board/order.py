"""Whether slots of one kind follow each other along the ribbon: a magnet is moved along it, under it.

Selects that are crossed between two parts of one kind leave no trace on the bus. What tells them apart is
where the parts are: each feels the magnet, or is tilted as the ribbon is lifted, when that is below it.
"""

import time

import identity
import parts
import readings
import sentences as say

UNTIL_REST_US = 5_000_000
REST_SCANS = 40
SCANS_MAX = 60_000_000 // readings.PERIOD_US
QUIET_SCANS = 120  # without any change, once something was felt: the magnet is off the ribbon
FELT = (1.0, 20.0)  # m/s^2 and uT from rest: 6 degrees, and a magnet nearer than a pitch


class Passage:
    """When one slot felt the magnet: the mean time, weighted with the square of the change."""

    def __init__(self, part):
        self.part = part
        self._rest = [0, 0, 0]
        self._resting = 0
        self._weight = self._moment = 0.0
        self.felt = False

    def rest(self, burst):
        """A burst read before the magnet moves."""
        if not identity.is_all(burst, 0xFF):
            counts, _ = parts.decode(self.part, burst)
            self._rest = [rest + count for rest, count in zip(self._rest, counts)]
            self._resting += 1

    def feel(self, scan, burst):
        """A burst read while the magnet moves; whether it is felt."""
        if identity.is_all(burst, 0xFF) or not self._resting:
            return False
        counts, _ = parts.decode(self.part, burst)
        squares = sum((count - rest / self._resting) ** 2 for count, rest in zip(counts, self._rest))
        change = squares * self.part.lsb * self.part.lsb
        if change < FELT[self.part.kind] ** 2:
            return False
        self.felt = True
        self._weight += change
        self._moment += change * scan
        return True

    def mean_scan(self):
        return self._moment / self._weight


def follow(string, found, tell):
    """A Passage for each slot with a part, else None; `tell` shows a sentence to the person."""
    passages = [Passage(part) if part else None for part in found]
    tell(say.LAY_DOWN)
    time.sleep_us(UNTIL_REST_US)
    scanner = readings.Scanner(string, found)
    for _ in range(REST_SCANS):
        for passage, burst in zip(passages, scanner.scan()):
            if passage:
                passage.rest(burst)
    tell(say.PUSH)
    last = SCANS_MAX
    for scan in range(SCANS_MAX):
        for passage, burst in zip(passages, scanner.scan()):
            if passage and passage.feel(scan, burst):
                last = scan
        if scan - last > QUIET_SCANS:
            break
    return passages


def faults_of(passages):
    """Sentences about slots that felt nothing, or not in their turn."""
    faults = []
    for kind, name in enumerate(parts.KINDS):
        felt = [slot for slot, passage in enumerate(passages) if passage and passage.felt]
        slots = [slot for slot in felt if passages[slot].part.kind == kind]
        passed = sorted(slots, key=lambda slot: passages[slot].mean_scan())
        if len(slots) > 1 and passed == slots[::-1]:
            faults.append(say.REVERSED.format(name))
        else:
            faults += _out_of_turn(dict(zip(slots, passed)))
    unfelt = [slot for slot, passage in enumerate(passages) if passage and not passage.felt]
    if unfelt:
        faults.append(say.NOT_FELT.format(say.names(unfelt)))
    return faults


def _out_of_turn(answers_at):
    """answers_at: by the slot whose place it is, the slot that the part there answers in."""
    moved = sorted(slot for slot, other in answers_at.items() if slot != other)
    pairs = [(i, answers_at[i]) for i in moved if i < answers_at[i] and answers_at[answers_at[i]] == i]
    faults = [say.OUT_OF_TURN.format(*pair) for pair in pairs]
    rest = [slot for slot in moved if answers_at[answers_at[slot]] != slot]
    if rest:
        answers = ", ".join([str(answers_at[slot]) for slot in rest])
        faults.append(say.SHUFFLED.format(say.names(rest, False), answers))
    return faults
