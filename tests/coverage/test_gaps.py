"""Plans for gaps: every cell left out lies in a line's tool, lines end there, no way crosses what is not worked."""

from typing import NamedTuple

import numpy as np
import pytest
import shapely
from scipy import ndimage

from lgprjax.coverage import (
    CellGrid,
    Field,
    Line,
    PatternSettings,
    Tool,
    check_drivable,
    field_of_polygon,
    grid_of_field,
    ground_of_sides,
    inside_cells,
    lay_pattern,
    outline_of,
    plan_gaps,
)
from lgprjax.coverage.gaps import GapPlan, _either_way, wide_parts
from lgprjax.coverage.layer import TourSwath
from lgprjax.errors import InputError

from .drawn_gaps import KINDS

FLAIL = PatternSettings(
    tool_width_m=1.2, overlap=0.2, order="free", smallest_radius_m=1.5, turning_room_m=5.5, tool_ahead_m=1.2
)
TOOL = Tool(1.2, 0.3, 1.2, 0.0)
OUTLINE = outline_of(TOOL, track_m=1.1)
CELL_M = 0.1
SPACING_M = 0.96


class Sample(NamedTuple):
    field: Field
    grid: CellGrid
    east_m: np.ndarray
    north_m: np.ndarray
    inside: np.ndarray


def sample(length_m: float = 30.0, width_m: float = 20.0, yaw_rad: float = 0.0, cell_m: float = CELL_M) -> Sample:
    """A rectangle, turned, with places of its cells along and across its sides."""
    cos, sin = np.cos(yaw_rad), np.sin(yaw_rad)
    corners = np.array([[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m]])
    field = field_of_polygon(corners @ np.array([[cos, sin], [-sin, cos]]), name="field")
    grid = grid_of_field(field, cell_m, 1.0)
    north, east = np.mgrid[: grid.north_cells, : grid.east_cells] + 0.5
    east, north = grid.east_m + east * cell_m, grid.north_m + north * cell_m
    return Sample(field, grid, cos * east + sin * north, cos * north - sin * east, inside_cells(field, grid))


def plan(held: Sample, left: np.ndarray, *, least_width_m: float = 0.0, room_m: float = 5.5) -> GapPlan | None:
    ground = ground_of_sides(held.field.perimeter_m, [room_m] * 4, (), 0.25)
    made = plan_gaps(
        held.field, ~left, held.grid, ground, FLAIL, TOOL, OUTLINE, least_width_m=least_width_m, name="run"
    )
    if made is not None:
        check_drivable(made.pattern, ground, OUTLINE, name="run")
    return made


def under_tool(lines: tuple[Line, ...], held: Sample) -> np.ndarray:
    """Cells in a line's tool, by their centres."""
    grid = held.grid
    north, east = np.mgrid[: grid.north_cells, : grid.east_cells] + 0.5
    places = np.stack([grid.east_m + east * grid.cell_m, grid.north_m + north * grid.cell_m], axis=-1)
    under = np.zeros(grid.shape, bool)
    for line in lines:
        way = (line.end_m - line.start_m) / line.length_m
        along, aside = (places - line.start_m) @ way, (places - line.start_m) @ np.array([-way[1], way[0]])
        reach_m = 0.5 * TOOL.length_m + 1e-6
        under |= (along > -reach_m) & (along < line.length_m + reach_m) & (np.abs(aside) < 0.5 * TOOL.width_m)
    return under


def crossed(made: GapPlan, held: Sample, left: np.ndarray) -> float:
    """Length of turns, of the reference point, over cells not worked by then, but in the swath that comes next."""
    grid, rest = held.grid, left.copy()
    route = lay_pattern(made.pattern)
    rows, line = np.asarray(route.rows)[: int(route.count)], np.asarray(route.line)[: int(route.count)]
    total, last = 0.0, -1
    for row, number in zip(rows, line, strict=True):
        if number >= 0:
            if number != last:
                rest &= ~under_tool((made.pattern.lines[number],), held)
                last = int(number)
            continue
        column = int((row[0] - grid.east_m) / grid.cell_m)
        north = int((row[1] - grid.north_m) / grid.cell_m)
        if not (0 <= north < rest.shape[0] and 0 <= column < rest.shape[1]) or not rest[north, column]:
            continue
        following = made.pattern.lines[last + 1]
        way = (following.end_m - following.start_m) / following.length_m
        away = row[:2] - following.start_m
        aside, ahead = abs(float(away @ np.array([-way[1], way[0]]))), float(away @ way)
        if not (aside <= 0.5 * TOOL.width_m + CELL_M and -TOOL.ahead_m - 1.7 < ahead < 0.2):
            total += float(route.spacing_m)
    return total


def test_nothing_left_out_needs_no_plan() -> None:
    held = sample()
    assert plan(held, np.zeros(held.grid.shape, bool)) is None
    ground = ground_of_sides(held.field.perimeter_m, [5.5] * 4, (), 0.25)
    with pytest.raises(InputError, match="run: map: expected"):
        plan_gaps(held.field, np.ones((3, 4), bool), held.grid, ground, FLAIL, TOOL, OUTLINE, name="run")


