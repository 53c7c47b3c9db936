"""A whole ribbon on the wing scene, emulated at register level, and what its host sees of it."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache

import numpy as np
from firmware.rotations import angle_deg
from numpy.typing import NDArray
from ribbonhil.faults import Fault
from ribbonhil.ribbon import Device, EmulatedRibbon, drawn_device
from ribbonhil.scenes import load_scene
from ribbonhil.truth import CombTruth, RibbonTruth, comb_truth
from ribbonhost import wire
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.wire import Ack, AckCode, Command, CommandCode, Mode, Orient, Raw, Status

RIBBON = 2
SLOTS, NODES = 32, 16


@cache
def wing() -> CombTruth:
    """The scene that all tests of whole ribbons share, 20 s a period."""
    return comb_truth(load_scene("wing", 20.0), 3)


@dataclass(frozen=True)
class Seen:
    """What arrived while time passed: packets in order, readings and orientations with their true times.

    reasons: (T, S) of RAW. t_raw_s: (T,).
    error_deg: (T', N) of ORIENT against the truth, NaN where not valid. t_orient_s: (T',).
    """

    packets: list[wire.Packet]
    t_raw_s: NDArray[np.float64]
    reasons: NDArray[np.int64]
    t_orient_s: NDArray[np.float64]
    error_deg: NDArray[np.float64]

    @property
    def statuses(self) -> list[Status]:
        return [p for p in self.packets if isinstance(p, Status)]


class RunningRibbon:
    """An emulated ribbon, started and sending ORIENT and RAW unless told otherwise."""

    def __init__(
        self,
        device: Device | None = None,
        *,
        faults: tuple[Fault, ...] = (),
        mode: int = Mode.ORIENT | Mode.RAW,
        truth: RibbonTruth | None = None,
    ) -> None:
        self.ribbon = EmulatedRibbon.from_truth(
            truth or wing().ribbon(RIBBON), device or drawn_device(3, RIBBON)
        )
        for fault in faults:
            self.ribbon.add_fault(fault)
        self._deframer = Deframer()
        self._tag = 0
        self.run_until(0.3)
        self.accepted(CommandCode.SET_MODE, mode)

    def run_until(self, t_s: float) -> list[wire.Packet]:
        """All packets that arrive until true time t_s."""
        self.ribbon.run_until(t_s)
        packets = [wire.decode(packet)[0] for packet in self._deframer.feed(self.ribbon.read())]
        assert (self._deframer.crc_errors, self._deframer.malformed) == (0, 0)
        return packets

    def command(
        self, code: CommandCode, argument: int = 0, data: bytes = b""
    ) -> tuple[Ack, list[wire.Packet]]:
        """Sends a command, lets 60 ms pass, returns its ACK and all packets of that time."""
        self._tag += 1
        command = Command(tag=self._tag, command=code, argument=argument, data=data)
        self.ribbon.write(encode_frame(wire.encode(command)))
        packets = self.run_until(self.ribbon.now_s + 0.06)
        acks = [p for p in packets if isinstance(p, Ack) and p.tag == self._tag]
        assert len(acks) == 1
        return acks[0], packets

    def accepted(self, code: CommandCode, argument: int = 0, data: bytes = b"") -> Ack:
        ack, _ = self.command(code, argument, data)
        assert ack.code == AckCode.OK
        return ack

    def status(self) -> Status:
        _, packets = self.command(CommandCode.GET_STATUS)
        # On a slow link it takes 40 ms after the answers and the frame before it.
        packets += self.run_until(self.ribbon.now_s + 0.06)
        return next(p for p in packets if isinstance(p, Status))

    def true_time_s(self, t_us: int) -> float:
        """True time at which the device's clock shows t_us, in its first 71 minutes."""
        device = self.ribbon.device
        return (t_us - device.clock_offset_us) % 2**32 * 1e-6 / (1 + device.clock_ppm * 1e-6)

    def watch(self, until_s: float) -> Seen:
        """Runs until true time until_s."""
        packets = self.run_until(until_s)
        raws = [p for p in packets if isinstance(p, Raw)]
        orients = [p for p in packets if isinstance(p, Orient)]
        reasons = np.empty((len(raws), SLOTS), int)
        reasons[:, 0::2] = np.array([p.accels.reason for p in raws]).reshape(-1, NODES)
        reasons[:, 1::2] = np.array([p.mags.reason for p in raws]).reshape(-1, NODES)
        t_orient_s = np.array([self.true_time_s(p.t_us) for p in orients])
        truth = wing().q_world_slot(t_orient_s)[:, RIBBON, 1::2]
        return Seen(
            packets=packets,
            t_raw_s=np.array([self.true_time_s(p.t_us) for p in raws]),
            reasons=reasons,
            t_orient_s=t_orient_s,
            error_deg=angle_deg(np.array([p.nodes.q_world_node for p in orients]), truth),
        )
