"""What is true of emulated ribbons: what they lie on, where their sensors sit, what disturbs their field."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from ribbonhost.errors import UsageError

from ribbonhil.disturbances import CarriedMagnet, Disturbance
from ribbonhil.emulated_device import Device
from ribbonhil.handling import HANDLINGS, Handling, handled_truth
from ribbonhil.rotations import Array
from ribbonhil.scenes import Scene, load_scene
from ribbonhil.truth import CombTruth, Field, comb_truth, orthonormal

EARTH = Field()
STENCIL = 4  # slots that a place between slots is interpolated from


def load_world(name: str, period_s: float | None = None) -> Scene | Handling:
    """A handling (bar, rest) or a scene by its name; period_s is for scenes.

    Raises SceneError if there is none, UsageError for the period of a handling, which its poses give.
    """
    handling = HANDLINGS.get(name)
    if handling is None:
        return load_scene(name, period_s)
    if period_s is not None:
        raise UsageError(f"{name} has no period to choose: its poses take {handling.period_s:g} s")
    return handling


def world_truth(
    world: Scene | Handling,
    ribbons: int,
    field: Field = EARTH,
    *,
    devices: Sequence[Device] = (),
    disturbances: Sequence[Disturbance] = (),
) -> CombTruth:
    """The truth of `ribbons` on a reference; field is that of the earth.

    devices: of the ribbons, the reference's first: their errors say where sensors sit; none: all nominal.

    Raises SceneError or UsageError for a comb that cannot be.
    """
    offset_m = None
    if any(device.errors is not None and device.errors.offset_m.any() for device in devices):
        zero = np.zeros(len(devices[0].parts))
        offset_m = np.array([zero if device.errors is None else device.errors.offset_m for device in devices])
    if isinstance(world, Handling):
        truth = handled_truth(world, ribbons, field, offset_m)
    else:
        truth = comb_truth(world, ribbons, field)
        truth = truth if offset_m is None else displaced(truth, offset_m)
    return disturbed(truth, field, disturbances)


def displaced(truth: CombTruth, offset_m: Array) -> CombTruth:
    """The truth at sensors that sit (R + 1, S) further along their ribbons than their slots do."""
    count = truth.position_m.shape[2]
    place = np.arange(count) + offset_m / truth.pitch_m
    first = np.clip(np.floor(place).astype(int) - 1, 0, count - STENCIL)
    # Lagrange's weights of the four slots around.
    weight = np.ones((*place.shape, STENCIL))
    for i in range(STENCIL):
        for j in range(STENCIL):
            if i != j:
                weight[..., i] *= (place - first - j) / (i - j)
    ribbon = np.arange(len(offset_m))[:, None, None]
    slots = first[..., None] + np.arange(STENCIL)

    def moved(values: Array) -> Array:
        return np.asarray(np.einsum("rsw,krsw...->krs...", weight, values[:, ribbon, slots]))

    return replace(
        truth,
        position_m=moved(truth.position_m),
        r_world_node=orthonormal(moved(truth.r_world_node)),
        specific_force_mps2=moved(truth.specific_force_mps2),
        field_ut=moved(truth.field_ut),
    )


def disturbed(truth: CombTruth, field: Field, disturbances: Sequence[Disturbance]) -> CombTruth:
    """The truth with the fields of disturbances added. Raises UsageError for one on no ribbon or slot."""
    if not disturbances:
        return truth
    _, ribbons, slots, _ = truth.position_m.shape
    extra_ut = np.zeros(truth.position_m.shape)
    for disturbance in disturbances:
        if isinstance(disturbance, CarriedMagnet) and not (
            0 <= disturbance.ribbon < ribbons and 0 <= disturbance.slot < slots
        ):
            raise UsageError(
                f"a magnet can be carried by ribbons 0 to {ribbons - 1} at slots 0 to {slots - 1}, "
                f"not by ribbon {disturbance.ribbon} at slot {disturbance.slot}"
            )
        extra_ut += disturbance.field_ut(truth.position_m, truth.r_world_node, field.world_ut())
    return replace(
        truth, field_ut=truth.field_ut + np.einsum("...ij,...i->...j", truth.r_world_node, extra_ut)
    )
