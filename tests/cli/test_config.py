"""`ribbonhost config`: what was dumped comes back bit for bit, to the ribbon it belongs to, or not at all."""

import json
import tomllib
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from host.fake_ribbon import FakeRibbon
from ribbonhil.emulator import EmulatedComb
from ribbonhost import wire
from ribbonhost.device import Device, open_device
from ribbonhost.device.calibration import read_calibration, write_calibration
from ribbonhost.errors import CommandRefusedError, LinkLostError
from ribbonhost.wire import AckCode, CommandCode

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture(scope="module")
def comb() -> Iterator[EmulatedComb]:
    with EmulatedComb("wing", ribbons=2, seed=5) as comb:
        yield comb


@pytest.fixture
def calibrated(comb: EmulatedComb) -> bytes:
    """Gives ribbon 0 an uneven calibration; returns the record."""
    rng = np.random.default_rng(7)
    device = open_device(comb.urls[0])
    try:
        slots = len(device.info.slots) if device.info else 0
        values = wire.Calibration(
            layout=1,
            mag_axes=2,
            created_s=1_700_000_000,
            pitch_m=0.025,
            field_horizontal_ut=21.987654,
            field_down_ut=-1 / 3,
            slots=wire.SlotCalibrationArray(
                offset=rng.normal(0, 0.1, (slots, 3)) * 10.0 ** rng.integers(-12, 1, (slots, 3)),
                matrix=np.tile(np.eye(3).ravel(), (slots, 1)) + rng.normal(0, 0.01, (slots, 9)),
            ),
        )
        return write_calibration(device, values).record
    finally:
        device.close()


def record_of(url: str) -> bytes:
    device = open_device(url)
    try:
        return read_calibration(device).record
    finally:
        device.close()


def replaced(path: Path, old: str, new: str) -> Path:
    text = path.read_text()
    assert old in text
    path.write_text(text.replace(old, new, 1))
    return path


def test_what_was_dumped_comes_back_bit_for_bit(
    run: Run, comb: EmulatedComb, calibrated: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "ribbon.toml"
    code, out, _ = run("config", "dump", comb.urls[0], "-o", path)
    assert code == 0
    assert comb.serials[0] in out
    device = open_device(comb.urls[0])
    device.command(CommandCode.SET_RATE, 37)
    device.command(CommandCode.SET_MODE, wire.Mode.RAW)
    other = read_calibration(device).values
    other.slots.offset[3] += 0.5
    assert write_calibration(device, other).record != calibrated
    device.close()
    code, out, _ = run("config", "restore", comb.urls[0], path, "--json")
    assert code == 0
    restored = json.loads(out)["restored"]
    assert (restored["rate_hz"], restored["mode"]) == (100, ["orient"])
    assert record_of(comb.urls[0]) == calibrated


def test_the_file_says_where_it_comes_from(run: Run, comb: EmulatedComb, calibrated: bytes) -> None:
    code, out, _ = run("config", "dump", comb.urls[0])
    tables = tomllib.loads(out)
    assert code == 0
    assert tables["device"]["serial"] == comb.serials[0]
    assert tables["provenance"]["port"] == comb.urls[0]
    assert tables["provenance"]["calibration_sequence"] > 0
    assert tables["settings"] == {"rate_hz": 100, "mode": ["orient"]}
    assert "# 1: mmc5983ma" in out
    assert json.loads(run("config", "dump", comb.urls[0], "--json")[1])["dumped"]["mode"] == ["orient"]


def test_a_file_that_is_there_is_kept_unless_forced(run: Run, comb: EmulatedComb, tmp_path: Path) -> None:
    path = tmp_path / "ribbon.toml"
    path.write_text("mine")
    code, _, err = run("config", "dump", comb.urls[0], "-o", path)
    assert code == 2
    assert "is there already" in err
    assert path.read_text() == "mine"
    assert run("config", "dump", comb.urls[0], "-o", path, "--force")[0] == 0
    assert "format" in path.read_text()
    assert [p.name for p in tmp_path.iterdir()] == ["ribbon.toml"]


def test_a_folder_that_is_not_there_is_a_failure(run: Run, comb: EmulatedComb, tmp_path: Path) -> None:
    code, _, err = run("config", "dump", comb.urls[0], "-o", tmp_path / "none" / "ribbon.toml")
    assert code == 1
    assert "cannot be written: No such file or directory" in err


def test_the_file_of_another_ribbon_needs_force(
    run: Run, comb: EmulatedComb, calibrated: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "ribbon.toml"
    run("config", "dump", comb.urls[0], "-o", path)
    before = record_of(comb.urls[1])
    code, _, err = run("config", "restore", comb.urls[1], path)
    assert code == 2
    assert f"is of ribbon {comb.serials[0]}" in err
    assert record_of(comb.urls[1]) == before
    assert run("config", "restore", comb.urls[1], path, "--force")[0] == 0
    assert record_of(comb.urls[1]) == calibrated


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        ('format = "ribbonhost', 'format = "other', "is no file of"),
        ("field_horizontal_ut = 21.9", "field_horizontal_ut = 21.8", "was changed since it was written"),
        ("rate_hz = 100", "rate_hz = 1000", "says 1000 scans a second"),
        ('mode = ["orient"]', 'mode = ["fly"]', 'mode "fly" is not one of'),
        ('mode = ["orient"]', 'mode = ["orient", "orient_compact"]', "of which a ribbon sends one"),
        ("mag_axes = 2", "mag_axes = true", "no whole number"),
        ("mag_axes = 2", "", "mag_axes is missing"),
        ("[settings]", "[[[", "is not TOML"),
        ("pitch_m = 0.025", "pitch_m = inf", "no number"),
        ("[[calibration.slot]]  # 0", "[[calibration.other]]  # 0", "was changed"),
    ],
)
def test_a_file_that_cannot_be_changes_nothing(
    run: Run, comb: EmulatedComb, calibrated: bytes, tmp_path: Path, old: str, new: str, message: str
) -> None:
    path = tmp_path / "ribbon.toml"
    run("config", "dump", comb.urls[0], "-o", path)
    replaced(path, old, new)
    code, out, err = run("config", "restore", comb.urls[0], path)
    assert (code, out) == (2, "")
    assert message in err
    assert err.count("\n") == 1
    assert record_of(comb.urls[0]) == calibrated


