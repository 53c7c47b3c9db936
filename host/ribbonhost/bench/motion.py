"""`ribbonhost bench motion`: errors of level reading, live and two-sided estimate, case by case."""

from math import isnan
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

if TYPE_CHECKING:
    from ribbonhost.bench.motion_comb import CombResult
    from ribbonhost.bench.motion_results import Result

MARKDOWN_HEADER = (
    "| case | level | live mean | max | two-sided mean | max | inside 95 %: live | two-sided |\n"
    + "|---" * 8
    + "|"
)
HEADER = f"{'mean and largest E, %':50} {'level':>8} {'live':>15} {'two-sided':>15} {'inside 95 %':>13}"


def motion(
    json_output: Annotated[
        bool, typer.Option("--json", help="Print one JSON object instead of a table.")
    ] = False,
    scene: Annotated[
        str | None, typer.Option(metavar="SCENE", help="Only this scene: sea, wing, breath, or a file.py.")
    ] = None,
    period: Annotated[float, typer.Option(metavar="S", help="Period of that scene, seconds.")] = 2.0,
    axes: Annotated[int, typer.Option(min=2, max=3, help="Axes of the magnetometers.")] = 2,
    only: Annotated[str, typer.Option(metavar="TEXT", help="Only cases with this in their name.")] = "",
    plots: Annotated[
        Path | None, typer.Option(metavar="FOLDER", help="Save a plot of each case there; needs matplotlib.")
    ] = None,
    markdown: Annotated[
        bool, typer.Option("--markdown", help="Print the table as docs/motion.md shows it.")
    ] = False,
    check: Annotated[bool, typer.Option("--check", help="Exit with 1 if a figure is not reached.")] = False,
) -> None:
    """Motion on emulated ribbons, one setting for all: mean and largest error, percent of the length."""
    import dataclasses
    import json

    from ribbonhost.bench.motion_cases import goals, scene_goals
    from ribbonhost.bench.motion_comb import evaluate_comb
    from ribbonhost.bench.motion_results import as_json, coverage_of, evaluate
    from ribbonhost.bench.motion_speed import speed_of
    from ribbonhost.errors import RibbonError

    wanted = [
        dataclasses.replace(goal, case=dataclasses.replace(goal.case, axes=axes))
        for goal in (scene_goals(scene, period) if scene else goals())
        if only in goal.case.name
    ]
    if not wanted:
        typer.echo(f'No case has "{only}" in its name; without --only all are run.', err=True)
        raise typer.Exit(2)
    results, failures = [], []
    try:
        for goal in wanted:
            result = evaluate(goal)
            results.append(result)
            failures += result.failures()
            if markdown and not json_output:
                typer.echo((MARKDOWN_HEADER + "\n" if len(results) == 1 else "") + _row(result))
            elif not json_output:
                typer.echo((HEADER + "\n" if len(results) == 1 else "") + _line(result))
            if plots:
                _plot(result, plots)
        comb = None if scene or only else evaluate_comb(axes=axes)
    except RibbonError as error:
        typer.echo(str(error), err=True)
        raise typer.Exit(1) from None
    speed = speed_of(results)
    coverage = coverage_of(results)
    failures += speed.failures() + (comb.failures() if comb else [])
    # A few cases say little of it.
    failures += coverage.failures() if coverage and not only else []
    if json_output:
        summary = {
            "cases": [as_json(result) for result in results],
            "comb": dataclasses.asdict(comb) if comb else None,
            "coverage_percent": dataclasses.asdict(coverage) if coverage else None,
            "speed": dataclasses.asdict(speed),
            "failures": failures,
        }
        typer.echo(json.dumps(summary))
    else:
        if comb:
            typer.echo(_comb_row(comb) if markdown else _comb_line(comb))
        if coverage:
            typer.echo(
                "\nInside the 95 % region, over the cases that the model covers: "
                f"live {coverage.live:.1f} %, two-sided {coverage.two_sided:.1f} %."
            )
        typer.echo(
            f"\nSix ribbons at 100 Hz: live {speed.live_percent:.0f} % of a core; two-sided "
            f"{speed.two_sided_times_real_time:.1f} times real time; {speed.times_reference:.0f} times "
            "the speed of the NumPy reference."
        )
        for failure in failures:
            typer.echo(f"not reached: {failure}")
    if check and failures:
        raise typer.Exit(1)


def _line(result: "Result") -> str:
    def both(name: str) -> str:
        return f"{result.mean(name):7.3f} {result.largest(name):7.3f}"

    return (
        f"{result.goal.case.name:50} {result.mean('level'):8.3f} {both('live'):>15} {both('two_sided'):>15} "
        f"{result.coverage_live:6.1f} {result.coverage_two_sided:6.1f}"
        + ("" if isnan(result.lagged) else f"\n    with a lag of 0.2 s: {result.lagged:.3f}")
        + "".join(f"\n    not reached: {failure}" for failure in result.failures())
    )


def _row(result: "Result") -> str:
    lagged = "" if isnan(result.lagged) else f" (with a lag of 0.2 s: {result.lagged:.3f})"
    errors = [
        f"{value:.3f}"
        for name in ("live", "two_sided")
        for value in (result.mean(name), result.largest(name))
    ]
    return (
        f"| {result.goal.case.name}{lagged} | {result.mean('level'):.3f} | {' | '.join(errors)} | "
        f"{result.coverage_live:.1f} | {result.coverage_two_sided:.1f} |"
    )


COMB = "comb of five and its reference, wing 2 s"


def _comb_line(comb: "CombResult") -> str:
    return f"{COMB:50} {comb.level:8.3f} {comb.live:7.3f}         {comb.two_sided:7.3f}"


def _comb_row(comb: "CombResult") -> str:
    return f"| {COMB} | {comb.level:.3f} | {comb.live:.3f} | | {comb.two_sided:.3f} | | | |"


def _plot(result: "Result", folder: Path) -> None:
    try:
        from matplotlib.figure import Figure
    except ImportError:
        typer.echo("Plots need matplotlib: pip install matplotlib", err=True)
        raise typer.Exit(1) from None
    folder.mkdir(parents=True, exist_ok=True)
    figure = Figure(figsize=(8, 4), layout="constrained")
    axes = figure.subplots()
    for name, label in (("level", "level reading"), ("live", "live"), ("two_sided", "two-sided")):
        axes.semilogy(result.t_s, getattr(result, name), label=label, linewidth=1)
    axes.set(xlabel="time, s", ylabel="E, % of the length", title=result.goal.case.name)
    axes.legend(loc="upper right")
    name = "".join(c if c.isalnum() else "-" for c in result.goal.case.name)
    figure.savefig(folder / f"{name}.png", dpi=100)
