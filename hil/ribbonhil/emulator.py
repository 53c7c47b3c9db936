"""Emulated combs in real time: all ribbons in one thread, each with a port that a host can open."""

import threading
import time
from collections.abc import Callable, Sequence
from types import TracebackType
from typing import Protocol, Self

import numpy as np
from ribbonhost.errors import LinkError

from ribbonhil.comb_spec import CombSpec
from ribbonhil.disturbances import Disturbance
from ribbonhil.emulated_device import Device, drawn_device
from ribbonhil.faults import NO_FAULTS, Fault, FaultyLine, LinkFaults
from ribbonhil.ribbon import EmulatedRibbon
from ribbonhil.scenes import Array
from ribbonhil.sensor_string import BusCounters
from ribbonhil.truth import CombTruth, Field, RibbonTruth
from ribbonhil.world import disturbed, load_world, world_truth

__all__ = ["EmulatedComb", "EmulatedRibbon", "Line"]

IDLE_S = 0.1  # longest sleep of the thread, whatever the ribbons wait for
LAZY_S = 1e-3  # what no host can see may happen so much late: fewer wake-ups


class _Ribbon(Protocol):
    """What a comb is made of; each in virtual time."""

    @property
    def device(self) -> Device: ...
    @property
    def next_event_s(self) -> float: ...
    @property
    def is_sending(self) -> bool: ...
    def run_until(self, t_s: float) -> None: ...
    def write(self, data: bytes) -> int: ...
    def read(self) -> bytes: ...
    def add_fault(self, fault: Fault) -> None: ...
    def counters(self) -> BusCounters: ...
    def feel(self, truth: RibbonTruth) -> None: ...


class Line:
    """The host's end of the link to one ribbon: what an open port reads and writes. Any thread may call.

    on_arrival: called, in the emulator's thread, after bytes have arrived; must return at once.
    """

    def __init__(self, world: "_World", index: int, faults: LinkFaults) -> None:
        self.index = index
        self.on_arrival: Callable[[], None] | None = None
        self._world = world
        self._faults = faults
        self._opened_s = world.now_s()
        self._times_unplugged = world.times_unplugged[index]
        self._to_host = FaultyLine(faults, world.spec.seed + index, 0)
        self._to_device = FaultyLine(faults, world.spec.seed + index, 1)
        self._arrived = threading.Condition()
        self._bytes = bytearray()
        self._cancelled = False
        self._closed = False

    @property
    def waiting(self) -> int:
        """Bytes that read() would return at once."""
        return len(self._bytes)

    def is_connected(self) -> bool:
        """Whether the link is there; once gone, this line stays gone, and a new one must be opened."""
        return (
            self._world.times_unplugged[self.index] == self._times_unplugged
            and self.index not in self._world.unplugged
            and self._faults.is_connected(self._opened_s, self._world.now_s())
        )

    def write(self, data: bytes) -> None:
        """Sends bytes to the device. Raises LinkError if the link is gone."""
        if not self.is_connected():
            raise LinkError("the device is gone")
        self._world.write(self.index, self._to_device.pass_on(data))

    def read(self, size: int, timeout_s: float | None) -> bytes:
        """Up to `size` bytes: as soon as there are so many, or what there is after timeout_s (None: never).

        Returns early when it is cancelled or the line closes. Raises LinkError if the link is gone.
        """
        deadline_s = None if timeout_s is None else time.monotonic() + timeout_s
        with self._arrived:
            while len(self._bytes) < size and not self._cancelled and not self._closed:
                if not self.is_connected():
                    raise LinkError("the device is gone")
                left_s = IDLE_S if deadline_s is None else min(IDLE_S, deadline_s - time.monotonic())
                if left_s <= 0:
                    break
                self._arrived.wait(left_s)
            self._cancelled = False
            data = bytes(self._bytes[:size])
            del self._bytes[:size]
            return data

    def cancel_read(self) -> None:
        """Makes a read that waits, or else the next one, return what there is."""
        with self._arrived:
            self._cancelled = True
            self._arrived.notify_all()

    def discard(self) -> None:
        """Forgets what was received and not read."""
        with self._arrived:
            self._bytes.clear()

    def close(self) -> None:
        """Gives the ribbon back, so that it can be opened again. Harmless when closed before."""
        with self._arrived:
            if self._closed:
                return
            self._closed = True
            self._arrived.notify_all()
        self._world.disconnect(self)
        _release(self._world)

    def deliver(self, data: bytes) -> None:
        """Bytes that have left the device."""
        if self.is_connected():
            with self._arrived:
                self._bytes += self._to_host.pass_on(data)
                self._arrived.notify_all()
            if self.on_arrival is not None:
                self.on_arrival()


