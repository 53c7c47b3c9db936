"""A calibration commit that loses power at any moment leaves the old or the new one, never neither."""

from dataclasses import replace

import numpy as np
from image.programs import built
from ribbonhil.emulated_device import drawn_device
from ribbonhil.scenes import BUILTIN
from ribbonhil.stm32f405.elf import read_elf
from ribbonhil.stm32f405.image_ribbon import ImageRibbon
from ribbonhil.stm32f405.mcu import Options
from ribbonhil.stm32f405.session import CHUNK_BYTES, Session
from ribbonhil.truth import comb_truth
from ribbonhost.framing import crc32, encode_frame
from ribbonhost.wire import Calibration, Command, CommandCode, encode

CUTS = 200
TAG = 60_000


def new_session(ribbon: ImageRibbon) -> Session:
    session = Session(ribbon)
    session.wait_for_info()
    return session


def stage(session: Session, record: bytes) -> None:
    for offset in range(0, len(record), CHUNK_BYTES):
        session.command(CommandCode.CALIBRATION_WRITE, offset, record[offset : offset + CHUNK_BYTES])


def test_calibration_survives_200_power_cuts() -> None:
    random = np.random.default_rng(7)
    truth = comb_truth(BUILTIN["wing"], 2).ribbon(0)
    ribbon = ImageRibbon(
        read_elf(built()).image, truth, drawn_device(2, 0), options=Options(seed=5, erase_us=1000)
    )
    session = new_session(ribbon)
    stored = session.read_calibration()
    session.write_calibration(replace(stored, created_s=1))
    before = ribbon.mcu.counters.flash_operations
    session.write_calibration(replace(stored, created_s=2))
    operations = ribbon.mcu.counters.flash_operations - before
    assert operations > len(stored.pack()) // 4
    old = replace(stored, created_s=2).pack()

    outcomes = {"old": 0, "new": 0}
    for cut in range(CUTS):
        new = replace(stored, created_s=1000 + cut).pack()
        stage(session, new)
        # A fifth of the cuts come too late to stop the commit.
        moment = int(random.integers(1, operations + operations // 4))
        ribbon.mcu.cut_power_in_flash_operation(moment)
        ribbon.write(encode_frame(encode(Command(TAG, CommandCode.CALIBRATION_COMMIT, crc32(new), b""))))
        session.run_for(0.02)
        was_acknowledged = TAG in session.acks
        assert was_acknowledged == (moment > operations)
        ribbon.mcu.power_on()
        session = new_session(ribbon)
        found = session.read_calibration().pack()
        assert found == new or (found == old and not was_acknowledged), f"cut {cut} in operation {moment}"
        assert session.info is not None
        assert session.info.calibration_crc32 == crc32(found)
        outcomes["new" if found == new else "old"] += 1
        old = found
    assert outcomes["old"] > CUTS // 2
    assert outcomes["new"] > CUTS // 10
    print(f"{CUTS} power cuts: {outcomes}")


def test_commit_without_a_power_cut_is_kept_over_a_power_cycle() -> None:
    truth = comb_truth(BUILTIN["wing"], 2).ribbon(0)
    ribbon = ImageRibbon(read_elf(built()).image, truth, drawn_device(2, 0))
    session = new_session(ribbon)
    changed: Calibration = replace(session.read_calibration(), created_s=77, field_horizontal_ut=20.5)
    session.write_calibration(changed)
    ribbon.mcu.power_on()
    session = new_session(ribbon)
    assert session.read_calibration().pack() == changed.pack()
    assert ribbon.mcu.violation == ""
