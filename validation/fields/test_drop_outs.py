"""30 × 20 m worked through drop-outs of GNSS: one pass with the overlap planned for them, and one over its gaps."""

from collections.abc import Callable
from pathlib import Path

import jax
import numpy as np
import pytest

from lgprjax.autopilot.fence import fence_of_ground
from lgprjax.coverage import (
    CellGrid,
    Pattern,
    SafeGround,
    Tool,
    cell_states,
    grid_of_field,
    inside_cells,
    lay_pattern,
    outline_of,
    plan_gaps,
)
from lgprjax.simulation.field_loop import FieldLoopSpec, FieldWorld, made_up_field_world, run_fields
from lgprjax.worked import PlanOptions, plan_field
from lgprjax.worked.evidence import UNCHECKED_SIGMA_M
from true_cells import true_cells
from validation.fields.sessions import map_of

ONBOARD = Path(__file__).resolve().parents[2] / "onboard"


def probability_of(
    grid: CellGrid, tool: Tool, world: FieldWorld, pattern: Pattern, ground: SafeGround, seed: int
) -> tuple[np.ndarray, np.ndarray]:
    """Of a drive over a pattern: probability of each cell, and cells that the true tool was over."""
    route = lay_pattern(pattern)
    # Waiting for GNSS takes its time: twice the way's.
    moments = int(10.0 * (2.0 * float(route.length_m) / float(world.set_speed_mps) + 240.0))
    kept = run_fields(FieldLoopSpec(moments=moments), world, route, fence_of_ground(ground), jax.random.key(seed)[None])
    kept = jax.tree.map(lambda leaf: np.asarray(leaf)[:, 0], kept)
    on = (kept.tool > 0.5) & kept.engaged
    truth = np.stack([kept.x_m, kept.y_m, kept.yaw_rad], axis=1).astype(np.float64)
    probability = map_of(grid, tool, kept, on, UNCHECKED_SIGMA_M)
    return probability, true_cells(grid, tool, truth, on)


@pytest.mark.parametrize(
    ("off_s", "every_s", "borne_s", "least"),
    [(0.0, 90.0, 0.0, 0.999), (30.0, 90.0, 30.0, 0.99), (90.0, 180.0, 60.0, 0.99)],
)
@pytest.mark.parametrize("seed", [1, 2])
def test_a_field_is_worked_through_drop_outs(
    off_s: float,
    every_s: float,
    borne_s: float,
    least: float,
    seed: int,
    record_property: Callable[[str, object], None],
) -> None:
    """Drop-outs longer than any overlap bears are waited out where the position gets too uncertain."""
    vehicle = ONBOARD / "made_up_flail.vehicle.toml"
    options = PlanOptions(order="boustrophedon", confidence=0.95, drop_out_s=borne_s, speed_mps=0.45)
    made = plan_field(ONBOARD / "field.geojson", vehicle, options)
    assert made is not None
    plan, world = made.plan, made_up_field_world(off_s=off_s, every_s=every_s)
    field = plan.pattern.field
    grid = grid_of_field(field, 0.1, plan.tool.width_m)
    inside = inside_cells(field, grid)
    probability, truly = probability_of(grid, plan.tool, world, plan.pattern, made.ground, seed)
    once = float(np.mean(cell_states(probability, 0.95)[inside] == 2))
    record_property("processed_once", once)
    processed = cell_states(probability, 0.95) == 2
    both = once
    gaps = plan_gaps(
        field,
        processed,
        grid,
        made.ground,
        plan.pattern.settings,
        plan.tool,
        outline_of(plan.tool, track_m=1.1),
        least_width_m=0.1,
        name="gaps",
    )
    if gaps is not None:
        again, again_truly = probability_of(grid, plan.tool, world, gaps.pattern, made.ground, seed + 100)
        probability, truly = np.maximum(probability, again), truly | again_truly
        processed = cell_states(probability, 0.95) == 2
        both = float(np.mean(processed[inside]))
        record_property("processed_with_gaps", both)
        record_property("gaps_m", gaps.swath_m)
    claimed = processed & inside
    record_property("true_share", float(np.mean(truly[claimed])))
    assert np.mean(truly[claimed]) >= 0.95
    assert (once if off_s == 0.0 else both) >= least
