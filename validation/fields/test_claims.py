"""What is claimed is so: fields worked in the closed loop, their claims held against where the tool truly was.

Every field draws its own track, slips, wheel scales and errors of the sensors. The filter's covariance is all that the
claims stand on: it knows nothing of a GNSS that is biased or drifts, and those rows are recorded, not held to a level.
"""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Bool, Float

from lgprjax.coverage import (
    LEVELS,
    CellGrid,
    CellState,
    ToolMoment,
    cell_states,
    grid_of_field,
    init_worked,
    inside_cells,
    run_worked,
)
from lgprjax.coverage.swaths import PatternSettings
from lgprjax.navigation import cautious_skid_model
from lgprjax.simulation.field_loop import (
    FieldLoopSpec,
    FieldMoment,
    FieldWorld,
    made_up_field_world,
    made_up_tool,
    run_fields,
)
from lgprjax.simulation.field_loop import rectangle_course as course_of
from lgprjax.worked.evidence import UNCHECKED_SIGMA_M
from true_cells import true_cells

LENGTH_M, WIDTH_M, CELL_M = 10.0, 6.0, 0.1
LANES, AT_ONCE = 50, 512
TOOL = made_up_tool()
SETTINGS = PatternSettings(
    tool_width_m=TOOL.width_m,
    overlap=0.25,
    order="boustrophedon",
    smallest_radius_m=1.5,
    turning_room_m=9.0,
    tool_ahead_m=TOOL.ahead_m,
)
BY_PERIOD = 0.1


class Claims(NamedTuple):
    """What came of fields at one level, a field a value.

    Attributes:
        claimed, true: cells inside the perimeter that were claimed, and those of them that the tool was truly over.
        worked: cells that it was truly over.
    """

    claimed: Float[np.ndarray, " field"]
    true: Float[np.ndarray, " field"]
    worked: Float[np.ndarray, " field"]

    def told(self, level: float) -> str:
        """One line."""
        share = self.true[self.claimed > 0.0] / self.claimed[self.claimed > 0.0]
        return (
            f"{len(share)} of {len(self.true)} fields were begun, {self.claimed.sum() / self.worked.sum():.3f} of what "
            f"was worked is claimed; of the claimed cells true {100 * self.pooled():.3f} %, worst field "
            f"{100 * share.min():.2f} %; {100 * self.fields_of(level):.1f} % of fields reach the level"
        )

    def pooled(self) -> float:
        """Share of the claimed cells of all fields that are true."""
        return float(self.true.sum() / self.claimed.sum())

    def fields_of(self, level: float) -> float:
        """Share of the fields with a claim of whose claimed area at least the level is true."""
        begun = self.claimed > 0.0
        return float(np.mean(self.true[begun] >= level * self.claimed[begun]))


def work_fields(world: FieldWorld, fields: int, seed: int, *, shared_sigma_m: float = 0.0) -> dict[float, Claims]:
    """Fields driven, their claims by level."""
    course = course_of(LENGTH_M, WIDTH_M, SETTINGS, TOOL)
    grid = grid_of_field(course.field, CELL_M, 0.5)
    inside = inside_cells(course.field, grid)
    way_m = float(course.route.length_m) + FieldLoopSpec(moments=1).run_up_m
    spec = FieldLoopSpec(moments=int((way_m / float(world.set_speed_mps) + 40.0) / BY_PERIOD))
    found: dict[float, list[tuple[float, float, float]]] = {level: [] for level in LEVELS}
    keys = jax.random.split(jax.random.key(seed), fields)
    for first in range(0, fields, LANES):
        kept = run_fields(spec, world, course.route, course.fence, keys[first : first + LANES])
        kept = jax.tree.map(np.asarray, kept)
        for lane in range(kept.x_m.shape[1]):
            probability, over = _one_field(grid, kept, lane, shared_sigma_m)
            for level in LEVELS:
                claimed = (cell_states(probability, level) == CellState.PROCESSED) & inside
                counts = np.sum(claimed), np.sum(claimed & over), np.sum(over & inside)
                found[level].append((float(counts[0]), float(counts[1]), float(counts[2])))
    return {level: Claims(*np.asarray(rows).T) for level, rows in found.items()}