@pytest.mark.parametrize("yaw_rad", [0.0, 0.4, 2.5])
def test_gaps_of_all_shapes_are_worked_and_little_else(yaw_rad: float) -> None:
    held = sample(yaw_rad=yaw_rad)
    along, across = held.east_m, held.north_m
    left = (
        ((along > 5.0) & (along < 15.0) & (across > 7.0) & (across < 7.3))
        | ((along > 20.0) & (along < 24.0) & (across > 12.0) & (across < 14.6))
        | ((along > 27.0) & (across > 18.8))
    ) & held.inside
    made = plan(held, left)
    assert made is not None
    assert (made.pattern.unreached, made.regions) == ((), 3)
    assert np.all(under_tool(made.pattern.lines, held)[left])
    # The sliver: one line; the block: its own shorter side is no better; the corner: two lines of 3 m.
    assert made.swath_m == pytest.approx(10.0 + 3 * 4.0 + 2 * 3.0, abs=1.0)
    # Half a tool beyond each end, and no line across the field.
    assert made.pattern.line_length_m <= made.swath_m + 1.2 * len(made.pattern.lines) + 1e-6
    assert max(line.length_m for line in made.pattern.lines) < 11.6
    assert crossed(made, held, left) == 0.0


@pytest.mark.parametrize(("length_m", "width_m", "share"), [(8.0, 8.0, 0.4), (40.0, 40.0, 0.35), (60.0, 30.0, 0.62)])
def test_what_a_day_leaves_costs_what_it_is_worth(length_m: float, width_m: float, share: float) -> None:
    """The rest of a field of which a share was done: at most 1.15 times its area by the spacing."""
    held = sample(length_m, width_m)
    left = held.inside & (held.north_m > share * width_m)
    made = plan(held, left)
    assert made is not None
    assert made.pattern.unreached == ()
    assert np.all(under_tool(made.pattern.lines, held)[left])
    assert made.swath_m <= 1.15 * made.left_m2 / SPACING_M
    assert crossed(made, held, left) == 0.0


def test_many_regions_drawn_at_random() -> None:
    for seed in (3, 4, 5):
        rng = np.random.default_rng(seed)
        held = sample(yaw_rad=float(rng.uniform(0.0, 3.0)))
        left = np.zeros(held.grid.shape, bool)
        for _ in range(7):
            at, half = rng.uniform((0.0, 0.0), (30.0, 20.0)), 0.5 * rng.uniform((0.2, 0.2), (9.0, 3.0))
            left |= (np.abs(held.east_m - at[0]) < half[0]) & (np.abs(held.north_m - at[1]) < half[1])
        left &= held.inside
        made = plan(held, left)
        assert made is not None
        both = (*made.pattern.lines, *made.pattern.unreached)
        assert np.all(under_tool(both, held)[left])
        assert len(made.pattern.unreached) <= 1
        assert crossed(made, held, left) <= 0.3


def test_narrow_places_are_left_and_told() -> None:
    held = sample(cell_m=0.05)
    border = held.inside & ((held.north_m < 0.051) | (held.north_m > 19.949))
    block = held.inside & (np.abs(held.east_m - 10.0) < 2.0) & (held.north_m < 2.0)
    assert plan(held, border, least_width_m=0.1) is None
    made = plan(held, border | block, least_width_m=0.1)
    assert made is not None
    assert made.left_m2 == pytest.approx(8.0, abs=0.05)
    # Less what lies at the block's foot.
    assert made.narrow_m2 == pytest.approx(0.05 * (2.0 * 30.0 - 4.0), abs=0.05)
    assert all(line.length_m < 5.3 for line in made.pattern.lines)


def test_wide_parts_are_those_that_hold_a_square() -> None:
    cells = np.zeros((12, 12), bool)
    cells[2:5, 1:9] = True
    cells[5:11, 4] = True
    cells[0, 0] = True
    opened = wide_parts(cells, 2.0)
    brute = np.zeros_like(cells)
    for row in range(11):
        for column in range(11):
            if cells[row : row + 2, column : column + 2].all():
                brute[row : row + 2, column : column + 2] = True
    np.testing.assert_array_equal(opened, brute)
    np.testing.assert_array_equal(wide_parts(cells, 1.0), cells)


def test_where_no_swath_fits_it_is_said() -> None:
    held = sample(8.0, 6.0)
    ground = ground_of_sides(held.field.perimeter_m, [0.0] * 4, (), 2.6)
    with pytest.raises(InputError, match="no swath fits"):
        plan_gaps(held.field, ~held.inside, held.grid, ground, FLAIL, TOOL, OUTLINE, least_width_m=0.0, name="run")
    # Of two gaps the one nearer to a wall than the clearance is told with its area.
    ground = ground_of_sides(held.field.perimeter_m, [0.0, 5.5, 0.0, 5.5], (), 0.25)
    left = held.inside & ((held.north_m < 0.15) | (np.abs(held.north_m - 3.0) < 0.3))
    made = plan_gaps(held.field, ~left, held.grid, ground, FLAIL, TOOL, OUTLINE, name="run")
    assert made is not None
    assert made.shut_m2 == pytest.approx(np.count_nonzero(left & (held.north_m < 0.15)) * CELL_M**2)
    assert under_tool(made.pattern.lines, held)[left & (held.north_m > 1.0)].all()


