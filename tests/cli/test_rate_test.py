"""`ribbonhost rate-test` tells rates that lose nothing from those that do, and leaves the ribbon as found."""

import json
from collections.abc import Callable

import pytest
from host.fake_ribbon import FakeRibbon, orient_packet
from ribbonhil.emulator import EmulatedComb
from ribbonhost import wire
from ribbonhost.cli.rate_test import FrameCounter
from ribbonhost.device import open_device

Run = Callable[..., tuple[int, str, str]]


def test_a_slow_link_carries_low_rates_only_and_the_ribbon_is_left_as_found(run: Run) -> None:
    with EmulatedComb("wing", ribbons=2, seed=6, baud=115_200) as comb:
        device = open_device(comb.urls[1])
        device.command(wire.CommandCode.SET_RATE, 40)
        device.command(wire.CommandCode.SET_MODE, wire.Mode.ORIENT_COMPACT)
        device.close()
        code, out, err = run("rate-test", comb.urls[1], "--rates", "20,200", "--seconds", "0.4", "--json")
        assert (code, err) == (0, "")
        test = json.loads(out)["rate_test"]
        device = open_device(comb.urls[1])
        device.close()
    assert device.info is not None
    assert (device.info.rate_hz, device.info.mode) == (40, wire.Mode.ORIENT_COMPACT)
    assert test["highest_clean_rate_hz"] == {"orient": 20, "compact": 20, "raw": 20, "both": 20}
    results = {(r["mode"], r["rate_hz"]): r for r in test["results"]}
    assert len(results) == 8
    overloaded = results["both", 200]
    assert overloaded["dropped"] > 0
    assert overloaded["frames_per_s"] < 0.5 * overloaded["expected_per_s"]
    # A busy machine may deliver late what came in time.
    assert 80 < overloaded["link_percent"] < 125
    assert results["orient", 20]["link_percent"] < 40
    # 16 nodes of 7 bytes, 8 bytes before them, 4 of framing, 20 times a second; and a STATUS
    assert 1500 < results["orient", 20]["bytes_per_s"] < 3500


def test_the_table_ends_with_the_highest_rates(run: Run, urls: list[str]) -> None:
    code, out, _ = run("rate-test", urls[0], "--rates", "100", "--seconds", "0.3")
    assert code == 0
    assert out.splitlines()[0].split()[:3] == ["mode", "rate", "Hz"]
    assert "Highest rate that loses nothing: orient 100 Hz" in out
    assert "\x1b" not in out


def test_frames_spoiled_on_the_way_are_a_loss(run: Run, urls: list[str], fakes: list[FakeRibbon]) -> None:
    count = 0

    def spoil(frame: bytes) -> bytes:
        nonlocal count
        if not 30 < len(frame) < 55:  # only ORIENT is so long
            return frame
        count += 1
        return frame[:-3] + bytes([frame[-3] ^ 1 or 2]) + frame[-2:] if count % 10 == 9 else frame

    fakes[0].spoil = spoil
    code, out, _ = run("rate-test", urls[0], "--rates", "100", "--seconds", "0.5", "--json")
    assert code == 0
    result = json.loads(out)["rate_test"]["results"][0]
    assert result["lost"] > 0
    assert result["crc_errors"] > 0
    assert result["is_clean"] is False


def test_gaps_are_counted_through_the_wrap_of_the_sequence() -> None:
    counter = FrameCounter()
    for sequence in (65_533, 65_534, 1, 2, 5):
        counter.received(wire.encode(orient_packet(0, sequence)), 0.0)
    assert (counter.frames, counter.gaps) == (5, 2 + 2)


@pytest.mark.parametrize("rates", ["0", "201", "50,fast", ""])
def test_rates_that_cannot_be_are_wrong_usage(run: Run, urls: list[str], rates: str) -> None:
    code, _, err = run("rate-test", urls[0], "--rates", rates)
    assert code == 2
    assert "--rates 50,100" in err
