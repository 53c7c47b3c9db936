"""The stream: scans of the devices in, frames of the comb out, and what there is to say about both."""

import queue
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace

from ribbonhost import wire
from ribbonhost.device import Device, Scan, Seeker
from ribbonhost.errors import LinkLostError, RibbonError
from ribbonhost.pipeline.arrangement import REFERENCE_ABSENT, Arrangement
from ribbonhost.pipeline.estimating import source_of
from ribbonhost.pipeline.joining import Admission
from ribbonhost.pipeline.keeper import Keeper
from ribbonhost.pipeline.poses import MotionMode
from ribbonhost.pipeline.readings import NO_CALIBRATIONS
from ribbonhost.pipeline.reconstruction import Reconstruction
from ribbonhost.pipeline.report import Report
from ribbonhost.pipeline.solving import OnSolved, Truth
from ribbonhost.reconstruct.comb import Method

QUEUE_SCANS = 1024
"""Scans that may wait for reconstruction; further ones are dropped and counted."""

BEHIND_SCANS = 120
"""While so many wait, a fifth of a second of six ribbons, further ones go without their readings: the level
reading costs next to nothing. The user is told, once."""

POLL_S = 0.1
UNDERWAY_S = 0.5
"""So long a scan that arrived is at most on its way to the reconstruction."""

SETTLE_S = 3.0
"""So long a stream waits at most, before it starts to count, for all nodes of all ribbons to be valid."""
SETTLED_S = 0.2


