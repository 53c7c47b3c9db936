"""The live table of `ribbonhost stream`."""

import math

from rich.box import SIMPLE_HEAD
from rich.table import Table
from rich.text import Text

from ribbonhost.pipeline.report import Report, RibbonReport

HEADINGS = (
    "frames/s",
    "lost",
    "CRC\nerrors",
    "invalid\nnodes",
    "other",
    "latency ms\np50    p99",
    "E %",
)
STATES = {
    "streaming": Text("live", "green"),
    "silent": Text("silent", "yellow"),
    "absent": Text("absent", "red"),
    "missing": Text("missing", "red"),
}
RARE = (
    "malformed",
    "unknown_packets",
    "wrong_node_count",
    "sequence_jumps",
    "clock_jumps",
    "repeated",
    "untimed",
    "raw_lost",
    "unexpected",
)
"""Counters that are summed in one column; --json has each."""


def table_of(report: Report) -> Table:
    """A row for each ribbon and one for the comb."""
    table = Table(
        title=f"{report.t_s:.0f} s at {report.rate_hz} Hz",
        title_justify="left",
        box=SIMPLE_HEAD,
        collapse_padding=True,
        pad_edge=False,
    )
    table.add_column("ribbon", overflow="ellipsis", no_wrap=True, max_width=16)
    table.add_column("state", no_wrap=True)
    for heading in HEADINGS:
        table.add_column(heading, justify="right", no_wrap=True)
    for ribbon in report.ribbons:
        counters = ribbon.counters
        table.add_row(
            ribbon.label,
            _state(ribbon),
            f"{ribbon.frames_per_s:.1f}",
            _alert(counters.lost),
            _alert(counters.crc_errors),
            _alert(counters.invalid_nodes),
            _alert(_rare(ribbon)),
            _quantiles(ribbon.latency_p50_s, ribbon.latency_p99_s),
            "",
        )
    comb = report.comb
    table.add_section()
    table.add_row(
        "surface",
        "" if comb.surfaces else "none",
        f"{comb.surfaces_per_s:.1f}",
        _alert(comb.dropped),
        "",
        "",
        _alert(comb.unsolved),
        _quantiles(comb.latency_p50_s, comb.latency_p99_s),
        "" if math.isnan(comb.error_mean_percent) else f"{comb.error_mean_percent:.3f}",
    )
    health = [f"{ribbon.label}: {ribbon.health()}" for ribbon in report.ribbons if ribbon.unfit]
    if health:
        table.caption = Text("\n".join(health), "yellow")
        table.caption_justify = "left"
    return table


def summary_of(report: Report) -> str:
    """What a stream has done, in a sentence or two."""
    summary = report.summary_as_json()["summary"]
    assert isinstance(summary, dict)
    comb = report.comb
    made = f"{comb.surfaces} surfaces" if comb.surfaces else f"{comb.frames} curves, no surface"
    text = (
        f"{summary['ribbons']} ribbons in {report.t_s:.1f} s: {summary['frames']} frames, "
        f"{summary['lost']} lost, {summary['crc_errors']} CRC errors, "
        f"{summary['invalid_nodes']} invalid nodes; {made}, "
        f"latency p50 {_ms(comb.latency_p50_s)} ms, p99 {_ms(comb.latency_p99_s)} ms, "
        f"age p50 {_ms(comb.age_p50_s)} ms; "
        f"{comb.cpu_percent:.0f} % of a core"
    )
    if not math.isnan(comb.error_mean_percent):
        text += (
            f"; E {comb.error_mean_percent:.3f} % of the length "
            f"({comb.error_min_percent:.3f} to {comb.error_max_percent:.3f})"
        )
    text += "."
    for ribbon in report.ribbons:
        if ribbon.state == "absent":
            text += f"\n{ribbon.label}: it never joined."
        elif ribbon.times_gone:
            times = "once" if ribbon.times_gone == 1 else f"{ribbon.times_gone} times"
            text += f"\n{ribbon.label}: it was gone {times}, {ribbon.gone_s:.1f} s in all."
    return text


def _state(ribbon: RibbonReport) -> Text:
    if ribbon.state == "gone":
        return Text(f"gone {ribbon.gone_s:.0f} s", "red")
    if ribbon.level_per_s > 0.5 * ribbon.frames_per_s:
        return Text("level", "yellow")  # its motion is to be estimated, and is not
    return STATES[ribbon.state]


def _rare(ribbon: RibbonReport) -> int:
    counts: list[int] = [getattr(ribbon.counters, name) for name in RARE]
    as_level = ribbon.motion.level if ribbon.motion and ribbon.motion.estimated else 0
    return sum(counts) + as_level


def _alert(count: int) -> Text:
    return Text(str(count), "bold red" if count else "")


def _quantiles(p50_s: float, p99_s: float) -> str:
    return f"{_ms(p50_s)} {_ms(p99_s):>6}"


def _ms(duration_s: float) -> str:
    return "-" if math.isnan(duration_s) else f"{duration_s * 1e3:.2f}"
