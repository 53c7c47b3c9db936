"""`ribbonhost calibrate`: from a ribbon or a recording to a file and back, or nothing changed."""

import io
import json
import threading
import time
import tomllib
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from calibrate.handled import BAR, PITCH_M, devices
from ribbonhil.emulator import EmulatedComb
from ribbonhil.ribbon import EmulatedRibbon
from ribbonhil.truth import Field
from ribbonhil.world import world_truth
from ribbonhost import wire
from ribbonhost.bench.calibration import recorded_raw
from ribbonhost.calibrate.coverage import Coverage
from ribbonhost.cli.calibrate_guide import picture, watch_bar
from ribbonhost.cli.calibrate_source import Traffic
from ribbonhost.cli.calibration_file import load_calibrations
from ribbonhost.device import open_device
from ribbonhost.device.calibration import read_calibration
from ribbonhost.record import Header, RecordedRibbon, Recorder, Recording
from rich.console import Console

Run = Callable[..., tuple[int, str, str]]

FIELD = ("--field-ut", "48", "--dip-deg", "62")


@pytest.fixture(scope="module")
def packets() -> list[bytes]:
    """INFO, then RAW packets, of a ribbon that is turned on a bar."""
    truth = world_truth(BAR, len(devices()) - 1, Field(), devices=devices())
    info, raws = recorded_raw(EmulatedRibbon.from_truth(truth.ribbon(0), devices()[0]), BAR.period_s, 50)
    return [wire.encode(info), *(wire.encode(raw) for raw in raws)]


@pytest.fixture(scope="module")
def comb() -> Iterator[EmulatedComb]:
    """Ribbons of which the first is the one that was turned on the bar."""
    with EmulatedComb("rest", ribbons=2, seed=3) as comb:
        assert comb.serials[0] == devices()[0].serial
        yield comb


def recording(path: Path, packets: list[bytes], in_use: bytes = b"") -> Path:
    info, _ = wire.decode(packets[0])
    assert isinstance(info, wire.Info)
    serial = bytes(info.unique_id).hex()
    ribbon = RecordedRibbon(
        "bar", serial, 0, "here", info.node_count, info.pitch_m, calibration_record=in_use
    )
    recorder = Recorder(path)
    tap = recorder.tap()
    recorder.start(Header((ribbon,), "", 50, "spline", 0, "0", wire.WIRE_VERSION, wire.SCHEMA_HASH))
    for index, packet in enumerate(packets):
        tap.received(packet, 1.0 + 0.02 * index)
    recorder.close()
    return path


@pytest.fixture(scope="module")
def file(tmp_path_factory: pytest.TempPathFactory, packets: list[bytes]) -> Path:
    return recording(tmp_path_factory.mktemp("calibrate") / "bar.mcap", packets)


def held_by(url: str) -> tuple[bytes, wire.Mode, int]:
    device = open_device(url)
    try:
        assert device.info is not None
        return read_calibration(device).record, device.info.mode, device.info.rate_hz
    finally:
        device.close()


def test_a_recording_calibrates_the_ribbon_it_is_of_and_a_file_keeps_it(
    run: Run, comb: EmulatedComb, file: Path, tmp_path: Path
) -> None:
    kept = tmp_path / "left.toml"
    before = held_by(comb.urls[0])
    code, out, err = run("calibrate", "bar", comb.urls[0], "--from", file, *FIELD, "-o", kept, "--json")
    assert (code, err) == (0, "")
    facts = json.loads(out)["calibrated"]
    assert facts["written"]
    assert facts["poses"] == 24
    assert facts["orientation_sigma_worst_deg"] < 0.5
    assert facts["disagreement_deg"] < 0.05 < facts["disagreement_before_deg"]
    record = held_by(comb.urls[0])[0]
    assert record != before[0]

    tables = tomllib.loads(kept.read_text())
    assert tables["device"]["serial"] == comb.serials[0]
    assert tables["place"]["field_ut"] == 48.0
    assert tables["calibration"]["pitch_m"] == PITCH_M
    assert len(tables["sensor"]) == 32
    sensor = tables["sensor"][0]
    covariance = sensor["covariance"]
    assert len(covariance) == len(covariance[-1]) == 12
    assert np.sqrt(covariance[-1][-1]) == pytest.approx(sensor["bias_z_mps2"]["sigma"], rel=1e-2)

    code, out, _ = run("calibrate", "diff", comb.urls[0], kept)
    assert (code, "They are equal." in out) == (0, True)
    code, out, _ = run("calibrate", "show", kept, "--json")
    shown = json.loads(out)["calibration"]
    assert (code, shown["serial"], len(shown["slots"])) == (0, comb.serials[0], 32)
    bias = shown["slots"][0]["bias"][2]
    assert bias == pytest.approx(sensor["bias_z_mps2"]["value"], abs=1e-5)
    # The linear basis of the calibration: to second order the same mounting.
    assert shown["slots"][0]["mounting_deg"][0] == pytest.approx(sensor["mounting_x_deg"]["value"], abs=0.01)

    code, _, err = run("calibrate", "restore", comb.urls[1], kept)
    assert (code, "its sensors are others" in err) == (2, True)
    assert run("calibrate", "restore", comb.urls[0], kept)[0] == 0
    assert held_by(comb.urls[0])[0] == record

    code, out, err = run("calibrate", "bar", comb.urls[0], "--from", file, *FIELD, "-o", tmp_path / "n.toml")
    assert (code, "that one stays" in err) == (1, True)
    for kind in ("flat", "in-place"):
        code, _, err = run("calibrate", kind, comb.urls[0], "--from", file, "-o", tmp_path / "n.toml")
        assert (code, "that one stays" in err) == (1, True)
    assert held_by(comb.urls[0]) == (record, *before[1:])
    assert not (tmp_path / "n.toml").exists()


