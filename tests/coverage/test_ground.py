"""Declared ground: in front of no side is any place safe that lies deeper than the side declares."""

import numpy as np
import shapely
from jaxtyping import Float

from lgprjax.coverage import ground_of_sides
from lgprjax.coverage.field import signed_area_m2
from validation.fields.random_fields import draw_field

_GRID_M = 1e-4
"""What overlays of sides round away, with room to spare."""

CHAMFERED = np.array([[0, 0], [60, 0], [60, 39], [59, 40], [0, 40]], float)
U = np.array([[0, 0], [30, 0], [30, 20], [18, 20], [18, 8], [12, 8], [12, 20], [0, 20]], float)
BOX = np.array([[0, 0], [20, 0], [20, 3], [0, 3]], float)


def check_rooms(perimeter_m: Float[np.ndarray, "_ 2"], rooms_m: list[float]) -> None:
    """No place in front of a side and beyond its room is safe, as deep as any side has room."""
    ground = ground_of_sides(perimeter_m, rooms_m, (), 0.25).shape
    field = shapely.Polygon(perimeter_m).buffer(_GRID_M)
    deepest_m = max(rooms_m)
    for start, end, room_m in zip(perimeter_m, np.roll(perimeter_m, -1, axis=0), rooms_m, strict=True):
        side = end - start
        out = np.array([side[1], -side[0]]) / np.hypot(*side)
        shares, depths_m = np.linspace(0.02, 0.98, 15), np.linspace(0.0, deepest_m, 60)[1:-1]
        share, depth_m = (each.ravel() for each in np.meshgrid(shares, depths_m))
        beyond = depth_m > room_m + _GRID_M
        east, north = (start + share[:, None] * side + depth_m[:, None] * out).T
        safe = shapely.contains_xy(ground, east, north) & ~shapely.contains_xy(field, east, north)
        assert not (safe & beyond).any()


def test_no_other_side_makes_ground_before_a_side_deeper() -> None:
    # Arcs about the far corners reach over the narrow field.
    check_rooms(BOX, [7.0, 7.0, 1.0, 7.0])
    check_rooms(BOX, [1.0, 7.0, 7.0, 7.0])
    # A short slanting side with room: the arc at its far corner reaches before the east side.
    check_rooms(CHAMFERED, [7.0, 1.0, 7.0, 7.0, 7.0])
    # Room of the notch's inner side reaches through the arm and out on its other side.
    check_rooms(U, [5.0, 1.0, 5.0, 10.0, 5.0, 10.0, 5.0, 1.0])


def test_drawn_sides_keep_to_their_rooms() -> None:
    """A notched, a star-shaped and a smooth field."""
    for seed in (0, 2, 5):
        perimeter_m = draw_field(seed).field.perimeter_m
        assert signed_area_m2(perimeter_m) > 0.0
        rng = np.random.default_rng(seed)
        rooms = rng.choice([0.0, 0.5, 1.0, 2.5, 4.0, 8.0], len(perimeter_m)).tolist()
        check_rooms(perimeter_m, [*rooms[:-1], 3.0])


def test_rooms_that_are_the_same_lie_around_the_whole_field() -> None:
    """Convex, without keep-outs: each side's strip, and an arc about each corner."""
    shape = ground_of_sides(CHAMFERED, [3.0] * 5, (), 0.25).shape
    around = shapely.Polygon(CHAMFERED).buffer(3.0, quad_segs=16)
    assert shapely.symmetric_difference(shape, around).area < 1.0
