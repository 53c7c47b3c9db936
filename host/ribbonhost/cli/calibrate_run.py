"""`ribbonhost calibrate`: from readings to a file and a ribbon that uses it, or one sentence why not."""

from __future__ import annotations

import contextlib
import json
import math
import sys
from collections.abc import Callable, Iterator
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

import numpy as np

from ribbonhost import wire
from ribbonhost.calibrate.bar import Result, calibrate_bar
from ribbonhost.calibrate.flat import calibrate_flat
from ribbonhost.calibrate.in_place import calibrate_in_place
from ribbonhost.calibrate.refusals import RefusedError
from ribbonhost.calibrate.solution_checks import check_calibrated
from ribbonhost.cli.calibrate_guide import watch_bar
from ribbonhost.cli.calibrate_options import BarOptions, CalibrateOptions, FlatOptions
from ribbonhost.cli.calibrate_place import pitch_m_of, place_of
from ribbonhost.cli.calibrate_source import (
    Collected,
    Traffic,
    collect_for,
    header_of_one,
    read_recording,
)
from ribbonhost.cli.calibration_file import calibration_text
from ribbonhost.cli.files import write_whole
from ribbonhost.cli.naming import open_named
from ribbonhost.device import Device
from ribbonhost.device.calibration import StoredCalibration, read_calibration, write_calibration
from ribbonhost.errors import UsageError
from ribbonhost.record import Recorder

FLAT = (
    "lay the ribbon flat and straight on a table, sensor side up; turn it end for end; the same with its "
    "back up; three seconds each or longer."
)
IN_PLACE = "use the ribbon, slowly, so that every part of it turns as far as it can."


def run_bar(options: BarOptions) -> None:
    """The straight bar, guided. Raises RibbonError."""

    def collect(device: Device, traffic: Traffic) -> Collected:
        info = _info(device)
        return watch_bar(
            device,
            traffic,
            rate_hz=options.rate_hz,
            field_ut=place_of(options, None).field_ut,
            pitch_m=pitch_m_of(options, info),
            poses=options.poses,
            timeout_s=options.seconds,
        )

    def solve(collected: Collected, in_use: wire.Calibration, now: datetime) -> Result:
        return calibrate_bar(
            collected.readings(),
            in_use,
            place_of(options, None),
            axes=options.axes,
            pitch_m=pitch_m_of(options, collected.info),
            created_s=int(now.timestamp()),
            temperatures_c=collected.temperatures_c,
        )

    _run(options, collect, solve)


def run_flat(options: FlatOptions) -> None:
    """The quick refresh with the ribbon flat on a table. Raises RibbonError."""

    def solve(collected: Collected, in_use: wire.Calibration, now: datetime) -> Result:
        return calibrate_flat(
            collected.readings(),
            in_use,
            place_of(options, in_use),
            created_s=int(now.timestamp()),
            temperatures_c=collected.temperatures_c,
        )

    _run(options, _recorder(options, FLAT), solve, refreshes=True)


def run_in_place(options: CalibrateOptions) -> None:
    """Hard iron from a ribbon in use. Raises RibbonError."""

    def solve(collected: Collected, in_use: wire.Calibration, now: datetime) -> Result:
        return calibrate_in_place(
            collected.readings(),
            in_use,
            place_of(options, in_use),
            created_s=int(now.timestamp()),
            temperatures_c=collected.temperatures_c,
        )

    _run(options, _recorder(options, IN_PLACE), solve, refreshes=True)


def _recorder(options: CalibrateOptions, what: str) -> Callable[[Device, Traffic], Collected]:
    """Collects for a while, and says what to do meanwhile."""

    def collect(device: Device, traffic: Traffic) -> Collected:
        print(f"For {options.seconds:g} s: {what}", file=sys.stderr)
        return collect_for(device, traffic, options.seconds, options.rate_hz)

    return collect


def _run(
    options: CalibrateOptions,
    collect: Callable[[Device, Traffic], Collected],
    solve: Callable[[Collected, wire.Calibration, datetime], Result],
    *,
    refreshes: bool = False,
) -> None:
    place_of(options, None, lenient=True)  # what cannot be meant is said before the work
    if options.output and options.output.exists() and not options.force:
        raise UsageError(
            f"{options.output} is there already: name another file, or give --force to replace it"
        )
    with _opened(options) as (device, stored, traffic):
        try:
            if refreshes and stored:
                check_calibrated(stored.values.created_s)
            if options.from_recording:
                recorded = read_recording(options.from_recording, device.serial if device else options.serial)
                collected, in_use = recorded.collected, stored.values if stored else recorded.in_use
                if refreshes and not in_use:
                    raise UsageError(
                        f"{options.from_recording} does not hold the calibration of ribbon "
                        f"{recorded.serial}, which is what is refreshed: name the ribbon too"
                    )
            else:
                assert device is not None  # _opened makes sure
                assert stored is not None
                collected, in_use = collect(device, traffic), stored.values
            now = datetime.now(UTC)
            result = solve(collected, in_use or _unknown(collected), now)
        except RefusedError as error:
            _refused(error, options)
        _finish(options, device, stored, collected, result, now)


