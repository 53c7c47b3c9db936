"""What is wrong with a string: from what was measured to a verdict a slot and sentences."""

import identity
import parts
import readings
import sentences as say

NOISE_MAX = 2.0  # times what the data sheet has; the noise of 64 readings is known to 9 %
SUPPLY_V = (3.1, 3.5)
RIPPLE_MAX_V = 0.02
REST_MIN = 2  # so many silent slots at the end are a broken chain rather than missing parts
SHIFT_MIN = 3  # so many slots of the wrong kind at the end are a chain that is shifted
GAPS_MIN = readings.SCANS // 16


class Findings:
    """All that was measured. Lists are by slot.

    miso: levels with pull-up and pull-down. is_idle_silent: no part answers while none is selected;
    always_selected: the slots of those that do, as far as known. parts: the part or None; answers: FOUND to
    CHANGING of identity. beyond: a part answers behind the last slot. second: the second part that answers.
    keeps: settings read back. statistics: of the readings, or None. alike: pairs of slots that read the same.
    supply: (mean V, ripple V) at rest and the same while scanned, or None.
    """

    def __init__(self, slots):
        self.slots = slots
        self.miso = (1, 0)
        self.is_idle_silent = True
        self.always_selected = []
        self.parts = [None] * slots
        self.answers = [identity.SILENT] * slots
        self.beyond = False
        self.second = [None] * slots
        self.keeps = [True] * slots
        self.statistics = [None] * slots
        self.alike = []
        self.supply = None


class Diagnosis:
    """verdicts: by slot, "ok" or a few words. faults: sentences."""

    def __init__(self, slots):
        self.verdicts = ["ok"] * slots
        self.faults = []

    def fault(self, sentence, verdict, slots):
        """Adds a sentence, and its verdict for all slots that it is about."""
        self.faults.append(sentence)
        for slot in slots:
            self.verdicts[slot] = verdict

    def pair(self, sentence, verdict, i, j):
        """Adds a sentence about two slots; the verdict of each names the other."""
        self.fault(sentence.format(i, j), f"{verdict} {j}", (i,))
        self.verdicts[j] = f"{verdict} {i}"


def diagnose(findings):
    """The Diagnosis of all that was found. What hides the rest is told alone."""
    diagnosis = Diagnosis(findings.slots)
    if not any(hides(findings, diagnosis) for hides in (_bus_is_held, _always_selected, _is_longer)):
        _shorted(findings, diagnosis)
        _wrong_kind(findings, diagnosis)
        _broken_chain(findings, diagnosis)
        _each_slot(findings, diagnosis)
        for kind in range(len(parts.KINDS)):
            _noise(findings, diagnosis, kind)
    _supply(findings, diagnosis)
    return diagnosis


def _bus_is_held(findings, diagnosis):
    everything = range(findings.slots)
    up, down = findings.miso
    if not up and not down:
        diagnosis.fault(say.MISO_LOW, "MISO low", everything)
    elif not findings.is_idle_silent or any(answer != identity.SILENT for answer in findings.answers):
        return False
    elif up and down:
        diagnosis.fault(say.MISO_HIGH, "MISO high", everything)
    else:
        diagnosis.fault(say.NOTHING, "silent", everything)
    return True


def _always_selected(findings, diagnosis):
    if findings.is_idle_silent:
        return False
    slots = findings.always_selected
    where = say.SOMETHING_ANSWERS
    if slots:
        where = (say.SELECTS_ARE_LOW if slots[1:] else say.SELECT_IS_LOW).format(say.names(slots, False))
    diagnosis.fault(say.ALWAYS_SELECTED.format(where), "hidden", range(findings.slots))
    for slot in slots:
        diagnosis.verdicts[slot] = "always selected"
    return True


def _is_longer(findings, diagnosis):
    if findings.beyond:
        diagnosis.fault(say.LONGER.format(findings.slots - 1), "hidden", range(findings.slots))
    return findings.beyond


def _shorted(findings, diagnosis):
    for i, j in findings.alike:
        diagnosis.pair(say.SHORTED, "shorted to", i, j)
    double = [slot for slot in range(findings.slots) if findings.second[slot]]
    if len(double) == 2:
        diagnosis.pair(say.SHORTED, "shorted to", *double)
    elif double:
        diagnosis.fault(say.TWO_PARTS.format(say.names(double, False)), "two parts", double)


