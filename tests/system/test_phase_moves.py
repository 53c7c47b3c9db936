"""Moving the phase of a ribbon's scans, as hosts do to align a comb, does not disturb what it measures."""

import numpy as np
from ribbonhil.ribbon import EmulatedRibbon, drawn_device
from ribbonhil.scenes import load_scene
from ribbonhil.truth import Field, comb_truth
from ribbonhost.framing import Deframer, encode_frame
from ribbonhost.wire import Ack, Command, CommandCode, Orient, decode, encode

MOVES = 30
LARGEST_TURN_DEG = 3.0


def test_no_node_turns_when_the_phase_moves() -> None:
    ribbon = EmulatedRibbon.from_truth(
        comb_truth(load_scene("wing", 20.0), 2, Field()).ribbon(0), drawn_device(0, 0)
    )
    random = np.random.default_rng(0)
    deframer = Deframer()
    orients: list[Orient] = []
    moved = 0
    for step in range(1, MOVES * 3):
        ribbon.run_until(step / 10)
        packets = [decode(packet)[0] for packet in deframer.feed(ribbon.read())]
        orients += [packet for packet in packets if isinstance(packet, Orient)]
        moved += sum(isinstance(packet, Ack) and packet.value != 0 for packet in packets)
        if step % 3 == 0:
            t_us = (orients[-1].t_us + int(random.integers(-5000, 5000))) % 2**32
            command = Command(tag=step, command=CommandCode.SET_PHASE, argument=t_us, data=b"")
            ribbon.write(encode_frame(encode(command)))
    assert moved >= MOVES - 2

    q = np.array([orient.nodes.q_world_node for orient in orients])
    assert all(orient.nodes.valid.all() for orient in orients)
    cosine = np.abs(np.sum(q[1:] * q[:-1], axis=-1)).clip(max=1.0)
    assert np.degrees(2 * np.arccos(cosine)).max() < LARGEST_TURN_DEG
