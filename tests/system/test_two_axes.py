"""Ribbons whose magnetometers measure two axes reach the surface as exactly as the product promises."""

import numpy as np
import pytest
from numpy.typing import NDArray
from ribbonhil.ribbon import EmulatedRibbon, drawn_device
from ribbonhil.scenes import load_scene
from ribbonhil.truth import Field, RibbonTruth, comb_truth
from ribbonhost.framing import Deframer, crc32, encode_frame
from ribbonhost.reconstruct import CombLayout, CombSolver, error_percent
from ribbonhost.wire import Ack, AckCode, Calibration, Command, CommandCode, Orient, Packet, decode, encode

RIBBONS = 5
PERIOD_S = 20.0
SETTLED_S = 2.0
END_S = SETTLED_S + 10.0
EVERY = 10
"""Frames of the comb are solved at a tenth of the rate of scans."""


class Session:
    """A ribbon in virtual time, and what it says."""

    def __init__(self, truth: RibbonTruth, index: int) -> None:
        self.ribbon = EmulatedRibbon.from_truth(truth, drawn_device(0, index, clock_ppm_max=0.0))
        self._deframer = Deframer()

    def run_until(self, t_s: float) -> list[Packet]:
        self.ribbon.run_until(t_s)
        return [decode(packet)[0] for packet in self._deframer.feed(self.ribbon.read())]

    def command(self, code: CommandCode, argument: int = 0, data: bytes = b"") -> Ack:
        self.ribbon.write(encode_frame(encode(Command(tag=7, command=code, argument=argument, data=data))))
        packets = self.run_until(self.ribbon.now_s + 0.05)
        (ack,) = [packet for packet in packets if isinstance(packet, Ack)]
        assert ack.code == AckCode.OK
        return ack

    def measure_axes(self, axes: int) -> None:
        """Gives the ribbon the identity calibration of one whose magnetometers have so many axes."""
        size = self.command(CommandCode.CALIBRATION_READ).value
        record = b"".join(
            self.command(CommandCode.CALIBRATION_READ, offset).data for offset in range(0, size, 192)
        )
        values = {
            name: getattr(Calibration.unpack(record), name) for name in Calibration.__dataclass_fields__
        }
        record = Calibration(**{**values, "mag_axes": axes, "created_s": 1}).pack()
        for offset in range(0, size, 192):
            self.command(CommandCode.CALIBRATION_WRITE, offset, record[offset : offset + 192])
        self.command(CommandCode.CALIBRATION_COMMIT, crc32(record))


def scanned(truth: RibbonTruth, index: int) -> tuple[NDArray[np.float64], list[Orient]]:
    """True times of the ends of the scans after it has settled, and the packets of those scans."""
    session = Session(truth, index)
    session.run_until(0.5)
    session.measure_axes(2)
    session.run_until(SETTLED_S)
    start_us = session.ribbon.device_us
    orients = [packet for packet in session.run_until(END_S) if isinstance(packet, Orient)]
    since_us = np.array([(orient.t_us - start_us) % 2**32 for orient in orients], np.float64)
    return SETTLED_S + since_us * 1e-6, orients


@pytest.mark.parametrize(("name", "limit_percent"), [("wing", 0.25), ("breath", 0.25), ("sea", 0.5)])
def test_two_measured_axes_give_the_surface(name: str, limit_percent: float) -> None:
    truth = comb_truth(load_scene(name, PERIOD_S), RIBBONS, Field())
    start_m = tuple(0.15 * ribbon for ribbon in range(RIBBONS))
    solver = CombSolver(CombLayout(0.025, 16, start_m))
    ribbons = [scanned(truth.ribbon(index), index) for index in range(RIBBONS + 1)]
    errors = []
    for frame in range(0, min(len(orients) for _, orients in ribbons), EVERY):
        nodes = [orients[frame].nodes for _, orients in ribbons]
        solved = solver.solve(
            np.array([node.q_world_node for node in nodes]), np.array([node.valid for node in nodes])
        )
        t_s = np.mean([times[frame] for times, _ in ribbons])
        errors.append(error_percent(solved.node_m[1:], truth.node_from_anchor_m(t_s)[1:], 0.775))
    assert len(errors) > 90
    assert np.mean(errors) <= limit_percent