class Stream:
    """Runs the devices of an arrangement and reconstructs what they send.

    Threads: one reads each link and decodes, one matches and reconstructs, one keeps the devices in order,
    and one looks for those whose ports vanished.
    """

    def __init__(
        self,
        arrangement: Arrangement,
        *,
        rate_hz: int,
        method: Method = "spline",
        truth: Truth | None = None,
        on_event: Callable[[str, str], None] = lambda label, what: None,
        on_solved: Iterable[OnSolved] = (),
        reconnect: bool = False,
        motion: MotionMode = "off",
        calibrations: dict[str, wire.Calibration] | None = None,
        named: Sequence[str] = (),
        on_joined: Callable[[Device], None] = lambda device: None,
    ) -> None:
        """`on_event` is told, in any thread, what happened to which ribbon; each of `on_solved` each
        frame, in the thread that reconstructs. reconnect: look for ribbons that are absent or whose ports
        vanish; named: see Seeker. on_joined: told, in any thread, which absent one was set up.
        motion, calibrations: see source_of; the devices are asked for RAW where motion is estimated. Those of
        ribbons that join are read and added, unless it is None."""
        self._places = arrangement.places
        self._on_event = on_event
        self._named = named
        self._admission = Admission(
            arrangement, rate_hz, calibrations, lambda device, what: on_event(self._labels[device], what)
        )
        self._reconstruction = Reconstruction(
            arrangement,
            rate_hz=rate_hz,
            method=method,
            truth=truth,
            on_event=on_event,
            on_solved=on_solved,
            source_of=source_of(
                motion,
                arrangement,
                rate_hz=rate_hz,
                calibrations=NO_CALIBRATIONS if calibrations is None else calibrations,
                on_event=on_event,
            ),
        )
        self._labels = {place.device: place.label for place in self._places if place.device}
        self._failed: set[Device] = set()
        self._keeper = Keeper(
            arrangement.devices,
            rate_hz,
            lambda device, what: on_event(self._labels[device], what),
            raw=motion != "off",
            on_joined=on_joined,
        )
        self._reconnect = reconnect
        self._seeker: Seeker | None = None
        self._queue: queue.SimpleQueue[tuple[int, Scan | LinkLostError]] = queue.SimpleQueue()
        self._dropped = [0] * len(self._places)
        self._estimates = motion != "off"
        self._told_behind = False
        self._stopping = threading.Event()
        self._thread = threading.Thread(target=self._work, name="reconstruct", daemon=True)

    def start(self, stop: threading.Event | None = None) -> None:
        """Sets the devices up, lets them send, and starts to count once all deliver valid nodes.

        Nodes that stay invalid delay the count for SETTLE_S, then they are counted. A device that cannot be
        set up is reported to `on_event` and left out. `stop`, once set, cuts the waiting short.

        Raises RibbonError if no device that is there can be set up, or, in a comb, the reference cannot.
        """
        self._leave_out(self._keeper.prepare())
        for index, place in enumerate(self._places):
            if place.device:
                place.device.on_scan = self._taker(index)
                place.device.on_lost = self._loser(index)
        self._thread.start()
        self._leave_out(self._keeper.start())
        if self._reconnect:
            kept = [device for device in self._labels if device not in self._failed]
            self._seeker = Seeker(
                kept,
                self._welcome,
                named=self._named,
                admit=self._admission.admit,
                on_refused=self._refuse,
            )
            self._seeker.start()
        self._settle(stop or threading.Event())
        self._reconstruction.start_counting(sum(self._dropped))

    def close(self) -> None:
        """Quiets the devices, closes their links and ends all threads."""
        if self._seeker:
            self._seeker.stop()
        self._keeper.stop()
        self._stopping.set()
        if self._thread.is_alive():
            self._thread.join()
        for device in self._labels:
            device.link.stop()
        for device in self._labels:
            device.close()

    @property
    def over(self) -> str:
        """Why nothing more can come, unless a ribbon comes back; empty while something can."""
        if self._is_alone:
            return "no ribbon is left"
        if self._reconstruction.is_comb and (device := self._places[0].device) and device.lost:
            gone = "gone" if device.info else "absent"
            return f"the reference ribbon is {gone}: {device.lost}; meanwhile {REFERENCE_ABSENT}"
        return ""

    @property
    def _is_alone(self) -> bool:
        return all(device.lost or device in self._failed for device in self._labels)

    def report(self) -> Report:
        """What happened since the count began; rates are over the time since the report before."""
        return self._reconstruction.report(
            failed=self._failed, is_aligned=self._keeper.aligner.is_aligned, dropped=sum(self._dropped)
        )

    def _leave_out(self, failed: Mapping[Device, RibbonError]) -> None:
        for device, error in failed.items():
            if self._reconstruction.is_comb and device is self._places[0].device:
                raise error
            self._failed.add(device)
            self._on_event(self._labels[device], f"is left out: {error}")
            if all(other in self._failed or other.info is None for other in self._labels):
                raise error

    def _taker(self, index: int) -> Callable[[Scan], None]:
        def take(scan: Scan) -> None:
            waiting = self._queue.qsize()
            if waiting < QUEUE_SCANS:
                is_behind = scan.raw is not None and waiting > BEHIND_SCANS
                self._queue.put((index, replace(scan, raw=None) if is_behind else scan))
            else:
                self._dropped[index] += 1

        return take

    def _loser(self, index: int) -> Callable[[LinkLostError], None]:
        """In its turn among the scans, so that a recording of them gives the same frames."""
        return lambda error: self._queue.put((index, error))

    def _lose(self, index: int, error: LinkLostError) -> None:
        self._reconstruction.lose(index)
        looked_for = ": it is looked for until it is back" if self._reconnect else ""
        self._on_event(self._places[index].label, f"{error}{looked_for}")

    def _welcome(self, device: Device, away_s: float) -> None:
        self._on_event(self._labels[device], f"is back on {device.name} after {away_s:.1f} s")

    def _refuse(self, device: Device | None, why: str) -> None:
        self._on_event(self._labels[device] if device else "stream", why)

    def _settle(self, stop: threading.Event) -> None:
        deadline_s = time.monotonic() + SETTLE_S
        devices = [device for device in self._labels if device not in self._failed and not device.lost]
        while time.monotonic() < deadline_s and not stop.is_set() and not self._is_alone:
            before = {device: device.counters() for device in devices}
            stop.wait(SETTLED_S)
            news = [device.counters() - before[device] for device in devices]
            if all(new.frames and not new.invalid_nodes for new in news):
                return

    def _work(self) -> None:
        while not self._stopping.is_set():
            try:
                place, what = self._queue.get(timeout=POLL_S)
            except queue.Empty:
                # Scans tell the time while there are any, so that a recording of them gives the same frames.
                self._reconstruction.expire(time.monotonic() - UNDERWAY_S)
            else:
                if isinstance(what, LinkLostError):
                    self._lose(place, what)
                    continue
                self._reconstruction.take(place, what)
                if not self._told_behind and self._queue.qsize() > BEHIND_SCANS:
                    self._told_behind = True
                    self._on_event("stream", self._behind())

    def _behind(self) -> str:
        if self._estimates:
            return (
                "this computer does not keep up: motion is estimated in part only; give --motion off, or a "
                "lower --rate"
            )
        return "this computer does not keep up: what is shown is late; give a lower --rate"
