"""What calibration is worth: emulated combs with the errors of real parts, before and after it.

Every ribbon has errors of its own drawn by the seed, is turned on a bar by emulated hands, calibrated from
its RAW packets, and told its calibration; then the comb lies on a moving surface. All by way of the registers
of the parts, the firmware and its packets.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.bench.accuracy import LAYOUT, comb_errors
from ribbonhost.calibrate.bar import Result, calibrate_bar
from ribbonhost.calibrate.place import Place
from ribbonhost.calibrate.readings import Readings, readings_of
from ribbonhost.calibrate.refusals import RefusedError
from ribbonhost.calibrate.sensor_errors import matrix_basis
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.reconstruct import CombSolver

if TYPE_CHECKING:
    from ribbonhil.emulated_device import Device
    from ribbonhil.handling import Handling
    from ribbonhil.part_errors import PartErrors
    from ribbonhil.ribbon import EmulatedRibbon

Float64 = NDArray[np.float64]

RIBBONS = 5
RATE_HZ = 50
START_S = 0.2
STEP_S = 0.5  # a ribbon keeps only so many bytes for a reader
SETTLED_S = 2.0
WATCHED_S = 20.0
"""A period of the scene's own motion."""
PLACE = Place(field_ut=48.0, dip_deg=62.0, declination_deg=0.0, source="that of the emulation")


@dataclass(frozen=True)
class CalibratedRibbon:
    """One ribbon, its calibration, and how far that is from the truth.

    Attributes:
        error_sigmas: (K,) error of each parameter in its stated standard deviations.
        solve_s: how long it took from readings to result.
    """

    device: Device
    result: Result
    error_sigmas: Float64
    solve_s: float


def handled_readings(
    device: Device, devices: list[Device], index: int, handling: Handling, rate_hz: int = RATE_HZ
) -> tuple[wire.Info, Readings, wire.Calibration]:
    """What a ribbon sends while it is handled, and the calibration that it uses then."""
    from ribbonhil.ribbon import EmulatedRibbon
    from ribbonhil.stm32f405.session import Session
    from ribbonhil.truth import Field
    from ribbonhil.world import world_truth

    truth = world_truth(handling, len(devices) - 1, Field(), devices=devices)
    ribbon = EmulatedRibbon.from_truth(truth.ribbon(index), device)
    session = Session(ribbon)
    session.wait_for_info()
    in_use = session.read_calibration()
    info, raws = recorded_raw(ribbon, handling.period_s, rate_hz)
    return info, readings_of(info, raws), in_use


def recorded_raw(ribbon: EmulatedRibbon, seconds: float, rate_hz: int) -> tuple[wire.Info, list[wire.Raw]]:
    """INFO and the RAW packets of a ribbon in virtual time."""
    deframer = Deframer()
    raws: list[wire.Raw] = []
    info: wire.Info | None = None
    ribbon.run_until(max(START_S, ribbon.now_s))
    ribbon.read()
    commands = (
        (wire.CommandCode.SET_RATE, rate_hz),
        (wire.CommandCode.SET_MODE, int(wire.Mode.RAW)),
        (wire.CommandCode.GET_INFO, 0),
    )
    for tag, (code, argument) in enumerate(commands, 60_000):
        ribbon.write(encode_frame(wire.encode(wire.Command(tag, code, argument, b""))))
    end_s = ribbon.now_s + seconds
    while ribbon.now_s < end_s:
        ribbon.run_until(min(ribbon.now_s + STEP_S, end_s))
        for packet in deframer.feed(ribbon.read()):
            message = wire.decode(packet)[0]
            if isinstance(message, wire.Raw):
                raws.append(message)
            elif isinstance(message, wire.Info):
                info = message
    assert info is not None  # it was asked for
    return info, raws


def calibrate_ribbon(
    devices: list[Device], index: int, handling: Handling, axes: int = 2
) -> CalibratedRibbon:
    """Turns one ribbon of a comb on a bar, and calibrates it. Raises RefusedError."""
    device = devices[index]
    info, readings, in_use = handled_readings(device, devices, index, handling)
    start_s = time.perf_counter()
    result = calibrate_bar(
        readings, in_use, PLACE, axes=axes, pitch_m=float(info.pitch_m), created_s=1_700_000_000
    )
    solve_s = time.perf_counter() - start_s
    assert device.errors is not None  # a ribbon without errors needs no calibration
    true = np.append(true_values(device.errors, axes), np.radians(PLACE.dip_deg or 0.0))
    sigmas = (result.solution.values - true) / result.solution.sigma
    return CalibratedRibbon(device, result, sigmas, solve_s)


def true_values(errors: PartErrors, axes: int) -> Float64:
    """The errors of emulated parts as parameters of a Solution, without the dip."""
    rows = []
    for first, used in ((0, 3), (1, axes)):
        basis, names = matrix_basis(used)
        deviation = (errors.matrix[first::2, :used] - np.eye(3)[:used]).reshape(-1, used * 3)
        values = np.linalg.lstsq(basis.reshape(len(names), -1).T, deviation.T, rcond=None)[0].T
        rows.append(np.concatenate([values, errors.total_bias[first::2, :used]], axis=1).ravel())
    return np.concatenate(rows)


