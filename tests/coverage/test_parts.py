"""Parts of the ground that nothing joins: a plan is for the one in which most can be worked, of those one can enter."""

import math

import numpy as np
import pytest
import shapely

from lgprjax.coverage import Outline, PatternSettings, Tool, field_of_polygon, outline_of
from lgprjax.coverage.ground import breaches, safe_ground
from lgprjax.coverage.joints import Terrain
from lgprjax.coverage.lattice import Lattice
from lgprjax.coverage.parts import workable_cells
from lgprjax.coverage.tour import plan_tour

TOOL = Tool(1.2, 0.3, 1.2, 0.0)
OUTLINE = outline_of(TOOL, Outline(1.4, -0.5, 0.65, -0.65), track_m=1.1)
SMALL, NECK, LARGE = shapely.box(0, 0, 8, 6), shapely.box(8, 2.4, 10, 3.6), shapely.box(10, 0, 24, 6)
BEFORE_SMALL, BEFORE_LARGE = shapely.box(-7, 0, 0, 6), shapely.box(10, -7, 24, 0)
FIELD = shapely.union_all([SMALL, NECK, LARGE])
"""The neck is 1.2 m wide: the vehicle of 1.3 m does not fit through."""


@pytest.mark.parametrize(
    ("outside", "part"),
    [((BEFORE_SMALL, BEFORE_LARGE), LARGE), ((BEFORE_SMALL,), SMALL), ((), LARGE)],
)
def test_the_part_with_most_to_work_counts_of_those_that_can_be_entered(
    outside: tuple[shapely.Polygon, ...], part: shapely.Polygon
) -> None:
    ground = safe_ground(shapely.union_all([FIELD, *outside]), 0.25)
    terrain = Terrain(ground, FIELD, OUTLINE)
    cells = workable_cells(terrain, TOOL) & terrain.target
    x, y = np.meshgrid(terrain.east_m, terrain.north_m)
    within = shapely.contains_xy(part, x, y)
    # The tool reaches into the neck as far as the vehicle gets before it.
    assert cells[within].mean() > 0.8
    assert cells[terrain.target & ~within & ~shapely.contains_xy(NECK, x, y)].sum() == 0


def test_a_plan_begins_in_that_part_and_tells_what_it_leaves() -> None:
    ground = safe_ground(shapely.union_all([FIELD, BEFORE_SMALL, BEFORE_LARGE]), 0.25)
    field = field_of_polygon(np.asarray(FIELD.exterior.coords)[:-1], name="two parts")
    settings = PatternSettings(TOOL.width_m, 0.2, "free", 1.5, 6.0, TOOL.ahead_m)
    pattern = plan_tour(field, ground, (), settings, TOOL, OUTLINE, name="two parts").pattern
    assert breaches(pattern, ground, OUTLINE) == []
    assert all(min(line.start_m[0], line.end_m[0]) > 8.0 for line in pattern.lines)
    left = [line for line in pattern.unreached if max(line.start_m[0], line.end_m[0]) < 9.0]
    assert sum(line.length_m for line in left) * TOOL.width_m > 0.7 * SMALL.area
    # No more of them than it takes: each works ground that the others do not.
    assert len(pattern.unreached) <= math.ceil(8.0 / 0.96) + 4


def test_a_finer_lattice_is_of_the_same_ground_and_ends_where_it_would_be_too_large() -> None:
    terrain = Terrain(safe_ground(shapely.union_all([FIELD, BEFORE_SMALL]), 0.25), FIELD, OUTLINE)
    lattice: Lattice | None = Lattice(terrain, 0.0, 1.5)
    steps_m = []
    while lattice is not None:
        steps_m.append(lattice.step_m)
        assert lattice.free.any()
        lattice = lattice.finer()
    assert steps_m == pytest.approx([0.6, 0.4, 0.6 * 4 / 9])
