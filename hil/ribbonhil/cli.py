"""The command line: `ribbonhil serve`, `truth`, `run`, `conformance`, `check`."""

import os
import shlex
import sys
from pathlib import Path
from typing import Annotated

import typer
from ribbonhost.errors import RibbonError, UsageError

from ribbonhil.check.command import check
from ribbonhil.conformance.command import conformance
from ribbonhil.stm32f405.command import run

SceneArgument = Annotated[
    str,
    typer.Argument(
        metavar="SCENE",
        help="Surface: sea, wing, breath, or a Python file; bar, rest: handled for a calibration.",
    ),
]
PartErrorsOption = Annotated[
    int | None,
    typer.Option(min=0, metavar="SEED", help="Errors of parts off the shelf.  [default: none]"),
]
RibbonsOption = Annotated[int, typer.Option(min=2, max=6, help="Ribbons on the reference.")]
PeriodOption = Annotated[
    float | None,
    typer.Option(min=0.01, help="Seconds of one period of the motion.  [default: the scene's own, 20]"),
]

TCP_PORT = 7700
WRITTEN_HERE = "# Written by `ribbonhil serve`.\n"

app = typer.Typer(
    name="ribbonhil",
    help="Emulates sensor ribbons, and tests any ribbon over its link.",
    no_args_is_help=True,
    add_completion=False,
    pretty_exceptions_enable=False,
    rich_markup_mode=None,
    context_settings={"help_option_names": ["-h", "--help"]},
)


@app.callback()
def _ribbonhil() -> None:
    pass


@app.command(epilog="Example: ribbonhil serve wing --ribbons 5")
def serve(
    scene: SceneArgument,
    ribbons: RibbonsOption = 5,
    rate: Annotated[
        int, typer.Option(min=1, max=200, help="Scans a second, until a host asks for others.")
    ] = 100,
    seed: Annotated[int, typer.Option(min=0, help="Of noise, clocks and serial numbers.")] = 0,
    period: PeriodOption = None,
    noise: Annotated[float, typer.Option(min=0.0, help="Times the noise of the parts' data sheets.")] = 1.0,
    part_errors: PartErrorsOption = None,
    warming: Annotated[float, typer.Option(metavar="C", help="By how much the parts warm up.")] = 0.0,
    disturb: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:...", help="A magnet, a steel beam, a magnet that is carried; repeatable."
        ),
    ] = None,
    image: Annotated[
        Path | None,
        typer.Option(metavar="IMAGE", help="Run an STM32F405 image (ribbon.bin) in place of the module."),
    ] = None,
    board: Annotated[str, typer.Option(help="What the image was built for.")] = "pyboard_v11",
    pty: Annotated[
        bool | None,
        typer.Option("--pty/--tcp", help="Pseudo-terminals or TCP ports.  [default: what there is]"),
    ] = None,
    port: Annotated[
        int, typer.Option(min=0, max=65535, help="First TCP port, one a ribbon; 0: any that are free.")
    ] = TCP_PORT,
    bind: Annotated[str, typer.Option(help="Address to listen on.")] = "127.0.0.1",
    faults: Annotated[
        int | None,
        typer.Option(
            min=0,
            max=65535,
            metavar="PORT",
            help="TCP port of 127.0.0.1 that takes faults from `ribbonhil check`; 0: any that is free.",
        ),
    ] = None,
    comb: Annotated[
        Path, typer.Option(metavar="FILE", help="Comb file to write for `ribbonhost stream`.")
    ] = Path("comb.toml"),
    force: Annotated[bool, typer.Option("--force", help="Replace a comb file of somebody else.")] = False,
    seconds: Annotated[
        float | None, typer.Option(min=0.1, help="Stop after so long.  [default: at Ctrl-C]")
    ] = None,
) -> None:
    """Offer emulated ribbons to any program that opens serial ports or TCP, in real time."""
    from rich.console import Console

    from ribbonhil.serve_command import ServeOptions, run_serve

    check_replaceable(comb, force)
    options = ServeOptions(
        scene=scene,
        ribbons=ribbons,
        rate_hz=rate,
        seed=seed,
        period_s=period,
        noise=noise,
        part_errors=part_errors,
        warming_c=warming,
        disturb=";".join(disturb or ()),
        image="" if image is None else str(image),
        board=board,
        use_tcp=os.name != "posix" if pty is None else not pty,
        address=bind,
        port=port,
        faults_port=faults,
        seconds=seconds,
    )
    console = Console()

    def started(comb_text: str, urls: list[str], faults_at: str) -> None:
        write_text(comb, WRITTEN_HERE + comb_text)
        for index, url in enumerate(urls):
            console.print(f"ribbon {index}{' (reference)' if index == 0 else ''}: {url}", highlight=False)
        if faults_at:
            console.print(f"faults: {faults_at}", highlight=False)
        console.print("Ctrl-C ends. To see the surface, type in another terminal:\n", highlight=False)
        # One line, however narrow the terminal is: it is meant to be copied.
        print(f"ribbonhost stream --comb {shlex.join([str(comb), *urls])}\n", flush=True)

    def changed(index: int, is_used: bool, dropped: int) -> None:
        lost = f"; {dropped} bytes were lost, it did not take them in time" if dropped else ""
        console.print(f"ribbon {index}: {'connected' if is_used else 'disconnected'}{lost}", highlight=False)

    try:
        run_serve(options, started, changed)
    except KeyboardInterrupt:
        console.print()