def comb_error(
    scene_name: str, devices: list[Device], records: list[wire.Calibration] | None
) -> tuple[float, float]:
    """Mean E over a period, percent, and the root mean square error of orientations, degrees."""
    from ribbonhil.ribbon import EmulatedRibbon
    from ribbonhil.scenes import load_scene
    from ribbonhil.stm32f405.session import Session
    from ribbonhil.truth import Field
    from ribbonhil.world import world_truth

    truth = world_truth(load_scene(scene_name), RIBBONS, Field(), devices=devices)
    sent = []
    for index, device in enumerate(devices):
        session = Session(EmulatedRibbon.from_truth(truth.ribbon(index), device))
        session.wait_for_info()
        if records:
            session.write_calibration(records[index])
        session.orients.clear()
        while session.ribbon.now_s < SETTLED_S + WATCHED_S:
            session.run_for(STEP_S)
        packets = [wire.decode(packet)[0] for packet in session.orients]
        sent.append({packet.t_us: packet for packet in packets if isinstance(packet, wire.Orient)})
    together = [t for t in sorted(set.intersection(*map(set, sent))) if t >= SETTLED_S * 1e6]
    nodes = [[packets[t].nodes for packets in sent] for t in together]
    q = np.array([[n.q_world_node for n in row] for row in nodes])
    valid: NDArray[np.bool_] = np.array([[n.valid for n in row] for row in nodes])
    t_s = np.array(together) * 1e-6
    seen = np.all(np.any(valid, axis=2), axis=1)
    solved = CombSolver(LAYOUT, "spline").solve_many(q[seen], valid[seen])
    percent = comb_errors(LAYOUT, solved.node_m, truth.node_from_anchor_m(t_s[seen])).percent
    cosine = np.abs(np.einsum("...i,...i", truth.q_world_slot(t_s)[:, :, 1::2], q))
    turned = 2 * np.degrees(np.arccos(np.clip(cosine[valid], 0, 1)))
    return float(np.nanmean(percent)), float(np.sqrt(np.mean(turned**2)))


def drawn_devices(seed: int) -> list[Device]:
    """The ribbons of a comb, their parts with errors drawn by the seed, their clocks exact."""
    from ribbonhil.emulated_device import drawn_device

    return [
        replace(drawn_device(seed, index, part_errors=seed), clock_ppm=0.0, clock_offset_us=0)
        for index in range(RIBBONS + 1)
    ]


def measure_calibration(
    seeds: int, scene: str, on_progress: Callable[[float], None] = lambda share: None
) -> dict[str, Any]:
    """Figures of so many combs, each before and after calibration; `on_progress` is told the share done.

    A ribbon whose calibration is refused is counted, and its comb has no figures after it.
    """
    from ribbonhil.handling import Handling

    combs: list[dict[str, Any]] = []
    refused: list[dict[str, Any]] = []
    for seed in range(1, seeds + 1):
        devices = drawn_devices(seed)
        ribbons = []
        for index in range(len(devices)):
            on_progress((seed - 1 + index / (len(devices) + 1)) / seeds)
            try:
                ribbons.append(calibrate_ribbon(devices, index, Handling(seed=100 * seed + index)))
            except RefusedError as error:
                refused.append(
                    {"seed": seed, "ribbon": index, "reason": str(error.reason), "message": str(error)}
                )
        on_progress((seed - 1 + len(devices) / (len(devices) + 1)) / seeds)
        before, before_deg = comb_error(scene, devices, None)
        comb = {"seed": seed, "error_before_percent": before, "orientation_error_before_deg": before_deg}
        combs.append(comb)
        if len(ribbons) == len(devices):
            comb.update(_after(scene, ribbons))
    percents = [comb["error_percent"] for comb in combs if "error_percent" in comb]
    return {
        "scene": scene,
        "ribbons": seeds * (RIBBONS + 1),
        "refused": refused,
        "combs": combs,
        "error_median_percent": float(np.median(percents)) if percents else None,
        "error_max_percent": float(np.max(percents)) if percents else None,
    }


def _after(scene: str, ribbons: list[CalibratedRibbon]) -> dict[str, float]:
    """Figures of a comb whose ribbons all are calibrated."""
    percent, degrees = comb_error(
        scene, [ribbon.device for ribbon in ribbons], [ribbon.result.record for ribbon in ribbons]
    )
    sigmas = np.concatenate([ribbon.error_sigmas for ribbon in ribbons])
    return {
        "error_percent": percent,
        "orientation_error_deg": degrees,
        "orientation_sigma_deg": max(float(ribbon.result.sigma_deg.max()) for ribbon in ribbons),
        "largest_error_sigmas": float(np.abs(sigmas).max()),
        "rms_error_sigmas": float(np.sqrt(np.mean(sigmas**2))),
        "solve_s": float(np.mean([ribbon.solve_s for ribbon in ribbons])),
    }


COLUMNS = {
    "seed": ("seed", "d"),
    "E before %": ("error_before_percent", ".1f"),
    "E %": ("error_percent", ".3f"),
    "before deg": ("orientation_error_before_deg", ".1f"),
    "deg": ("orientation_error_deg", ".3f"),
    "sigma deg": ("orientation_sigma_deg", ".3f"),
    "worst z": ("largest_error_sigmas", ".2f"),
    "rms z": ("rms_error_sigmas", ".2f"),
    "solve s": ("solve_s", ".1f"),
}


def calibration_table(result: dict[str, Any]) -> str:
    """What measure_calibration found."""
    from ribbonhost.bench.tables import table

    rows = [
        [format(comb[key], form) if key in comb else "-" for key, form in COLUMNS.values()]
        for comb in result["combs"]
    ]
    lines = [
        f"Combs of {RIBBONS} ribbons and a reference on {result['scene']}, parts with errors, before and "
        "after a bar.",
        table(list(COLUMNS), rows),
    ]
    if result["error_median_percent"] is not None:
        lines.append(
            f"E after: median {result['error_median_percent']:.3f} %, "
            f"largest {result['error_max_percent']:.3f} %."
        )
    lines.append(f"{len(result['refused'])} of {result['ribbons']} calibrations were refused.")
    lines += [f"seed {one['seed']}, ribbon {one['ribbon']}: {one['message']}" for one in result["refused"]]
    return "\n".join(lines)
