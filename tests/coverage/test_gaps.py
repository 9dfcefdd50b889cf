"""Plans for gaps: every cell left out lies in a line's tool, lines end there, no way crosses what is not worked."""

import numpy as np
import pytest

from lgprjax.coverage import ground_of_sides, plan_gaps
from lgprjax.coverage.gaps import _either_way, wide_parts
from lgprjax.coverage.layer import TourSwath
from refusals import refused
from validation.fields.gap_plans import (
    CELL_M,
    FLAIL,
    MOST_OVER_BOUND,
    MOST_RATIO,
    OUTLINE,
    SPACING_M,
    TOOL,
    crossed,
    drawn_lengths,
    plan,
    sample,
    under_tool,
)


def test_nothing_left_out_needs_no_plan() -> None:
    held = sample()
    assert plan(held, np.zeros(held.grid.shape, bool)) is None
    ground = ground_of_sides(held.field.perimeter_m, [5.5] * 4, (), 0.25)
    with refused("map", held.grid.shape, file="run", found=(3, 4)):
        plan_gaps(held.field, np.ones((3, 4), bool), held.grid, ground, FLAIL, TOOL, OUTLINE, name="run")


@pytest.mark.parametrize("yaw_rad", [0.0, 2.5])
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


@pytest.mark.parametrize(("length_m", "width_m", "share"), [(8.0, 8.0, 0.4), (40.0, 20.0, 0.62)])
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
    with refused("field", file="run", found="48.0 m²"):
        plan_gaps(held.field, ~held.inside, held.grid, ground, FLAIL, TOOL, OUTLINE, least_width_m=0.0, name="run")
    # Of two gaps the one nearer to a wall than the clearance is told with its area.
    ground = ground_of_sides(held.field.perimeter_m, [0.0, 5.5, 0.0, 5.5], (), 0.25)
    left = held.inside & ((held.north_m < 0.15) | (np.abs(held.north_m - 3.0) < 0.3))
    made = plan_gaps(held.field, ~left, held.grid, ground, FLAIL, TOOL, OUTLINE, name="run")
    assert made is not None
    assert made.shut_m2 == pytest.approx(np.count_nonzero(left & (held.north_m < 0.15)) * CELL_M**2)
    assert under_tool(made.pattern.lines, held)[left & (held.north_m > 1.0)].all()


@pytest.mark.parametrize("kind", ["stripes", "branched"])
def test_swaths_are_little_longer_than_area_by_spacing(kind: str) -> None:
    found = drawn_lengths(kind, range(1), 30.0, 20.0)
    assert np.median(found[:, 0]) <= MOST_RATIO[kind]
    assert np.median(found[:, 1]) <= MOST_OVER_BOUND[kind]


def test_of_three_swaths_that_share_a_way_the_longer_direction_is_driven() -> None:
    """Beside a keep-out a stretch has parts both ways round; two ahead are longer than one behind."""

    def swath(begin_m: float, end_m: float) -> TourSwath:
        return TourSwath(np.array([begin_m, 0.0]), np.array([end_m, 0.0]), False)

    ahead = [swath(0.0, 4.0), swath(6.0, 9.0)]
    assert _either_way([ahead[0], swath(4.0, 0.0), ahead[1]]) == ahead
    assert _either_way([swath(4.0, 0.0), swath(0.0, 3.0), swath(4.0, 9.0)])[0].end_m[0] == 3.0
