"""Runs the probe under MicroPython's unix port against the sensor models: python -m ribbonhil.probe.emulated

The probe is the compiled one that a board would get; hil/probe/standin is what it takes for `machine` and
`time`.
"""

import argparse
import math
import os
import subprocess
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from ribbonhost.errors import RibbonError, UsageError

from ribbonhil._firmware import ffi, lib
from ribbonhil.emulated_device import PARTS, Device
from ribbonhil.faults import BUS, Fault, FaultKind
from ribbonhil.probe.build import PROBE, build
from ribbonhil.sensor_string import BusCounters, SensorString, TruthTable, fill_config
from ribbonhil.stm32f405.boards import BOARDS
from ribbonhil.truth import GRAVITY_MPS2, PITCH_M, Field, RibbonTruth

STANDIN = PROBE / "standin"
POWER_UP_NS = 50_000_000
PIN_NS = 3_000
CALL_NS = 20_000
HEAP = "200K"
"""Twice what a pyboard has left: words are twice as long here."""

REFERENCE_V = 1.204
FACTORY_ADDRESS = 0x1FFF7A2A
FACTORY_V = 3.3
ADC_FULL_SCALE = 4095


@dataclass(frozen=True)
class Supply:
    """The 3.3 V of an emulated board. has_adc: whether MicroPython can measure it."""

    mean_v: float = 3.3
    ripple_v: float = 0.0
    ripple_hz: float = 300.0
    has_adc: bool = True

    def at(self, t_s: float) -> float:
        """Volts; ripple_v is the amplitude of a sine."""
        return self.mean_v + self.ripple_v * math.sin(2 * math.pi * self.ripple_hz * t_s)


