"""Magnets and steel around emulated ribbons: their fields, their texts, and what sensors feel of them."""

import numpy as np
import pytest
from ribbonhil.comb_spec import CombSpec, parse_url
from ribbonhil.disturbances import CarriedMagnet, Magnet, SteelBeam, dipole_ut, parse_disturbance
from ribbonhil.emulator import EmulatedComb
from ribbonhil.scenes import load_scene
from ribbonhil.truth import Field, comb_truth
from ribbonhil.world import disturbed
from ribbonhost.errors import UsageError

EARTH = Field()


def test_a_dipole_has_the_field_of_the_text_book() -> None:
    """1 A m^2 at 10 cm: 200 uT along its axis, -100 uT beside it."""
    moment = np.array([0.0, 0.0, 1.0])
    at_m = np.array([[0.0, 0.0, 0.1], [0.1, 0.0, 0.0]])
    assert dipole_ut(at_m, np.zeros(3), moment) == pytest.approx(np.array([[0, 0, 200.0], [0, 0, -100.0]]))
    assert np.isfinite(dipole_ut(np.zeros(3), np.zeros(3), moment)).all(), "inside it"


def test_fields_of_dipoles_have_no_sources() -> None:
    """Divergence and curl vanish outside."""
    step_m, at_m = 1e-4, np.array([0.11, -0.07, 0.2])
    moment = np.array([0.3, -0.8, 0.5])
    ahead, behind = (dipole_ut(at_m + s * step_m * np.eye(3), np.zeros(3), moment) for s in (1, -1))
    slope = (ahead - behind) / (2 * step_m)  # [along, component]
    assert abs(np.trace(slope)) < 1e-3 * np.abs(slope).max()
    assert np.abs(slope - slope.T).max() < 1e-3 * np.abs(slope).max()


def test_a_steel_beam_draws_the_field_in_along_itself() -> None:
    """A beam along north is magnetised northward: it adds to the field off its ends, takes away beside it."""
    beam = SteelBeam((0.0, -1.0, 0.0), (0.0, 1.0, 0.0))
    at_m = np.array([[0.0, 1.3, 0.0], [0.3, 0.0, 0.0], [5.0, 0.0, 0.0]])
    horizontal = np.array([0.0, 20.0, 0.0])
    added = beam.field_ut(at_m, np.eye(3), horizontal)
    assert added[0, 1] > 1.0
    assert added[1, 1] < -0.5
    assert np.linalg.norm(added[2]) < 0.2
    assert beam.field_ut(at_m, np.eye(3), np.zeros(3)) == pytest.approx(0.0), "it is no magnet by itself"


def test_what_a_ribbon_carries_turns_with_it() -> None:
    truth = comb_truth(load_scene("wing"), 2, EARTH)
    felt = disturbed(truth, EARTH, [CarriedMagnet(1, 15, (0.0, 0.0, 0.02), (0.0, 0.0, 1e-3))])
    added = felt.field_ut - truth.field_ut
    assert added[:, 1, 15] == pytest.approx(np.broadcast_to([0.0, 0.0, 25.0], added[:, 1, 15].shape))
    assert np.linalg.norm(added[:, 1, 25], axis=-1).max() < 0.05
    assert felt.specific_force_mps2 is truth.specific_force_mps2


def test_a_magnet_stays_where_it_is() -> None:
    truth = comb_truth(load_scene("wing"), 2, EARTH)
    vectors = np.array([0.1, 0.3, -0.2]), np.array([0.0, 0.4, 0.0])
    magnet = Magnet((0.1, 0.3, -0.2), (0.0, 0.4, 0.0))
    felt = disturbed(truth, EARTH, [magnet])
    world_ut = np.einsum("...ij,...j->...i", truth.r_world_node, felt.field_ut - truth.field_ut)
    away_m = np.linalg.norm(truth.position_m - magnet.position_m, axis=-1)
    strength = np.linalg.norm(world_ut, axis=-1) * away_m**3 / 0.04  # 1 beside it, 2 along its axis
    assert strength.min() > 0.99
    assert strength.max() < 2.01
    assert world_ut[0, 0, 0] == pytest.approx(dipole_ut(truth.position_m[0, 0, 0], *vectors), rel=1e-9)


@pytest.mark.parametrize(
    ("text", "meant"),
    [
        ("magnet:at=0.3,0.2,-0.1:moment=0,0,2", Magnet((0.3, 0.2, -0.1), (0.0, 0.0, 2.0))),
        ("magnet:at=1,2,3", Magnet((1.0, 2.0, 3.0))),
        ("beam:from=0,0,0:to=1,0,0:area=0.01", SteelBeam((0.0, 0.0, 0.0), (1.0, 0.0, 0.0), 0.01)),
        ("carried:ribbon=1:slot=9", CarriedMagnet(1, 9)),
    ],
)
def test_disturbances_can_be_written(text: str, meant: object) -> None:
    assert parse_disturbance(text) == meant
    spec = CombSpec(disturb=text, part_errors=4, warming_c=12.5)
    assert parse_url(spec.url(0)).comb == spec
    assert spec.disturbances() == (meant,)


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("moon:at=1,2,3", "no disturbance"),
        ("magnet:moment=0,0,1", "lacks at"),
        ("magnet:at=1,2", "three numbers"),
        ("magnet:at=1,2,nan", "three numbers"),
        ("magnet:at=1,2,3:colour=red", "not 'colour'"),
        ("carried:ribbon=1.5:slot=2", "a whole number"),
        ("beam:from=0,0,0:to=0,0,0", "the same point"),
        ("beam:from=0,0,0:to=1,0,0:area=0", "more than 0"),
    ],
)
def test_what_is_no_disturbance_is_told(text: str, says: str) -> None:
    with pytest.raises(UsageError, match=says):
        parse_disturbance(text)


def test_nothing_is_carried_where_there_is_no_slot() -> None:
    with pytest.raises(UsageError, match="not by ribbon 4"):
        EmulatedComb("wing", 2, disturb="carried:ribbon=4:slot=1")
    with EmulatedComb("wing", 2) as comb, pytest.raises(UsageError, match="at slot 32"):
        comb.disturb([CarriedMagnet(1, 32)])
