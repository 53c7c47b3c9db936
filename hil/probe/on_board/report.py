"""The probe's table and sentences, as text."""

import identity
import parts
import readings
import sentences as say

HEAD = "slot  part       id            noise x       y       z   data sheet  verdict"
NO_NOISE = f"{'-':>7s} {'-':>7s} {'-':>7s} {'':12s}"


def table(findings, places, diagnosis):
    """One line a slot: part, id, noise of each axis and what the data sheet has, verdict."""
    print(HEAD)
    for slot, (part, verdict) in enumerate(zip(findings.parts, diagnosis.verdicts)):
        name = part.name if part else "-"
        answers = [part.identity] if part else identity.answers_of(places[slot][-1])
        shown = " ".join([answer.hex() for answer in answers])
        print(f"{slot:4d}  {name:9s}  {shown:12s}  {_noise(findings.statistics[slot], part)}  {verdict}")


def _noise(statistics, part):
    if not statistics or not statistics.sigma:
        return NO_NOISE
    form = "{:.1f}" if part.kind == 0 else "{:.3f}"
    x, y, z, expected = [form.format(v) for v in statistics.sigma + [readings.expected_sigma(part)]]
    return f"{x:>7s} {y:>7s} {z:>7s} {expected:>6s} {parts.UNITS[part.kind]:5s}"


def supply(findings, reason):
    """The supply in one line; reason: why it was not measured."""
    if findings.supply is None:
        print(f"\nsupply at the MCU: not measured, {reason}")
        return
    (rest_v, rest_ripple_v), (_, scan_ripple_v) = findings.supply
    ripple = f"{1000 * rest_ripple_v:.0f} mV at rest, {1000 * scan_ripple_v:.0f} mV while scanned"
    print(f"\nsupply at the MCU: {rest_v:.2f} V, ripple (RMS) {ripple}")


def summary(faults, slots, walk):
    """Every fault, and the verdict."""
    print()
    for fault in faults:
        print(f"- {fault}")
    if faults:
        print(say.FAIL.format(say.number(len(faults), "fault")))
    else:
        print(say.PASS.format(slots))
        if not walk:
            print(say.TRY_WALK)