class EmulatedPins:
    """An MCU's pins with a sensor string on them, for the lines of text of hil/probe/standin/link.py.

    Time passes by what is done: a pin, a byte on SPI, a sleep.
    """

    def __init__(self, board: str, device: Device, truth: RibbonTruth, supply: Supply) -> None:
        self._wiring = BOARDS[board]
        self._supply = supply
        self._truth = TruthTable(truth, len(device.parts))
        config = ffi.new("struct sensor_bus_config *")
        errors = fill_config(config, device)
        self._bus = ffi.new("struct sensor_bus *")
        if lib.sensor_bus_init(self._bus, config, self._truth.pointer) != 0:
            raise UsageError(f"no string can be made of {len(device.parts)} such parts")
        del errors  # copied
        self.string = SensorString(self._bus)
        self._t_ns = POWER_UP_NS
        self._levels: dict[str, bool] = {}
        self._pulled_up: dict[str, bool] = {}
        self._verbs: dict[str, Callable[..., str | None]] = {
            "mode": self._mode,
            "drive": self._drive,
            "level": self._level,
            "spi": self._spi,
            "adc": self._adc,
            "memory": self._memory,
            "time": self._time,
            "sleep": self._sleep,
        }

    @property
    def selected(self) -> int:
        """Bit i: the chain selects slot i."""
        return int(self._bus.chain.selected)

    def answer(self, line: str) -> str | None:
        """Does what a line says. Raises RibbonError for what the pins of this board cannot do."""
        verb, *words = line.split()
        return self._verbs[verb](*words)

    def _mode(self, pin: str, mode: str, pull: str) -> None:
        self._pulled_up[pin] = pull == "up"

    def _drive(self, pin: str, level: str) -> None:
        self._t_ns += PIN_NS
        rises = level == "1" and not self._levels.get(pin, False)
        self._levels[pin] = level == "1"
        if f"P{pin}" == self._wiring.sel_clk and rises:
            data = self._levels.get(self._wiring.sel_data[1:], False)
            lib.sensor_bus_select_clock(self._bus, self._t_ns, data)

    def _level(self, pin: str) -> str:
        if f"P{pin}" != self._wiring.spi_miso:
            raise RibbonError(f"the probe reads pin {pin}, which is not MISO")
        self._t_ns += PIN_NS
        return str(int(lib.sensor_bus_miso(self._bus, self._t_ns, self._pulled_up[pin])))

    def _spi(self, sck: str, mosi: str, miso: str, polarity: str, phase: str, baud: str, data: str) -> str:
        wired = (self._wiring.spi_sck, self._wiring.spi_mosi, self._wiring.spi_miso)
        if (f"P{sck}", f"P{mosi}", f"P{miso}") != wired or (polarity, phase) != ("1", "1"):
            raise RibbonError(
                f"SPI on {sck}, {mosi}, {miso} in mode {polarity}{phase} does not reach the string"
            )
        if not self._pulled_up[miso]:
            raise RibbonError("MISO has no pull-up: silence would read as anything")
        self._t_ns += CALL_NS
        answer = bytearray()
        for byte in bytes.fromhex(data):
            self._t_ns += 8_000_000_000 // int(baud)
            answer.append(lib.sensor_bus_transfer(self._bus, self._t_ns, byte))
        return answer.hex()

    def _adc(self, channel: str) -> str:
        self._t_ns += CALL_NS
        counts = round(ADC_FULL_SCALE * REFERENCE_V / self._supply.at(self._t_ns * 1e-9))
        return str(counts << 4 | counts >> 8)

    def _memory(self, address: str) -> str:
        known = int(address) == FACTORY_ADDRESS
        return str(round(ADC_FULL_SCALE * REFERENCE_V / FACTORY_V) if known else 0)

    def _time(self) -> str:
        return str(self._t_ns // 1000)

    def _sleep(self, us: str) -> None:
        self._t_ns += int(us) * 1000


def at_rest(slots: int) -> RibbonTruth:
    """What the sensors of a ribbon feel that lies flat on a table, toward east."""
    force = np.broadcast_to([0.0, 0.0, GRAVITY_MPS2], (1, slots, 3))
    return RibbonTruth(force, np.broadcast_to(Field().world_ut(), (1, slots, 3)), 1.0)


def passed_by_a_magnet(slots: int, start_s: float = 12.0, speed_mps: float = 0.1) -> RibbonTruth:
    """The same ribbon, with a magnetised rod that is pushed under it from the connector to the end."""
    step_s = 0.02
    length_m = slots * PITCH_M
    t_s = np.arange(0.0, start_s + length_m / speed_mps + 4.0, step_s)
    rod_m = speed_mps * (t_s - start_s) - 2 * PITCH_M
    behind = (np.arange(slots) * PITCH_M - rod_m[:, None]) / PITCH_M
    near = np.exp(-(behind**2))
    tilt_rad = -0.4 * behind * near
    rest = at_rest(slots)
    force = GRAVITY_MPS2 * np.stack([np.sin(tilt_rad), np.zeros_like(near), np.cos(tilt_rad)], axis=-1)
    field = rest.field_ut + near[..., None] * [0.0, 60.0, 150.0]
    return RibbonTruth(force, field, step_s, periodic=False)


@dataclass(frozen=True)
class Outcome:
    """What the probe printed, its exit status (0 if it found no fault), and what happened on the bus."""

    text: str
    status: int
    counters: BusCounters


def environment(send: int, receive: int, supply: Supply) -> dict[str, str]:
    """The environment in which MicroPython finds the stand-ins, and they the pipes."""
    without_adc = {} if supply.has_adc else {"PROBE_WITHOUT_ADC": "1"}
    pipes = {"PROBE_SEND": f"/dev/fd/{send}", "PROBE_RECEIVE": f"/dev/fd/{receive}"}
    return {**os.environ, "MICROPYPATH": f"{STANDIN}:.frozen", **pipes, **without_adc}


def micropython() -> str:
    """The unix port beside this Python. Raises RibbonError if it is not there."""
    program = Path(sys.executable).parent / "micropython"
    if not program.exists():
        raise RibbonError("MicroPython's unix port is missing: type pip install -r tests/requirements.txt")
    return str(program)


def run(
    device: Device,
    *,
    board: str = "pyboard_v11",
    faults: Sequence[Fault] = (),
    truth: RibbonTruth | None = None,
    supply: Supply = Supply(),
    slots: int | None = None,
    walk: bool = False,
) -> Outcome:
    """Probes an emulated string. slots: how many the probe is told, if not those that there are.

    Raises RibbonError if the probe does what no board can.
    """
    truth = truth or (passed_by_a_magnet if walk else at_rest)(len(device.parts))
    pins = EmulatedPins(board, device, truth, supply)
    for fault in faults:
        pins.string.add_fault(fault)
    code = f"import sys, probe; sys.exit(int(probe.main({slots or len(device.parts)}, {walk}) > 0))"
    from_probe, to_pins = os.pipe()
    from_pins, to_probe = os.pipe()
    process = subprocess.Popen(
        [micropython(), "-X", f"heapsize={HEAP}", "-c", code],
        cwd=build(board),
        env=environment(to_pins, from_pins, supply),
        pass_fds=(to_pins, from_pins),
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    os.close(to_pins)
    os.close(from_pins)
    try:
        serve(pins, from_probe, to_probe)
    except BaseException:
        process.kill()
        raise
    finally:
        text, _ = process.communicate()
    return Outcome(text, process.returncode, pins.string.counters())


def serve(pins: EmulatedPins, receive: int, send: int) -> None:
    """Answers the lines of a probe until it closes its pipe; closes both."""
    with open(receive) as lines, open(send, "w") as answers:
        for line in lines:
            answer = pins.answer(line)
            if answer is not None:
                answers.write(answer + "\n")
                answers.flush()


def parse_fault(text: str) -> Fault:
    """A fault from KIND:SLOT[:PARAMETER], as in shorted:4:6. Raises UsageError."""
    kind, _, rest = text.partition(":")
    slot, _, parameter = rest.partition(":")
    try:
        at = int(slot) if slot else int(BUS)
        return Fault(FaultKind[kind.upper()], at, parameter=float(parameter or 0.0))
    except (KeyError, ValueError):
        kinds = ", ".join(known.name.lower() for known in FaultKind)
        raise UsageError(f"{text} is no fault: KIND:SLOT[:PARAMETER], KIND being one of {kinds}") from None


def main() -> int:
    """Returns the exit status: 0 if the probe found nothing wrong."""
    parser = argparse.ArgumentParser(prog="python -m ribbonhil.probe.emulated", description=__doc__)
    parser.add_argument("--board", default="pyboard_v11")
    parser.add_argument("--slots", type=int, default=len(PARTS))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--fault", action="append", default=[], metavar="KIND:SLOT[:PARAMETER]")
    parser.add_argument("--ripple", type=float, default=0.0, metavar="V", help="amplitude on the supply")
    parser.add_argument("--walk", action="store_true", help="a magnet is moved along the ribbon")
    arguments = parser.parse_args()
    try:
        outcome = run(
            Device(seed=arguments.seed, parts=(PARTS * 2)[: arguments.slots]),
            board=arguments.board,
            faults=[parse_fault(text) for text in arguments.fault],
            supply=Supply(ripple_v=arguments.ripple),
            walk=arguments.walk,
        )
    except RibbonError as error:
        print(error, file=sys.stderr)
        return error.exit_code
    print(outcome.text, end="")
    return outcome.status


if __name__ == "__main__":
    sys.exit(main())
