"""The image, while its 32-bit clock of microseconds wraps."""

import numpy as np
from image.programs import built
from ribbonhil.emulated_device import drawn_device
from ribbonhil.faults import Fault, FaultKind
from ribbonhil.scenes import BUILTIN
from ribbonhil.stm32f405.elf import read_elf
from ribbonhil.stm32f405.image_ribbon import ImageRibbon
from ribbonhil.stm32f405.session import Session
from ribbonhil.truth import comb_truth
from ribbonhost.wire import CommandCode, Orient, SlotReason, decode

ACCELEROMETER = 16


def test_everything_goes_on_when_the_clock_wraps() -> None:
    """Scans 10 ms apart within 0.2 ms; waits, blinks, commands, and a sensor that is stuck just then."""
    ribbon = ImageRibbon(
        read_elf(built("late_clock")).image, comb_truth(BUILTIN["wing"], 2).ribbon(1), drawn_device(3, 1)
    )
    session = Session(ribbon)
    session.wait_for_info()
    session.command(CommandCode.IDENTIFY, 3000)
    session.run_for(1.6 - ribbon.now_s)
    assert ribbon.device_us > 2**31
    session.orients.clear()
    overruns = session.current_status().overruns
    ribbon.add_fault(Fault(FaultKind.STUCK, ACCELEROMETER, 1.7, 2.6))
    session.run_for(2.5 - ribbon.now_s)
    assert ribbon.device_us < 2**31
    status = session.current_status()
    assert np.flatnonzero(status.slots.reason).tolist() == [ACCELEROMETER]
    assert status.slots.reason[ACCELEROMETER] == SlotReason.STUCK
    session.run_for(4.1 - ribbon.now_s)
    orients = [orient for packet in session.orients if isinstance(orient := decode(packet)[0], Orient)]
    step_us = np.diff(np.array([orient.t_us for orient in orients], dtype=np.int64)) % 2**32
    assert np.abs(step_us - 10_000).max() < 200
    assert set(np.diff([orient.sequence for orient in orients])) == {1}
    assert all(orient.nodes.valid.all() for orient in orients)
    status = session.current_status()
    assert not status.slots.reason.any()
    assert (status.overruns - overruns, status.uptime_s) == (0, 4)
    assert ribbon.mcu.violation == ""
    assert not ribbon.mcu.led, "the blinking has ended"