class _World:
    """The ribbons of one comb and the thread that runs them, once they are powered up."""

    def __init__(self, spec: CombSpec) -> None:
        self.spec = spec
        self.users = 0
        devices = [
            drawn_device(
                spec.seed,
                index,
                noise=spec.noise,
                clock_ppm_max=spec.clock_ppm,
                baud=spec.baud,
                part_errors=spec.part_errors,
                warming_c=spec.warming_c,
            )
            for index in range(spec.ribbons + 1)
        ]
        earth = Field(spec.dip_deg, spec.field_ut)
        world = load_world(spec.scene, spec.period_s)
        self.truth: CombTruth = world_truth(world, spec.ribbons, earth, devices=devices)
        felt = disturbed(self.truth, earth, spec.disturbances())
        self.ribbons = [_new_ribbon(spec, felt.ribbon(index), device) for index, device in enumerate(devices)]
        self._lines: list[Line | None] = [None] * len(self.ribbons)
        self._due_s = [0.0] * len(self.ribbons)
        self.unplugged: set[int] = set()
        self.times_unplugged = [0] * len(self.ribbons)
        self._changed = threading.Condition()
        self._ending = False
        self.start_s = np.inf
        self._thread = threading.Thread(target=self._run, name=f"emulated {spec.scene}", daemon=True)

    def power_up(self) -> None:
        """Lets true time begin, unless it has."""
        with self._changed:
            if not self._is_powered():
                self.start_s = time.monotonic()
                self._thread.start()

    def now_s(self) -> float:
        """True time: seconds since the ribbons were powered up, 0 before."""
        return max(0.0, time.monotonic() - self.start_s)

    def end(self) -> None:
        with self._changed:
            self._ending = True
            self._changed.notify_all()
        if self._is_powered():
            self._thread.join()

    def _is_powered(self) -> bool:
        return self.start_s < np.inf

    def connect(self, index: int, faults: LinkFaults) -> Line:
        """Raises LinkError if the ribbon is open already or not there."""
        with self._changed:
            other = self._lines[index]
            if other is not None and other.is_connected():
                raise LinkError(f"ribbon {index} of {self.spec.scene} is open already")
            line = Line(self, index, faults)
            if not line.is_connected():
                raise LinkError(f"ribbon {index} of {self.spec.scene} is disconnected")
            self._lines[index] = line
            return line

    def disconnect(self, line: Line) -> None:
        with self._changed:
            if self._lines[line.index] is line:
                self._lines[line.index] = None

    def plug(self, index: int, plugged: bool) -> None:
        with self._changed:
            if plugged:
                self.unplugged.discard(index)
            elif index not in self.unplugged:
                self.unplugged.add(index)
                self.times_unplugged[index] += 1

    def write(self, index: int, data: bytes) -> None:
        with self._changed:
            # Bytes arrive now, not when the thread last looked.
            self.ribbons[index].run_until(self.now_s())
            self.ribbons[index].write(data)
            self._due_s[index] = 0.0
            self._changed.notify_all()

    def disturb(self, disturbances: Sequence[Disturbance]) -> None:
        earth = Field(self.spec.dip_deg, self.spec.field_ut)
        truth = disturbed(self.truth, earth, disturbances)
        with self._changed:
            for index, ribbon in enumerate(self.ribbons):
                ribbon.feel(truth.ribbon(index))

    def add_fault(self, index: int, fault: Fault) -> None:
        with self._changed:
            self.ribbons[index].add_fault(fault)

    def counters(self, index: int) -> BusCounters:
        with self._changed:
            return self.ribbons[index].counters()

    def _run(self) -> None:
        with self._changed:
            while not self._ending:
                now_s = self.now_s()
                for index, ribbon in enumerate(self.ribbons):
                    if self._due_s[index] > now_s:
                        continue
                    ribbon.run_until(now_s)
                    data, line = ribbon.read(), self._lines[index]
                    if data and line is not None:
                        line.deliver(data)
                    lazy_s = 0.0 if ribbon.is_sending else now_s + LAZY_S
                    self._due_s[index] = max(ribbon.next_event_s, lazy_s)
                # Waiting, however shortly, lets writers in.
                self._changed.wait(max(0.0, min(IDLE_S, min(self._due_s) - self.now_s())))