def _one_field(
    grid: CellGrid, kept: FieldMoment, lane: int, shared_sigma_m: float
) -> tuple[Float[np.ndarray, "north east"], Bool[np.ndarray, "north east"]]:
    """The map as it would be live, and where the tool truly was."""
    on = np.asarray((kept.tool[:, lane] > 0.5) & kept.engaged[:, lane])
    # Of the moments with the tool off the first alone ends a pass; the others change nothing.
    told = np.flatnonzero(on | np.roll(on, 1))
    told = np.append(told, np.full(-len(told) % AT_ONCE, np.flatnonzero(~on)[0]))
    believed, covariance = kept.believed, kept.covariance[told, lane]
    x, y, yaw = (jnp.asarray(part[told, lane]) for part in (believed.x_m, believed.y_m, believed.yaw_rad))
    moments = ToolMoment(x, y, yaw, jnp.asarray(covariance), jnp.asarray(on[told]))
    probability = np.asarray(
        run_worked(grid, TOOL, init_worked(grid), moments, jnp.float32(shared_sigma_m)).probability
    )
    poses = np.stack([kept.x_m[:, lane], kept.y_m[:, lane], kept.yaw_rad[:, lane]], axis=1).astype(np.float64)
    ahead_m, left_m = (float(each) for each in kept.tool_m[0, lane])
    mounted = TOOL._replace(ahead_m=TOOL.ahead_m + ahead_m, left_m=TOOL.left_m + left_m)
    return probability, true_cells(grid, mounted, poses, on)


@pytest.mark.parametrize("off_s", [0.0, 30.0])
def test_cells_claimed_at_a_level_are_worked_at_least_as_often(
    off_s: float, record_property: Callable[[str, object], None]
) -> None:
    """GNSS all along, and GNSS off for 30 s of every 90 s; half of 500 fields each."""
    for level, claims in work_fields(made_up_field_world(off_s=off_s), 250, 7).items():
        record_property(f"{level:g}", claims.told(level))
        assert claims.pooled() >= level
        assert claims.fields_of(level) >= 0.95
        assert claims.claimed.sum() > 0.5 * claims.worked.sum()


@pytest.mark.parametrize(
    ("name", "bias_m", "drift_mps"),
    [("bias of 3 cm", 0.03, 0.0), ("bias of 10 cm", 0.10, 0.0), ("drift of 2 cm a minute", 0.0, 0.02 / 60.0)],
)
def test_what_a_gnss_that_lies_costs(
    name: str, bias_m: float, drift_mps: float, record_property: Callable[[str, object], None]
) -> None:
    """Across the lines, and not told of by the receiver: the claims fall short of their level."""
    world = made_up_field_world()
    across = jnp.asarray([0.0, 1.0], jnp.float32)
    sensors = world.sensors._replace(bias_m=bias_m * across, drift_mps=drift_mps * across)
    for level, claims in work_fields(world._replace(sensors=sensors), 100, 8).items():
        record_property(f"{name}, {level:g}", claims.told(level))
        assert claims.pooled() < 1.0


@pytest.mark.parametrize("off_s", [0.0, 30.0])
def test_claims_hold_by_other_laws_than_the_filters(
    off_s: float, record_property: Callable[[str, object], None]
) -> None:
    """Slopes, soil, load, bursts, tails, a base up to 10 cm off: what vehicles drive with, and what records assume."""
    world = made_up_field_world(off_s=off_s)
    model = cautious_skid_model(
        track_m=float(world.setup.model.track_m), gnss_x_m=float(world.setup.model.gnss_x_m), gnss_y_m=0.0
    )
    world = world._replace(setup=world.setup._replace(model=model), largest_base_m=jnp.float32(0.10))
    for level, claims in work_fields(world, 250, 31, shared_sigma_m=UNCHECKED_SIGMA_M).items():
        record_property(f"{level:g}", claims.told(level))
        assert claims.fields_of(level) >= 0.95
        assert claims.claimed.sum() > 0.8 * claims.worked.sum()
