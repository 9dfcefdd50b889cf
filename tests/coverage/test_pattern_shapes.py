"""Patterns over fields of any shape: covered whole, part by part, with turns off ground not yet worked."""

import math
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, reject, settings
from hypothesis import strategies as st

from lgprjax.coverage import field_of_polygon, plan_pattern
from lgprjax.coverage.swaths import Order
from lgprjax.errors import InputError
from pattern_checks import BOX, FLAIL, check_ground, check_turns, missing_share

LEGS = np.array(
    [[0.0, 0.0], [30.0, 0.0], [30.0, 24.0], [18.0, 24.0], [18.0, 10.0], [12.0, 10.0], [12.0, 24.0], [0.0, 24.0]]
)


@pytest.mark.parametrize("order", ["zamboni", "boustrophedon"])
@pytest.mark.parametrize("lean_m", [-10.0, 48.0])
def test_turns_at_slanting_sides_stay_off_ground_not_yet_worked(order: Order, lean_m: float) -> None:
    corners = BOX * [30.0, 16.0] + np.array([[0.0, 0.0], [0.0, 0.0], [lean_m, 0.0], [lean_m, 0.0]])
    chosen = replace(FLAIL, order=order, turning_room_m=14.0 + abs(lean_m))
    pattern = plan_pattern(field_of_polygon(corners, name="lean"), chosen, name="lean")
    check_turns(pattern)
    assert missing_share(pattern, 0.1) == 0.0
    check_ground(pattern)


@pytest.mark.parametrize("order", ["zamboni", "boustrophedon"])
def test_a_concave_field_is_driven_part_by_part(order: Order) -> None:
    chosen = replace(FLAIL, order=order, smallest_radius_m=0.8, turning_room_m=6.0)
    pattern = plan_pattern(field_of_polygon(LEGS, name="legs"), chosen, name="legs")
    check_turns(pattern)
    check_ground(pattern)
    assert missing_share(pattern) == 0.0
    assert len({line.number for line in pattern.lines}) < len(pattern.lines)


def test_turns_go_round_a_nose_of_the_field() -> None:
    nose = np.array([[30.0, 4.0], [40.0, 4.0], [40.0, 12.0], [30.0, 12.0]])
    corners = np.concatenate([[[0.0, 0.0], [30.0, 0.0]], nose, [[30.0, 20.0], [0.0, 20.0]]])
    chosen = replace(FLAIL, turning_room_m=30.0)
    pattern = plan_pattern(field_of_polygon(corners, name="nose"), chosen, name="nose")
    check_turns(pattern)
    check_ground(pattern)


@settings(deadline=None, max_examples=8)
@given(seed=st.integers(0, 2**31), ahead_m=st.floats(-1.5, 1.5), heading_rad=st.floats(-3.0, 3.0))
def test_fields_of_any_shape_are_covered_whole_by_boustrophedon_or_refused(
    seed: int, ahead_m: float, heading_rad: float
) -> None:
    rng = np.random.default_rng(seed)
    yaw = np.linspace(0.0, 2.0 * np.pi, 9, endpoint=False) + rng.uniform(0.0, 0.4, 9)
    corners = rng.uniform(6.0, 22.0, 9)[:, None] * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
    chosen = replace(
        FLAIL,
        order="boustrophedon",
        smallest_radius_m=0.8,
        turning_room_m=15.0,
        tool_ahead_m=ahead_m,
        heading_rad=heading_rad,
    )
    try:
        pattern = plan_pattern(field_of_polygon(corners, name="star"), chosen, name="star")
    except InputError:
        reject()  # too many of them would fail the test
    check_turns(pattern)
    check_ground(pattern)
    assert missing_share(pattern, 0.2) == 0.0


def test_a_triangle_and_a_heading_of_ones_own() -> None:
    corners = np.array([[0.0, 0.0], [25.0, 0.0], [5.0, 20.0]])
    chosen = replace(FLAIL, order="boustrophedon", smallest_radius_m=0.6, heading_rad=0.4, turning_room_m=12.0)
    pattern = plan_pattern(field_of_polygon(corners, name="triangle"), chosen, name="triangle")
    check_turns(pattern)
    assert missing_share(pattern, 0.07) == 0.0
    way = pattern.lines[0].end_m - pattern.lines[0].start_m
    assert math.isclose(math.atan2(way[1], way[0]), 0.4)
