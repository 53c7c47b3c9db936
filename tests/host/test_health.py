"""What a stream says of sensors that their calibration does not fit."""

from dataclasses import replace

import numpy as np
from host.fake_ribbon import status_packet
from ribbonhost.pipeline.health import Unfit, sentence, unfit_slots
from ribbonhost.wire import Misfit, SlotHealthArray, SlotReason, SlotStatusArray, Status


def status(misfit: dict[int, Misfit], permille: dict[int, int] | None = None) -> Status:
    fine = status_packet()
    misfits, lengths = np.zeros(len(fine.slots), np.uint8), np.full(len(fine.slots), -128, np.int32)
    for slot, bits in misfit.items():
        misfits[slot] = bits
    for slot, value in (permille or {}).items():
        lengths[slot] = value
    return replace(fine, health=SlotHealthArray(misfits, lengths))


def test_nothing_is_said_of_sensors_that_fit_or_say_nothing() -> None:
    assert unfit_slots(None) == ()
    assert unfit_slots(status({}, {2: 9})) == ()
    assert sentence((), 8) == ""


def test_each_sensor_is_told_with_what_does_not_fit() -> None:
    found = unfit_slots(status({2: Misfit.LENGTH, 4: Misfit.NEIGHBOURS}, {2: 18, 4: 1}))
    assert found == (
        Unfit(2, SlotReason.OK, Misfit.LENGTH, 1.8),
        Unfit(4, SlotReason.OK, Misfit.NEIGHBOURS, 0.1),
    )
    assert sentence(found, 8) == (
        "accelerometer in slot 2 is off g by +1.8 % at rest; "
        "accelerometer in slot 4 is not level with its neighbours: calibrate it"
    )
    assert found[0].as_json() == {"slot": 2, "reason": "ok", "misfit": ["length"], "length_percent": 1.8}


def test_magnetometers_may_be_off_for_another_reason() -> None:
    found = unfit_slots(status({3: Misfit.LENGTH | Misfit.DIP, 5: Misfit.DIP}, {3: -40}))
    assert sentence(found, 8) == (
        "magnetometer in slot 3 is off the field's magnitude by -4.0 %; "
        "magnetometer in slot 5 is off the field's dip: calibrate it, or take away what is magnetic"
    )
    assert found[0].as_json()["misfit"] == ["length", "dip"]
    assert unfit_slots(status({3: Misfit.DIP}))[0].length_percent is None


def test_many_are_counted() -> None:
    found = unfit_slots(status(dict.fromkeys(range(6), Misfit.LENGTH)))
    assert sentence(found, 8) == "6 of 8 sensors do not fit the calibration: calibrate it"


def test_sensors_that_are_not_used_are_told_with_the_reason() -> None:
    def unused(*reasons: int) -> tuple[Unfit, ...]:
        fine = status_packet()
        reason = np.zeros(len(fine.slots), np.uint8)
        reason[: len(reasons)] = reasons
        return unfit_slots(replace(fine, slots=SlotStatusArray(reason, fine.slots.errors)))

    assert sentence(unused(0, 7), 8) == (
        "magnetometer in slot 1 is not used: out of range: calibrate it, or take away what is magnetic"
    )
    assert sentence(unused(1), 8) == "accelerometer in slot 0 is not used: absent"
    assert sentence(unused(1, 1, 1), 8) == "3 of 8 sensors are not used"
    assert sentence(unused(99), 8) == "accelerometer in slot 0 is not used: reason 99"


def test_sensors_that_are_not_used_and_that_do_not_fit_are_counted_apart() -> None:
    found = unfit_slots(status({2: Misfit.LENGTH, 4: Misfit.LENGTH}))
    unused = Unfit(1, SlotReason.OUT_OF_RANGE, Misfit(0), None)
    assert sentence((unused, *found), 8) == (
        "1 of 8 sensors are not used, 2 more do not fit the calibration: calibrate it"
    )
