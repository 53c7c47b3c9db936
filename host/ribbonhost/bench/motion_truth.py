"""What is true in a case of the motion benchmark: a scene at any pace, its anchor held or shaken."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

Float64 = NDArray[np.float64]
Bool = NDArray[np.bool_]

STEP_S = 0.001
REST_S = 0.5
RAMP_S = 1.0
RIBBONS = 5


@dataclass(frozen=True)
class Case:
    """One motion of one ribbon and what is wrong with its sensors.

    scene: name or file of a scene. starts: "rest" (still for REST_S, then up to speed within RAMP_S),
    "motion" (at full speed from the first sample) or "never" (nothing moves).
    anchor: "held" (the scene's motion there is taken away), "scene" (left as it is), "shaken" (held, and in
    addition 0.3 g RMS between 0.5 and 3 Hz) or "carried" (held, and walked through a room).
    trouble: names of what is wrong, see motion_trouble. is_calibrated: the parts have the errors of parts off
    the shelf, and were calibrated; else they have none. axes: of the magnetometers, 2 or 3.
    """

    name: str
    scene: str
    period_s: float
    seconds: float = 8.0
    starts: str = "motion"
    anchor: str = "held"
    trouble: tuple[str, ...] = ()
    ribbon: int = 3
    seed: int = 0
    is_calibrated: bool = False
    axes: int = 2


@dataclass(frozen=True, eq=False)
class Truth:
    """A ribbon's true motion, K equal steps of STEP_S.

    position_m: (K, S, 3) from the anchor. r_world_node: (K, S, 3, 3).
    force_mps2, field_ut: (K, S, 3) node frame.
    """

    position_m: Float64
    r_world_node: Float64
    force_mps2: Float64
    field_ut: Float64
    world_field_ut: Float64
    pitch_m: float

    @property
    def length_m(self) -> float:
        """From the anchor to the last slot."""
        return float(self.pitch_m * (self.position_m.shape[1] - 1))

    def at(self, table: Float64, t_s: Float64) -> Float64:
        """Rows of a table (K, ...) at times (T,): linear between its steps, fine enough for that."""
        place = np.clip(t_s / STEP_S, 0, len(table) - 1.001)
        below = place.astype(np.int64)
        u = (place - below).reshape(-1, *(1,) * (table.ndim - 1))
        return np.asarray(table[below] * (1 - u) + table[below + 1] * u)


def times_s(count: int) -> Float64:
    """(count,) the times of the steps."""
    return np.asarray(np.arange(count) * STEP_S, dtype=np.float64)


def phases(case: Case) -> tuple[Float64, Float64, Float64, Float64]:
    """Times (K,), and the scene's phase with its first two derivatives by time, periods."""
    t_s = times_s(round(case.seconds / STEP_S))
    speed = 1.0 / case.period_s
    if case.starts == "never":
        still = np.zeros_like(t_s)
        return t_s, still + 0.2, still, still
    if case.starts == "motion":
        steady: Float64 = np.zeros_like(t_s) + speed
        return t_s, speed * t_s, steady, np.zeros_like(t_s)
    u = np.clip((t_s - REST_S) / RAMP_S, 0.0, 1.0)
    phase = speed * (RAMP_S * (u**3 - u**4 / 2) + np.maximum(t_s - REST_S - RAMP_S, 0.0))
    rate = speed * (3 * u**2 - 2 * u**3)
    change = speed * np.where((u > 0) & (u < 1), (6 * u - 6 * u**2) / RAMP_S, 0.0)
    return t_s, np.asarray(phase), np.asarray(rate), np.asarray(change)


def anchor_acceleration(case: Case, t_s: Float64) -> Float64:
    """(K, 3) what the anchor does beside the scene."""
    random = np.random.default_rng([case.seed, 1])
    if case.anchor == "shaken":
        frequency_hz = random.uniform(0.5, 3.0, (12, 3))
        phase = random.uniform(0.0, 2 * np.pi, (12, 3))
        wave = np.sin(2 * np.pi * frequency_hz * t_s[:, None, None] + phase).sum(axis=1)
        rms = np.sqrt((wave**2).sum(axis=1).mean())
        return np.asarray(0.3 * 9.80665 * wave / rms)
    if case.anchor == "carried":
        # Ten steps through a room and back: starts, stops and turns, with the bounce of the steps.
        sway = 2 * np.pi * t_s
        return np.stack(
            [
                1.2 * np.sin(0.25 * sway) + 0.8 * np.sin(1.8 * sway),
                0.9 * np.cos(0.2 * sway),
                1.5 * np.sin(1.8 * sway + 1.0),
            ],
            axis=1,
        )
    return np.zeros((len(t_s), 3))


def make_truth(case: Case) -> Truth:
    """The truth of a case. Raises SceneError for a scene that cannot be."""
    from ribbonhil.scenes import load_scene
    from ribbonhil.truth import GRAVITY_MPS2, Field, comb_truth, orthonormal

    comb = comb_truth(load_scene(case.scene, case.period_s), RIBBONS)
    t_s, phase, rate, change = phases(case)
    position = comb.position_m[:, case.ribbon]
    if case.anchor != "scene":
        position = position - position[:, :1]
    series = _Series(position)
    acceleration = (
        series.at(phase, 2) * (rate**2)[:, None, None]
        + series.at(phase, 1) * change[:, None, None]
        + anchor_acceleration(case, t_s)[:, None]
    )
    position_m = series.at(phase, 0)
    rotation = orthonormal(_Series(comb.r_world_node[:, case.ribbon]).at(phase, 0))
    world_field = Field().world_ut()
    pull = acceleration + np.array([0.0, 0.0, GRAVITY_MPS2])
    return Truth(
        position_m=position_m - position_m[:, :1],
        r_world_node=rotation,
        force_mps2=np.einsum("ksij,ksi->ksj", rotation, pull),
        field_ut=np.einsum("ksij,i->ksj", rotation, world_field),
        world_field_ut=world_field,
        pitch_m=comb.pitch_m,
    )


class _Series:
    """A periodic table (M, ...) by its harmonics, at any phases."""

    def __init__(self, table: Float64) -> None:
        self._shape = table.shape[1:]
        spectrum = np.fft.rfft(table.reshape(len(table), -1), axis=0) / len(table)
        size = np.abs(spectrum).max(axis=1)
        count = int(np.flatnonzero(size > 1e-9)[-1]) + 1
        self._spectrum = spectrum[:count]

    def at(self, phase: Float64, derivative: int) -> Float64:
        """(K, ...) for phases (K,), differentiated by the phase."""
        harmonics = np.arange(len(self._spectrum))
        weight = np.where(harmonics == 0, 1.0, 2.0) * (2j * np.pi * harmonics) ** derivative
        waves = np.exp(2j * np.pi * np.outer(phase, harmonics))
        value = np.real(waves @ (weight[:, None] * self._spectrum))
        return np.asarray(value.reshape(len(phase), *self._shape))
