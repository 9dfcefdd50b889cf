"""Recorded runs over one field made one record of what was worked: of each cell the best pass, never a product."""

from collections.abc import Callable, Sequence
from datetime import UTC, datetime, timedelta
from functools import partial

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int, UInt16

from lgprjax import __version__
from lgprjax.archive.cover_passes import passes_of_runs, stops_of_runs
from lgprjax.archive.cover_plans import PlanFile
from lgprjax.archive.cover_runs import CoverRun
from lgprjax.coverage import (
    LEVELS,
    CellGrid,
    Tool,
    ToolMoment,
    WorkedState,
    cell_states,
    grid_of_field,
    init_worked,
    step_worked,
)
from lgprjax.errors import InputError
from lgprjax.formats.worked_record import FULL, CoverChannels, CoverEvents, WorkedCells, WorkedRecord

COUNTS = 8
"""The bit of ``cover``'s tool field that says that cells count."""
_BLOCK = 256
# Two moments are a tenth of a second apart. Where one is missing nobody knows what the tool did.
_LONGEST_STEP_NS = 250_000_000


def record_cover(
    plans: Sequence[PlanFile],
    runs: Sequence[CoverRun],
    *,
    cell_m: float = 0.05,
    progress: Callable[[int], None] | None = None,
) -> WorkedRecord:
    """The record of a field.

    Cells beyond the perimeter are kept as far as the tool is wide, so that what was worked there is seen.

    Args:
        plans: of the field; the first names it, others are for gaps of it. Their tool is the one that worked.
        runs: over it, each by one of the plans.
        cell_m: side of a cell.
        progress: told the moments done, now and then; those where nothing counts are soon done.

    Raises:
        InputError: no run, the same run twice, one by another plan, plans of different fields or tools, or cells too
            small for the field.
    """
    first, plan = plans[0], plans[0].plan
    _check_plans(plans)
    _check_runs(plans, runs)
    ordered = sorted(runs, key=lambda run: int(run.utc_ns[0]))
    t0_ns = int(ordered[0].utc_ns[0])
    grid = grid_of_field(plan.pattern.field, cell_m, plan.tool.width_m)
    best = np.zeros(grid.shape, np.float32)
    for run in ordered:
        best = np.maximum(best, _probability(grid, plan.tool, run, progress))
    numbers = whole_down(best)
    kept = numbers / FULL
    t0 = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=t0_ns // 1000)
    passes, swaths = passes_of_runs(ordered, plan.tool, t0_ns)
    return WorkedRecord(
        name=plan.name,
        frame=plan.frame,
        perimeter_m=plan.pattern.field.perimeter_m,
        tool=plan.tool,
        t0_utc=t0.isoformat(),
        cells=WorkedCells(
            east_m=grid.east_m,
            north_m=grid.north_m,
            cell_m=grid.cell_m,
            probability=numbers,
            level=np.array(LEVELS),
            state=np.stack([cell_states(kept, level) for level in LEVELS]),
        ),
        channels=_channels(ordered, t0_ns),
        passes=passes,
        swaths=swaths,
        stops=stops_of_runs(ordered, t0_ns),
        events=_events(ordered, t0_ns),
        provenance={
            "program": f"lgprjax {__version__}",
            "step": "cover record",
            "plan": {"file": first.path.name, "sha256": first.sha256},
            "other_plans": [{"file": each.path.name, "sha256": each.sha256} for each in plans[1:]],
            "vehicle": {"name": plan.vehicle_name, "sha256": plan.vehicle_sha256},
            "runs": [{**run.provenance, "plan_sha256": run.plan_sha256} for run in ordered],
            "combined": "the largest probability of any pass of any run, a cell",
        },
    )


def whole_down(probability: Float[np.ndarray, "north east"]) -> UInt16[np.ndarray, "north east"]:
    """Probabilities as whole numbers of 1/65535, never more than they were; what is no number is none."""
    known = np.clip(np.nan_to_num(np.asarray(probability, np.float64)), 0.0, 1.0)
    return np.floor(known * FULL).astype(np.uint16)


def moments_of_run(run: CoverRun) -> tuple[np.ndarray, ...]:
    """Fields of ``ToolMoment`` over a run, on the host; in a hole of the recording one that does not count."""
    rows = run.rows
    holes = np.flatnonzero(np.diff(run.utc_ns) > _LONGEST_STEP_NS) + 1
    on = np.insert((rows["tool"] & COUNTS) != 0, holes, False)
    # One moment that does not count ends a pass as well as many.
    kept = on | np.concatenate([[True], on[:-1]])

    def filled(name: str) -> np.ndarray:
        values = np.asarray(rows[name], np.float32)
        return np.asarray(np.insert(values, holes, values[holes], axis=0)[kept])

    return *(filled(name) for name in ToolMoment._fields[:-1]), on[kept]


