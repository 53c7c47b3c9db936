"""Runs an image against an emulated sensor string, and measures what it does."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from pathlib import Path

from ribbonhost.errors import UsageError
from ribbonhost.wire import CommandCode, Orient, decode

from ribbonhil.emulated_device import drawn_device
from ribbonhil.stm32f405.boards import BOARDS
from ribbonhil.stm32f405.elf import read_elf, read_image
from ribbonhil.stm32f405.image_ribbon import ImageRibbon
from ribbonhil.stm32f405.profile import by_function
from ribbonhil.stm32f405.replay import replay
from ribbonhil.stm32f405.session import Session, SilentImageError
from ribbonhil.world import load_world, world_truth

EVENTS_PER_SCAN_MAX = 1500  # bytes, select clocks and looks at the clock
EVENTS_AT_START = 400_000
COMPARED_FRAMES_MAX = 20_000  # what a log of a reasonable size holds


@dataclass(frozen=True)
class RunOptions:
    """What to run, and on what: `ribbon` of a comb of `ribbons` on a scene, 0 being the reference."""

    image: Path
    scene: str
    frames: int
    rate_hz: int | None = None  # None: what the firmware starts with
    board: str = "pyboard_v11"
    ribbons: int = 5
    ribbon: int = 1
    seed: int = 0
    noise: float = 1.0
    period_s: float | None = None
    axes: int | None = None  # of the magnetometers; None: what the firmware starts with
    profile: bool = False  # needs the ELF file
    part_errors: int | None = None  # seed of what is wrong with the parts; None: nothing is


@dataclass(frozen=True)
class RunReport:
    """What was measured over `frames` scans.

    crc_errors: frames that arrived damaged. overruns, scan_us: as the firmware says in STATUS.
    bus_conflicts: bytes on the sensor bus while two parts were selected.
    violations: things that the firmware did and the real MCU forbids; `violation` names the first.
    frames_per_second: emulated in a second of processor time, the comparison not counted.
    matches_host_port: the first `frames_compared` ORIENT packets equal those of the host's build of the
        firmware on the same input, byte for byte.
    axes: of the magnetometers.
    instructions_by_function: in a frame, most first; empty unless asked for.
    """

    frames: int
    crc_errors: int
    overruns: int
    bus_conflicts: int
    instructions_per_frame: int
    scan_us: int
    frames_per_second: float
    matches_host_port: bool
    frames_compared: int
    rate_hz: int
    invalid_nodes: int
    resets: int
    violations: int
    violation: str
    axes: int
    instructions_by_function: dict[str, int] = field(default_factory=dict)

    @property
    def is_good(self) -> bool:
        """Whether nothing went wrong."""
        faults = (self.crc_errors, self.overruns, self.bus_conflicts, self.resets, self.violations)
        return self.matches_host_port and not any(faults)


def run(options: RunOptions) -> RunReport:
    """Runs `frames` scans, once the ribbon has started and has its rate.

    Raises RibbonError for an image or a scene that cannot be run, or an image that does not answer."""
    if options.ribbon > options.ribbons:
        raise UsageError(f"a comb of {options.ribbons} ribbons has no ribbon {options.ribbon}")
    devices = [
        drawn_device(options.seed, index, noise=options.noise, part_errors=options.part_errors)
        for index in range(options.ribbons + 1)
    ]
    world = load_world(options.scene, options.period_s)
    truth = world_truth(world, options.ribbons, devices=devices)
    device = devices[options.ribbon]
    program = read_elf(options.image) if options.profile else None
    ribbon = ImageRibbon(
        read_image(options.image), truth.ribbon(options.ribbon), device, BOARDS[options.board]
    )
    session = Session(ribbon)
    compared = min(options.frames, COMPARED_FRAMES_MAX)
    ribbon.mcu.start_log(EVENTS_AT_START + EVENTS_PER_SCAN_MAX * compared)
    info = session.wait_for_info()
    rate_hz = info.rate_hz
    if options.rate_hz is not None:
        rate_hz = session.command(CommandCode.SET_RATE, options.rate_hz).value

    axes = session.set_axes(options.axes)
    overruns = session.current_status().overruns  # of storing the calibration
    first, before = len(session.orients), ribbon.mcu.counters
    if program is not None:
        ribbon.mcu.start_profile()
    cpu_s, log = 0.0, None
    end_s = ribbon.now_s + 1.0 + 2.0 * options.frames / rate_hz
    while len(session.orients) - first < options.frames and ribbon.now_s < end_s:
        left = options.frames - (len(session.orients) - first)
        start = time.process_time()
        session.run_for(max(0.3, min(10.0, left - 0.5)) / rate_hz)
        cpu_s += time.process_time() - start
        if log is None and len(session.orients) - first >= compared:
            log, orients_compared = ribbon.mcu.end_log(), len(session.orients)
    if log is None:
        raise SilentImageError(
            f"Only {len(session.orients) - first} of {options.frames} frames came within "
            f"{ribbon.now_s:.1f} s of virtual time"
        )
    counters = ribbon.mcu.counters
    profile = by_function(program, ribbon.mcu.end_profile()) if program is not None else {}
    frames = len(session.orients) - first
    status = session.current_status()
    replayed = replay(*log)
    return RunReport(
        frames=frames,
        crc_errors=session.crc_errors,
        overruns=status.overruns - overruns,
        bus_conflicts=ribbon.counters().conflicts,
        instructions_per_frame=round((counters.instructions - before.instructions) / frames),
        scan_us=status.scan_us,
        frames_per_second=round(frames / cpu_s, 1),
        matches_host_port=replayed.matches(session.orients[:orients_compared]),
        frames_compared=orients_compared,
        rate_hz=rate_hz,
        invalid_nodes=_invalid_nodes(session.orients[first:]),
        resets=counters.resets,
        violations=counters.violations,
        violation=ribbon.mcu.violation,
        axes=axes,
        instructions_by_function={name: round(count / frames) for name, count in profile.items()},
    )


def _invalid_nodes(orients: list[bytes]) -> int:
    decoded = (decode(packet)[0] for packet in orients)
    return sum(int((~orient.nodes.valid).sum()) for orient in decoded if isinstance(orient, Orient))
