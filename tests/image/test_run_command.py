"""`ribbonhil run` and images behind emulated:// URLs: what is printed, and how mistakes end."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from image.programs import built
from ribbonhil.emulator import EmulatedComb
from ribbonhost.device import open_device
from ribbonhost.wire import Board

RIBBONHIL = [sys.executable, "-c", "from ribbonhil.cli import main; main()"]


def ribbonhil(*arguments: str) -> subprocess.CompletedProcess[str]:
    return subprocess.run([*RIBBONHIL, *arguments], capture_output=True, text=True, check=False, timeout=120)


@pytest.mark.parametrize("axes", [2, 3])
def test_run_prints_one_json_object(axes: int) -> None:
    image = built().with_suffix(".elf")
    chosen = ("--axes", str(axes)) if axes == 3 else ()
    result = ribbonhil("run", str(image), "--scene", "wing", "--frames", "400", "--json", *chosen)
    assert (result.returncode, result.stderr) == (0, "")
    report = json.loads(result.stdout)
    expected = {"frames": 400, "crc_errors": 0, "overruns": 0, "bus_conflicts": 0, "matches_host_port": True}
    expected["axes"] = axes
    assert expected.items() <= report.items()
    assert 10_000 < report["instructions_per_frame"] <= 60_000
    assert 100 < report["scan_us"] < 5_000
    assert report["frames_per_second"] > 0


def test_profile_says_where_the_instructions_go() -> None:
    """Function by function they add up to those of a frame, within the rounding of a hundred functions."""
    image = built().with_suffix(".elf")
    result = ribbonhil("run", str(image), "--frames", "50", "--profile", "--json")
    assert (result.returncode, result.stderr) == (0, "")
    report = json.loads(result.stdout)
    functions = report["instructions_by_function"]
    assert sum(functions.values()) == pytest.approx(report["instructions_per_frame"], abs=50)
    assert functions["fusion_update"] > 1000
    assert list(functions.values()) == sorted(functions.values(), reverse=True)


def test_run_of_another_boards_image_says_what_to_give() -> None:
    result = ribbonhil("run", str(built(board="feather_f405")), "--frames", "5")
    assert result.returncode == 1
    assert "--board" in result.stderr
    assert "Traceback" not in result.stderr


@pytest.mark.parametrize(
    ("arguments", "complaint"),
    [
        (["run", "absent.bin"], "absent.bin cannot be read: No such file"),
        (["run", "{empty}"], "0 bytes: that is not even its vector table"),
        (["run", "{large}"], "does not fit into 1 MiB"),
        (["run", "{image}", "--board", "nucleo"], "no board nucleo"),
        (["run", "{image}", "--scene", "lake"], "lake"),
        (["run", "{image}", "--logged", "{empty}"], "NPZ"),
        (["run", "{image}", "--axes", "4"], "--axes"),
        (["run", "{binary}", "--profile"], "ELF"),
    ],
    ids=["absent", "empty", "large", "board", "scene", "log", "axes", "profile"],
)
def test_mistakes_are_one_sentence_and_exit_with_2(
    tmp_path: Path, arguments: list[str], complaint: str
) -> None:
    places = {"empty": tmp_path / "empty.bin", "large": tmp_path / "large.bin", "image": built()}
    places["binary"] = tmp_path / "ribbon.bin"
    places["binary"].write_bytes(bytes(4096))
    places["empty"].write_bytes(b"")
    places["large"].write_bytes(bytes(1 << 20) + b"!")
    result = ribbonhil(*(argument.format(**places) for argument in arguments))
    assert complaint in result.stderr
    assert result.returncode == 2
    assert "Traceback" not in result.stderr


def test_image_that_does_nothing_is_told_after_two_virtual_seconds(tmp_path: Path) -> None:
    stack_and_entry = np.array([0x20002000, 0x08000009], dtype="<u4").tobytes()
    (tmp_path / "idle.bin").write_bytes(stack_and_entry + b"\xfe\xe7" * 4)
    result = ribbonhil("run", str(tmp_path / "idle.bin"))
    assert result.returncode == 1
    assert "No INFO came within 2 s" in result.stderr


def test_host_talks_to_an_image_as_to_any_ribbon() -> None:
    with EmulatedComb("wing", ribbons=1, image=str(built())) as comb:
        device = open_device(comb.urls[1])
        try:
            assert device.info.board == Board.PYBOARD_V11
            assert device.info.unique_id.hex() == comb.serials[1]
        finally:
            device.close()
        assert comb.counters(1).conflicts == 0
