"""Ribbons that are handled for a calibration: turned by hand on a straight bar, or lying at rest.

A bar is held still in one attitude after the other, as well as hands can: they sway slowly by tenths of a
degree, and tremble at 8 to 12 Hz (physiological tremor), which moves a bar by micrometres and accelerates it
by hundredths of m/s^2. World and node frames as in docs/architecture.md; the bar's frame is that of a node.
"""

from dataclasses import dataclass, field
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from ribbonhil.disturbances import Magnet
from ribbonhil.rotations import Array, rotation_matrices, rotation_vectors
from ribbonhil.truth import GRAVITY_MPS2, PITCH_M, SLOT_COUNT, CombTruth, Field, resample, starts_m

UNDER_THE_BAR = Magnet((0.0, 0.0, -0.7), (0.0, 7.0, 7.0))
UP_MPS2 = np.array([0.0, 0.0, GRAVITY_MPS2])
RATE_HZ = 64.0  # of the rows of truth: five to a period of the fastest tremor
TREMOR_HZ = (8.0, 12.0)
SWAY_HZ = (0.1, 0.6)
TONES = 8  # sinusoids that a tremor or a sway is made of
REACH_M = 0.1  # by which poses lie apart
SATURATING_MPS2 = 60.0
SATURATING_UT = 2000.0
BAR_M = PITCH_M * (SLOT_COUNT - 1)
ON_TABLE = (0, 1, 10, 11)  # normal up, binormal up; the same with the bar turned end for end


@dataclass(frozen=True)
class Trouble:
    """What is wrong with a handling: nothing, unless said so.

    bend_1pm: curvature of the bar, 1/m. twist_radpm: turn of the ribbon around it per metre. magnet: stands
    near the bar in the poses `disturbed`. loose_slot: a sensor that is turned by loose_deg in every second
    pose. saturated_slot: a sensor that feels more than it can measure. one_axis: all attitudes are turns
    about the bar's own axis.
    """

    bend_1pm: float = 0.0
    twist_radpm: float = 0.0
    magnet: Magnet = UNDER_THE_BAR
    disturbed: tuple[int, ...] = ()
    loose_slot: int | None = None
    loose_deg: float = 8.0
    saturated_slot: int | None = None
    one_axis: bool = False


@dataclass(frozen=True)
class Handling:
    """A bar held in `poses` attitudes for hold_s each, with moves of move_s between them, over and over.

    The first 24 attitudes point the bar to the six sides of a cube and roll it to four sides; the next 24 are
    the same turned by 45 degrees about the vertical. All are off by scatter_deg (RMS, all axes together).
    sway_deg, sway_m, tremor_mps2: RMS an axis. A handling that is never still has hold_s = 0.

    In the poses ON_TABLE the bar does not lie in hands but on a table that is tilted by table_deg: on two of
    its sides, each end for end, its sides flush with the table but for flush_deg. NaN: there is no table.
    """

    name: str = "bar"
    poses: int = 24
    hold_s: float = 4.0
    move_s: float = 1.0
    scatter_deg: float = 6.0
    sway_deg: float = 0.15
    sway_m: float = 1.5e-3
    tremor_mps2: float = 0.02
    table_deg: float = 1.0
    flush_deg: float = 0.05
    seed: int = 0
    trouble: Trouble = field(default_factory=Trouble)

    @property
    def period_s(self) -> float:
        """How long all poses take; then the first one comes again."""
        return self.poses * (self.hold_s + self.move_s)

    def holds_s(self) -> Array:
        """(poses, 2) from when until when each pose is held, in the first period."""
        start_s = np.arange(self.poses) * (self.hold_s + self.move_s)
        return np.stack([start_s, start_s + self.hold_s], axis=1)

    def attitudes(self) -> Array:
        """(poses, 3, 3) r_world_bar of the poses, without sway."""
        random = np.random.default_rng([self.seed, 1])
        off_rad = np.radians(self.scatter_deg) / np.sqrt(3) * random.standard_normal((self.poses, 3))
        nominal = _nominal(self.poses, self.trouble.one_axis)
        lies = self.lies()
        yaw_rad = off_rad * [0.0, 0.0, 1.0]
        flush_rad = np.radians(self.flush_deg) / np.sqrt(2) * random.standard_normal((self.poses, 3))
        table_rad = np.radians(np.nan_to_num(self.table_deg)) * np.append(_unit(random), 0.0)
        lying = rotation_matrices(table_rad) @ rotation_matrices(yaw_rad) @ nominal
        held = nominal @ rotation_matrices(off_rad)
        return np.where(lies[:, None, None], lying @ rotation_matrices(flush_rad), held)

    def lies(self) -> NDArray[np.bool_]:
        """(poses,) whether the bar lies on the table."""
        if np.isnan(self.table_deg) or self.trouble.one_axis:
            return np.zeros(self.poses, np.bool_)
        return np.isin(_chosen(self.poses), ON_TABLE)