@app.command(epilog="Example: ribbonhil truth wing --seconds 20 -o truth.npz")
def truth(
    scene: SceneArgument,
    output: Annotated[Path, typer.Option("--output", "-o", metavar="FILE", help="NPZ file to write.")],
    ribbons: RibbonsOption = 5,
    rate: Annotated[float, typer.Option(min=0.01, max=10000, help="Instants a second.")] = 100.0,
    seconds: Annotated[float, typer.Option(min=0.001, help="How long.")] = 20.0,
    period: PeriodOption = None,
    part_errors: PartErrorsOption = None,
    force: Annotated[bool, typer.Option("--force", help="Replace the file if it is there.")] = False,
) -> None:
    """Write the true positions and orientations of all sensors.

    Arrays in the file: t_s, slot_position_m, q_world_slot, node_position_m, q_world_node, slot_s_m, node_s_m,
    start_m, period_s, gravity_mps2, field_world_ut, scene; `units` says what each of them is.
    """
    from ribbonhil.emulated_device import drawn_device
    from ribbonhil.truth import Field
    from ribbonhil.truth_file import write_truth
    from ribbonhil.world import load_world, world_truth

    world, field = load_world(scene, period), Field()
    devices = [drawn_device(0, index, part_errors=part_errors) for index in range(ribbons + 1)]
    found = world_truth(world, ribbons, field, devices=devices)
    count = write_truth(output, world.name, found, field, rate, seconds, replace=force)
    print(f"{output}: {count} instants of {ribbons + 1} ribbons on {world.name}")


@app.command("part-errors", epilog="Example: ribbonhil part-errors 7 --ribbon 1")
def part_errors_command(
    seed: Annotated[int, typer.Argument(metavar="SEED", help="As given to --part-errors.")],
    ribbon: Annotated[int, typer.Option(min=0, max=6, help="Of the comb; 0: the reference.")] = 0,
    as_json: Annotated[bool, typer.Option("--json", help="One JSON object.")] = False,
) -> None:
    """Show what is wrong with the parts of an emulated ribbon."""
    from ribbonhil.part_errors_command import show_part_errors

    show_part_errors(seed, ribbon, as_json=as_json)


app.command(epilog="Example: ribbonhil conformance /dev/ttyACM0")(conformance)
app.command(epilog="Example: ribbonhil check --link /dev/ttyACM0")(check)
app.command(epilog="Example: ribbonhil run firmware/build/stm32f405/ribbon.bin --scene wing")(run)


def check_replaceable(path: Path, force: bool) -> None:
    """Raises UsageError if a file is there that was not written by this program, unless forced."""
    if force or not path.exists():
        return
    try:
        with path.open(encoding="utf-8", errors="replace") as file:
            is_ours = file.readline() == WRITTEN_HERE
    except OSError as error:
        raise UsageError(f"{path} cannot be read: {error.strerror}") from error
    if not is_ours:
        raise UsageError(f"{path} is there already: give another name with --comb, or --force to replace it")


def write_text(path: Path, text: str) -> None:
    """Writes a file. Raises RibbonError if that is not possible."""
    try:
        path.write_text(text, encoding="utf-8")
    except OSError as error:
        raise RibbonError(f"{path} cannot be written: {error.strerror}") from error


def main() -> None:
    """Runs `ribbonhil`; exits with 0 on success, 1 on failure, 2 on wrong usage."""
    try:
        app(prog_name="ribbonhil")
    except RibbonError as error:
        print(f"ribbonhil: {error}", file=sys.stderr)
        sys.exit(error.exit_code)
    except KeyboardInterrupt:
        sys.exit(130)
    except BrokenPipeError:
        # Nobody reads what is printed any more: print the rest nowhere, so that the exit is quiet.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        sys.exit(0)
    except Exception as error:
        if os.environ.get("RIBBONHIL_DEBUG"):
            raise
        print(
            f"ribbonhil: a defect of this program: {type(error).__name__}: {error} "
            "(RIBBONHIL_DEBUG=1 shows where; please report it)",
            file=sys.stderr,
        )
        sys.exit(1)
