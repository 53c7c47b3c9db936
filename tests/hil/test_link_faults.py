"""Faults of an emulated link: how often, the same for a seed, and whatever the division of the bytes."""

import numpy as np
import pytest
from ribbonhil.faults import FaultyLine, LinkFaults
from ribbonhost.errors import UsageError

CONTENT = np.random.default_rng(8).integers(1, 256, 200_000, dtype=np.uint8)
CONTENT[::100] = 0


def passed(content: np.ndarray = CONTENT, **faults: float) -> np.ndarray:
    return np.frombuffer(FaultyLine(LinkFaults(**faults), 3, 0).pass_on(content.tobytes()), np.uint8)


def test_link_without_faults_passes_everything():
    np.testing.assert_array_equal(passed(), CONTENT)


def test_lost_duplicated_and_inserted_bytes_come_with_their_probability():
    assert 1 - len(passed(loss=0.02)) / len(CONTENT) == pytest.approx(0.02, rel=0.1)
    assert len(passed(duplicate=0.02)) / len(CONTENT) - 1 == pytest.approx(0.02, rel=0.1)
    assert len(passed(insert=0.02)) / len(CONTENT) - 1 == pytest.approx(0.02, rel=0.1)


def test_flipped_bytes_differ_in_one_bit():
    difference = passed(flip=0.02) ^ CONTENT
    changed = difference[difference != 0]
    assert len(changed) / len(CONTENT) == pytest.approx(0.02, rel=0.1)
    assert {int(d).bit_count() for d in changed} == {1}
    assert len(set(changed.tolist())) == 8


def test_truncation_loses_the_rest_of_a_frame_and_keeps_its_delimiter():
    frames = passed(truncate=0.001).tobytes().split(b"\0")
    sent = CONTENT.tobytes().split(b"\0")
    assert len(frames) == len(sent)
    cut = [len(s) - len(f) for f, s in zip(frames, sent, strict=True)]
    assert all(s.startswith(f) for f, s in zip(frames, sent, strict=True))
    assert np.mean(np.array(cut) > 0) == pytest.approx(1 - 0.999**100, rel=0.15)


def test_faults_do_not_depend_on_how_the_bytes_are_divided():
    faults = LinkFaults(loss=0.01, flip=0.01, duplicate=0.01, insert=0.01, truncate=0.001)
    whole = FaultyLine(faults, 3, 0).pass_on(CONTENT.tobytes())
    line = FaultyLine(faults, 3, 0)
    cuts = np.sort(np.random.default_rng(1).integers(0, len(CONTENT), 500))
    assert b"".join(line.pass_on(part.tobytes()) for part in np.split(CONTENT, cuts)) == whole
    assert FaultyLine(faults, 4, 0).pass_on(CONTENT.tobytes()) != whole
    assert FaultyLine(faults, 3, 1).pass_on(CONTENT.tobytes()) != whole


def test_port_is_gone_from_disconnect_to_reconnect_and_an_open_one_for_good():
    faults = LinkFaults(disconnect_s=2.0, reconnect_s=3.0)
    assert faults.is_connected(0.0, 1.9)
    assert not faults.is_connected(0.0, 2.1)
    assert not faults.is_connected(0.0, 9.0)
    assert not faults.is_connected(2.5, 2.6)
    assert faults.is_connected(3.1, 9.0)
    assert not LinkFaults(disconnect_s=2.0).is_connected(5.0, 6.0)


@pytest.mark.parametrize(
    "wrong", [{"loss": 1.5}, {"flip": -0.1}, {"insert": float("nan")}, {"disconnect_s": -1.0}]
)
def test_impossible_faults_are_refused(wrong: dict[str, float]):
    with pytest.raises(UsageError):
        LinkFaults(**wrong)
