"""Slices of the ground hold exactly what their window sees, about their own origin, in float32."""

from dataclasses import replace

import jax
import numpy as np
import pytest

from lgprjax.scene import Cover, Day, Ground, GroundConfig, Skin, Trench, ground_on, make_ground, slice_ground
from lgprjax.scene.ground import value_at
from lgprjax.scene.propagation import TRENCHES, count_stones, count_utilities

GROUND = make_ground(1, GroundConfig(length_m=30.0, utilities_per_100m=20.0, trees_per_100m=0.0))


def stones_within(ground: Ground, low: float, high: float) -> np.ndarray:
    along = ground.scatterers.place_m[:, 0]
    return ground.scatterers.place_m[(along >= low) & (along < high)]


def test_a_slice_holds_exactly_its_window_about_its_origin() -> None:
    piece = slice_ground(GROUND, 3.0, 5.0, stones=512, origin_m=(4.0, 1.0))
    inside = stones_within(GROUND, 3.0, 5.0)
    np.testing.assert_allclose(piece.stone_m[: len(inside)], inside - [4.0, 1.0, 0.0], atol=1e-6)
    assert not piece.stone_strength_m[len(inside) :].any()
    assert np.all(piece.stone_strength_m[: len(inside)] != 0)
    assert all(leaf.dtype == np.float32 for leaf in jax.tree.leaves(piece))
    assert count_stones(GROUND, np.array([3.0]), np.array([5.0])) == len(inside)


def test_a_slice_holds_the_pipes_that_reach_into_it() -> None:
    pipes = GROUND.utilities
    low, high = 10.0, 14.0
    t = np.linspace(-1.0, 1.0, 2001)
    points = pipes.centre_m[:, None, 0] + t * (pipes.half_length_m * pipes.direction[:, 0])[:, None]
    inside = np.any((points >= low) & (points <= high), axis=1)
    assert 1 < inside.sum() < len(inside)
    piece = slice_ground(GROUND, low, high, stones=1024, origin_m=(12.0, 0.0))
    np.testing.assert_allclose(piece.utilities.depth_m[: inside.sum()], pipes.depth_m[inside], rtol=1e-6)
    np.testing.assert_allclose(
        piece.utilities.centre_m[: inside.sum()], pipes.centre_m[inside] - [12.0, 0.0], atol=1e-4
    )
    assert not piece.utilities.reflectivity[inside.sum() :].any()
    assert count_utilities(GROUND, np.array([low]), np.array([high])) == inside.sum()


def test_each_stone_has_the_slowness_of_the_ground_above_it() -> None:
    day = Day(seed=5, moisture_rms=0.02, clutter_per_m2=0.0, skin=Skin(0.3, 0.05, 0.2, 0.0))
    that_day, conditions = ground_on(GROUND, day)
    inside = stones_within(that_day, 3.0, 5.0)
    piece = slice_ground(that_day, 3.0, 5.0, stones=512, conditions=conditions)
    for place, slowness in list(zip(inside, piece.stone_slowness, strict=False))[:40]:
        skin_m = float(value_at(conditions.skin_m, place[:2]))
        depth = np.linspace(0.0, place[2], 4001)
        mean = np.mean(1.0 + 0.2 * (depth < skin_m))
        mean += float(value_at(GROUND.moisture, place[:2]) + value_at(conditions.moisture, place[:2]))
        assert slowness == pytest.approx(mean, abs=2e-3)


def test_a_slice_carries_the_days_velocity_loss_and_snow() -> None:
    day = Day(velocity_factor=0.9, velocity_spread=0.0, attenuation_factor=2.0, cover=Cover(0.1, 0.0, index=1.4))
    that_day, conditions = ground_on(GROUND, day)
    piece = slice_ground(that_day, 3.0, 5.0, stones=1024, conditions=conditions)
    assert piece.velocity_m_per_ns == pytest.approx(0.09)
    assert piece.attenuation_per_m == pytest.approx(1.4)
    assert piece.cover[0] == pytest.approx(1.4)
    assert piece.cover_m.mean == pytest.approx(0.1)


def test_a_slice_holds_the_trenches_that_reach_into_it_however_long_they_are() -> None:
    trenches = (Trench((0.0, 29.0)), Trench((9.0, 10.0)), Trench((12.5, 13.0)), Trench((14.0, 15.0)))
    that_day, conditions = ground_on(GROUND, replace(Day(), trenches=trenches))
    piece = slice_ground(that_day, 10.5, 12.8, stones=2048, conditions=conditions, origin_m=(11.0, 0.0))
    np.testing.assert_allclose(piece.trenches[:, :2], [[-11.0, 18.0], [1.5, 2.0]], atol=1e-6)
    alone = slice_ground(that_day, 20.0, 22.0, stones=2048, conditions=conditions)
    assert np.sum(alone.trenches[:, 4] > 0) == 1
    with pytest.raises(ValueError, match=str(TRENCHES)):
        slice_ground(that_day, 9.5, 12.8, stones=2048, conditions=conditions)


def test_a_slice_too_small_for_what_it_must_hold_is_refused() -> None:
    with pytest.raises(ValueError, match="16"):
        slice_ground(GROUND, 3.0, 5.0, stones=16)
    with pytest.raises(ValueError, match=r"\b1$"):
        slice_ground(GROUND, 10.0, 14.0, stones=2048, utilities=1)
