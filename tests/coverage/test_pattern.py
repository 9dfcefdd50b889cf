"""Patterns over rectangles: lengths in closed form, no strip missing, refusals that tell what would do."""

import math
from dataclasses import replace
from typing import Any, cast

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.coverage import plan_pattern
from pattern_checks import FLAIL, box, check_turns, missing_share
from refusals import refused


@settings(deadline=None, max_examples=12)
@given(
    along_m=st.floats(5.0, 60.0),
    across_m=st.floats(12.0, 40.0),
    overlap=st.floats(0.0, 0.5),
    yaw=st.floats(-math.pi, math.pi),
    ahead_m=st.floats(-2.0, 2.0),
)
def test_zamboni_over_rectangles_is_as_long_as_its_closed_form(
    along_m: float, across_m: float, overlap: float, yaw: float, ahead_m: float
) -> None:
    chosen = replace(FLAIL, overlap=overlap, tool_ahead_m=ahead_m, turning_room_m=40.0)
    pattern = plan_pattern(box(along_m, across_m, yaw), chosen, name="box")
    count = math.ceil((across_m - 1.2 - 1e-6) / ((1.0 - overlap) * 1.2)) + 1
    assert len(pattern.lines) == count
    spacing_m = (across_m - 1.2) / (count - 1)
    half = (count + 1) // 2
    steps = [half if number % 2 == 0 else half - 1 for number in range(count - 1)]
    # Semicircles between lines, and the tool's way out and in.
    turns_m = sum(0.5 * math.pi * step * spacing_m + 2.0 * abs(ahead_m) for step in steps)
    np.testing.assert_allclose(pattern.line_length_m, count * along_m, rtol=1e-9)
    np.testing.assert_allclose(pattern.length_m, count * along_m + turns_m, rtol=1e-9)
    np.testing.assert_allclose(pattern.spacing_m, spacing_m, rtol=1e-9)
    np.testing.assert_allclose(pattern.tightest_radius_m, 0.5 * min(steps) * spacing_m, rtol=1e-9)
    assert all(np.all(turn.pieces[:, 1] >= 0.0) for turn in pattern.turns)
    assert [line.number for line in pattern.lines[:3]] == [1, half + 1, 2]
    check_turns(pattern)
    assert missing_share(pattern, 0.35) == 0.0


@settings(deadline=None, max_examples=12)
@given(
    along_m=st.floats(5.0, 60.0), across_m=st.floats(2.0, 20.0), radius_m=st.floats(0.3, 3.0), yaw=st.floats(-3.0, 3.0)
)
def test_boustrophedon_over_rectangles_turns_in_semicircles_or_bulbs(
    along_m: float, across_m: float, radius_m: float, yaw: float
) -> None:
    chosen = replace(FLAIL, order="boustrophedon", smallest_radius_m=radius_m, turning_room_m=20.0)
    pattern = plan_pattern(box(along_m, across_m, yaw), chosen, name="box")
    check_turns(pattern)
    assert [line.number for line in pattern.lines] == list(range(1, len(pattern.lines) + 1))
    for turn in pattern.turns:
        if pattern.spacing_m >= 2.0 * radius_m:
            turn_m = 0.5 * math.pi * pattern.spacing_m + 2.0 * FLAIL.tool_ahead_m
            assert math.isclose(turn.length_m, turn_m, rel_tol=1e-9)
            assert math.isclose(turn.tightest_radius_m, 0.5 * pattern.spacing_m, rel_tol=1e-9)
        else:
            lean = math.acos((2.0 * radius_m + pattern.spacing_m) / (4.0 * radius_m))
            # Lead-out of the tool's distance; the way in begins where the tool is at the edge: a little off a bulb.
            bulb_m = radius_m * (math.pi + 4.0 * lean)
            assert bulb_m < turn.length_m < bulb_m + 2.0 * FLAIL.tool_ahead_m + 1e-6
            assert math.isclose(turn.tightest_radius_m, radius_m, rel_tol=1e-9)
    assert missing_share(pattern, 0.35) == 0.0


def test_no_strip_is_missing_on_a_fine_raster() -> None:
    assert missing_share(plan_pattern(box(30.0, 20.0, 0.3), FLAIL, name="box"), 0.03) == 0.0


def test_the_room_decides_between_a_semicircle_quarters_and_a_refusal_that_tells_what_would_do() -> None:
    field = box(30.0, 20.0)
    wide = plan_pattern(field, replace(FLAIL, turning_room_m=20.0), name="box")
    tight = plan_pattern(field, replace(FLAIL, turning_room_m=3.0), name="box")
    # With radius r the way goes a tool's distance and r beyond the perimeter.
    assert wide.tightest_radius_m > 4.0
    assert 1.5 <= tight.tightest_radius_m <= 2.0
    check_turns(tight)
    with refused("turn from line 1 to line 11", "2.50 m", file="box", found="2.40 m"):
        plan_pattern(field, replace(FLAIL, turning_room_m=2.4), name="box")
    enough = plan_pattern(field, replace(FLAIL, turning_room_m=2.5), name="box")
    assert math.isclose(enough.tightest_radius_m, 1.5)


def test_lines_too_close_for_one_handed_turns_are_refused_and_as_many_as_told_do() -> None:
    with refused("zamboni", 7, "1.02 m", "1.5 m", "boustrophedon", file="box"):
        plan_pattern(box(30.0, 4.8 * 1.0 + 0.5), FLAIL, name="box")
    check_turns(plan_pattern(box(30.0, 6 * 1.02 + 1.2), FLAIL, name="box"))


def test_a_tool_beside_the_vehicle_is_counted() -> None:
    for left_m, chosen, across_m in ((0.3, FLAIL, 20.0), (-0.3, replace(FLAIL, order="boustrophedon"), 9.0)):
        beside = replace(chosen, tool_left_m=left_m)
        pattern = plan_pattern(box(20.0, across_m, 1.0), beside, name="box")
        check_turns(pattern)
        assert missing_share(pattern, 0.2) == 0.0


def test_one_line_needs_no_turn() -> None:
    pattern = plan_pattern(box(30.0, 1.2), FLAIL, name="box")
    assert (len(pattern.lines), pattern.turns, pattern.spacing_m) == (1, (), 0.0)
    assert pattern.tightest_radius_m == math.inf
    assert math.isclose(pattern.length_m, 30.0)


def test_what_cannot_be_driven_is_refused_with_the_reason() -> None:
    with refused("field", "1.20 m", file="box", found="0.80 m"):
        plan_pattern(box(30.0, 0.8), FLAIL, name="box")
    with refused("first and last line", "1.00 m", file="box", found="0.50 m"):
        plan_pattern(box(30.0, 1.2), replace(FLAIL, turning_room_m=0.5), name="box")
    with refused("pattern", "30 km", file="big"):
        plan_pattern(box(900.0, 800.0), replace(FLAIL, turning_room_m=300.0), name="big")


def test_settings_out_of_their_range_are_refused() -> None:
    for name, value in {
        "tool_width_m": 0.0, "overlap": 1.0, "smallest_radius_m": 0.0, "turning_room_m": -1.0,
        "tool_ahead_m": math.nan, "heading_rad": math.inf,
    }.items():  # fmt: skip
        with refused(name, file="pattern", found=f"{value:g}"):
            replace(FLAIL, **cast(Any, {name: value}))
    with refused("overlap", found=-0.1):
        replace(FLAIL, overlap=-0.1)
    with refused("order", "zamboni", "boustrophedon", file="pattern", found="spiral"):
        replace(FLAIL, order=cast(Any, "spiral"))
