"""Plans within declared ground: nothing of the vehicle is outside, and what can be reached is worked."""

import math
import re

import numpy as np
import pytest
import shapely
from jaxtyping import Float

from lgprjax.coverage import (
    Outline,
    PatternSettings,
    SafeGround,
    Tool,
    check_drivable,
    field_of_polygon,
    ground_of_plan,
    ground_of_sides,
    lay_pattern,
    outline_of,
)
from lgprjax.coverage.ground import breaches, buffered
from lgprjax.coverage.joints import _words
from lgprjax.coverage.lattice import _primitives
from lgprjax.coverage.pattern import driving_time_s, plan_pattern
from lgprjax.coverage.swaths import line_order
from lgprjax.coverage.tour import Tour, plan_tour
from lgprjax.coverage.turns import Pose, dubins_ways
from lgprjax.errors import InputError
from refusals import refusal_in
from validation.fields.drawn_tours import corners_driven
from validation.fields.random_fields import draw_field

TOOL = Tool(1.2, 0.3, 1.2, 0.0)
OUTLINE = outline_of(TOOL, Outline(1.4, -0.5, 0.65, -0.65), track_m=1.1)
FLAIL = PatternSettings(1.2, 0.2, "free", 1.5, 6.0, 1.2)
BOX = np.array([[0.0, 0.0], [30.0, 0.0], [30.0, 20.0], [0.0, 20.0]])


def planned(
    corners: Float[np.ndarray, "corner 2"], rooms: list[float], *keep_outs: np.ndarray
) -> tuple[Tour, SafeGround]:
    field = field_of_polygon(corners, name="field")
    ground = ground_of_sides(field.perimeter_m, rooms, keep_outs, 0.25)
    return plan_tour(field, ground, keep_outs, FLAIL, TOOL, OUTLINE, name="field"), ground


@pytest.fixture(scope="module")
def two_shut() -> tuple[Tour, SafeGround]:
    return planned(BOX, [0.0, 0.0, 6.0, 6.0])


def walked(start: Float[np.ndarray, "3"], lengths: np.ndarray, bends: np.ndarray) -> np.ndarray:
    """Where arcs lead, by the midpoint rule, a centimetre at a time."""
    x, y, yaw = start
    for length, curvature in zip(lengths, bends, strict=True):
        count = max(int(abs(length) / 0.01), 1)
        steps = yaw + (np.arange(count) + 0.5) * length / count * curvature
        x, y = x + np.sum(np.cos(steps)) * length / count, y + np.sum(np.sin(steps)) * length / count
        yaw += length * curvature
    return np.array([x, y, yaw])


def test_nothing_is_outside_of_two_sides_without_room(two_shut: tuple[Tour, SafeGround]) -> None:
    tour, ground = two_shut
    assert breaches(tour.pattern, ground, OUTLINE) == []
    east, north = corners_driven(tour.pattern, OUTLINE).T
    # Along the first side and the second one the clearance is kept, less what a row of the route is off.
    assert north.min() > 0.25 - 0.06
    assert east.max() < 30.0 - 0.25 + 0.06
    assert tour.pattern.unreached == ()
    assert tour.worked_m2 > 0.96 * 600.0
    assert tour.cusps >= 10


def test_keep_outs_are_kept_out_of() -> None:
    ring = buffered(np.array([[10.0, 8.0], [13.0, 8.0], [13.0, 11.0], [10.0, 11.0]]), 0.5)
    tour, ground = planned(BOX, [6.0] * 4, ring)
    check_drivable(tour.pattern, ground, OUTLINE, name="field")
    places = shapely.points(corners_driven(tour.pattern, OUTLINE))
    assert shapely.distance(shapely.Polygon(ring), places).min() > 0.25 - 0.06
    assert tour.worked_m2 > 0.97 * tour.target_m2
    # A body that is longer than the one planned for no longer fits, and the refusal names the place.
    with pytest.raises(InputError) as caught:
        check_drivable(tour.pattern, ground, OUTLINE._replace(rear_m=-1.6), name="field")
    refused = refusal_in(caught.value)
    refused.check(None, "0.25 m", file="field")
    assert re.search(r"line \d+$", refused.place)