def _wrong_kind(findings, diagnosis):
    wrong = [
        slot
        for slot, part in enumerate(findings.parts)
        if part and part.kind != parts.kind_of_slot(slot) and diagnosis.verdicts[slot] == "ok"
    ]
    if len(wrong) >= SHIFT_MIN and wrong == list(range(wrong[0], findings.slots)):
        diagnosis.fault(say.SHIFTED.format(wrong[0]), "wrong kind", wrong)
        return
    while wrong:
        slot = wrong.pop(0)
        kind = findings.parts[slot].kind
        other = next((o for o in wrong if findings.parts[o].kind != kind), None)
        if other is None:
            belongs = parts.KINDS[parts.kind_of_slot(slot)]
            diagnosis.fault(say.WRONG_KIND.format(slot, parts.KINDS[kind], belongs), "wrong kind", (slot,))
        else:
            wrong.remove(other)
            diagnosis.pair(say.CROSSED, "crossed with", slot, other)


def _broken_chain(findings, diagnosis):
    first = findings.slots
    while findings.answers[first - 1] == identity.SILENT:
        first -= 1
    if findings.slots - first >= REST_MIN:
        rest = range(first, findings.slots)
        diagnosis.fault(say.BROKEN_CHAIN.format(first, first - 1), "silent", rest)


def _each_slot(findings, diagnosis):
    for verdict, is_so, sentence in _SLOT_FAULTS:
        slots = [s for s in range(findings.slots) if diagnosis.verdicts[s] == "ok" and is_so(findings, s)]
        if slots:
            diagnosis.fault(sentence.format(say.names(slots)), verdict, slots)


def _answers(wanted):
    return lambda findings, slot: findings.answers[slot] == wanted


def _has_gaps(findings, slot):
    statistics = findings.statistics[slot]
    return statistics is not None and statistics.silent >= GAPS_MIN


def _loses_settings(findings, slot):
    return not findings.keeps[slot]


def _is_stale(findings, slot):
    statistics = findings.statistics[slot]
    return statistics is not None and statistics.sigma is None


def _is_stuck(findings, slot):
    statistics = findings.statistics[slot]
    return statistics is not None and min(statistics.sigma) == 0


# The first that holds of a slot is its verdict.
_SLOT_FAULTS = (
    ("silent", _answers(identity.SILENT), say.SILENT),
    ("MISO low", _answers(identity.LOW), say.LOW),
    ("unknown id", _answers(identity.UNKNOWN), say.UNKNOWN_ID),
    ("garbage", _answers(identity.CHANGING), say.GARBAGE),
    ("bad contact", _answers(identity.CONTACT), say.CONTACT),
    ("bad contact", _has_gaps, say.CONTACT),
    ("loses settings", _loses_settings, say.LOSES_SETTINGS),
    ("no readings", _is_stale, say.NO_READINGS),
    ("stuck", _is_stuck, say.STUCK),
)


def _noise(findings, diagnosis, kind):
    measured, noisy = [], []
    for slot, part in enumerate(findings.parts):
        if part and part.kind == kind and diagnosis.verdicts[slot] == "ok":
            measured.append(slot)
            if max(findings.statistics[slot].sigma) > NOISE_MAX * readings.expected_sigma(part):
                noisy.append(slot)
    if len(noisy) > 1 and len(noisy) > len(measured) // 2:
        sentence = say.ALL_NOISY.format(parts.KINDS[kind], NOISE_MAX, say.WHY_ALL_NOISY[kind])
        diagnosis.fault(sentence, "noisy", noisy)
    elif noisy:
        diagnosis.fault(say.NOISY.format(say.names(noisy), NOISE_MAX), "noisy", noisy)


def _supply(findings, diagnosis):
    if findings.supply is None:
        return
    (rest_v, rest_ripple_v), (_, scan_ripple_v) = findings.supply
    if not SUPPLY_V[0] <= rest_v <= SUPPLY_V[1]:
        diagnosis.faults.append(say.SUPPLY.format(rest_v, *SUPPLY_V))
    if rest_ripple_v > RIPPLE_MAX_V:
        diagnosis.faults.append(say.RIPPLE.format(1000 * rest_ripple_v))
    elif scan_ripple_v > RIPPLE_MAX_V:
        diagnosis.faults.append(say.RIPPLE_OF_STRING.format(1000 * scan_ripple_v, 1000 * rest_ripple_v))
