"""Readings of a real sensor, played to the image: here a bar that tilts and rests, made up with its truth."""

from pathlib import Path

import numpy as np
import pytest
from image.programs import built
from numpy.typing import NDArray
from ribbonhil.stm32f405.logged import (
    LogError,
    angle_rad,
    heading_offset_rad,
    local_field,
    quaternion_product,
    read_log,
    run_log,
)
from scipy.spatial.transform import Rotation

RATE_HZ = 95.24
FIELD_WORLD_UT = np.array([0.0, 16.0, -41.0])
HEADING_OFFSET_DEG = 25.0


def made_up_log(seconds: float = 12.0) -> dict[str, NDArray[np.float64]]:
    """A bar that tilts between two rests, its truth turned about the vertical, as optical frames are."""
    random = np.random.default_rng(5)
    t_s = np.arange(round(seconds * RATE_HZ)) / RATE_HZ
    swing = 0.5 - 0.5 * np.cos(np.pi * np.clip((t_s - seconds / 3) / (seconds / 3), 0.0, 1.0))
    attitude = Rotation.from_rotvec(np.column_stack([0.9 * swing, -0.5 * swing, 0.4 + 0.7 * swing]))
    down = attitude.inv().apply([0.0, 0.0, 9.81])
    field = attitude.inv().apply(FIELD_WORLD_UT)
    turned = Rotation.from_euler("z", -HEADING_OFFSET_DEG, degrees=True) * attitude
    q = turned.as_quat()[:, [3, 0, 1, 2]]
    q[200:220] = np.nan
    return {
        "t_s": t_s,
        "acc_mps2": down + random.normal(0.0, 0.02, down.shape),
        "mag_ut": field + random.normal(0.0, 0.3, field.shape),
        "q_world_sensor": q,
    }


def saved(folder: Path, **arrays: object) -> Path:
    path = folder / "log.npz"
    np.savez(path, **arrays)  # type: ignore[arg-type]
    return path


@pytest.mark.parametrize("axes", [3, 2])
def test_orientations_of_a_log_agree_with_its_truth(tmp_path: Path, axes: int) -> None:
    report = run_log(built(), read_log(saved(tmp_path, **made_up_log())), axes)
    assert report.crc_errors == report.overruns == 0
    assert report.field_horizontal_ut == pytest.approx(16.0, abs=0.2)
    assert report.field_down_ut == pytest.approx(41.0, abs=0.2)
    assert report.heading_offset_deg == pytest.approx(HEADING_OFFSET_DEG, abs=1.0)
    assert report.good_share is not None
    assert report.good_share > 0.4
    assert report.rmse_deg is not None
    assert report.rmse_deg < (1.0 if axes == 3 else 1.5)
    assert report.within_3_sigma is not None
    assert report.within_3_sigma >= 0.97


def test_log_without_truth_is_played_all_the_same(tmp_path: Path) -> None:
    arrays = made_up_log(3.0)
    del arrays["q_world_sensor"]
    report = run_log(built(), read_log(saved(tmp_path, **arrays)), 3)
    assert report.frames > 250
    assert report.rmse_deg is None


def test_heading_offset_is_the_mean_turn_about_the_vertical() -> None:
    random = np.random.default_rng(1)
    errors = Rotation.from_euler("z", 130.0, degrees=True) * Rotation.from_rotvec(
        random.normal(0.0, 0.01, (500, 3))
    )
    q = errors.as_quat()[:, [3, 0, 1, 2]] * np.where(random.random((500, 1)) < 0.5, -1.0, 1.0)
    offset = heading_offset_rad(q)
    assert np.degrees(offset) == pytest.approx(130.0, abs=0.1)
    back = np.array([np.cos(offset / 2), 0.0, 0.0, -np.sin(offset / 2)])
    assert np.degrees(angle_rad(quaternion_product(back, q)).max()) < 5.0


@pytest.mark.parametrize(
    ("change", "complaint"),
    [
        ({"acc_mps2": None}, "has no acc_mps2"),
        ({"mag_ut": np.zeros((7, 3))}, r"mag_ut has the shape \(7, 3\)"),
        ({"t_s": np.zeros(286)}, "growing times"),
        ({"acc_mps2": np.full((286, 3), np.nan)}, "values that are no numbers"),
        ({"mag_ut": np.full((286, 3), "north")}, "no NPZ file of numbers"),
    ],
    ids=["missing", "shape", "time", "nan", "text"],
)
def test_bad_log_is_refused_with_its_reason(
    tmp_path: Path, change: dict[str, NDArray[np.float64] | None], complaint: str
) -> None:
    arrays = {**made_up_log(3.0), **change}
    path = saved(tmp_path, **{name: array for name, array in arrays.items() if array is not None})
    with pytest.raises(LogError, match=complaint):
        read_log(path)


def test_file_that_is_no_npz_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "log.npz"
    path.write_bytes(b"not a zip file")
    with pytest.raises(LogError, match="no NPZ file"):
        read_log(path)
    with pytest.raises(LogError, match="cannot be read"):
        read_log(tmp_path / "absent.npz")


def test_log_that_never_rests_tells_no_field(tmp_path: Path) -> None:
    arrays = made_up_log(3.0)
    arrays["acc_mps2"] *= np.random.default_rng(2).uniform(0.5, 1.5, (len(arrays["t_s"]), 1))
    with pytest.raises(LogError, match="never still"):
        local_field(read_log(saved(tmp_path, **arrays)))