def test_values_that_the_device_refuses_leave_the_old_ones_in_use(
    run: Run, comb: EmulatedComb, calibrated: bytes, tmp_path: Path
) -> None:
    path = tmp_path / "ribbon.toml"
    run("config", "dump", comb.urls[0], "-o", path)
    replaced(path, "mag_axes = 2", "mag_axes = 7")
    path.write_text("\n".join(line for line in path.read_text().splitlines() if "crc32" not in line))
    code, _, err = run("config", "restore", comb.urls[0], path)
    assert code == 1
    assert "refused calibration_commit" in err
    assert "still in use" in err
    assert record_of(comb.urls[0]) == calibrated


def test_an_upload_that_breaks_off_changes_nothing(
    comb: EmulatedComb, calibrated: bytes, monkeypatch: pytest.MonkeyPatch
) -> None:
    device = open_device(comb.urls[0])
    values = read_calibration(device).values
    values.slots.offset[0] += 1.0
    command = Device.command
    sent: list[CommandCode] = []

    def break_off(device: Device, code: CommandCode, *rest: Any, **options: Any) -> wire.Ack:
        sent.append(code)
        if sent.count(CommandCode.CALIBRATION_WRITE) == 4:
            raise LinkLostError("the cable was pulled")
        return command(device, code, *rest, **options)

    monkeypatch.setattr(Device, "command", break_off)
    with pytest.raises(LinkLostError):
        write_calibration(device, values)
    monkeypatch.undo()
    device.close()
    assert record_of(comb.urls[0]) == calibrated


def test_a_device_that_tells_nonsense_of_its_record_is_a_failure(
    run: Run, urls: list[str], fakes: list[FakeRibbon]
) -> None:
    code, _, err = run("config", "dump", urls[0])
    assert code == 1
    assert "that cannot be" in err
    fakes[1].refused = {CommandCode.CALIBRATION_READ: AckCode.UNSUPPORTED}
    code, _, err = run("config", "dump", urls[1])
    assert code == 1
    assert "refused calibration_read 0: unsupported" in err


def test_a_refused_write_says_that_the_old_calibration_is_in_use(
    urls: list[str], fakes: list[FakeRibbon], comb: EmulatedComb, calibrated: bytes
) -> None:
    fakes[0].refused = {CommandCode.CALIBRATION_WRITE: AckCode.STORAGE_FAILED}
    device = open_device(urls[0])
    try:
        with pytest.raises(CommandRefusedError, match="still in use"):
            write_calibration(device, wire.Calibration.unpack(calibrated))
    finally:
        device.close()
