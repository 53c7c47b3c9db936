"""`ribbonhost identify` asks the right ribbon to blink."""

import json
from collections.abc import Callable

import pytest
from host.fake_ribbon import FakeRibbon
from ribbonhost.wire import AckCode, CommandCode

Run = Callable[..., tuple[int, str, str]]


def test_the_named_ribbon_blinks_for_as_long_as_asked(
    run: Run, urls: list[str], fakes: list[FakeRibbon]
) -> None:
    code, out, _ = run("identify", urls[1], "--seconds", "2.5", "--json")
    assert code == 0
    assert json.loads(out)["identify"] == {"serial": fakes[1].serial, "port": urls[1], "seconds": 2.5}
    assert (CommandCode.IDENTIFY, 2500) in fakes[1].commands
    assert fakes[0].commands == []


def test_a_time_that_cannot_be_is_wrong_usage(run: Run, urls: list[str]) -> None:
    for seconds in ("61", "-1", "nan"):
        code, _, err = run("identify", urls[0], "--seconds", seconds)
        assert code == 2
        assert "between 0 and 60" in err


def test_a_refusal_is_a_failure(run: Run, urls: list[str], fakes: list[FakeRibbon]) -> None:
    fakes[0].refused = {CommandCode.IDENTIFY: AckCode.UNSUPPORTED}
    code, _, err = run("identify", urls[0])
    assert code == 1
    assert "refused identify" in err


@pytest.mark.parametrize(("seconds", "words"), [("0", "no longer blinks"), ("3", "blinks for 3 s")])
def test_it_says_what_the_led_does(run: Run, seconds: str, words: str) -> None:
    code, out, _ = run("identify", "emulated://wing/1?seed=3", "--seconds", seconds)
    assert code == 0
    assert words in out
