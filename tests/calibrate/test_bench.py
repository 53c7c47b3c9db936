"""The bench of calibration counts what is refused and goes on."""

import pytest
from ribbonhost.bench import calibration
from ribbonhost.bench.calibration import calibration_table, measure_calibration
from ribbonhost.calibrate.refusals import Reason, RefusedError


def test_a_refused_ribbon_is_counted_and_the_others_are_measured(monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[int] = []
    shares: list[float] = []

    def refuse(devices: object, index: int, handling: object) -> None:
        asked.append(index)
        raise RefusedError(Reason.MOTION, f"ribbon {index} moved")

    monkeypatch.setattr(calibration, "calibrate_ribbon", refuse)
    monkeypatch.setattr(calibration, "comb_error", lambda scene, devices, records: (3.0, 2.0))
    result = measure_calibration(2, "wing", shares.append)
    assert asked == 2 * list(range(calibration.RIBBONS + 1))
    assert shares == sorted(shares)
    assert 0 <= shares[0] < shares[-1] < 1
    assert len(result["refused"]) == result["ribbons"] == 12
    assert result["error_median_percent"] is None
    text = calibration_table(result)
    assert "12 of 12 calibrations were refused." in text
    assert "seed 2, ribbon 5: ribbon 5 moved" in text
