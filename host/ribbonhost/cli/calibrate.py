"""The commands that calibrate ribbons. Nothing slow is imported before a command runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from ribbonhost.cli.options import BaudOption, CombOption
from ribbonhost.cli.ribbons import JsonOption, NameArgument

DeviceArgument = Annotated[
    str | None,
    typer.Argument(metavar="DEVICE", help="A ribbon as for `info`; may be left out with --from."),
]
HolderArgument = Annotated[
    str, typer.Argument(metavar="DEVICE_OR_FILE", help="A ribbon, or a calibration file (.toml).")
]
FromOption = Annotated[
    Path | None,
    typer.Option("--from", metavar="RECORDING.mcap", help="Use the RAW packets of a recording."),
]
SerialOption = Annotated[
    str, typer.Option(metavar="SERIAL", help="Which ribbon of the recording, if there are several.")
]
OutputOption = Annotated[
    Path | None,
    typer.Option(
        "-o", "--output", metavar="FILE", help="File to write.  [default: calibration-SERIAL-TIME.toml]"
    ),
]
ForceOption = Annotated[bool, typer.Option("--force", help="Replace files that are there already.")]
DryRunOption = Annotated[bool, typer.Option("--dry-run", help="Write the file, but not to the ribbon.")]
PlaceOption = Annotated[
    str | None,
    typer.Option(
        "--place", metavar="LAT,LON[,M]", help="Where it is: degrees north and east, metres of height."
    ),
]
DayOption = Annotated[
    str | None, typer.Option("--date", metavar="YYYY-MM-DD", help="For the magnetic model.  [default: today]")
]
FieldOption = Annotated[
    float | None, typer.Option(min=1.0, max=100.0, help="Strength of the field, instead of --place.")
]
DipOption = Annotated[float | None, typer.Option(min=-90.0, max=90.0, help="How far the field points down.")]
DeclinationOption = Annotated[
    float | None, typer.Option(min=-180.0, max=180.0, help="Magnetic north east of true north.")
]
RateOption = Annotated[int, typer.Option(min=20, max=200, help="Scans a second meanwhile.")]
RecordOption = Annotated[
    Path | None, typer.Option(metavar="FILE.mcap", help="Keep all that is received, for --from.")
]


def register(app: typer.Typer) -> None:
    """Adds the commands."""
    calibrate = typer.Typer(
        help="Find the errors of a ribbon's sensors, and let it know them.", no_args_is_help=True
    )
    calibrate.command(epilog="Example: ribbonhost calibrate bar 21d7 --place 45.19,5.72,212")(bar)
    calibrate.command(epilog="Example: ribbonhost calibrate flat 21d7 --seconds 60")(flat)
    calibrate.command("in-place", epilog="Example: ribbonhost calibrate in-place 21d7")(in_place)
    calibrate.command(epilog="Example: ribbonhost calibrate show 21d7")(show)
    calibrate.command(epilog="Example: ribbonhost calibrate diff 21d7 left.toml")(diff)
    calibrate.command(epilog="Example: ribbonhost calibrate restore 21d7 left.toml")(restore)
    app.add_typer(calibrate, name="calibrate")


def bar(
    name: DeviceArgument = None,
    from_recording: FromOption = None,
    serial: SerialOption = "",
    output: OutputOption = None,
    force: ForceOption = False,
    dry_run: DryRunOption = False,
    place: PlaceOption = None,
    day: DayOption = None,
    field_ut: FieldOption = None,
    dip_deg: DipOption = None,
    declination_deg: DeclinationOption = None,
    axes: Annotated[int, typer.Option(min=2, max=3, help="Magnetometer axes that are used.")] = 2,
    pitch_mm: Annotated[
        float | None,
        typer.Option(min=1.0, max=1000.0, help="Between slots, by a ruler.  [default: as the ribbon says]"),
    ] = None,
    poses: Annotated[int, typer.Option(min=16, max=200, help="End after so many, whatever is missing.")] = 36,
    seconds: Annotated[float, typer.Option(min=10.0, help="End after so long.")] = 900.0,
    rate: RateOption = 50,
    record: RecordOption = None,
    comb: CombOption = None,
    baud: BaudOption = 921_600,
    json: JsonOption = False,
) -> None:
    """Calibrate all sensors at once: the ribbon on a straight bar, turned as is said."""
    from ribbonhost.cli.calibrate_options import CalibrateOptions
    from ribbonhost.cli.calibrate_run import run_bar

    run_bar(
        CalibrateOptions(
            name=name,
            from_recording=from_recording,
            serial=serial,
            output=output,
            force=force,
            dry_run=dry_run,
            place=place,
            day=day,
            field_ut=field_ut,
            dip_deg=dip_deg,
            declination_deg=declination_deg,
            axes=axes,
            pitch_mm=pitch_mm,
            rate_hz=rate,
            poses=poses,
            seconds=seconds,
            record=record,
            comb=comb,
            baud=baud,
            json=json,
        )
    )


def flat(
    name: DeviceArgument = None,
    from_recording: FromOption = None,
    serial: SerialOption = "",
    output: OutputOption = None,
    force: ForceOption = False,
    dry_run: DryRunOption = False,
    place: PlaceOption = None,
    day: DayOption = None,
    field_ut: FieldOption = None,
    dip_deg: DipOption = None,
    seconds: Annotated[float, typer.Option(min=6.0, help="How long.")] = 60.0,
    rate: RateOption = 50,
    record: RecordOption = None,
    comb: CombOption = None,
    baud: BaudOption = 921_600,
    json: JsonOption = False,
) -> None:
    """Refresh biases and mountings: the ribbon flat on a table, either side up."""
    from ribbonhost.cli.calibrate_options import CalibrateOptions
    from ribbonhost.cli.calibrate_run import run_flat

    run_flat(
        CalibrateOptions(
            name=name,
            from_recording=from_recording,
            serial=serial,
            output=output,
            force=force,
            dry_run=dry_run,
            place=place,
            day=day,
            field_ut=field_ut,
            dip_deg=dip_deg,
            rate_hz=rate,
            seconds=seconds,
            record=record,
            comb=comb,
            baud=baud,
            json=json,
        )
    )


def in_place(
    name: DeviceArgument = None,
    from_recording: FromOption = None,
    serial: SerialOption = "",
    output: OutputOption = None,
    force: ForceOption = False,
    dry_run: DryRunOption = False,
    place: PlaceOption = None,
    day: DayOption = None,
    field_ut: FieldOption = None,
    dip_deg: DipOption = None,
    seconds: Annotated[float, typer.Option(min=10.0, help="How long.")] = 120.0,
    rate: RateOption = 50,
    record: RecordOption = None,
    comb: CombOption = None,
    baud: BaudOption = 921_600,
    json: JsonOption = False,
) -> None:
    """Find hard iron anew while the ribbon is used; nobody needs to handle it."""
    from ribbonhost.cli.calibrate_options import CalibrateOptions
    from ribbonhost.cli.calibrate_run import run_in_place

    run_in_place(
        CalibrateOptions(
            name=name,
            from_recording=from_recording,
            serial=serial,
            output=output,
            force=force,
            dry_run=dry_run,
            place=place,
            day=day,
            field_ut=field_ut,
            dip_deg=dip_deg,
            rate_hz=rate,
            seconds=seconds,
            record=record,
            comb=comb,
            baud=baud,
            json=json,
        )
    )


def show(
    name: HolderArgument, comb: CombOption = None, baud: BaudOption = 921_600, json: JsonOption = False
) -> None:
    """Print the calibration that a ribbon uses, or that a file holds, as errors of its sensors."""
    from ribbonhost.cli.calibrate_keep import run_show

    run_show(name, comb=comb, baud=baud, as_json=json)


def diff(
    one: HolderArgument,
    other: HolderArgument,
    comb: CombOption = None,
    baud: BaudOption = 921_600,
    json: JsonOption = False,
) -> None:
    """Print how far two calibrations are apart."""
    from ribbonhost.cli.calibrate_keep import run_diff

    run_diff(one, other, comb=comb, baud=baud, as_json=json)


def restore(
    name: NameArgument,
    file: Annotated[Path, typer.Argument(metavar="FILE", help="What `calibrate` wrote.")],
    force: Annotated[bool, typer.Option("--force", help="Even if it is of another ribbon.")] = False,
    comb: CombOption = None,
    baud: BaudOption = 921_600,
    json: JsonOption = False,
) -> None:
    """Give a ribbon the calibration of a file; it is replaced as a whole or not at all."""
    from ribbonhost.cli.calibrate_keep import run_restore

    run_restore(name, file, force=force, comb=comb, baud=baud, as_json=json)