HANDLINGS = {
    "bar": Handling(),
    "rest": Handling(
        "rest", 1, 20.0, 0.0, scatter_deg=1.0, sway_deg=0.0, sway_m=0.0, tremor_mps2=0.0, table_deg=np.nan
    ),
}


def _unit(random: np.random.Generator) -> Array:
    """(2,) a direction."""
    angle = random.uniform(0, 2 * np.pi)
    return np.array([np.cos(angle), np.sin(angle)])


def _chosen(poses: int) -> NDArray[np.int64]:
    """(poses,) numbers of attitudes; fewer than 24 are spread over directions and rolls alike."""
    return np.arange(poses) * 24 // poses if poses < 24 else np.arange(poses)


def _nominal(poses: int, one_axis: bool) -> Array:
    quarter = np.pi / 2
    if one_axis:
        turns = 2 * np.pi * np.arange(poses) / poses
        return rotation_matrices(turns[:, None] * np.array([1.0, 0.0, 0.0]))
    yaws = [np.array([0.0, 0.0, quarter * i]) for i in range(4)]
    pitches = [np.array([0.0, -quarter, 0.0]), np.array([0.0, quarter, 0.0])]
    points = rotation_matrices([*yaws, *pitches])
    # The first roll differs from side to side: so those of fewer poses are spread as well.
    roll_rad = quarter * (np.arange(6)[:, None] + np.arange(4))
    rolls = rotation_matrices(roll_rad[..., None] * np.array([1.0, 0.0, 0.0]))
    cube = (points[:, None] @ rolls).reshape(24, 3, 3)
    chosen = _chosen(poses)
    turned = rotation_matrices(np.array([0.0, 0.0, np.pi / 4]) * (chosen // 24)[:, None])
    return np.asarray(turned @ cube[chosen % 24])


def _tones(
    random: np.random.Generator, band_hz: tuple[float, float], handling: Handling, t_s: Array
) -> Array:
    """(K, 3) of RMS 1 an axis in a band of frequencies, periodic with the handling."""
    period_s = handling.period_s
    lowest, highest = (max(1, round(hz * period_s)) for hz in band_hz)
    turns = random.integers(lowest, highest, (TONES, 3), endpoint=True)
    phases = random.uniform(0, 2 * np.pi, (TONES, 3))
    total = np.zeros((len(t_s), 3))
    for turn, phase in zip(turns, phases, strict=True):
        total += np.sqrt(2 / TONES) * np.sin(2 * np.pi * turn * (t_s / period_s)[:, None] + phase)
    return total


def _jitter(handling: Handling, t_s: Array) -> tuple[Array, Array]:
    """What hands add to a pose: displacements (K, 3) m and rotation vectors (K, 3) rad."""
    random = np.random.default_rng([handling.seed, 2])
    sway = [_tones(random, SWAY_HZ, handling, t_s) for _ in range(2)]
    tremor = [_tones(random, TREMOR_HZ, handling, t_s) for _ in range(2)]
    tremor_m = handling.tremor_mps2 / (2 * np.pi * np.mean(TREMOR_HZ)) ** 2
    moved_m = handling.sway_m * sway[0] + tremor_m * tremor[0]
    # Hands at the ends of the bar tremble apart as much as together.
    turned_rad = np.radians(handling.sway_deg) * sway[1] + tremor_m / (BAR_M / 2) * tremor[1]
    return moved_m, turned_rad


def _carried(handling: Handling, t_s: Array) -> tuple[Array, Array, Array]:
    """Centre (K, 3) and r_world_bar (K, 3, 3) of the bar, and which pose each row belongs to (K,)."""
    attitude = handling.attitudes()
    random = np.random.default_rng([handling.seed, 3])
    centre_m = random.uniform(-REACH_M, REACH_M, (handling.poses, 3))
    slot_s = handling.hold_s + handling.move_s
    pose = np.minimum((t_s / slot_s).astype(int), handling.poses - 1)
    after = (pose + 1) % handling.poses
    u = np.clip((t_s - pose * slot_s - handling.hold_s) / max(handling.move_s, 1e-9), 0.0, 1.0)
    # The polynomial that starts and ends without velocity, acceleration and jerk.
    way = (u**4 * (35 - 84 * u + 70 * u**2 - 20 * u**3))[:, None]
    turn = rotation_vectors(attitude.swapaxes(-1, -2) @ np.roll(attitude, -1, axis=0))
    moved_m, turned_rad = _jitter(handling, t_s)
    in_hands = (~handling.lies()).astype(np.float64)[:, None]
    shaking = in_hands[pose] + way * (in_hands[after] - in_hands[pose])
    moved_m, turned_rad = shaking * moved_m, shaking * turned_rad
    r = attitude[pose] @ rotation_matrices(way * turn[pose]) @ rotation_matrices(turned_rad)
    nearest = np.where(way[:, 0] < 0.5, pose, after)
    return centre_m[pose] + way * (centre_m[after] - centre_m[pose]) + moved_m, r, nearest


def _along_bar(trouble: Trouble, s_m: Array) -> tuple[Array, Array]:
    """Places (S, 3) and orientations (S, 3, 3) of sensors at arc lengths s_m, in the frame of the bar."""
    from_middle_m = s_m - BAR_M / 2
    slope = trouble.bend_1pm * from_middle_m
    zero = np.zeros_like(slope)
    x_m = from_middle_m * np.sinc(slope / np.pi)
    z_m = 0.5 * from_middle_m * slope * np.sinc(slope / (2 * np.pi)) ** 2
    bent = rotation_matrices(np.stack([zero, -slope, zero], axis=-1))
    twisted = rotation_matrices(np.stack([trouble.twist_radpm * from_middle_m, zero, zero], axis=-1))
    return np.stack([x_m, zero, z_m], axis=-1), bent @ twisted


@lru_cache(maxsize=2)
def _nominal_truth(handling: Handling, earth: Field) -> CombTruth:
    return _one_ribbon(handling, earth, np.zeros(SLOT_COUNT))


def handled_truth(handling: Handling, ribbons: int, earth: Field, offset_m: Array | None = None) -> CombTruth:
    """The truth of ribbons that are all handled alike, each on a bar of its own.

    offset_m: (ribbons + 1, S) by which sensors sit further along than their slots.
    """
    if offset_m is None:
        one = _nominal_truth(handling, earth)
        alike = [one] * (ribbons + 1)
    else:
        alike = [_one_ribbon(handling, earth, offset) for offset in offset_m]
    turned = alike[0].r_world_node
    return CombTruth(
        handling.period_s,
        PITCH_M,
        starts_m(ribbons),
        np.concatenate([one.position_m for one in alike], axis=1),
        # What an offset turns on a bent bar is less than anything that is measured here.
        np.broadcast_to(turned, (len(turned), ribbons + 1, *turned.shape[2:])),
        np.concatenate([one.specific_force_mps2 for one in alike], axis=1),
        np.concatenate([one.field_ut for one in alike], axis=1),
    )


def _one_ribbon(handling: Handling, earth: Field, offset_m: Array) -> CombTruth:
    trouble = handling.trouble
    rows = max(2, round(handling.period_s * RATE_HZ))
    t_s = np.arange(rows) * handling.period_s / rows
    centre_m, r_world_bar, pose = _carried(handling, t_s)
    place_m, r_bar_node = _along_bar(trouble, np.arange(SLOT_COUNT) * PITCH_M + offset_m)
    r = r_world_bar[:, None] @ r_bar_node
    if trouble.loose_slot is not None:
        turn = rotation_matrices(np.radians([0.0, trouble.loose_deg, trouble.loose_deg]) / np.sqrt(2))
        felt = r.copy()
        felt[pose % 2 == 1, trouble.loose_slot] @= turn
    else:
        felt = r
    position_m = centre_m[:, None] + place_m @ r_world_bar.swapaxes(-1, -2)
    # x'' = c'' + R'' x of the bar, whose motion is periodic.
    second_s2 = handling.period_s**2
    centre_mps2 = resample(centre_m, rows, derivative=2) / second_s2
    turning = resample(r_world_bar, rows, derivative=2) / second_s2
    pull_mps2 = (centre_mps2 + UP_MPS2)[:, None] + place_m @ turning.swapaxes(-1, -2)
    field_ut = np.broadcast_to(earth.world_ut(), position_m.shape)
    if trouble.disturbed:
        near = np.isin(pose, trouble.disturbed)[:, None, None]
        field_ut = field_ut + near * trouble.magnet.field_ut(position_m, r, earth.world_ut())
    specific_force_mps2 = (pull_mps2[..., None, :] @ felt)[..., 0, :]
    field_node_ut = (field_ut[..., None, :] @ felt)[..., 0, :]
    if trouble.saturated_slot is not None:
        specific_force_mps2[:, trouble.saturated_slot] += SATURATING_MPS2
        field_node_ut[:, trouble.saturated_slot] += SATURATING_UT
    return CombTruth(
        handling.period_s,
        PITCH_M,
        (),
        position_m[:, None],
        r[:, None],
        specific_force_mps2[:, None],
        field_node_ut[:, None],
    )
