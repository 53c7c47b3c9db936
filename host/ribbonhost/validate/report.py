"""The comparison as plots and as one page that needs no other file."""

import base64
import html
import io
from pathlib import Path
from typing import Any

import numpy as np

from ribbonhost.errors import MissingExtraError
from ribbonhost.validate.comparison import Comparison

PAGE = """<!DOCTYPE html>
<html lang="en"><meta charset="utf-8"><title>{title}</title>
<style>
body {{ font: 16px/1.5 sans-serif; max-width: 60em; margin: 2em auto; padding: 0 1em }}
td, th {{ padding: 0.1em 1em 0.1em 0; text-align: left }}
td.n {{ text-align: right }}
img {{ max-width: 100% }}
</style>
<h1>{title}</h1>
<table>{facts}</table>
<h2>Error over time</h2><img alt="E over time" src="data:image/png;base64,{error}">
<h2>Error of each node</h2><img alt="mean distance of each node" src="data:image/png;base64,{nodes}">
<table><tr><th>ribbon<th>mean, mm<th>worst node, mm{ribbons}</table>
"""


def facts_of(comparison: Comparison) -> dict[str, str]:
    """What was found, in plain words."""
    mean, low, high = comparison.error_range()
    a = comparison.alignment
    return {
        "E, percent of the length": f"{mean:.4f} mean, {low:.4f} min, {high:.4f} max",
        "frames compared": str(int(np.isfinite(comparison.error_percent).sum())),
        "time offset": f"{a.offset_s * 1e3:.3f} ms, sigma {a.offset_sigma_s * 1e3:.3f} ms",
        "rotation": f"{comparison.rotation_deg:.3f} deg",
        "translation": " ".join(f"{x:.4f}" for x in a.translation_m) + " m",
        "residual": f"{a.rms_m * 1e3:.3f} mm RMS",
    }


def write_report(comparison: Comparison, path: Path, title: str) -> list[Path]:
    """Writes the page and, beside it, its plots as PNG; returns the files.

    Raises MissingExtraError without matplotlib, OSError if a file cannot be written.
    """
    error, nodes = _plots(comparison)
    pictures = [path.with_name(f"{path.stem}-{name}.png") for name in ("error", "nodes")]
    per_node = comparison.node_mean_m * 1e3
    page = PAGE.format(
        title=html.escape(title),
        facts="".join(
            f"<tr><td>{html.escape(name)}<td>{html.escape(value)}"
            for name, value in facts_of(comparison).items()
        ),
        error=base64.b64encode(error).decode(),
        nodes=base64.b64encode(nodes).decode(),
        ribbons="".join(
            f'<tr><td>{html.escape(name)}<td class="n">{np.nanmean(row):.3f}'
            f'<td class="n">{np.nanmax(row):.3f}'
            for name, row in zip(comparison.names, per_node, strict=True)
            if np.isfinite(row).any()
        ),
    )
    path.write_text(page, encoding="utf-8")
    for picture, content in zip(pictures, (error, nodes), strict=True):
        picture.write_bytes(content)
    return [path, *pictures]


def _plots(comparison: Comparison) -> tuple[bytes, bytes]:
    try:
        from matplotlib.backends.backend_agg import FigureCanvasAgg
        from matplotlib.figure import Figure
    except ImportError as error:
        raise MissingExtraError("the report", "matplotlib", "validate") from error

    def png(figure: Any) -> bytes:
        FigureCanvasAgg(figure)
        content = io.BytesIO()
        figure.savefig(content, format="png", dpi=110)
        return content.getvalue()

    over_time = Figure(figsize=(8, 3), layout="constrained")
    axes = over_time.add_subplot()
    axes.plot(comparison.t_s, comparison.error_percent, linewidth=0.8)
    axes.axhline(comparison.error_range()[0], color="0.5", linestyle="--", linewidth=0.8)
    axes.set(xlabel="time in the recording (s)", ylabel="E (%)")
    axes.set_ylim(bottom=0)
    of_nodes = Figure(figsize=(8, 3.5), layout="constrained")
    axes = of_nodes.add_subplot()
    for name, row in zip(comparison.names, comparison.node_mean_m, strict=True):
        axes.plot(np.arange(len(row)), row * 1e3, "-o", markersize=3, label=name)
    axes.set(xlabel="node", ylabel="mean distance (mm)")
    axes.set_ylim(bottom=0)
    axes.legend(fontsize="small")
    return png(over_time), png(of_nodes)