@contextlib.contextmanager
def _opened(
    options: CalibrateOptions,
) -> Iterator[tuple[Device | None, StoredCalibration | None, Traffic]]:
    """The ribbon that was named, if one was, and the calibration in use."""
    if options.name is None:
        if not options.from_recording:
            raise UsageError("name the ribbon to calibrate, or give a recording: --from FILE.mcap")
        yield None, None, Traffic()
        return
    recorder = Recorder(options.record, force=options.force) if options.record else None
    traffic = Traffic(recorder.tap() if recorder else None)
    device = open_named(options.name, baud=options.baud, comb=options.comb, observer=traffic)
    try:
        stored = read_calibration(device)
        if recorder:
            recorder.start(header_of_one(device, stored, options.rate_hz, version("ribbonhost")))
            device.handshake()  # so that the recording says who it is of
        yield device, stored, traffic
    finally:
        device.close()
        if recorder:
            recorder.close()


def _finish(
    options: CalibrateOptions,
    device: Device | None,
    stored: StoredCalibration | None,
    collected: Collected,
    result: Result,
    now: datetime,
) -> None:
    """The file first: then nothing is lost if the ribbon goes."""
    info = collected.info
    assert info is not None  # there are readings
    serial = bytes(info.unique_id).hex()
    source = str(options.from_recording or options.name)
    path = options.output or Path(f"calibration-{serial[:8]}-{now:%Y%m%dT%H%M%S}.toml")
    text = calibration_text(result, info, source=source, version=version("ribbonhost"), now=now)
    write_whole(path, text)
    written: StoredCalibration | None = None
    if device and not options.dry_run:
        written = write_calibration(device, result.record)
    facts: dict[str, object] = {
        "serial": serial,
        "file": str(path),
        "written": written is not None,
        "calibration_sequence": written.sequence if written else (stored.sequence if stored else None),
        **quality_facts(result),
    }
    if options.json:
        print(json.dumps({"calibrated": facts}))
        return
    print(summary(result))
    print(f"{path}: the calibration, its uncertainty and where it comes from.")
    if written:
        print(
            f"Ribbon {serial} uses it: calibration {written.sequence}, CRC {written.crc32:08x}, "
            "read back and equal."
        )
    else:
        print("No ribbon was changed: `ribbonhost calibrate restore DEVICE FILE` writes it.")


def quality_facts(result: Result) -> dict[str, object]:
    """How good a calibration is, for --json."""
    low, high = result.temperature_c
    return {
        "method": result.method,
        "poses": len(result.poses),
        "orientation_sigma_deg": round(float(np.median(result.sigma_deg)), 5),
        "orientation_sigma_worst_deg": round(float(np.max(result.sigma_deg)), 5),
        "misfit": round(math.sqrt(result.solution.chi2_per_dof), 4),
        "kept_back": result.held_out,
        "disagreement_before_deg": round(result.old_deg, 5),
        "disagreement_deg": round(result.new_deg, 5),
        "dip_deg": round(math.degrees(result.solution.parameters.dip_rad), 4),
        "temperature_c": None if math.isnan(low) else [low, high],
    }


def summary(result: Result) -> str:
    """How good a calibration is, in a few lines."""
    residuals = np.sqrt(result.solution.chi2_per_dof)
    return (
        f"{len(result.poses)} poses. Residuals {residuals:.2f} times the noise (1 is as expected).\n"
        f"In {result.held_out} kept back, sensors disagree by {result.new_deg:.3f} deg; "
        f"with the calibration that was in use by {result.old_deg:.3f} deg.\n"
        f"Orientations will be uncertain by {np.median(result.sigma_deg):.3f} deg from calibration, "
        f"at the worst node by {np.max(result.sigma_deg):.3f} deg."
    )


def _refused(error: RefusedError, options: CalibrateOptions) -> NoReturn:
    if options.json:
        print(json.dumps({"refused": {"reason": str(error.reason), "message": str(error)}}))
    raise error


def _unknown(collected: Collected) -> wire.Calibration:
    """The identity: what a recording alone can be compared with."""
    info = collected.info
    if info is None:
        collected.readings()  # says what is missing
    assert info is not None
    slots = len(info.slots.part)
    return wire.Calibration(
        layout=wire.CALIBRATION_LAYOUT,
        mag_axes=2,
        created_s=0,
        pitch_m=info.pitch_m,
        field_horizontal_ut=22.53,
        field_down_ut=42.38,
        slots=wire.SlotCalibrationArray(
            offset=np.zeros((slots, 3)), matrix=np.tile(np.eye(3).ravel(), (slots, 1))
        ),
    )


def _info(device: Device) -> wire.Info:
    assert device.info is not None  # a device that was opened has answered
    return device.info
