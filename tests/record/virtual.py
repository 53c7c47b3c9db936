"""An emulated comb that is streamed and recorded in virtual time: the same each time, and quick."""

from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace

import pytest
from ribbonhil.ribbon import EmulatedRibbon
from ribbonhil.scenes import load_scene
from ribbonhil.truth import Field, comb_truth
from ribbonhost import wire
from ribbonhost.comb import Comb, CombRibbon
from ribbonhost.device import Device
from ribbonhost.errors import LinkLostError
from ribbonhost.framing import encode_frame
from ribbonhost.link import Link
from ribbonhost.pipeline.arrangement import arrange_comb
from ribbonhost.pipeline.estimating import source_of
from ribbonhost.pipeline.header import header_of
from ribbonhost.pipeline.poses import MotionMode
from ribbonhost.pipeline.reconstruction import Reconstruction
from ribbonhost.pipeline.solving import Solved
from ribbonhost.reconstruct.comb import Method
from ribbonhost.record import Recorder

START_S = 1000.0
STEP_S = 0.002
PONG_STEP_S = 0.0001
"""How exactly the arrival of answers to pings is known, and with it the time of scans."""
RATE_HZ = 100


def host_time_s(t_s: float) -> float:
    """A whole number of nanoseconds, as time.monotonic() has it."""
    return round((START_S + t_s) * 1e9) / 1e9


class VirtualLink(Link):
    """Hands over bytes when told; what is written arrives at once."""

    def __init__(self, ribbon: EmulatedRibbon, name: str) -> None:
        self.ribbon = ribbon
        self.name = name
        self.lost = None
        self.bytes_read = 0

    def start(
        self, on_bytes: Callable[[bytes, float], None], on_lost: Callable[[LinkLostError], None] | None = None
    ) -> None:
        self.on_bytes = on_bytes

    def write(self, data: bytes) -> None:
        self.ribbon.write(data)

    def deliver(self, t_s: float) -> None:
        self.ribbon.run_until(t_s)
        if data := self.ribbon.read():
            self.on_bytes(data, host_time_s(t_s))


def stream_virtually(
    path: Path,
    monkeypatch: pytest.MonkeyPatch,
    *,
    seconds: float = 2.0,
    ribbons: int = 2,
    method: Method = "spline",
    period_s: float | None = None,
    spoil_at_s: float | None = None,
    motion: MotionMode = "off",
    truth: bool = False,
) -> list[Solved]:
    """Records the wing to `path` and returns what was reconstructed. True time 0 is START_S.

    motion: how it is reconstructed; unless off, RAW comes beside ORIENT. truth: the frames hold it.
    """
    clock = SimpleNamespace(t_s=START_S)
    monkeypatch.setattr("ribbonhost.device.device.time", SimpleNamespace(monotonic=lambda: clock.t_s))
    recorder = Recorder(path)
    links, devices, taps = [], [], []
    for index in range(ribbons + 1):
        ribbon = EmulatedRibbon("wing", index, ribbons=ribbons, period_s=period_s)
        links.append(VirtualLink(ribbon, f"ribbon {index}"))
        taps.append(recorder.tap())
        devices.append(Device(links[-1], taps[-1]))
    t_s = 0.0

    def pass_time(duration_s: float, step_s: float = STEP_S) -> None:
        nonlocal t_s
        for _ in range(round(duration_s / step_s)):
            t_s += step_s
            clock.t_s = host_time_s(t_s)
            for link in links:
                link.deliver(t_s)

    pass_time(0.02)
    for code, argument in (
        (wire.CommandCode.GET_INFO, 0),
        (wire.CommandCode.SET_MODE, 0),
        (wire.CommandCode.SET_RATE, RATE_HZ),
        (wire.CommandCode.GET_STATUS, 0),
    ):
        for device in devices:
            device._send_command(int(code), code, argument, b"")
        pass_time(0.02)
    for _ in range(20):
        for device in devices:
            device.ping()
        pass_time(0.002, PONG_STEP_S)
        pass_time(0.018)
    serials = [device.serial for device in devices]
    starts = [0.15 * index for index in range(ribbons)]
    comb = Comb(
        serials[0], 0.025, tuple(CombRibbon(s, at) for s, at in zip(serials[1:], starts, strict=True))
    )
    arrangement = arrange_comb(devices, comb)
    solved: list[Solved] = []
    true = comb_truth(load_scene("wing", period_s), ribbons, Field())
    reconstruction = Reconstruction(
        arrangement,
        rate_hz=RATE_HZ,
        method=method,
        truth=(lambda t_host_s: true.node_from_anchor_m(t_host_s - START_S)) if truth else None,
        on_solved=[solved.append],
        source_of=source_of(
            motion, arrangement, rate_hz=RATE_HZ, calibrations={}, on_event=lambda label, what: None
        ),
    )
    for index, device in enumerate(devices):
        device.on_scan = lambda scan, index=index: reconstruction.take(index, scan)
    channels = {device: tap.channel for device, tap in zip(devices, taps, strict=True)}
    recorder.start(header_of(arrangement, channels, comb=comb, rate_hz=RATE_HZ, method=method, motion=motion))
    for device in devices:
        mode = wire.Mode.ORIENT if motion == "off" else wire.Mode.ORIENT | wire.Mode.RAW
        device._questions.ask(9, wire.CommandCode.SET_MODE)
        device._send_command(9, wire.CommandCode.SET_MODE, int(mode), b"")
    pass_time(0.5)
    solved.clear()
    recorder.keep(-1, "recording", 1, clock.t_s, b"the stream counts from here")
    end_s = t_s + seconds
    while t_s < end_s - 1e-9:
        for device in devices:
            device.ping()
        if spoil_at_s is not None and t_s > spoil_at_s:
            links[1].on_bytes(encode_frame(b"\x02spoiled")[:-2] + b"\x11\0", clock.t_s)
            spoil_at_s = None
        pass_time(0.002, PONG_STEP_S)
        pass_time(0.248)
    recorder.close()
    return solved