# How long swaths are, of ground drawn by kind.

MOST_RATIO = {"blocks": 1.15, "stripes": 1.15, "rectangles": 1.3, "branched": 1.45, "blobs": 1.3, "missed": 5.0}
"""Median of swaths over area by spacing: 1.15 where what is left is about as wide as swaths are, or wide."""
MOST_OVER_BOUND = {"blocks": 1.15, "stripes": 1.15, "rectangles": 1.3, "branched": 1.45, "blobs": 1.3, "missed": 1.05}


def least_m(left: np.ndarray, cell_m: float) -> float:
    """A bound on swaths, each with a tool's width more: of each region its area by the spacing, or how far it reaches.

    A swath and the tool's width cannot reach farther than the two together; regions that are a tool's width apart share
    no part of a swath.
    """
    near = ndimage.distance_transform_edt(~left) * cell_m <= 0.5 * TOOL.width_m
    labels = np.where(left, ndimage.label(near, np.ones((3, 3)))[0], 0)
    total_m = 0.0
    for number in np.unique(labels[left]):
        places = np.argwhere(labels == number) * cell_m
        corners = shapely.get_coordinates(shapely.convex_hull(shapely.MultiPoint(places)))
        reach_m = max(float(np.hypot(*(corners - each).T).max()) for each in corners)
        total_m += max(reach_m, len(places) * cell_m**2 / SPACING_M)
    return total_m


def drawn_lengths(kind: str, seeds: range, length_m: float, width_m: float) -> np.ndarray:
    """Of each seed: swaths over area by spacing, and over the bound; area by spacing, and bound; lines, and the way."""
    rows = []
    for seed in seeds:
        rng = np.random.default_rng([seed, list(KINDS).index(kind)])
        held = sample(length_m, width_m, yaw_rad=float(rng.uniform(0.0, 3.0)))
        left = KINDS[kind](rng, held.east_m, held.north_m, (length_m, width_m)) & held.inside
        made = plan(held, left)
        assert made is not None
        assert np.all(under_tool((*made.pattern.lines, *made.pattern.unreached), held)[left])
        assert len(made.pattern.unreached) <= 1
        assert crossed(made, held, left) <= 0.3
        area_m, bound_m = made.left_m2 / SPACING_M, least_m(left, CELL_M)
        way_m = made.pattern.line_length_m + sum(each.length_m for each in made.pattern.turns)
        rows.append((made.swath_m / area_m, made.swath_m / bound_m, len(made.pattern.lines), way_m))
    return np.array(rows)


@pytest.mark.parametrize("kind", KINDS)
def test_swaths_are_little_longer_than_area_by_spacing(kind: str) -> None:
    found = drawn_lengths(kind, range(1), 30.0, 20.0)
    assert np.median(found[:, 0]) <= MOST_RATIO[kind]
    assert np.median(found[:, 1]) <= MOST_OVER_BOUND[kind]


@pytest.mark.campaign
@pytest.mark.parametrize("kind", KINDS)
def test_swaths_of_many_drawn(kind: str) -> None:
    """Medians and worst are printed."""
    found = drawn_lengths(kind, range(100, 106), 50.0, 40.0)
    (median, over), (worst, worst_over) = np.median(found[:, :2], axis=0), found[:, :2].max(axis=0)
    print(
        f"{kind}: {median:.2f} ({worst:.2f} at most) of area by spacing, {over:.2f} ({worst_over:.2f}) of the bound; "
        f"{found[:, 2].sum():.0f} lines, way {found[:, 3].sum():.0f} m"
    )
    assert median <= MOST_RATIO[kind]
    assert over <= MOST_OVER_BOUND[kind]


@pytest.mark.campaign
def test_swaths_of_a_hectare_with_26_regions() -> None:
    found = drawn_lengths("rectangles", range(3), 100.0, 100.0)
    print("of area by spacing, of the bound, lines, way m:", *np.round(found, 2).tolist())
    assert np.all(found[:, 0] <= 1.4)
    assert np.all(found[:, 1] <= 1.3)


def test_of_three_swaths_that_share_a_way_the_longer_direction_is_driven() -> None:
    """Beside a keep-out a stretch has parts both ways round; two ahead are longer than one behind."""

    def swath(begin_m: float, end_m: float) -> TourSwath:
        return TourSwath(np.array([begin_m, 0.0]), np.array([end_m, 0.0]), False)

    ahead = [swath(0.0, 4.0), swath(6.0, 9.0)]
    assert _either_way([ahead[0], swath(4.0, 0.0), ahead[1]]) == ahead
    assert _either_way([swath(4.0, 0.0), swath(0.0, 3.0), swath(4.0, 9.0)])[0].end_m[0] == 3.0
