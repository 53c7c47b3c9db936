"""Checks a new sensor string before any firmware runs on it, and says what is wrong with it.

Runs under MicroPython on the board that the string hangs on. A line that begins with PASS or FAIL tells the
result.
"""

import hardware
import identity
import order
import readings
import report
import sentences as say
from diagnosis import Findings, diagnose
from sensor_string import BAUD, SensorString
from supply import Supply


def main(slots=hardware.SLOTS, walk=False):
    """Probes a string of so many slots; walk: also the order of its parts. Returns the number of faults."""
    string = None
    try:
        print(f"String of {slots} slots on a {hardware.BOARD}, SPI at {BAUD // 1000} kHz\n")
        string = SensorString(slots)
        return _probe(string, walk)
    except KeyboardInterrupt:
        print(say.STOPPED)
        return 1
    finally:
        if string:
            string.release()


def _probe(string, walk):
    findings = Findings(string.slots)
    supply, reason = _supply()
    if supply:
        supply.rest()
        at_rest = supply.take()
    findings.miso = string.miso_levels()
    findings.is_idle_silent = identity.is_silent(string)
    if not findings.is_idle_silent:
        findings.always_selected = identity.always_selected(string)
    places = identity.signatures_of(string)
    found = _judge(places, findings)
    if findings.beyond:  # a walk over fewer slots than there are leaves one selected
        found = [None] * string.slots
    if any(findings.miso) and findings.is_idle_silent and not findings.beyond:
        for slot, answer in enumerate(findings.answers):
            if answer in (identity.LOW, identity.UNKNOWN):
                findings.second[slot] = identity.second_part(string, slot)
    findings.keeps = readings.bring_up(string, found)
    measured = readings.measure(string, found)
    findings.statistics = [readings.Statistics(slot) if slot else None for slot in measured]
    findings.alike = readings.alike(measured)
    if supply:
        while not supply.is_full():
            readings.work_hard(string, found, supply.sample)
        findings.supply = (at_rest, supply.take())
    diagnosis = diagnose(findings)
    report.table(findings, places, diagnosis)
    report.supply(findings, reason)
    faults = diagnosis.faults
    if walk and faults:
        print(say.ORDER_LATER)
    elif walk:
        faults = order.faults_of(order.follow(string, found, print))
    report.summary(faults, string.slots, walk)
    return len(faults)


def _judge(places, findings):
    """Fills in what the places along the chain answered; returns the part of each slot, or None."""
    judged = [identity.judge(place) for place in places]
    findings.beyond = judged.pop()[1] == identity.FOUND
    findings.parts = [part for part, _ in judged]
    findings.answers = [answer for _, answer in judged]
    return findings.parts


def _supply():
    """The supply to measure and "", or None and why not."""
    try:
        return Supply(), ""
    except (ImportError, AttributeError, ValueError) as error:
        return None, f"MicroPython on this board has no ADC on the reference ({error})"
