"""A recording keeps the calibrations that were in use, and can be made again with later ones."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from record.conftest import Command
from ribbonhost import wire
from ribbonhost.cli.config_file import calibration_lines
from ribbonhost.framing import crc32
from ribbonhost.pipeline.replay import Replay
from ribbonhost.record import Received, Recording
from scipy.spatial.transform import Rotation


def info_of(path: Path, ribbon: int) -> wire.Info:
    for item in Recording(path).items():
        if isinstance(item, Received) and item.ribbon == ribbon and item.packet[0] == wire.PacketId.INFO:
            info, _ = wire.decode(item.packet)
            assert isinstance(info, wire.Info)
            return info
    raise AssertionError("no INFO was recorded")


def written(path: Path, serial: str, calibration: wire.Calibration, info: wire.Info) -> Path:
    """A calibration file as `config dump` writes it."""
    lines = ['format = "ribbonhost config 1"', "[device]", f'serial = "{serial}"']
    path.write_text("\n".join([*lines, *calibration_lines(calibration, info)]) + "\n")
    return path


def exported(command: Command, recording: Path, output: Path, *options: object) -> dict[str, np.ndarray]:
    done = command("export", recording, "-o", output, "--to", "1.5", "--rate", "20", *options, "--force")
    assert done.returncode == 0, done.stderr
    with np.load(output) as file:
        return dict(file)


def test_the_calibrations_in_use_are_in_the_recording(wing: Path) -> None:
    for ribbon in Recording(wing).header.ribbons:
        sequence, crc = ribbon.calibration
        assert crc32(ribbon.calibration_record) == crc
        assert sequence == 0
        assert len(wire.Calibration.unpack(ribbon.calibration_record).slots.offset) == 32


def test_a_later_calibration_changes_what_its_ribbon_is_made_of(
    command: Command, wing: Path, tmp_path: Path
) -> None:
    header = Recording(wing).header
    ribbon = header.ribbons[1]
    info = info_of(wing, 1)
    used = wire.Calibration.unpack(ribbon.calibration_record)
    same = written(tmp_path / "same.toml", ribbon.serial, used, info)
    # As if all its parts were mounted turned by 3 degrees about the normal, which no estimator can find out.
    turn = Rotation.from_rotvec([0.0, 0.0, np.radians(3.0)]).as_matrix()
    matrix = turn @ np.array(used.slots.matrix).reshape(-1, 3, 3)
    changed = replace(used, slots=replace(used.slots, matrix=matrix.reshape(np.shape(used.slots.matrix))))
    later = written(tmp_path / "later.toml", ribbon.serial, changed, info)
    out = tmp_path / "x.npz"
    as_live = exported(command, wing, out)
    again = exported(command, wing, out, "--calibration", same)
    np.testing.assert_array_equal(as_live["node_m"], again["node_m"])
    tilted = exported(command, wing, out, "--calibration", later)
    moved_m = np.linalg.norm(tilted["node_m"] - as_live["node_m"], axis=-1)[:, :, -1].mean(axis=0)
    assert moved_m[1] > 0.02, "the tip of the ribbon that was calibrated anew"
    assert moved_m[1] > 20 * moved_m[2]


def test_files_that_are_not_for_this_recording_are_wrong_usage(
    command: Command, wing: Path, tmp_path: Path
) -> None:
    ribbon, info = Recording(wing).header.ribbons[1], info_of(wing, 1)
    used = wire.Calibration.unpack(ribbon.calibration_record)
    mine = written(tmp_path / "mine.toml", ribbon.serial, used, info)
    other = written(tmp_path / "other.toml", "ab" * 12, used, info)
    for options, message in (
        (["--calibration", other], "is of ribbon abababababababababababab, which is not in the recording"),
        (["--calibration", mine, "--calibration", mine], "another file given is of ribbon"),
        (["--calibration", mine, "--motion", "off"], "give --motion live or offline"),
        (["--calibration", tmp_path / "none.toml"], "cannot be read"),
    ):
        done = command("export", wing, "-o", tmp_path / "x.csv", *options)
        assert (done.returncode, done.stdout) == (2, "")
        assert message in done.stderr
        assert done.stderr.count("\n") == 1


def test_a_recorded_calibration_that_is_damaged_is_a_sentence(wing: Path) -> None:
    recording = Recording(wing)
    ribbons = tuple(replace(ribbon, calibration_record=b"\x01\x02") for ribbon in recording.header.ribbons)
    recording.header = replace(recording.header, ribbons=ribbons)
    with pytest.raises(Exception, match="holds a damaged calibration"):
        Replay([recording])
    kept = json.loads(recording.header.to_metadata()["ribbons"])
    assert kept[0]["calibration_record"] == "0102"
