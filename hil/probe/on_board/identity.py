"""Which part answers in which slot, and what answers where none or another should."""

import time

import hardware as hw

ROUNDS = 8
BETWEEN_ROUNDS_US = 10_000  # so that a bad contact is seen both ways
REGISTERS_MAX = 128  # of a part

FOUND, SILENT, LOW, UNKNOWN, CONTACT, CHANGING = range(6)


def signatures_of(string):
    """The signatures of each slot in ROUNDS rounds, and of one place behind the last slot.

    A signature is what a place answers to the identity commands of all parts, one after the other.
    """
    places = [[] for _ in range(string.slots + 1)]
    for _ in range(ROUNDS):
        signatures = [b""] * len(places)
        for part in hw.PARTS:
            answers = string.walk([query(part)] * len(places))
            string.release()
            signatures = [signature + answer for signature, answer in zip(signatures, answers)]
        for place, signature in zip(places, signatures):
            place.append(signature)
        time.sleep_us(BETWEEN_ROUNDS_US)
    return places


def is_silent(string):
    """Whether nothing answers while no slot is selected."""
    return all(is_all(string.exchange(query(part)), 0xFF) for part in hw.PARTS)


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


def query(part):
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
    signature = b"".join([string.walk(_only(string, slot, query(part)))[slot] for part in hw.PARTS])
    string.walk(_only(string, slot, as_before))
    return part_of(signature)


def _only(string, slot, command):
    return [command if place == slot else None for place in range(string.slots)]