def test_a_recording_of_another_ribbon_is_refused_and_changes_nothing(
    run: Run, comb: EmulatedComb, file: Path, tmp_path: Path
) -> None:
    before = held_by(comb.urls[1])
    code, out, err = run("calibrate", "bar", comb.urls[1], "--from", file, *FIELD, "-o", tmp_path / "n.toml")
    assert (code, out) == (1, "")
    assert f"is of ribbon {comb.serials[0]}, and this one is {comb.serials[1]}" in err
    assert held_by(comb.urls[1]) == before
    assert list(tmp_path.iterdir()) == []


def test_what_is_refused_is_said_as_json_too(run: Run, packets: list[bytes], tmp_path: Path) -> None:
    short = recording(tmp_path / "short.mcap", packets[:2000])
    code, out, err = run("calibrate", "bar", "--from", short, *FIELD, "--json", "-o", tmp_path / "n.toml")
    assert code == 1
    refused = json.loads(out)["refused"]
    assert refused["reason"] == "too_few_attitudes"
    assert refused["message"] in err


@pytest.mark.parametrize(
    ("arguments", "sentence"),
    [
        ((), "strength of the earth's field is needed"),
        (("--place", "48.1"), "is not LATITUDE,LONGITUDE"),
        (("--place", "91,0"), "is no place"),
        (("--place", "48.1,11.6", "--date", "2031-01-02"), "is for 2025 to 2030 and not for 2031-01-02"),
        (("--place", "48.1,11.6", "--date", "soon"), "is no date"),
    ],
)
def test_a_place_that_cannot_be_is_said_before_the_work(
    run: Run, file: Path, arguments: tuple[str, ...], sentence: str
) -> None:
    code, out, err = run("calibrate", "bar", "--from", file, *arguments)
    assert (code, out) == (2, "")
    assert sentence in err


def test_a_place_gives_the_field_of_the_magnetic_model(run: Run, file: Path, tmp_path: Path) -> None:
    """Latitude first, metres of height, the day; microtesla and degrees come back."""
    kept = tmp_path / "munich.toml"
    arguments = ("--place", "48.1,11.6,500", "--date", "2026-11-23", "-o", kept)
    assert run("calibrate", "bar", "--from", file, *arguments)[0] == 0
    place = tomllib.loads(kept.read_text())["place"]
    assert place["field_ut"] == pytest.approx(48.8, abs=0.05)
    assert place["dip_deg"] == pytest.approx(64.4, abs=0.05)
    assert place["declination_deg"] == pytest.approx(4.4, abs=0.05)


def test_a_refresh_needs_a_ribbon_that_was_calibrated(run: Run, comb: EmulatedComb, file: Path) -> None:
    code, out, err = run("calibrate", "in-place", "--from", file, *FIELD)
    assert (code, out) == (2, "")
    assert "name the ribbon too" in err
    before = held_by(comb.urls[2])
    code, out, err = run("calibrate", "flat", comb.urls[2])
    assert (code, out) == (1, "")
    assert "begin with `ribbonhost calibrate bar`" in err
    assert held_by(comb.urls[2]) == before


