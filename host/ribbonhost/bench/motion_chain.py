"""From a true motion to samples: emulated sensors, firmware, RAW and ORIENT packets in virtual time."""

import dataclasses
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

import numpy as np

from ribbonhost import wire
from ribbonhost.bench.motion_trouble import at_sensors, dead_slots, on_the_way
from ribbonhost.bench.motion_truth import STEP_S, Case, Truth, make_truth
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.motion import MotionParams, Samples
from ribbonhost.motion.scans import Timing, params_of, samples_of

if TYPE_CHECKING:
    from ribbonhil.ribbon import Device

RATE_HZ = 100
START_UP_S = 1.0
"""The ribbon is powered up so long before the case begins."""


@dataclass(frozen=True, eq=False)
class Recording:
    """What came over the wire of a case, as samples; what was true; the one setting."""

    samples: Samples
    truth: Truth
    params: MotionParams


def record(case: Case) -> Recording:
    """Runs a case through the emulated ribbon. Raises SceneError for a scene that cannot be."""
    from ribbonhil.faults import Fault, FaultKind
    from ribbonhil.ribbon import Device, EmulatedRibbon
    from ribbonhil.stm32f405.session import Session
    from ribbonhil.truth import RibbonTruth

    truth = make_truth(case)
    felt = at_sensors(case, truth)
    lead = round(START_UP_S / STEP_S)
    # What came before a ribbon in full motion was motion, too; else it holds its first pose.
    before = np.arange(lead)[::-1] + 1 if case.starts == "motion" else np.zeros(lead, np.int64)
    rows = np.concatenate([before, np.arange(len(felt.force_mps2))])
    device, calibration = _calibrated_ribbon(case) if case.is_calibrated else (Device(seed=case.seed), None)
    ribbon = EmulatedRibbon.from_truth(
        RibbonTruth(
            np.ascontiguousarray(felt.force_mps2[rows]),
            np.ascontiguousarray(felt.field_ut[rows]),
            STEP_S,
            periodic=False,
        ),
        device,
    )
    if calibration:
        session = Session(ribbon)
        session.wait_for_info()
        session.write_calibration(calibration)
    for slot in dead_slots(case):
        ribbon.add_fault(Fault(FaultKind.ABSENT, slot, START_UP_S + 1.0))
    packets = run_ribbon(ribbon, START_UP_S + case.seconds)
    samples, params = collect(packets, calibration)
    params = dataclasses.replace(params, field_axes=case.axes)
    first = int(np.searchsorted(samples.t_s, 0.0))
    return Recording(on_the_way(case, samples[first:]), truth, params)


def run_ribbon(ribbon: Any, until_s: float, rate_hz: int = RATE_HZ) -> list[object]:
    """Lets an EmulatedRibbon send RAW and ORIENT at a rate until a true time; returns its packets."""
    ribbon.run_until(0.3)
    for tag, code, argument in (
        (1, wire.CommandCode.SET_RATE, rate_hz),
        (2, wire.CommandCode.SET_MODE, wire.Mode.ORIENT | wire.Mode.RAW),
        (3, wire.CommandCode.GET_INFO, 0),
    ):
        ribbon.write(encode_frame(wire.encode(wire.Command(tag, code, int(argument)))))
    ribbon.run_until(until_s)
    return [wire.decode(packet)[0] for packet in Deframer().feed(ribbon.read())]


def _calibrated_ribbon(case: Case) -> "tuple[Device, wire.Calibration]":
    """A ribbon of parts off the shelf, and what a bar and a table have told of their errors."""
    from ribbonhil.handling import Handling

    from ribbonhost.bench.calibration import calibrate_ribbon, drawn_devices

    devices = drawn_devices(case.seed)
    calibrated = calibrate_ribbon(
        devices, case.ribbon, Handling(seed=100 * case.seed + case.ribbon), case.axes
    )
    return calibrated.device, calibrated.result.record


def collect(
    packets: list[object], calibration: wire.Calibration | None = None
) -> tuple[Samples, MotionParams]:
    """Samples of the scans that have both RAW and ORIENT, at times of the case; the one setting."""
    info = next(p for p in packets[::-1] if isinstance(p, wire.Info))
    orients = {p.sequence: p for p in packets if isinstance(p, wire.Orient)}
    scans = [(p, orients[p.sequence]) for p in packets if isinstance(p, wire.Raw) and p.sequence in orients]
    t_s = np.array([raw.t_us for raw, _ in scans]) * 1e-6 - START_UP_S
    timing = Timing.of(scans[-1][0])
    return samples_of(info, scans, t_s, calibration), params_of(info, timing, calibration)
