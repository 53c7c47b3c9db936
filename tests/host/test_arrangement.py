"""Devices find their places in the comb, or a sentence says why not."""

from collections.abc import Callable, Iterator

import numpy as np
import pytest
from host.fake_ribbon import NODES, FakeRibbon
from ribbonhost import wire
from ribbonhost.comb import Comb, CombRibbon
from ribbonhost.device import Device
from ribbonhost.errors import CombFileError, DeviceError, UsageError
from ribbonhost.link import Link
from ribbonhost.pipeline.arrangement import arrange_comb, arrange_curves

SERIALS = [f"{i:024x}" for i in range(1, 5)]
COMB = Comb(SERIALS[0], 0.025, (CombRibbon(SERIALS[1], 0.0, "left"), CombRibbon(SERIALS[2], 0.1)))
Make = Callable[..., Device]


@pytest.fixture
def make() -> Iterator[Make]:
    devices: list[Device] = []

    def make(number: int, **info: object) -> Device:
        device = Device(Link(FakeRibbon(serial=SERIALS[number], info_changes=info), f"port {number}"))
        devices.append(device)
        device.handshake()
        return device

    yield make
    for device in devices:
        device.close()


def slots(count: int, part: wire.Part = wire.Part.LIS2DW12) -> wire.SlotInfoArray:
    return wire.SlotInfoArray(
        part=np.full(count, part, np.uint8), axes=np.full(count, 3, np.uint8), lsb=np.ones(count)
    )


def test_devices_stand_where_the_comb_says_whatever_their_order(make: Make) -> None:
    left, reference, right = make(1), make(0), make(2)
    arrangement = arrange_comb([left, right, reference], COMB)
    assert arrangement.devices == [reference, left, right]
    assert [place.label for place in arrangement.places] == ["reference", "left", "at 0.1 m"]
    assert arrangement.layout is not None
    assert arrangement.layout.start_m == (0.0, 0.1)
    assert arrangement.layout.node_count == NODES
    assert arrangement.notes == ()


def test_a_missing_ribbon_is_noted_and_the_others_go_on(make: Make) -> None:
    arrangement = arrange_comb([make(0), make(2)], COMB)
    assert [place.device is not None for place in arrangement.places] == [True, False, True]
    assert arrangement.notes == (f"ribbon {SERIALS[1]} (left) is not there: the surface bridges its place",)


def test_a_missing_reference_ends_it_and_says_who_answered(make: Make) -> None:
    with pytest.raises(DeviceError, match=f"{SERIALS[0]} is not there; answered: {SERIALS[1]} on port 1, "):
        arrange_comb([make(1), make(2)], COMB)


def test_a_device_that_is_not_in_the_file_is_left_out(make: Make) -> None:
    stranger = make(3)
    arrangement = arrange_comb([make(0), make(1), make(2), stranger], COMB)
    assert arrangement.unused == (stranger,)
    assert arrangement.notes == (f"ribbon {SERIALS[3]} on port 3 is not in the comb file: left out",)


def test_one_device_on_two_ports_is_wrong_usage(make: Make) -> None:
    with pytest.raises(UsageError, match=f"port 1 and port 1 are both ribbon {SERIALS[1]}"):
        arrange_comb([make(0), make(1), make(1)], COMB)
    with pytest.raises(UsageError, match="give one of them"):
        arrange_curves([make(1), make(1)])


@pytest.mark.parametrize(
    ("comb", "info", "unlike"),
    [
        (COMB, {"pitch_m": 0.03}, "a pitch of 0.03 m where the comb file says 0.025 m"),
        (COMB, {"slots": slots(10)}, "10 slots where the reference has 8"),
        (
            Comb(COMB.reference, 0.025, COMB.ribbons, slots=8),
            {"slots": slots(10)},
            "10 slots where the comb file says 8",
        ),
        (
            Comb(COMB.reference, 0.025, COMB.ribbons, parts=frozenset({"lis2dw12", "mmc5983ma"})),
            {"slots": slots(8, wire.Part.HMC5983)},
            "hmc5983 where the comb file says lis2dw12, mmc5983ma",
        ),
    ],
)
def test_a_ribbon_unlike_the_file_is_left_out_and_a_reference_ends_it(
    make: Make, comb: Comb, info: dict[str, object], unlike: str
) -> None:
    arrangement = arrange_comb([make(0), odd := make(1, **info), make(2)], comb)
    assert arrangement.places[1].device is None
    assert arrangement.unused == (odd,)
    [note] = arrangement.notes
    assert note == f"ribbon {SERIALS[1]} (left) is left out: it has {unlike}"


def test_a_reference_unlike_the_file_ends_it(make: Make) -> None:
    with pytest.raises(DeviceError, match=r"the reference ribbon on port 0 has a pitch of 0\.03 m"):
        arrange_comb([make(0, pitch_m=0.03), make(1), make(2)], COMB)


def test_a_start_beyond_the_reference_that_answered_is_a_mistake_of_the_file(make: Make) -> None:
    comb = Comb(SERIALS[0], 0.025, (CombRibbon(SERIALS[1], 0.0), CombRibbon(SERIALS[2], 0.2)))
    with pytest.raises(CombFileError, match=r"starts at 0\.2 m, beyond the end of the reference at 0\.175 m"):
        arrange_comb([make(0), make(1), make(2)], comb)


def test_without_a_comb_there_are_curves_and_it_is_said(make: Make) -> None:
    arrangement = arrange_curves([make(1), make(2)])
    assert arrangement.layout is None
    assert "curves only" in arrangement.notes[0]
