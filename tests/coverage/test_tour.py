"""Plans within declared ground: nothing of the vehicle is outside, and what can be reached is worked."""

import math
import os

import numpy as np
import pytest
import shapely
from jaxtyping import Float

from lgprjax.coverage import (
    Outline,
    Pattern,
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
from lgprjax.coverage.ground import breaches, buffered, pose_on_line, safe_ground
from lgprjax.coverage.joints import _words
from lgprjax.coverage.lattice import _primitives
from lgprjax.coverage.pattern import driving_time_s, plan_pattern
from lgprjax.coverage.swaths import line_order
from lgprjax.coverage.tour import Tour, plan_tour
from lgprjax.coverage.turns import Pose, dubins_ways, poses_along
from lgprjax.errors import InputError

from .random_fields import DrawnField, bound_by_motion, draw_field, reachable, worked_share

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


def corners_driven(pattern: Pattern, outline: Outline) -> Float[np.ndarray, "place 2"]:
    """Corners of the vehicle at every row of the route that is driven on board, by plain trigonometry."""
    route = lay_pattern(pattern)
    rows = np.asarray(route.rows, np.float64)[: int(route.count)]
    gears = np.ones(len(rows)) if route.legs is None else np.asarray(route.legs)[: len(rows), 0]
    yaw = rows[:, 2] + np.where(gears < 0.0, np.pi, 0.0)
    ahead, left = np.stack([np.cos(yaw), np.sin(yaw)], axis=1), np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
    ends = [(x, y) for x in (outline.front_m, outline.rear_m) for y in (outline.left_m, outline.right_m)]
    return np.concatenate([rows[:, :2] + x * ahead + y * left for x, y in ends])


def test_nothing_is_outside_of_two_sides_without_room() -> None:
    tour, ground = planned(BOX, [0.0, 0.0, 6.0, 6.0])
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
    # A body that is longer than the one planned for no longer fits, and the message names the place.
    with pytest.raises(InputError, match=r"turn from line|line \d+: expected vehicle and tool 0\.25 m within"):
        check_drivable(tour.pattern, ground, OUTLINE._replace(rear_m=-1.6), name="field")


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


def made(field_m: shapely.Geometry, ground_m: shapely.Geometry, radius_m: float, outline: Outline) -> DrawnField:
    """A field and its ground made by hand, for a tool of 1.2 m whose front is 5 cm behind the vehicle's."""
    corners = np.asarray(field_m.exterior.coords)[:-1]
    tool = Tool(1.2, 0.3, outline.front_m - 0.2, 0.0)
    settings = PatternSettings(1.2, 0.2, "free", radius_m, 6.0, tool.ahead_m)
    field = field_of_polygon(corners, name="made")
    shift = corners[0] - field.perimeter_m[0]
    assert np.abs(shift).max() < 1e-6
    return DrawnField(field, (), [], safe_ground(ground_m, 0.25), settings, tool, outline)


def test_the_bound_of_free_ground_is_all_of_it() -> None:
    field = shapely.box(0.0, 0.0, 12.0, 8.0)
    bound = bound_by_motion(made(field, field.buffer(6.0, join_style="mitre"), 1.5, OUTLINE))
    assert (bound.reached == bound.target).all()
    assert bound.reached_m2 == pytest.approx(96.0, rel=0.01)


def test_the_bound_of_a_dead_end_ends_where_the_vehicle_does() -> None:
    field = shapely.box(0.0, 0.0, 20.0, 2.4)
    bound = bound_by_motion(made(field, shapely.box(-8.0, 0.0, 20.0, 2.4), 1.5, OUTLINE))
    # 0.25 m are kept to every wall, and the vehicle reaches 0.05 m beyond its tool to the front and to both sides.
    assert bound.reached_m2 == pytest.approx(19.7 * 1.8, rel=0.03)
    places = bound.places()
    assert 19.6 < places[:, 0].max() < 19.8


def test_the_bound_asks_for_room_to_turn_in_by_arcs() -> None:
    """Round a corner by a chamber in which the vehicle could turn on the spot, with 6 cm to spare."""
    outline = Outline(1.0, -1.0, 0.65, -0.65)
    chamber = shapely.Point(0.0, 0.0).buffer(math.hypot(1.0, 0.65) + 0.25 + 0.06, quad_segs=64)
    way, pocket = shapely.box(-12.0, -0.95, 0.0, 0.95), shapely.box(-0.95, 0.0, 0.95, 6.0)
    ground = shapely.union_all([chamber, way, pocket])
    field = shapely.box(-6.0, -2.0, 2.0, 7.0)
    turned = {}
    for radius_m in (5.0, 0.1):
        drawn = made(field, ground, radius_m, outline)
        turned[radius_m] = float(bound_by_motion(drawn).places()[:, 1].max())
    assert turned[0.1] > 5.5
    assert turned[5.0] < 2.0
    _, reached, _ = reachable(drawn)
    # The coarse raster turns on the spot.
    assert np.count_nonzero(reached.any(axis=1)) * 0.1 > 6.0


@pytest.mark.parametrize(("seed", "least"), [(9, 0.98), (11, 0.98), (1008, 0.97)])
def test_a_drawn_field_is_planned_and_what_can_be_reached_is_worked(seed: int, least: float) -> None:
    """The last has three sides of four closed: no single word leads on from where most of its swaths end."""
    drawn = draw_field(seed)
    share = bound_by_motion(drawn).share(drawn, check_drawn(drawn, seed))
    assert share > least


def check_drawn(drawn: DrawnField, seed: int) -> list[Float[np.ndarray, "2 2"]]:
    """Lines of the plan of a drawn field; nothing is outside the ground."""
    tour = plan_tour(
        drawn.field, drawn.ground, drawn.keep_outs_m, drawn.settings, drawn.tool, drawn.outline, name=f"seed {seed}"
    )
    check_drivable(tour.pattern, drawn.ground, drawn.outline, name=f"seed {seed}")
    assert shapely.contains_xy(drawn.ground.shape, *corners_driven(tour.pattern, drawn.outline).T).all()
    for turn, line in zip(tour.pattern.turns, tour.pattern.lines[1:], strict=True):
        end = poses_along(turn.start, turn.pieces, np.array([turn.length_m]))[0]
        begin = pose_on_line(line, drawn.settings.tool_ahead_m, drawn.settings.tool_left_m)
        assert np.hypot(*(end - begin)[:2]) < 1e-6
    return [np.stack([line.start_m, line.end_m]) for line in tour.pattern.lines]


def test_ground_of_sides_that_meet_in_a_line_is_joined() -> None:
    """What the overlay of this field's sides leaves beside areas are lines, which cannot be joined to a field."""
    drawn = draw_field(1416)
    assert drawn.ground.shape.area > drawn.field.area_m2


@pytest.mark.campaign
def test_a_thousand_drawn_fields() -> None:
    """None planned and then refused; how many are planned over how much of what can be reached is printed.

    By both bounds: that of how the vehicle moves, and the coarse raster that turns on the spot. What falls short of
    98 % by the first on cells of 5 cm is judged again on cells of 2 cm.
    """
    shares = []
    for seed in range(int(os.environ.get("FIELDS_FROM", "1000")), int(os.environ.get("FIELDS_TO", "2000"))):
        drawn = draw_field(seed)
        try:
            lines = check_drawn(drawn, seed)
        except InputError:
            lines = []
        bound = bound_by_motion(drawn)
        # A bound of nearly nothing admits no plan.
        if bound.reached_m2 > 10.0:
            share = bound.share(drawn, lines)
            if share < 0.98:
                share = bound_by_motion(drawn, 0.02).share(drawn, lines)
            shares.append((share, worked_share(drawn, lines)[0]))
            print(f"{seed}: {bound.reached_m2:.1f} m2, {shares[-1][0]:.4f} by motion, {shares[-1][1]:.4f} by raster")
    for name, told in zip(("motion", "raster"), np.array(shares).T, strict=True):
        print(
            f"by {name}: {len(told)} fields, {np.mean(told >= 0.98):.3f} with 98 %, {np.mean(told >= 0.95):.3f} with "
            f"95 %, median {np.median(told):.4f}, least {told.min():.3f}"
        )
    assert np.mean(np.array(shares)[:, 0] >= 0.95) > 0.95


def test_words_end_where_they_must_and_the_shortest_is_that_of_dubins() -> None:
    rng = np.random.default_rng(3)
    starts, ends = (
        np.concatenate([rng.uniform(-6, 6, (60, 2)), rng.uniform(-4, 4, (60, 1))], axis=1) for _ in range(2)
    )
    lengths, hands = _words(starts, ends, np.full(60, 1.5))
    for number in range(60):
        forward = [np.abs(word).sum() for word in lengths[number, :6] if np.isfinite(word).all()]
        known = dubins_ways(Pose(*starts[number]), Pose(*ends[number]), 1.5)[0]
        assert min(forward) == pytest.approx(np.abs(known[:, 0]).sum(), abs=1e-9)
        for word, bend in zip(lengths[number], hands / 1.5, strict=True):
            if np.isfinite(word).all():
                # A millimetre at a time, by the midpoint rule.
                x, y, yaw = starts[number]
                for length, curvature in zip(word, bend, strict=True):
                    count = max(int(abs(length) / 0.01), 1)
                    steps = yaw + (np.arange(count) + 0.5) * length / count * curvature
                    x, y = x + np.sum(np.cos(steps)) * length / count, y + np.sum(np.sin(steps)) * length / count
                    yaw += length * curvature
                assert math.hypot(x - ends[number, 0], y - ends[number, 1]) < 1e-3


def test_words_of_the_lattice_lead_from_node_to_node() -> None:
    step_m, angle = 0.7, 2.0 * math.pi / 16
    lengths, bends, moves = _primitives(step_m, 1.5)
    assert len(moves) >= 16 * 4
    for word, bend, (heading, across, up, turned) in zip(lengths, bends, moves.tolist(), strict=True):
        assert (word >= 0.0).all()
        assert np.abs(bend).max() <= 1.0 / 1.5 + 1e-9
        x, y, yaw = 0.0, 0.0, heading * angle
        for length, curvature in zip(word, bend, strict=True):
            count = max(int(length / 0.005), 1)
            steps = yaw + (np.arange(count) + 0.5) * length / count * curvature
            x, y = x + np.sum(np.cos(steps)) * length / count, y + np.sum(np.sin(steps)) * length / count
            yaw += length * curvature
        assert math.hypot(x - across * step_m, y - up * step_m) < 1e-3
        assert abs(math.remainder(yaw - (heading + turned) * angle, 2.0 * math.pi)) < 1e-6


def test_a_route_in_reverse_runs_along_its_way_backwards() -> None:
    tour, _ = planned(BOX, [0.0, 0.0, 6.0, 6.0])
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


def test_time_counts_bends_and_cusps() -> None:
    tour, _ = planned(BOX, [0.0, 0.0, 6.0, 6.0])
    time_s = driving_time_s(tour.pattern, 0.3)
    # At 0.3 m/s the yaw rate of 0.2 rad/s is that of 1.5 m: bends cost nothing, each cusp 1.5 s.
    assert time_s == pytest.approx(tour.pattern.length_m / 0.3 + 1.5 * tour.cusps, rel=1e-6)
    assert driving_time_s(tour.pattern, 0.6) > 0.5 * time_s
