"""`ribbonhost calibrate`: from readings to a file and a ribbon that uses it, or one sentence why not."""

from __future__ import annotations

import contextlib
import json
import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import UTC, date, datetime
from importlib.metadata import version
from pathlib import Path
from typing import NoReturn

import numpy as np

from ribbonhost import wire
from ribbonhost.calibrate.bar import Result, calibrate_bar
from ribbonhost.calibrate.flat import calibrate_flat
from ribbonhost.calibrate.in_place import calibrate_in_place
from ribbonhost.calibrate.place import Place, place_at
from ribbonhost.calibrate.record import strength_ut
from ribbonhost.calibrate.refusals import RefusedError
from ribbonhost.cli.calibrate_guide import watch_bar
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


@dataclass(frozen=True)
class CalibrateOptions:
    """What was asked for on the command line."""

    name: str | None
    from_recording: Path | None
    serial: str
    output: Path | None
    force: bool
    dry_run: bool
    place: str | None
    day: str | None
    field_ut: float | None
    dip_deg: float | None
    rate_hz: int
    seconds: float
    record: Path | None
    comb: Path | None
    baud: int
    json: bool
    declination_deg: float | None = None
    axes: int = 2
    pitch_mm: float | None = None
    poses: int = 0


def run_bar(options: CalibrateOptions) -> None:
    """The straight bar, guided. Raises RibbonError."""

    def collect(device: Device, traffic: Traffic) -> Collected:
        info = _info(device)
        return watch_bar(
            device,
            traffic,
            rate_hz=options.rate_hz,
            field_ut=_place(options, None).field_ut,
            pitch_m=_pitch_m(options, info),
            poses=options.poses,
            timeout_s=options.seconds,
        )

    def solve(collected: Collected, in_use: wire.Calibration, now: datetime) -> Result:
        return calibrate_bar(
            collected.readings(),
            in_use,
            _place(options, None),
            axes=options.axes,
            pitch_m=_pitch_m(options, collected.info),
            created_s=int(now.timestamp()),
            temperatures_c=collected.temperatures_c,
        )

    _run(options, collect, solve)


def run_flat(options: CalibrateOptions) -> None:
    """The quick refresh with the ribbon flat on a table. Raises RibbonError."""

    def solve(collected: Collected, in_use: wire.Calibration, now: datetime) -> Result:
        return calibrate_flat(
            collected.readings(),
            in_use,
            _place(options, in_use),
            created_s=int(now.timestamp()),
            temperatures_c=collected.temperatures_c,
        )

    _run(options, lambda d, t: collect_for(d, t, options.seconds, options.rate_hz), solve)


def run_in_place(options: CalibrateOptions) -> None:
    """Hard iron from a ribbon in use. Raises RibbonError."""

    def solve(collected: Collected, in_use: wire.Calibration, now: datetime) -> Result:
        return calibrate_in_place(
            collected.readings(),
            in_use,
            _place(options, in_use),
            created_s=int(now.timestamp()),
            temperatures_c=collected.temperatures_c,
        )

    _run(options, lambda d, t: collect_for(d, t, options.seconds, options.rate_hz), solve)


def _run(
    options: CalibrateOptions,
    collect: Callable[[Device, Traffic], Collected],
    solve: Callable[[Collected, wire.Calibration, datetime], Result],
) -> None:
    _place(options, None, lenient=True)  # what cannot be meant is said before the work
    if options.output and options.output.exists() and not options.force:
        raise UsageError(
            f"{options.output} is there already: name another file, or give --force to replace it"
        )
    with _opened(options) as (device, traffic):
        stored = read_calibration(device) if device else None
        if options.from_recording:
            recorded = read_recording(options.from_recording, device.serial if device else options.serial)
            collected = recorded.collected
        else:
            assert device is not None  # _opened makes sure
            collected = collect(device, traffic)
        now = datetime.now(UTC)
        try:
            result = solve(collected, stored.values if stored else _unknown(collected), now)
        except RefusedError as error:
            _refused(error, options)
        _finish(options, device, stored, collected, result, now)


@contextlib.contextmanager
def _opened(options: CalibrateOptions) -> Iterator[tuple[Device | None, Traffic]]:
    if options.name is None:
        if not options.from_recording:
            raise UsageError("name the ribbon to calibrate, or give a recording: --from FILE.mcap")
        yield None, Traffic()
        return
    recorder = Recorder(options.record, force=options.force) if options.record else None
    traffic = Traffic(recorder.tap() if recorder else None)
    device = open_named(options.name, baud=options.baud, comb=options.comb, observer=traffic)
    try:
        if recorder:
            recorder.start(header_of_one(device, options.rate_hz, version("ribbonhost")))
            device.handshake()  # so that the recording says who it is of
        yield device, traffic
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


def _pitch_m(options: CalibrateOptions, info: wire.Info | None) -> float:
    if options.pitch_mm is not None:
        return options.pitch_mm / 1000
    assert info is not None  # there are readings
    return float(info.pitch_m)


def _place(options: CalibrateOptions, in_use: wire.Calibration | None, *, lenient: bool = False) -> Place:
    """The field of the place as it was given; else that of the calibration in use.

    Raises UsageError if there is none.
    """
    if options.place is not None:
        try:
            numbers = [float(word) for word in options.place.split(",")]
        except ValueError:
            numbers = []
        if len(numbers) not in (2, 3):
            raise UsageError(
                f"--place {options.place} is not LATITUDE,LONGITUDE or LATITUDE,LONGITUDE,METRES"
            )
        return place_at(numbers[0], numbers[1], numbers[2] if len(numbers) == 3 else 0.0, _day(options.day))
    if options.field_ut is not None:
        return Place(options.field_ut, options.dip_deg, options.declination_deg, "given by hand")
    if in_use is not None and in_use.created_s:
        dip_deg = math.degrees(math.atan2(in_use.field_down_ut, in_use.field_horizontal_ut))
        return Place(strength_ut(in_use), dip_deg, None, "the calibration in use")
    if lenient:
        return Place(math.nan, None, None, "")
    raise UsageError(
        "the strength of the earth's field is needed, which no pose tells: give --place "
        "LATITUDE,LONGITUDE, or --field-ut with --dip-deg"
    )


def _day(text: str | None) -> date:
    if text is None:
        return datetime.now(UTC).date()
    try:
        return date.fromisoformat(text)
    except ValueError as error:
        raise UsageError(f"--date {text} is no date: write it as 2026-11-24") from error