def test_a_u_is_driven_within_the_ground_that_its_plan_declares() -> None:
    """What made the fence's sides cross: the notch is narrower than the room."""
    corners = np.array([[0, 0], [30, 0], [30, 20], [18, 20], [18, 8], [12, 8], [12, 20], [0, 20]], float)
    field = field_of_polygon(corners, name="u")
    pattern = plan_pattern(
        field, PatternSettings(1.2, 0.2, "boustrophedon", 1.5, 12.0, 1.2, heading_rad=0.5 * math.pi), name="u"
    )
    ground = ground_of_plan(pattern, None, OUTLINE, spare_m=0.8)
    check_drivable(pattern, ground, OUTLINE, name="u")
    shape = ground.shape
    assert shapely.contains_xy(shape, *corners_driven(pattern, OUTLINE).T).all()


def test_ground_of_sides_that_meet_in_a_line_is_joined() -> None:
    """What the overlay of this field's sides leaves beside areas are lines, which cannot be joined to a field."""
    drawn = draw_field(1416)
    assert drawn.ground.shape.area > drawn.field.area_m2


def test_words_end_where_they_must_and_the_shortest_is_that_of_dubins() -> None:
    rng = np.random.default_rng(3)
    starts, ends = (
        np.concatenate([rng.uniform(-6, 6, (30, 2)), rng.uniform(-4, 4, (30, 1))], axis=1) for _ in range(2)
    )
    lengths, hands = _words(starts, ends, np.full(30, 1.5))
    for number in range(30):
        forward = [np.abs(word).sum() for word in lengths[number, :6] if np.isfinite(word).all()]
        known = dubins_ways(Pose(*starts[number]), Pose(*ends[number]), 1.5)[0]
        assert min(forward) == pytest.approx(np.abs(known[:, 0]).sum(), abs=1e-9)
        for word, bend in zip(lengths[number], hands / 1.5, strict=True):
            if np.isfinite(word).all():
                away = walked(starts[number], word, bend) - ends[number]
                assert math.hypot(*away[:2]) < 1e-3
                assert abs(math.remainder(away[2], 2.0 * math.pi)) < 1e-6


def test_words_of_the_lattice_lead_from_node_to_node() -> None:
    step_m, angle = 0.7, 2.0 * math.pi / 16
    lengths, bends, moves = _primitives(step_m, 1.5)
    assert len(moves) >= 16 * 4
    for word, bend, (heading, across, up, turned) in zip(lengths, bends, moves.tolist(), strict=True):
        assert (word >= 0.0).all()
        assert np.abs(bend).max() <= 1.0 / 1.5 + 1e-9
        x, y, yaw = walked(np.array([0.0, 0.0, heading * angle]), word, bend)
        assert math.hypot(x - across * step_m, y - up * step_m) < 1e-3
        assert abs(math.remainder(yaw - (heading + turned) * angle, 2.0 * math.pi)) < 1e-6


def test_a_route_in_reverse_runs_along_its_way_backwards(two_shut: tuple[Tour, SafeGround]) -> None:
    tour, _ = two_shut
    route = lay_pattern(tour.pattern)
    assert route.legs is not None
    count = int(route.count)
    rows, legs = np.asarray(route.rows, np.float64)[:count], np.asarray(route.legs, np.float64)[:count]
    same = legs[1:, 1] == legs[:-1, 1]
    along = np.diff(rows[:, :2], axis=0)
    ahead = np.stack([np.cos(rows[:-1, 2]), np.sin(rows[:-1, 2])], axis=1)
    # Within a leg every step leads on along the row's yaw, forwards or in reverse.
    assert ((along * ahead).sum(axis=1)[same] > 0.9 * float(route.spacing_m)).all()
    assert np.hypot(*along.T).max() < 1.01 * float(route.spacing_m)
    # The tool works in no row that is driven in reverse.
    assert not (rows[:, 4] > 0.5)[legs[:, 0] < 0.0].any()
    assert np.count_nonzero(np.diff(legs[:, 0])) == tour.cusps


def test_the_racetrack_takes_every_line_once_and_turns_no_wider_than_needed() -> None:
    for count in (1, 2, 7, 21, 104):
        order = line_order(count, "racetrack", 4)
        assert sorted(order) == list(range(count))
    steps = np.abs(np.diff(line_order(104, "racetrack", 4)))
    assert steps.max() <= 8
    assert np.median(steps) >= 3


def test_time_counts_bends_and_cusps(two_shut: tuple[Tour, SafeGround]) -> None:
    tour, _ = two_shut
    time_s = driving_time_s(tour.pattern, 0.3)
    # At 0.3 m/s the yaw rate of 0.2 rad/s is that of 1.5 m: bends cost nothing, each cusp 1.5 s.
    assert time_s == pytest.approx(tour.pattern.length_m / 0.3 + 1.5 * tour.cusps, rel=1e-6)
    assert driving_time_s(tour.pattern, 0.6) > 0.5 * time_s
