"""A calibration that is interrupted anywhere on its way leaves the old or the new one: on the image."""

from dataclasses import replace

import numpy as np
import pytest
from calibrate.handled import calibrated
from image.programs import built
from ribbonhil.emulated_device import drawn_device
from ribbonhil.scenes import BUILTIN
from ribbonhil.stm32f405.elf import read_elf
from ribbonhil.stm32f405.image_ribbon import ImageRibbon
from ribbonhil.stm32f405.mcu import Options
from ribbonhil.stm32f405.session import CHUNK_BYTES, Session, SilentImageError
from ribbonhil.truth import comb_truth
from ribbonhost.framing import crc32, encode_frame
from ribbonhost.wire import Command, CommandCode, encode

CUTS = 12
TAG = 61_000


def test_a_cable_or_the_power_lost_anywhere_leaves_the_old_or_the_new_calibration() -> None:
    random = np.random.default_rng(11)
    truth = comb_truth(BUILTIN["wing"], 2).ribbon(0)
    ribbon = ImageRibbon(
        read_elf(built()).image, truth, drawn_device(2, 0), options=Options(seed=5, erase_us=1000)
    )
    session = Session(ribbon)
    session.wait_for_info()
    old = replace(calibrated().record, created_s=1)
    session.write_calibration(old)
    # Every piece is another.
    slots = replace(old.slots, offset=old.slots.offset + 0.01, matrix=1.001 * old.slots.matrix)
    new = replace(old, created_s=2, slots=slots).pack()
    chunks = [(at, new[at : at + CHUNK_BYTES]) for at in range(0, len(new), CHUNK_BYTES)]

    # The cable goes after some pieces; who comes next has others to write, or commits what is not whole.
    for count in (1, len(chunks) - 1):
        for at, chunk in chunks[:count]:
            session.command(CommandCode.CALIBRATION_WRITE, at, chunk)
        session = Session(ribbon, _tag=1000 * count)
        with pytest.raises(SilentImageError, match="BAD_CRC"):
            session.command(CommandCode.CALIBRATION_COMMIT, crc32(new))
        assert session.read_calibration().pack() == old.pack()

    # The power goes: between pieces, then at any moment of the commit.
    session.command(CommandCode.CALIBRATION_WRITE, *chunks[0])
    ribbon.mcu.power_on()
    session = Session(ribbon)
    session.wait_for_info()
    assert session.read_calibration().pack() == old.pack()
    in_use = old.pack()
    outcomes = set()
    for cut in range(CUTS):
        wanted = replace(calibrated().record, created_s=100 + cut).pack()
        for at in range(0, len(wanted), CHUNK_BYTES):
            session.command(CommandCode.CALIBRATION_WRITE, at, wanted[at : at + CHUNK_BYTES])
        ribbon.mcu.cut_power_in_flash_operation(int(random.integers(1, 550)))
        ribbon.write(encode_frame(encode(Command(TAG, CommandCode.CALIBRATION_COMMIT, crc32(wanted), b""))))
        session.run_for(0.02)
        ribbon.mcu.power_on()
        session = Session(ribbon)
        session.wait_for_info()
        found = session.read_calibration().pack()
        assert found in (in_use, wanted), f"cut {cut}"
        outcomes.add(found == wanted)
        in_use = found
    assert outcomes == {False, True}
