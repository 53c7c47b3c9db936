"""Writes docs/accuracy.md: what was measured, as tables and plots. Every number in it comes from this run."""

import textwrap
from pathlib import Path
from typing import Any

from ribbonhost.bench import chain, plots
from ribbonhost.bench.accuracy import COVERAGE_RUNS, COVERAGE_SIGMA_RAD, LAYOUT, measure_accuracy, solve
from ribbonhost.bench.budget import measure_budget
from ribbonhost.bench.tables import spread

SCENES = ("sea", "wing", "breath")
FRAMES = 120
SEED = 0

TITLES = {
    "exact": "Exact orientations",
    "noise_free": "Sensors without noise",
    "noise": "Sensors with noise",
    "noise_smoothed": "Sensors with noise, smoothed",
    "noise_at_rest": "Sensors with noise, held still",
    "motion": "Noise and acceleration",
    "motion_smoothed": "Noise and acceleration, smoothed",
    "paper": "The paper's data",
}


def markdown(head: list[str], rows: list[list[str]]) -> str:
    lines = [head, ["---"] + ["---:"] * (len(head) - 1), *rows]
    return "\n".join("| " + " | ".join(line) + " |" for line in lines)


def write_report(folder: Path) -> list[Path]:
    """Measures everything, writes accuracy.md and its plots into a folder; returns the files. Raises
    UsageError if the emulator or matplotlib is missing."""
    plots.require()
    accuracy = measure_accuracy(SCENES, FRAMES, SEED)
    budget = measure_budget(SCENES, SEED)
    frames = {
        name: [
            solve(chain.moving(chain.load(name), 1.0, SEED, accelerated), "spline").percent
            for accelerated in (False, True)
        ]
        for name in SCENES
    }
    pictures = folder / "accuracy"
    written = [
        plots.plot_frames(frames, pictures / "frames.png"),
        plots.plot_spacing(budget, pictures / "spacing.png"),
        plots.plot_sources(budget, pictures / "sources.png"),
        plots.plot_motion(budget, pictures / "motion.png"),
    ]
    text = "\n\n".join([*_introduction(), *_accuracy(accuracy), *_budget(budget), *_surface(accuracy)]) + "\n"
    path = folder / "accuracy.md"
    path.write_text(text, encoding="utf-8")
    return [path, *written]


def prose(text: str) -> str:
    """A paragraph, wrapped."""
    return textwrap.fill(" ".join(text.split()), 110)


def _introduction() -> list[str]:
    return [
        "# How accurate it is",
        prose(
            """Written by `ribbonhost bench report`; every number and plot below was measured by it.
            `ribbonhost bench accuracy` gives the tables of whole combs alone, for any scene (`--scene
            file.py`)."""
        ),
        prose(
            f"""E is the mean distance of the sensors from where they truly are, as a share of the
            ribbon's length (Sprynski, Lacolle, Biard 2011): over {chain.RIBBONS} ribbons of
            {LAYOUT.node_count} nodes and {LAYOUT.length_m} m, which start on a measured reference
            ribbon. The scenes are those of the emulator: a travelling wave (sea), a wing that bends and
            twists, a bump that breathes."""
        ),
    ]


def _accuracy(result: dict[str, Any]) -> list[str]:
    scenes = result["scenes"]
    rows = [
        [TITLES[kind], method, *(spread(scene["error_percent"][kind][method]) for scene in scenes.values())]
        for kind in result["data"]
        for method in ("hermite", "spline")
    ]
    moves = ", ".join(
        f"{name} {scene['period_s']:g} s and {scene['fastest_node_mps']:.2g} m/s"
        for name, scene in scenes.items()
    )
    return [
        "## Whole combs",
        prose(
            f"""E, percent: mean [least, largest] over {result["frames"]} frames of one period.
            `hermite` is the paper's frame update, `spline` the default. Emulated sensors are those of the
            firmware's own settings: a ribbon's magnetometers measure two axes."""
        ),
        markdown(["data", "method", *scenes], rows),
        "\n".join(f"- {TITLES[kind]}: {meaning}." for kind, meaning in result["data"].items()),
        prose(
            f"""On its own analytic surface the paper reports 1.68 [1.18, 2.57]. The figures of the
            reconstruction are those without acceleration. An accelerometer that is accelerated is no
            level, however good the reconstruction: the last rows but the paper's show what the scenes' own
            motion adds when it is read as one, and [motion.md](motion.md) what the motion estimator makes of
            it. Periods and fastest nodes: {moves}."""
        ),
        "E of sensors with noise over a period, means of its hundredths; dashed: with acceleration.",
        "![E over a period](accuracy/frames.png)",
    ]


def _budget(budget: dict[str, Any]) -> list[str]:
    first = next(iter(budget.values()))
    spacing = [
        [f"{name}, {method}", *(f"{errors[method]:.2g}" for errors in scene["spacing"].values())]
        for name, scene in budget.items()
        for method in ("hermite", "spline")
    ]
    sources = [
        [source, *(f"{scene['sources'][source]:.4f}" for scene in budget.values())]
        for source in first["sources"]
    ]
    motion = [
        [name, *(f"{percent:.3g}" for percent in scene["motion"].values())] for name, scene in budget.items()
    ]
    return [
        "## Numerics and spacing of the nodes",
        prose(
            """Exact orientations, ribbons of one length with more or fewer nodes: mean E, percent. With
            many nodes the method's own arithmetic is what is left."""
        ),
        markdown(["nodes", *first["spacing"]], spacing),
        "![E by number of nodes](accuracy/spacing.png)",
        "## Where the rest comes from",
        prose(
            """Each source alone moves the nodes by so much on average, percent of the length, with the
            default method; the first and the two together are against the truth."""
        ),
        markdown(["source", *budget], sources),
        "![E by source](accuracy/sources.png)",
        "## Motion",
        prose(
            """A moving accelerometer is no level. Mean E of reading it as one, by the period of the
            motion in seconds, every sensor at every node, percent:"""
        ),
        markdown(["period", *first["motion"]], motion),
        "![E by period](accuracy/motion.png)",
    ]


def _surface(result: dict[str, Any]) -> list[str]:
    rows = [
        [
            f"{name}, {twist}",
            f"{found['mean_mm']:.4f}",
            f"{found['max_mm']:.3f}",
            f"{found['seam_deg']:.0e}",
            f"{found['lambda_min']:.2f}",
            f"{found['lambda_held']} of {found['lambda_count']}",
        ]
        for name, scene in result["scenes"].items()
        for twist, found in scene["surface"].items()
    ]
    inside = [[name, f"{scene['coverage']['percent']:.1f} %"] for name, scene in result["scenes"].items()]
    inside.append(["straight", f"{result['coverage_straight']['percent']:.1f} %"])
    return [
        "## The surface between the ribbons",
        prose(
            """Exact orientations. Distance of the vertices from the true surface in millimetres, with
            zero twist (the paper's) and measured twist (the default); the largest angle between normals
            across any seam; and how often a lambda would have come out below the least that is allowed,
            and was held there: where ribbons come close or cross."""
        ),
        markdown(["scene, twist", "mean", "max", "seam, deg", "least lambda", "held"], rows),
        "## Uncertainty",
        prose(
            f"""How often the nodes of a ribbon truly lie in the region that is said to hold them 95 %
            of the time, over {COVERAGE_RUNS} draws of orientations with a standard deviation of
            {COVERAGE_SIGMA_RAD} rad. Along a straight ribbon errors are of second order only."""
        ),
        markdown(["ribbon", "inside"], inside),
    ]
