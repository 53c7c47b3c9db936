"""What is wrong and what to do, in words."""

MISO_LOW = (
    "MISO is low even against the pull-up: it touches ground, or a part without 3.3 V or ground holds "
    "it. Measure MISO against ground with the power off; then part the string to find where."
)
MISO_HIGH = (
    "MISO is high even against the pull-down and no slot answers: it touches 3.3 V, or it has a pull-up"
    " of its own and nothing else arrives. Measure MISO against 3.3 V with the power off."
)
NOTHING = (
    "No slot answers and MISO is free: check that 3.3 V and ground reach the string, then SEL_CLK, "
    "SEL_DATA, SCK, MOSI and MISO at the connector, one by one."
)
ALWAYS_SELECTED = (
    "{} while no slot is selected: a select touches ground, or a flip-flop has no power or clock; where"
    " all from one slot on are low, the data of a flip-flop touches ground. No other slot can be judged"
    " until that is mended."
)
SELECT_IS_LOW = "The select of {} is low"
SELECTS_ARE_LOW = "The selects of {} are low"
SOMETHING_ANSWERS = "One or more parts answer"
LONGER = (
    "A part answers behind slot {}: the string is longer. Type how many slots it has: make probe SLOTS=..."
)
SHORTED = (
    "The selects of slots {0} and {1} are shorted: both parts answer in either slot. Look for a bridge "
    "of solder between the outputs of flip-flops {0} and {1} or along these two wires."
)
TWO_PARTS = "In {} two parts answer at once: their selects touch each other, or others."
CROSSED = (
    "The selects of slots {0} and {1} are crossed: each leads to the part of the other. Exchange the "
    "wires from flip-flops {0} and {1} to the parts."
)
SHIFTED = (
    "From slot {0} on every part is of the other kind: there is a flip-flop too many or too few in "
    "front of slot {0}."
)
WRONG_KIND = "In slot {} answers: {}; there belongs: {}."
BROKEN_CHAIN = (
    "No slot from {0} on answers: the select chain is broken between flip-flops {1} and {0} (data, "
    "SEL_CLK or power), or the rest of the string has no 3.3 V, ground, SCK, MOSI or MISO."
)
SILENT = "{} did not answer: no part, or its 3.3 V, ground, select, SCK, MOSI or MISO is open."
LOW = "{} answered zeros only: the part holds MISO low; check its 3.3 V and ground, then replace it."
UNKNOWN_ID = (
    "{} answered with the id of no known part: another part is soldered there, or MOSI or MISO lose bits."
)
GARBAGE = (
    "{} answered differently every time: look for bad joints of ground, SCK and MISO, then replace the part."
)
CONTACT = "{} answered only at times: look for a bad joint."
LOSES_SETTINGS = "{} did not keep what was written: check its supply and MOSI, then replace the part."
NO_READINGS = "{} gave no new readings: replace the part."
STUCK = "{} gave the same counts over and over on an axis: replace the part."
NOISY = (
    "{} had more than {:.0f} times the noise of the data sheet, and most others had not: check the 100 "
    "nF and the joints there, then replace the part."
)
ALL_NOISY = "Most {}s had more than {:.0f} times the noise of the data sheet, so it is not the parts: {}."
WHY_ALL_NOISY = (
    "the string was not at rest (lay it down and probe again), or its supply is not clean",
    "a motor, a transformer or a mains cable is near (move away and probe again), or the supply is not clean",
)
SUPPLY = (
    "The supply is {:.2f} V, not {} to {} V: take the string off and probe again; if it is right then, "
    "the string takes too much current."
)
RIPPLE = "The supply has {:.0f} mV RMS of ripple even at rest: try another USB supply, or a battery."
RIPPLE_OF_STRING = (
    "The supply has {:.0f} mV RMS of ripple while the string is scanned, at rest {:.0f} mV: its wires "
    "are too thin or too long, or capacitors are missing."
)

LAY_DOWN = "Lay the ribbon flat and let go of it."
PUSH = (
    "Now push a magnetised screwdriver, crosswise under the ribbon, from the connector to the far end "
    "and out, in about 10 s."
)
REVERSED = (
    "The {}s felt the magnet from the last slot to the first: it was moved from the wrong end, or the "
    "string is connected by its far end."
)
OUT_OF_TURN = (
    "The selects of slots {0} and {1} are crossed: each felt the magnet in the turn of the other. "
    "Exchange the wires from flip-flops {0} and {1} to the parts."
)
SHUFFLED = "In the places of {} sit, in this order, the parts that answer in slots {}: exchange the selects."
NOT_FELT = "{} did not feel the magnet: do it again, slower and nearer."
ORDER_LATER = "The order of the slots is looked at when nothing else is wrong."

PASS = "PASS: {} slots, in each a part of its kind that answers alone and is as quiet as it must be."
TRY_WALK = (
    "Selects that are crossed between two parts of one kind do not show so: make probe WALK=1 finds them."
)
FAIL = "FAIL: {} found."
STOPPED = "FAIL: stopped before the end, nothing was judged."


def names(slots, is_start=True):
    """Slots as a sentence names them: "Slots 3, 4 and 9"."""
    last = str(slots[-1])
    text = f"{', '.join([str(slot) for slot in slots[:-1]])} and {last}" if slots[1:] else last
    return f"{'Slot' if is_start else 'slot'}{'s' if slots[1:] else ''} {text}"


def number(count, noun):
    return f"{count} {noun}" if count == 1 else f"{count} {noun}s"