def _probability(
    grid: CellGrid, tool: Tool, run: CoverRun, progress: Callable[[int], None] | None
) -> Float[np.ndarray, "north east"]:
    moments = moments_of_run(run)
    count, state = len(moments[-1]), init_worked(grid)
    if progress is not None:
        progress(len(run.rows) - count)
    for start in range(0, count, _BLOCK):
        block = [each[start : start + _BLOCK] for each in moments]
        short = _BLOCK - len(block[0])
        # Filled up with moments that do not count: one compiled size serves every run.
        full = [np.concatenate([each, np.repeat(each[-1:], short, axis=0)]) for each in block]
        full[-1] &= np.arange(_BLOCK) < _BLOCK - short
        state = _work(grid, tool, state, ToolMoment(*(jnp.asarray(each) for each in full)))
        jax.block_until_ready(state.probability)
        if progress is not None:
            progress(min(_BLOCK, count - start))
    return np.asarray(state.probability)


@partial(jax.jit, static_argnames=("grid", "tool"))
def _work(grid: CellGrid, tool: Tool, state: WorkedState, moments: ToolMoment) -> WorkedState:
    def step(carried: WorkedState, moment: ToolMoment) -> tuple[WorkedState, None]:
        return step_worked(grid, tool, carried, moment), None

    worked: WorkedState = jax.lax.scan(step, state, moments)[0]
    return worked


def _check_plans(plans: Sequence[PlanFile]) -> None:
    """Cells of two plans coincide only about one anchor."""
    first = plans[0].plan
    for path, _, plan in plans[1:]:
        if plan.frame != first.frame or plan.tool != first.tool:
            expected = f"anchor and tool of {plans[0].path.name} (made by --gaps from its record)"
            raise InputError(path, "plan", expected, "others")


def _check_runs(plans: Sequence[PlanFile], runs: Sequence[CoverRun]) -> None:
    if not runs:
        raise InputError(plans[0].path, "runs", "one recorded run or more", "none")
    known = {plan.sha256 for plan in plans}
    seen: dict[str, str] = {}
    for run in runs:
        if run.plan_sha256 not in known:
            expected = "a run by this plan, or by another one that --plan names too"
            found = "none that it tells" if run.plan_sha256 is None else f"the plan {run.plan_sha256[:12]}..."
            raise InputError(run.name, "plan", expected, found)
        identity = str(run.provenance["run"])
        if identity in seen:
            raise InputError(run.name, "run", "each run once", f"the same as {seen[identity]}")
        seen[identity] = run.name


def _seconds(utc_ns: Int[np.ndarray, " row"], t0_ns: int) -> Float[np.ndarray, " row"]:
    return np.asarray(1e-9 * (utc_ns - t0_ns).astype(np.float64))


def _channels(runs: Sequence[CoverRun], t0_ns: int) -> CoverChannels:
    number = np.repeat(np.arange(len(runs), dtype=np.uint16), [len(run.rows) for run in runs])
    rows = np.concatenate([run.rows for run in runs])
    time_s = np.concatenate([_seconds(run.utc_ns, t0_ns) for run in runs])
    return CoverChannels(time_s, number, *(np.array(rows[name]) for name in CoverChannels._fields[2:]))


def _events(runs: Sequence[CoverRun], t0_ns: int) -> CoverEvents:
    number = np.repeat(np.arange(len(runs), dtype=np.uint16), [len(run.events) for run in runs])
    time_s, places, text = [np.zeros(0)], [np.zeros((0, 2))], []
    for run in runs:
        if not run.events:
            continue
        utc_ns = np.array([event.utc_ns for event in run.events], np.int64)
        # The newest moment before; before the first one nothing was known.
        before = np.searchsorted(run.utc_ns, utc_ns, side="right") - 1
        place = np.stack([run.rows["x_m"][before], run.rows["y_m"][before]], axis=1)
        time_s.append(_seconds(utc_ns, t0_ns))
        places.append(np.where(before[:, None] >= 0, place, np.nan))
        text += [event.text for event in run.events]
    east_m, north_m = np.concatenate(places).T
    return CoverEvents(number, np.concatenate(time_s), east_m, north_m, tuple(text))