def _new_ribbon(spec: CombSpec, truth: RibbonTruth, device: Device) -> _Ribbon:
    """Raises UsageError for an image that cannot be run."""
    if not spec.image:
        return EmulatedRibbon.from_truth(truth, device)
    # The model of the MCU needs a library that ribbons without an image do without.
    from ribbonhil.stm32f405.image_ribbon import image_ribbon

    return image_ribbon(spec.image, spec.board, truth, device)


_worlds: dict[CombSpec, _World] = {}
_worlds_lock = threading.RLock()


def _acquire(spec: CombSpec) -> _World:
    with _worlds_lock:
        world = _worlds.get(spec)
        if world is None:
            world = _worlds[spec] = _World(spec)
        world.users += 1
        return world


def _release(world: _World) -> None:
    with _worlds_lock:
        world.users -= 1
        if world.users == 0:
            del _worlds[world.spec]
        else:
            return
    world.end()


def open_line(spec: CombSpec, index: int, faults: LinkFaults = NO_FAULTS) -> Line:
    """Opens the link to a ribbon of a comb, which starts to run if it does not yet.

    Raises LinkError if that is open already, SceneError or UsageError if there can be no such comb.
    """
    world = _acquire(spec)
    try:
        line = world.connect(index, faults)
    except LinkError:
        _release(world)
        raise
    # Only now: the first packets of a ribbon that starts with its line must find it open.
    world.power_up()
    return line


class EmulatedComb:
    """A comb that runs in real time from its creation until close(), whether or not its ports are open.

    urls: ports of the ribbons for pyserial, the reference first.
    serials: serial numbers of the devices, in the same order.
    layout_start_m: where ribbon 1, 2 ... starts on the reference.
    pitch_m: distance between neighbouring slots.
    devices: what was drawn of each ribbon, the errors of its parts among it.
    """

    def __init__(
        self,
        scene: str = "wing",
        ribbons: int = 5,
        seed: int = 0,
        period_s: float | None = None,
        noise: float = 1.0,
        *,
        dip_deg: float = 62.0,
        field_ut: float = 48.0,
        clock_ppm: float = 20.0,
        baud: int = 921_600,
        faults: LinkFaults = NO_FAULTS,
        image: str = "",
        board: str = "pyboard_v11",
        part_errors: int | None = None,
        warming_c: float = 0.0,
        disturb: str = "",
    ) -> None:
        """See CombSpec. Raises SceneError or UsageError for a comb that cannot be."""
        self.spec = CombSpec(
            scene=scene,
            ribbons=ribbons,
            seed=seed,
            period_s=period_s,
            noise=float(noise),
            dip_deg=dip_deg,
            field_ut=field_ut,
            clock_ppm=clock_ppm,
            baud=baud,
            image=image,
            board=board,
            part_errors=part_errors,
            warming_c=float(warming_c),
            disturb=disturb,
        )
        self._world = _acquire(self.spec)
        self._world.power_up()
        self._open = True
        self.urls = tuple(self.spec.url(index, faults) for index in range(ribbons + 1))
        self.serials = tuple(ribbon.device.serial for ribbon in self._world.ribbons)
        self.layout_start_m = self._world.truth.start_m
        self.pitch_m = self._world.truth.pitch_m
        self.devices = tuple(ribbon.device for ribbon in self._world.ribbons)

    def disturb(self, disturbances: Sequence[Disturbance]) -> None:
        """Lets these disturb the field from now on, in place of those before.

        Raises UsageError for one that no ribbon can carry.
        """
        self._world.disturb(disturbances)

    @property
    def start_host_s(self) -> float:
        """Host time (time.monotonic) at which the ribbons were powered up: true time 0."""
        return self._world.start_s

    def truth_node_m(self, t_host_s: float | Array) -> Array:
        """True node positions from the reference's anchor, (..., R + 1, n, 3), at host times (...)."""
        t_s = np.asarray(t_host_s, dtype=np.float64) - self._world.start_s
        return self._world.truth.node_from_anchor_m(t_s)

    def add_fault(self, index: int, fault: Fault) -> None:
        """Adds a fault to the sensors of a ribbon; its times count from start_host_s."""
        self._world.add_fault(index, fault)

    def counters(self, index: int) -> BusCounters:
        """What happened on the sensor bus of a ribbon so far."""
        return self._world.counters(index)

    def plug(self, index: int, plugged: bool) -> None:
        """Pulls the cable of a ribbon, or puts it back: open ports fail, opening fails."""
        self._world.plug(index, plugged)

    def close(self) -> None:
        """Stops the ribbons unless somebody else has them open. Harmless when closed before."""
        if self._open:
            self._open = False
            _release(self._world)

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self.close()
