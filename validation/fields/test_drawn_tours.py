"""A thousand drawn fields planned, and the bound that their plans are held against."""

import math
import os
from collections.abc import Callable

import numpy as np
import pytest
import shapely

from lgprjax.coverage import Outline, PatternSettings, Tool, field_of_polygon, outline_of
from lgprjax.coverage.ground import safe_ground
from lgprjax.errors import InputError
from validation.fields.drawn_tours import check_drawn
from validation.fields.random_fields import DrawnField, bound_by_motion, draw_field, reachable, worked_share

OUTLINE = outline_of(Tool(1.2, 0.3, 1.2, 0.0), Outline(1.4, -0.5, 0.65, -0.65), track_m=1.1)


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


def test_a_thousand_drawn_fields(record_property: Callable[[str, object], None]) -> None:
    """None planned and then refused; how many are planned over how much of what can be reached is recorded.

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
        record_property(
            f"by {name}",
            f"{len(told)} fields, {np.mean(told >= 0.98):.3f} with 98 %, {np.mean(told >= 0.95):.3f} with "
            f"95 %, median {np.median(told):.4f}, least {told.min():.3f}",
        )
    assert np.mean(np.array(shares)[:, 0] >= 0.95) > 0.95


def test_a_drawn_field_is_planned_and_what_can_be_reached_is_worked() -> None:
    """Three sides of four are closed: no single word leads on from where most swaths end."""
    drawn = draw_field(1008)
    assert bound_by_motion(drawn).share(drawn, check_drawn(drawn, 1008)) > 0.97
