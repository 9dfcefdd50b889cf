"""Weather and years against closed forms: what comes later, what is gone, what is new."""

from dataclasses import replace

import numpy as np
import pytest

from lgprjax.scene import (
    WEATHER,
    Cover,
    Day,
    Ground,
    GroundConfig,
    Skin,
    Trench,
    ground_on,
    make_ground,
    usual_conditions,
)
from lgprjax.scene.ground import value_at
from scene.bare_ground import INDEX, LIGHT_M_PER_NS, SPOTLESS, ground_of, one_layer, peak_of, pipes, render

ANTENNA = [(0.0, 0.0, 0.3)]
STONE = ground_of([(0.0, 0.0, 1.0)], [0.02])
PIPE = ground_of(utilities=pipes((0.0, 0.0, np.pi / 2, 1.1, 0.05, -1.0)))
LAYER = ground_of(layer=one_layer(1.2, -0.05))
STONY = make_ground(2, GroundConfig(length_m=30.0, trees_per_100m=0.0))


def heard_on(ground: Ground, day: Day) -> tuple[float, float]:
    that_day, conditions = ground_on(ground, day)
    return peak_of(render(that_day, ANTENNA, conditions=conditions)[0])


@pytest.mark.parametrize("ground", [STONE, PIPE, LAYER])
def test_snow_delays_and_dims_what_lies_below_it(ground: Ground) -> None:
    """2 w (n - 1) / c straight down, exp(-2 a w), while the wheels cut through to the road."""
    snow = Cover(0.12, 0.0, index=1.4, attenuation_per_m=0.5, lift=0.0)
    bare, covered = heard_on(ground, SPOTLESS), heard_on(ground, replace(SPOTLESS, cover=snow))
    assert covered[0] - bare[0] == pytest.approx(2 * 0.12 * 0.4 / LIGHT_M_PER_NS, abs=0.01)
    assert covered[1] / bare[1] == pytest.approx(np.exp(-2 * 0.5 * 0.12), rel=0.01)


def test_packed_snow_raises_the_antenna() -> None:
    snow = Cover(0.12, 0.0, index=1.0, attenuation_per_m=0.0, lift=0.4)
    bare, covered = heard_on(STONE, SPOTLESS), heard_on(STONE, replace(SPOTLESS, cover=snow))
    assert covered[0] - bare[0] == pytest.approx(2 * 0.4 * 0.12 / LIGHT_M_PER_NS, abs=0.01)
    below = 1.0 / INDEX
    assert covered[1] / bare[1] == pytest.approx(((0.3 + below) / (0.348 + below)) ** 2, rel=0.01)


@pytest.mark.parametrize(("ground", "slowness"), [(STONE, -0.1), (PIPE, 0.2)])
def test_a_skin_hurries_or_delays_by_its_own_thickness(ground: Ground, slowness: float) -> None:
    day = replace(SPOTLESS, skin=Skin(0.25, 0.0, slowness, 0.0))
    depth = 1.1 if ground is PIPE else 1.0
    way = 1.05 if ground is PIPE else 1.0  # to the wall; the skin's share is that of the way to the axis
    expected_ns = 2 * 0.25 * slowness / 0.1 * way / depth
    assert heard_on(ground, day)[0] - heard_on(ground, SPOTLESS)[0] == pytest.approx(expected_ns, abs=0.01)


def test_the_front_of_a_skin_is_an_interface_where_its_slowness_ends() -> None:
    nothing = ground_of()
    that_day, conditions = ground_on(nothing, replace(SPOTLESS, skin=Skin(0.25, 0.03, -0.1, -0.05)))
    assert that_day.layers.depth_m[-1] == 0.25
    place = np.random.default_rng(0).uniform(-5.0, 5.0, (200, 2))
    angle = place @ that_day.layers.wave_rad_per_m[-1].T + that_day.layers.relief_phase_rad[-1]
    front_m = 0.25 + np.sin(angle) @ that_day.layers.relief_m[-1]
    np.testing.assert_allclose(value_at(conditions.skin_m, place), front_m, atol=1e-12)
    assert 0.01 < front_m.std() < 0.04


def test_velocity_and_loss_of_a_day_act_on_the_way_in_the_ground() -> None:
    dry, wet = heard_on(LAYER, SPOTLESS), heard_on(LAYER, replace(SPOTLESS, velocity_factor=1 / 1.05))
    assert wet[0] - dry[0] == pytest.approx(0.05 * 2 * 1.2 / 0.1, abs=0.01)
    lossy = heard_on(LAYER, replace(SPOTLESS, attenuation_factor=2.0))
    assert lossy[1] / dry[1] == pytest.approx(np.exp(-2 * 0.7 * 1.2), rel=0.01)
    spread = [ground_on(LAYER, Day(seed=s, velocity_spread=0.01))[1].velocity_factor for s in range(200)]
    assert np.std(spread) == pytest.approx(0.01, rel=0.2)
    assert np.mean(spread) == pytest.approx(1.0, abs=0.003)


