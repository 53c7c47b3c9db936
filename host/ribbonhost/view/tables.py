"""What the page says in words and numbers: the ribbons, their nodes, the recording."""

import math
from collections.abc import Sequence
from html import escape

import numpy as np

from ribbonhost import wire
from ribbonhost.pipeline.arrangement import Place
from ribbonhost.pipeline.report import Report
from ribbonhost.view.layout import Layout, Moment

ROWS_MAX = 40
DOTS = {
    "streaming": "#3fb950",
    "silent": "#d29922",
    "gone": "#f85149",
    "absent": "#f85149",
    "missing": "#f85149",
}
_HEAD = "text-align:right;padding:1px 5px;font-weight:500;opacity:0.7;white-space:nowrap"
_CELL = "text-align:right;padding:1px 5px;white-space:nowrap"
_LEFT = "text-align:left;padding:1px 5px;white-space:nowrap"


def ribbons_table(report: Report, calibrated: Sequence[str]) -> str:
    """A row for each ribbon. calibrated: what is known of the calibration of each."""
    heads = ("Hz", "lost", "CRC", "invalid", "ms p50", "p99", "°C", "calibrated")
    rows = [
        f'<th style="{_HEAD};text-align:left">ribbon</th>'
        + "".join(f'<th style="{_HEAD}">{head}</th>' for head in heads)
    ]
    for ribbon, since in zip(report.ribbons, calibrated, strict=True):
        counters = ribbon.counters
        cells = (
            f"{ribbon.frames_per_s:.0f}",
            _alert(counters.lost),
            _alert(counters.crc_errors),
            _alert(counters.invalid_nodes),
            _number(ribbon.latency_p50_s * 1e3, 1),
            _number(ribbon.latency_p99_s * 1e3, 1),
            "–" if ribbon.temperature_c is None else f"{ribbon.temperature_c:.1f}",
            escape(since),
        )
        dot = f'<span style="color:{DOTS.get(ribbon.state, "#888")}" title="{escape(ribbon.state)}">●</span>'
        rows.append(
            f'<td style="{_LEFT}">{dot} {escape(ribbon.label)}</td>'
            + "".join(f'<td style="{_CELL}">{cell}</td>' for cell in cells)
        )
    return _table(rows)


def trouble_table(layout: Layout, places: Sequence[Place], moment: Moment) -> str:
    """The nodes that have no orientation, or one that deserves less trust, and why."""
    rows = []
    invalid = int(np.count_nonzero(~moment.valid))
    doubtful = moment.valid & (moment.quality & 0xF0 != 0)
    for ribbon, (place, at, s_m) in enumerate(zip(places, layout.slices, layout.node_s_m, strict=True)):
        for node in range(layout.node_counts[ribbon]):
            k = at.start + node
            if not moment.valid[k]:
                why, mark = _why_invalid(place, node), '<span style="color:#ff7043">invalid</span>'
                if moment.known[k]:
                    why += "; its orientation is estimated from how the ribbon moves"
            elif doubtful[k]:
                why, mark = _doubts(int(moment.quality[k])), "doubtful"
            else:
                continue
            rows.append(
                f'<td style="{_LEFT}">{escape(layout.labels[ribbon])}</td><td style="{_CELL}">{node}</td>'
                f'<td style="{_CELL}">{1e3 * s_m[node]:.0f} mm</td><td style="{_LEFT}">{mark}</td>'
                f'<td style="text-align:left;padding:1px 5px">{escape(why)}</td>'
            )
    summary = (
        f'<div style="padding:0 7px 4px">{layout.node_count} nodes: {invalid} invalid, '
        f"{int(np.count_nonzero(doubtful))} doubtful</div>"
    )
    more = len(rows) - ROWS_MAX
    rest = f'<div style="padding:0 7px">and {more} more</div>' if more > 0 else ""
    return summary + (_table(rows[:ROWS_MAX]) if rows else "") + rest


def events_list(events: Sequence[tuple[float, str, str]], now_s: float) -> str:
    """What happened, the newest first."""
    lines = [
        f"<div><span style='opacity:0.6'>{now_s - t_s:.0f} s ago</span> {escape(label)}: {escape(what)}</div>"
        for t_s, label, what in reversed(events)
    ]
    return f'<div style="font-size:0.8em;padding:2px 7px">{"".join(lines)}</div>'


def _why_invalid(place: Place, node: int) -> str:
    status = place.device.status if place.device else None
    if place.device is None:
        return "the ribbon is not there"
    if place.device.lost:
        return "the ribbon's port is gone" if place.device.info else "the ribbon has not joined yet"
    if status is None:
        return "no sensor status came yet"
    found = []
    for what, slot in (("accelerometer", 2 * node), ("magnetometer", 2 * node + 1)):
        if slot < len(status.slots) and (reason := int(status.slots.reason[slot])):
            found.append(f"{what} {_slot_reason(reason)}")
    return ", ".join(found) or "its sensors answer: too few around it are usable, or it has just begun"


def _slot_reason(reason: int) -> str:
    try:
        return wire.SlotReason(reason).name.lower().replace("_", " ")
    except ValueError:
        return f"reason {reason}"


def _doubts(quality: int) -> str:
    flags = [flag.name or "" for flag in wire.Quality if quality & flag]
    return ", ".join(flag.lower().replace("_", " ") for flag in flags)


def _table(rows: Sequence[str]) -> str:
    body = "".join(f"<tr>{row}</tr>" for row in rows)
    style = "border-collapse:collapse;font-size:0.8em;font-variant-numeric:tabular-nums"
    return f'<div style="overflow-x:auto"><table style="{style}">{body}</table></div>'


def _alert(count: int) -> str:
    return f'<b style="color:#ff7043">{count}</b>' if count else "0"


def _number(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{value:.{digits}f}"