def test_a_recording_that_holds_the_calibration_in_use_is_enough_for_a_refresh(
    run: Run, file: Path, packets: list[bytes], tmp_path: Path
) -> None:
    assert run("calibrate", "bar", "--from", file, *FIELD, "-o", tmp_path / "bar.toml")[0] == 0
    header = Recording(file).header
    found = load_calibrations([tmp_path / "bar.toml"], header)[header.ribbons[0].serial]
    moved = np.array(found.slots.offset)
    moved[1::2, 0] += 3.0
    drifted = replace(found, slots=replace(found.slots, offset=moved))
    later = recording(tmp_path / "later.mcap", packets, drifted.pack())
    code, out, err = run("calibrate", "in-place", "--from", later, "-o", tmp_path / "again.toml", "--json")
    assert (code, err) == (0, "")
    assert json.loads(out)["calibrated"]["written"] is False
    again = load_calibrations([tmp_path / "again.toml"], header)[header.ribbons[0].serial]
    off_ut = again.slots.offset[1::2, :2] - found.slots.offset[1::2, :2]
    assert np.abs(off_ut).max() < 1.0, "of 3 uT"


class BarDevice:
    """A device that answers commands, and whose RAW came all at once."""

    def __init__(self, info: wire.Info) -> None:
        self.info = info
        self.lost = None
        self.commands: list[tuple[wire.CommandCode, int]] = []

    def command(self, code: wire.CommandCode, argument: int = 0) -> None:
        self.commands.append((code, argument))

    def handshake(self) -> wire.Info:
        return self.info


def test_the_guide_ends_when_all_attitudes_are_done_and_leaves_the_device_as_it_was(
    packets: list[bytes], capsys: pytest.CaptureFixture[str]
) -> None:
    info, _ = wire.decode(packets[0])
    assert isinstance(info, wire.Info)
    device, traffic = BarDevice(info), Traffic()

    def turn() -> None:
        time.sleep(0.1)
        for packet in packets:
            traffic.received(packet, 0.0)

    hands = threading.Thread(target=turn)
    hands.start()
    collected = watch_bar(
        device,  # type: ignore[arg-type]
        traffic,
        rate_hz=50,
        field_ut=48.0,
        pitch_m=PITCH_M,
        poses=36,
        timeout_s=30.0,
    )
    hands.join()
    assert len(collected) == len(packets) - 1
    assert "pose 24, 100 %. All attitudes are done." in capsys.readouterr().err
    assert device.commands[-2:] == [
        (wire.CommandCode.SET_MODE, int(info.mode)),
        (wire.CommandCode.SET_RATE, info.rate_hz),
    ]


def test_ctrl_c_leaves_the_device_as_it_was(packets: list[bytes], monkeypatch: pytest.MonkeyPatch) -> None:
    info, _ = wire.decode(packets[0])
    assert isinstance(info, wire.Info)
    device = BarDevice(replace(info, mode=wire.Mode.ORIENT, rate_hz=100))

    def interrupted(_: float) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr("ribbonhost.cli.calibrate_guide.time.sleep", interrupted)
    with pytest.raises(KeyboardInterrupt):
        watch_bar(
            device,  # type: ignore[arg-type]
            Traffic(),
            rate_hz=50,
            field_ut=48.0,
            pitch_m=PITCH_M,
            poses=36,
            timeout_s=30.0,
        )
    assert {code for code, _ in device.commands} == {wire.CommandCode.SET_MODE, wire.CommandCode.SET_RATE}
    assert device.commands[-2:] == [(wire.CommandCode.SET_MODE, 1), (wire.CommandCode.SET_RATE, 100)]


def test_the_picture_shows_what_is_missing() -> None:
    coverage = Coverage((4, 1, 2, 0, 0, 0), (True, True, True, False), 9)
    console = Console(width=100, file=io.StringIO())
    console.print(picture(coverage, "Now the back is up."))
    text = console.file.getvalue()  # type: ignore[attr-defined]
    rows = [line.strip("│ ").split("  ") for line in text.splitlines()]
    dots = {row[0]: row[-1].strip() for row in rows if len(row) > 1}
    assert dots["on a table"] == "●●●○"
    assert dots["sensor side up"] == "●●●●"
    assert dots["back up"] == "●○○○"
    assert dots["far end up"] == "○○○○"
    assert "Turn it end for end on the table, the left edge still up." in text
