"""Guides somebody who turns a bar: what is done, what is missing, what to do next, live in the terminal."""

from __future__ import annotations

import sys
import time

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.panel import Panel
from rich.table import Table
from rich.text import Text

from ribbonhost.calibrate.bar import pose_averages
from ribbonhost.calibrate.coverage import SIDES, WANTED, Coverage, coverage_of, side_up
from ribbonhost.calibrate.reading_checks import LOST_SHARE, check_readings
from ribbonhost.calibrate.readings import Readings
from ribbonhost.calibrate.stillness import Stay
from ribbonhost.cli.calibrate_source import Collected, Traffic, raw_mode
from ribbonhost.device import Device

LOOK_S = 0.3
LINK_KNOWN_S = 3.0
"""By then a link that is too slow for RAW has shown it."""
NOW_S = 0.3
DONE, MISSING = "●", "○"


class Guide:
    """Shows how far a calibration has got: a live picture on a terminal, a line for each pose elsewhere."""

    def __init__(self) -> None:
        self._console = Console(stderr=True, highlight=False)
        self._live: Live | None = None
        self._poses = 0

    def __enter__(self) -> Guide:
        if self._console.is_terminal:
            self._live = Live(console=self._console, auto_refresh=False)
            self._live.start()
        return self

    def __exit__(self, *_: object) -> None:
        if self._live:
            self._live.stop()

    def show(self, coverage: Coverage, now: str) -> None:
        """The picture of the moment; now: what the bar does."""
        new = coverage.poses > self._poses
        self._poses = coverage.poses
        if self._live:
            self._live.update(picture(coverage, now), refresh=True)
            if new:
                self._console.bell()
        elif new:
            # One line, however narrow: programs read it.
            print(
                f"pose {coverage.poses}, {100 * coverage.share:.0f} %. {coverage.next_step}", file=sys.stderr
            )


def picture(coverage: Coverage, now: str) -> Panel:
    """What is done and what is missing, and the next step."""
    table = Table(box=None, pad_edge=False, show_header=False)
    table.add_column(no_wrap=True)
    table.add_column(no_wrap=True)
    dots = "".join(DONE if done else MISSING for done in coverage.on_table)
    table.add_row("on a table", Text(dots, "green" if all(coverage.on_table) else "yellow"))
    for (name, _), count in zip(SIDES, coverage.headings, strict=True):
        dots = DONE * count + MISSING * (WANTED - count)
        table.add_row(f"{name} up", Text(dots, "green" if count >= WANTED else "yellow"))
    return Panel(
        Group(table, Text(), Text(coverage.next_step, "bold"), Text(now, "dim")),
        title=f"{coverage.poses} poses, {100 * coverage.share:.0f} %",
        title_align="left",
        width=84,
    )


def watch_bar(
    device: Device,
    traffic: Traffic,
    *,
    rate_hz: int,
    field_ut: float,
    pitch_m: float,
    poses: int,
    timeout_s: float,
) -> Collected:
    """Collects readings until all attitudes, or so many poses, are done, or the time is up.

    Raises LinkError and DeviceError; KeyboardInterrupt if somebody ends it. The device is left as it was.
    """
    collected = Collected()
    with raw_mode(device, rate_hz), Guide() as guide:
        collected.info = device.info
        traffic.take()
        start_s = time.monotonic()
        while time.monotonic() - start_s < timeout_s:
            time.sleep(LOOK_S)
            if device.lost:
                raise device.lost
            for packet in traffic.take():
                collected.add(packet)
            if len(collected) < 2 * rate_hz:
                continue
            readings = collected.readings()
            if readings.t_s[-1] > LINK_KNOWN_S and readings.lost > LOST_SHARE * len(readings):
                check_readings(readings)
            coverage, stays = _look(readings, field_ut, pitch_m)
            guide.show(coverage, _now(readings, stays))
            if coverage.complete or coverage.poses >= poses:
                break
    return collected


def _look(readings: Readings, field_ut: float, pitch_m: float) -> tuple[Coverage, list[Stay]]:
    found, stays = pose_averages(readings, field_ut, 2, pitch_m)
    still = [stay for stay in stays if stay.still]
    # The last one may still go on: it counts when it is as long as a pose must be.
    field = [readings.field_ut[stay.first : stay.last].mean(axis=(0, 1)) for stay in still]
    return coverage_of(found, np.array(field).reshape(-1, 3)), stays


def _now(readings: Readings, stays: list[Stay]) -> str:
    recent = readings.accel_mps2[readings.t_s > readings.t_s[-1] - NOW_S].mean(axis=(0, 1))
    name = SIDES[side_up(recent)][0]
    if stays and stays[-1].last >= len(readings) - 2:
        return (
            f"Now the {name} is up: got it, go on."
            if stays[-1].still
            else f"Now the {name} is up: hold still."
        )
    return f"Now the {name} is up."