def test_a_trench_takes_what_lay_in_it_and_leaves_the_rest() -> None:
    stones = [(0.0, 0.0, 0.6), (0.2, 0.0, 1.6), (4.0, 0.0, 0.6)]
    day = replace(SPOTLESS, trenches=(Trench((-1.0, 1.0), (-2.0, 2.0), depth_m=1.2),))
    dug, conditions = ground_on(ground_of(stones, [0.02, 0.02, 0.02], layer=one_layer(0.9, 0.05)), day)
    np.testing.assert_array_equal(dug.scatterers.place_m, stones[1:])
    alone = ground_of(layer=one_layer(0.9, 0.05))
    over, beside, edge, across = np.abs(
        render(
            ground_on(alone, day)[0],
            [(0.0, 0.0, 0.3), (1.5, 0.0, 0.3), (1.0, 0.0, 0.3), (0.0, 2.3, 0.3)],
            conditions=conditions,
        )
    ).max(axis=1)
    assert over == 0
    assert edge == pytest.approx(0.5 * beside, rel=1e-3)
    assert across == pytest.approx(beside, rel=1e-3)
    deeper = ground_of(layer=one_layer(1.4, 0.05))
    kept = render(ground_on(deeper, day)[0], ANTENNA, conditions=conditions)
    np.testing.assert_array_equal(kept, render(deeper, ANTENNA, conditions=usual_conditions()))


@pytest.mark.parametrize("depth_m", [0.1, 1.2, 4.0])
def test_a_trench_is_filled_with_as_many_other_stones(depth_m: float) -> None:
    ground = make_ground(5, GroundConfig(length_m=200.0, trees_per_100m=0.0))
    place = ground.scatterers.place_m
    dug = ground_on(ground, replace(SPOTLESS, trenches=(Trench((20.0, 180.0), depth_m=depth_m),)))[0].scatterers.place_m
    before, after = (
        int(np.sum((at[:, 0] >= 20.0) & (at[:, 0] <= 180.0) & (at[:, 2] <= depth_m))) for at in (place, dug)
    )
    assert after == pytest.approx(before, rel=0.03)
    assert np.all(np.diff(dug[:, 0]) >= 0)
    fresh = dug[~np.isin(dug[:, 0], place[:, 0])]
    assert len(fresh) == after
    assert np.all((fresh[:, 0] >= 20.0) & (fresh[:, 0] <= 180.0) & (fresh[:, 2] >= 0.15))
    assert np.all(fresh[:, 2] <= min(depth_m, 2.5))


def test_years_move_their_share_of_the_shallow_stones() -> None:
    aged = ground_on(STONY, replace(SPOTLESS, moved_share=0.5, moved_depth_m=0.6))[0].scatterers
    assert len(aged.strength_m) == len(STONY.scatterers.strength_m)
    kept = np.isin(STONY.scatterers.place_m[:, 0], aged.place_m[:, 0])
    shallow = STONY.scatterers.place_m[:, 2] < 0.6
    assert kept[~shallow].all()
    assert kept[shallow].mean() == pytest.approx(0.5, abs=4 * 0.5 / np.sqrt(shallow.sum()))
    new = ~np.isin(aged.place_m[:, 0], STONY.scatterers.place_m[:, 0])
    assert aged.place_m[new, 2].max() < 0.6
    np.testing.assert_allclose(
        np.sort(np.abs(aged.strength_m[new])), np.sort(np.abs(STONY.scatterers.strength_m[~kept])), rtol=1e-12
    )


def test_a_day_adds_its_own_clutter_near_the_surface_only() -> None:
    bare = ground_on(STONY, SPOTLESS)[0]
    np.testing.assert_array_equal(bare.scatterers.place_m, STONY.scatterers.place_m)
    before = set(map(tuple, STONY.scatterers.place_m))
    days = []
    for seed in (1, 2):
        littered = ground_on(STONY, replace(SPOTLESS, seed=seed, clutter_per_m2=5.0))[0].scatterers.place_m
        added = {tuple(p) for p in littered} - before
        assert len(littered) == len(STONY.scatterers.place_m) + round(54.0 * 8.0 * 5.0)
        assert max(depth for _, _, depth in added) <= 0.5
        days.append(added)
    assert not days[0] & days[1]
    again = ground_on(STONY, replace(SPOTLESS, seed=2, clutter_per_m2=5.0))[0].scatterers.place_m
    np.testing.assert_array_equal(again, littered)


def test_moisture_of_a_day_is_its_own_and_as_large_as_asked() -> None:
    place = np.random.default_rng(0).uniform(-300.0, 300.0, (8000, 2))
    one, other = (value_at(ground_on(STONY, Day(seed=s, moisture_rms=0.01))[1].moisture, place) for s in (1, 2))
    assert one.std() == pytest.approx(0.01, rel=0.1)
    assert abs(np.corrcoef(one, other)[0, 1]) < 0.2


def test_every_day_by_name_can_be_had_and_has_its_seed() -> None:
    for name, day_of in WEATHER.items():
        day = day_of(7)
        assert day.seed == 7, name
        that_day, conditions = ground_on(STONY, day)
        assert that_day.scatterers.place_m[:, 2].min() > 0, name
        assert 0.9 < conditions.velocity_factor < 1.1, name
