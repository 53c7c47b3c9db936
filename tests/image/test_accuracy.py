"""From sensor noise through the image and the host's reconstruction: the error of the whole comb."""

import numpy as np
import pytest
from image.programs import built
from ribbonhil.emulated_device import drawn_device
from ribbonhil.scenes import BUILTIN
from ribbonhil.stm32f405.elf import read_elf
from ribbonhil.stm32f405.image_ribbon import ImageRibbon
from ribbonhil.stm32f405.session import Session
from ribbonhil.truth import comb_truth
from ribbonhost.reconstruct import CombLayout, CombSolver, error_percent
from ribbonhost.wire import CommandCode, Orient, decode

RIBBONS = 5
RATE_HZ = 15
PERIOD_S = 20.0
SETTLE_S = 1.0
RIBBON_M = 0.775


@pytest.mark.parametrize("scene", ["wing", "breath"])
def test_mean_error_of_the_comb_is_at_most_0_12_percent(scene: str) -> None:
    """With the two axes that an uncalibrated ribbon has."""
    truth = comb_truth(BUILTIN[scene], RIBBONS)
    assert truth.period_s == PERIOD_S
    image = read_elf(built()).image
    t_s, q, valid = [], [], []
    for index in range(RIBBONS + 1):
        ribbon = ImageRibbon(image, truth.ribbon(index), drawn_device(11, index))
        session = Session(ribbon)
        session.wait_for_info()
        session.command(CommandCode.SET_RATE, RATE_HZ)
        session.run_for(SETTLE_S)
        first = len(session.orients)
        session.run_for(PERIOD_S)
        clock_starts_s = ribbon.now_s - ribbon.device_us * 1e-6
        orients = [o for p in session.orients[first:] if isinstance(o := decode(p)[0], Orient)]
        t_s.append([orient.t_us * 1e-6 + clock_starts_s for orient in orients[: RATE_HZ * int(PERIOD_S) - 2]])
        q.append([orient.nodes.q_world_node for orient in orients])
        valid.append([orient.nodes.valid for orient in orients])

    times = np.array(t_s)
    assert np.ptp(times, axis=0).max() < 1e-3  # all ribbons started together and scan together
    solver = CombSolver(CombLayout(truth.pitch_m, 16, truth.start_m))
    errors = []
    for frame, t in enumerate(times.mean(axis=0)):
        solved = solver.solve(
            np.stack([ribbon[frame] for ribbon in q]), np.stack([ribbon[frame] for ribbon in valid])
        )
        errors.append(error_percent(solved.node_m[1:], truth.node_from_anchor_m(t)[1:], RIBBON_M))
    print(f"{scene}: E {np.mean(errors):.3f} % in the mean, {np.max(errors):.3f} % at most")
    assert len(errors) > 0.9 * RATE_HZ * PERIOD_S
    assert np.mean(errors) <= 0.12
