"""What is wrong with the parts of an emulated ribbon: drawn by a seed, readable, and applied by its models.

A sensor reads, along the axes of the node frame and in SI units,

    reading = matrix @ v_node + bias
    matrix = (1 + scale + cross-axis) @ R^T @ (1 + soft iron),  bias = part's + (1 + ...) @ R^T @ hard iron

with v_node true at the sensor and R the rotation by which the part is turned in the node frame. The
calibration of the host means the same by a matrix and a bias. Temperatures away from 25 C add their drift:
native/sensor_errors.h.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ribbonhil._firmware import lib
from ribbonhil.part_ranges import ASSEMBLY, CUT_OFF_SIGMAS, RANGES, PartRange
from ribbonhil.rotations import Array, rotation_matrices
from ribbonhil.truth import PITCH_M

_STREAM = 0x6572726F72  # tells these numbers apart from the others that are drawn from [seed, index]
_PAIRS = ((0, 1), (0, 2), (1, 2))
NO_PART = PartRange(0.0, 0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class PartErrors:
    """Of the S sensors of one ribbon; units m/s^2 (accelerometers) or uT (magnetometers), node axes.

    scale: (S, 3) relative. cross_axis: (S, 3) relative, of the pairs xy, xz, yz. mounting_rad: (S, 3)
    rotation vector of the part in the node frame. bias: (S, 3) of the part. hard_iron_ut: (S, 3) and
    soft_iron: (S, 3, 3), zero for accelerometers. scale_per_c, bias_per_c: (S, 3). offset_m: (S,) by which
    each sensor sits further along the ribbon than its slot's nominal arc length.
    """

    scale: Array
    cross_axis: Array
    mounting_rad: Array
    bias: Array
    hard_iron_ut: Array
    soft_iron: Array
    scale_per_c: Array
    bias_per_c: Array
    offset_m: Array

    @cached_property
    def _gain(self) -> Array:
        """(S, 3, 3): a reading of the part, bias aside, from the field or force around it, in node axes."""
        axes = np.eye(3) + self.scale[:, :, None] * np.eye(3)
        for pair, (i, j) in enumerate(_PAIRS):
            axes[:, i, j] = axes[:, j, i] = self.cross_axis[:, pair]
        return np.asarray(axes @ rotation_matrices(self.mounting_rad).swapaxes(-1, -2))

    @cached_property
    def matrix(self) -> Array:
        """(S, 3, 3) sensing matrices; a two-axis magnetometer has the first two rows."""
        return np.asarray(self._gain @ (np.eye(3) + self.soft_iron))

    @cached_property
    def total_bias(self) -> Array:
        """(S, 3) what is read where the truth is zero, hard iron included."""
        return np.asarray(self.bias + np.einsum("sij,sj->si", self._gain, self.hard_iron_ut))

    def to_dict(self) -> dict[str, Any]:
        """All of it as JSON can hold it: a list entry a slot."""
        return {
            "slots": [
                {
                    "slot": slot,
                    **{name: getattr(self, name)[slot].tolist() for name in _DRAWN},
                    "matrix": self.matrix[slot].tolist(),
                    "total_bias": self.total_bias[slot].tolist(),
                }
                for slot in range(len(self.scale))
            ]
        }


_DRAWN = tuple(PartErrors.__dataclass_fields__)


def no_errors(slots: int) -> PartErrors:
    """Ideal parts, to make ones with chosen errors of by dataclasses.replace."""
    zero = np.zeros((slots, 3))
    return PartErrors(zero, zero, zero, zero, zero, np.zeros((slots, 3, 3)), zero, zero, np.zeros(slots))


def drawn_errors(seed: int, index: int, parts: Sequence[int]) -> PartErrors:
    """The errors of ribbon `index` with a wire.Part in each slot, from the ranges of part_ranges."""
    random = np.random.default_rng([seed, index, _STREAM])
    slots = len(parts)
    ranges = [RANGES.get(part, NO_PART) for part in parts]
    is_magnetic = np.array([part in (lib.WIRE_PART_MMC5983MA, lib.WIRE_PART_HMC5983) for part in parts])

    def draw(*shape: int) -> Array:
        drawn = random.standard_normal((slots, *shape))
        return np.asarray(np.clip(drawn, -CUT_OFF_SIGMAS, CUT_OFF_SIGMAS))

    def of_part(name: str) -> Array:
        return np.asarray(draw(3) * np.array([getattr(a_range, name) for a_range in ranges])[:, None])

    soft_iron = draw(3, 3) * ASSEMBLY.soft_iron
    pitch = float(np.clip(random.standard_normal(), -CUT_OFF_SIGMAS, CUT_OFF_SIGMAS)) * ASSEMBLY.pitch
    return PartErrors(
        scale=of_part("scale"),
        cross_axis=of_part("cross_axis"),
        mounting_rad=draw(3) * ASSEMBLY.mounting_rad + of_part("alignment_rad"),
        bias=of_part("bias"),
        hard_iron_ut=np.where(is_magnetic[:, None], draw(3) * ASSEMBLY.hard_iron_ut, 0.0),
        soft_iron=np.where(is_magnetic[:, None, None], 0.5 * (soft_iron + soft_iron.swapaxes(-1, -2)), 0.0),
        scale_per_c=of_part("scale_per_c"),
        bias_per_c=of_part("bias_per_c"),
        offset_m=draw() * ASSEMBLY.placement_m + pitch * PITCH_M * np.arange(slots),
    )
