"""Orientations of a comb by way of emulated sensors, the firmware and its packets, in virtual time."""

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from ribbonhost import wire
from ribbonhost.errors import UsageError
from ribbonhost.framing import Deframer

if TYPE_CHECKING:
    from ribbonhil.emulated_device import Device
    from ribbonhil.geodesics import Geodesics
    from ribbonhil.ribbon import EmulatedRibbon
    from ribbonhil.scenes import Scene

Float64 = NDArray[np.float64]

RIBBONS = 5
RATE_HZ = 100
RECORDED_S = 5.0
"""A moving comb is recorded over whole periods of its motion, and no shorter than that."""
START_UP_S = 2.0
"""A moving comb is recorded from so long after power-up, when the firmware's filters have settled."""
REST_S = 0.3
"""A comb at rest is read so long after power-up; soon after, readings that never change count as stuck."""


@dataclass(frozen=True)
class Orientations:
    """Orientations of a comb as a host gets them, and where the nodes truly are.

    t_s: (frames,). q_world_node: (frames, R + 1, n, 4), valid: (frames, R + 1, n), sigma_rad: (frames,
    R + 1, n).
    node_m: (frames, R + 1, n, 3) from the reference's anchor.
    """

    t_s: Float64
    q_world_node: Float64
    valid: NDArray[np.bool_]
    sigma_rad: Float64
    node_m: Float64


def load(name: str) -> "Scene":
    """A scene by name or file. Raises UsageError if there is no such scene, or no emulator."""
    try:
        from ribbonhil.scenes import load_scene
    except ImportError as error:
        raise UsageError("the benchmark needs the emulator: install it with pip install -e hil") from error
    return load_scene(name)


def trace(scene: "Scene", frames: int) -> "Geodesics":
    """The comb at `frames` equal steps of a period: arrays (frames, R + 1, slots, 3)."""
    from ribbonhil.truth import trace_comb

    return trace_comb(scene, RIBBONS, np.arange(frames) / frames)


def true_nodes(lines: "Geodesics") -> Float64:
    """(frames, R + 1, n, 3) positions of the nodes from the reference's anchor."""
    from_anchor = lines.position_m - lines.position_m[:, :1, :1]
    return np.ascontiguousarray(from_anchor[:, :, 1::2])


def exact(scene: "Scene", lines: "Geodesics") -> Orientations:
    """Orientations without any error."""
    from ribbonhil.truth import quaternions

    matrices = np.stack([lines.tangent, lines.binormal, lines.normal], axis=-1)[:, :, 1::2]
    q = np.ascontiguousarray(quaternions(matrices))
    shape = q.shape[:-1]
    t_s = np.arange(len(q)) / len(q) * scene.period_s
    return Orientations(t_s, q, np.ones(shape, np.bool_), np.zeros(shape), true_nodes(lines))


def at_rest(lines: "Geodesics", noise: float, seed: int) -> Orientations:
    """Each frame held still: what the firmware says REST_S after power-up."""
    from ribbonhil.ribbon import EmulatedRibbon
    from ribbonhil.truth import GRAVITY_MPS2, Field, RibbonTruth

    matrices = np.stack([lines.tangent, lines.binormal, lines.normal], axis=-1)
    force = np.einsum("...ij,i->...j", matrices, [0.0, 0.0, GRAVITY_MPS2])
    field = np.einsum("...ij,i->...j", matrices, Field().world_ut())
    frames = []
    for f in range(len(matrices)):
        rows = slice(f, f + 1)
        ribbons = [
            EmulatedRibbon.from_truth(
                RibbonTruth(np.ascontiguousarray(force[rows, r]), np.ascontiguousarray(field[rows, r]), 1.0),
                _device(seed, r, noise),
            )
            for r in range(RIBBONS + 1)
        ]
        frames.append([_orients(ribbon, REST_S)[-1] for ribbon in ribbons])
    return _collect(frames, true_nodes(lines))


def moving(scene: "Scene", noise: float, seed: int, accelerated: bool = True) -> Orientations:
    """Whole periods of the motion at RATE_HZ: every frame that all ribbons have sent.

    accelerated: whether the accelerometers feel the acceleration. Without it they feel gravity alone, and
    what is left is the error of sensors and reconstruction.
    """
    from ribbonhil.ribbon import EmulatedRibbon
    from ribbonhil.truth import GRAVITY_MPS2, comb_truth

    truth = comb_truth(scene, RIBBONS)
    if not accelerated:
        up = np.ascontiguousarray(truth.r_world_node[..., 2, :])
        truth = replace(truth, specific_force_mps2=GRAVITY_MPS2 * up)
    until_s = START_UP_S + scene.period_s * np.ceil(RECORDED_S / scene.period_s)
    sent = [
        _orients(EmulatedRibbon.from_truth(truth.ribbon(r), _device(seed, r, noise)), until_s)
        for r in range(RIBBONS + 1)
    ]
    by_time = [{packet.t_us: packet for packet in packets} for packets in sent]
    together = sorted(set.intersection(*(set(packets) for packets in by_time)))
    together = [t for t in together if t >= START_UP_S * 1e6]
    frames = [[packets[t] for packets in by_time] for t in together]
    return _collect(frames, truth.node_from_anchor_m(np.array(together) * 1e-6))


def _device(seed: int, index: int, noise: float) -> "Device":
    """The comb's devices, their clocks exact: skew between ribbons is a figure of its own."""
    from ribbonhil.emulated_device import drawn_device

    return replace(drawn_device(seed, index, noise=noise), clock_ppm=0.0, clock_offset_us=0)


def _orients(ribbon: "EmulatedRibbon", until_s: float) -> list[wire.Orient]:
    """ORIENT packets of a ribbon from power-up to a true time."""
    deframer, packets = Deframer(), []
    # A ribbon keeps only so many bytes for a reader.
    for t_s in np.arange(0.5, until_s + 0.5, 0.5):
        ribbon.run_until(min(t_s, until_s))
        packets += [wire.decode(frame)[0] for frame in deframer.feed(ribbon.read())]
    return [packet for packet in packets if isinstance(packet, wire.Orient)]


def _collect(frames: list[list[wire.Orient]], node_m: Float64) -> Orientations:
    nodes = [[packet.nodes for packet in packets] for packets in frames]
    return Orientations(
        t_s=np.array([packets[0].t_us for packets in frames]) * 1e-6,
        q_world_node=np.array([[n.q_world_node for n in row] for row in nodes]),
        valid=np.array([[n.valid for n in row] for row in nodes]),
        sigma_rad=np.array([[wire.sigma_rad(n.quality) for n in row] for row in nodes]),
        node_m=np.ascontiguousarray(node_m),
    )
