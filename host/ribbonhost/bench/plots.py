"""Plots of the accuracy report."""

from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ribbonhost.errors import UsageError

SIZE_IN = (6.4, 3.6)
DPI = 110


def require() -> None:
    """Raises UsageError if matplotlib is missing."""
    if find_spec("matplotlib") is None:
        raise UsageError("the report needs matplotlib for its plots: pip install matplotlib")


def _save(figure: Any, path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    # Without the program's name and the date the same figures give the same bytes.
    figure.savefig(path, dpi=DPI, metadata={"Software": None})
    return path


def _figure() -> tuple[Any, Any]:
    from matplotlib.figure import Figure

    figure = Figure(figsize=SIZE_IN, layout="constrained")
    axes = figure.add_subplot()
    axes.grid(alpha=0.3, which="both")
    axes.set_ylabel("E, % of the ribbon's length")
    return figure, axes


def plot_spacing(budget: dict[str, Any], path: Path) -> Path:
    """E over the number of nodes, by scene and method."""
    figure, axes = _figure()
    for i, (name, scene) in enumerate(budget.items()):
        nodes = np.array([int(n) for n in scene["spacing"]])
        for method, style in (("hermite", "--"), ("spline", "-")):
            percent = [errors[method] for errors in scene["spacing"].values()]
            axes.loglog(nodes, percent, style, color=f"C{i}", marker=".", label=f"{name}, {method}")
    axes.set_xlabel("nodes of a ribbon")
    axes.set_xticks(nodes, [str(n) for n in nodes], minor=False)
    axes.minorticks_off()
    axes.legend(fontsize="small")
    return _save(figure, path)


def plot_sources(budget: dict[str, Any], path: Path) -> Path:
    """E by source, a bar for each scene."""
    figure, axes = _figure()
    names = list(next(iter(budget.values()))["sources"])[::-1]
    height = 0.8 / len(budget)
    for i, (scene, found) in enumerate(budget.items()):
        at = np.arange(len(names)) + (len(budget) / 2 - i - 0.5) * height
        axes.barh(at, [found["sources"][name] for name in names], height, color=f"C{i}", label=scene)
    axes.set_xscale("log")
    axes.set_yticks(np.arange(len(names)), names, fontsize="x-small")
    axes.set_ylabel("")
    axes.set_xlabel("E, % of the ribbon's length")
    axes.legend(fontsize="small")
    return _save(figure, path)


def plot_motion(budget: dict[str, Any], path: Path) -> Path:
    """E over the period of the motion."""
    figure, axes = _figure()
    for name, scene in budget.items():
        axes.loglog(
            [float(p) for p in scene["motion"]], list(scene["motion"].values()), marker=".", label=name
        )
    axes.set_xlabel("period of the motion, s")
    axes.legend(fontsize="small")
    return _save(figure, path)


def plot_frames(percent: dict[str, list[NDArray[np.float64]]], path: Path) -> Path:
    """E over one period, means of its hundredths, of each scene without and with acceleration."""
    figure, axes = _figure()
    for i, (name, curves) in enumerate(percent.items()):
        for values, style in zip(curves, ("-", "--"), strict=True):
            means = [part.mean() for part in np.array_split(values, 100)]
            label = name if style == "-" else f"{name}, accelerated"
            axes.plot((np.arange(100) + 0.5) / 100, means, style, color=f"C{i}", label=label)
    axes.set_yscale("log")
    axes.set_xlabel("periods")
    axes.legend(fontsize="small")
    return _save(figure, path)
