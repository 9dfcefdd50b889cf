"""Resumption of work of earlier runs: after a stop, a power cut, on a new day, or together with another machine.

Everything comes from the recordings: the place is that of the last moment that counted, and the map is computed by the
step that keeps it on board. A run that resumed others stores their map in its own file, so that only its own rows are
processed again.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from statistics import NormalDist
from typing import Any

import numpy as np

from lgprjax.coverage import CellGrid, CellState, cell_states, grid_of_field
from lgprjax.coverage.resume import (
    Resumption,
    RoutePlace,
    place_of_tool,
    resume_place,
    share_of_lines,
    worked_stretches,
)
from lgprjax.errors import InputError
from lgprjax.formats.coverage_files import TakenUp, read_taken_up
from lgprjax.run_records import ToolBits
from lgprjax.run_segment import segments_of
from lgprjax.worked.evidence import UNCHECKED_SIGMA_M
from lgprjax.worked.plans import PlanFile
from lgprjax.worked.record import CoverRun, probability_of_run, read_cover_run

TAKEN_UP = "taken_up.npz"
"""File in a run's folder with the work that the run resumed."""


def runs_by_plan(folder: Path, plan: PlanFile) -> list[CoverRun]:
    """Runs in a folder that were driven by a plan, oldest first, without runs that have no coverage."""
    found = []
    for each in sorted(folder.iterdir()) if folder.is_dir() else []:
        if not each.is_dir() or not segments_of(each):
            continue
        try:
            run = read_cover_run(each)
        except InputError:
            continue
        if run.plan_sha256 == plan.sha256:
            found.append(run)
    return sorted(found, key=lambda run: int(run.utc_ns[0]))


def last_place(plan: PlanFile, runs: Sequence[CoverRun]) -> RoutePlace | None:
    """Place of the last counting moment of any run; ``None`` without one."""
    newest: tuple[int, RoutePlace] | None = None
    for run in runs:
        rows = run.rows
        good = ((rows["tool"] & ToolBits.COUNTS) != 0) & (rows["line"] >= 0) & np.isfinite(rows["x_m"] + rows["y_m"])
        good &= rows["line"] < len(plan.plan.pattern.lines)
        if not good.any():
            continue
        at = int(np.flatnonzero(good)[-1])
        if newest is None or int(run.utc_ns[at]) > newest[0]:
            pose = tuple(float(rows[name][at]) for name in ("x_m", "y_m", "yaw_rad"))
            place = place_of_tool(plan.plan.pattern, plan.plan.tool, int(rows["line"][at]), (pose[0], pose[1], pose[2]))
            newest = int(run.utc_ns[at]), place
    return None if newest is None else newest[1]


def take_up(
    plan: PlanFile,
    runs: Sequence[CoverRun],
    *,
    cell_m: float,
    level: float,
    shared_sigma_m: float = UNCHECKED_SIGMA_M,
    place: RoutePlace | None = None,
    machine: str | None = None,
    last_line: int | None = None,
    progress: Callable[[int], None] | None = None,
) -> TakenUp:
    """Work of earlier runs for a new run to resume.

    Args:
        plan: plan of all runs.
        runs: earlier runs of any machine.
        cell_m: side of a cell of the map.
        level: probability from which a cell counts as worked.
        shared_sigma_m: standard deviation per axis of the error shared by all positions.
        place: place to begin at; ``None``: slightly before the last counting moment of the machine's own runs.
        machine: identity of the machine that will drive. Runs without a machine count as its own; for ``None``, all do.
        last_line: last line of the machine's share, in driving order from 0; ``None``: the plan's last line.
        progress: function called with the number of moments done, at intervals.

    Raises:
        InputError: the plan has no such line, its end was reached, or a run's own file cannot be used.
    """
    pattern, tool = plan.plan.pattern, plan.plan.tool
    grid = grid_of_field(pattern.field, cell_m, tool.width_m)
    best = np.zeros(grid.shape, np.float32)
    within: set[str] = set()
    earlier = [_taken_up_by(run, plan, grid, shared_sigma_m) for run in runs]
    for held in earlier:
        if held is not None:
            best = np.maximum(best, held.probability)
            within |= set(held.runs)
    for run in runs:
        if _identity(run) not in within:
            best = np.maximum(best, probability_of_run(grid, tool, run, progress, shared_sigma_m))
    if place is None:
        own = [run for run in runs if machine is None or run.machine in (None, machine)]
        if runs and not own:
            raise InputError(
                plan.path, "resume", f"a run of {machine}", "runs of other machines only: give --start-line"
            )
        last = last_place(plan, own)
        place = RoutePlace(0, 0.0) if last is None else resume_place(pattern, last)
        if place is None:
            raise InputError(plan.path, "resume", "work left of the plan", "a complete plan: use cover plan --gaps")
    if not 0 <= place.line < len(pattern.lines):
        raise InputError(plan.path, "start line", f"1 to {len(pattern.lines)}", f"{place.line + 1}")
    if not 0.0 <= place.along_m < pattern.lines[place.line].length_m:
        length_m = pattern.lines[place.line].length_m
        raise InputError(plan.path, "start metre", f"0 to below {length_m:.2f}", f"{place.along_m:g}")
    if last_line is not None and not place.line <= last_line < len(pattern.lines):
        raise InputError(plan.path, "end line", f"{place.line + 1} to {len(pattern.lines)}", f"{last_line + 1}")
    worked = cell_states(best, level) == CellState.PROCESSED
    # The error shared by all positions alone leaves this much of the edge below the level.
    edge_m = NormalDist().inv_cdf(level) * shared_sigma_m
    done = worked_stretches(pattern, grid, worked, tool, after=place, last_line=last_line, edge_m=edge_m)
    stretches = share_of_lines(pattern, done, last_line)
    # If another copy of a run is given now, that copy says how much of the run is in the map.
    copies = {_identity(run).partition(":")[0] for run in runs}
    every = {each for each in within if each.partition(":")[0] not in copies} | {_identity(run) for run in runs}
    return TakenUp(plan.sha256, Resumption(place, stretches), grid, best, tuple(sorted(every)), shared_sigma_m)


def _taken_up_by(run: CoverRun, plan: PlanFile, grid: CellGrid, shared_sigma_m: float) -> TakenUp | None:
    path = run.folder / TAKEN_UP
    if not path.exists():
        return None
    held = read_taken_up(path)
    # With another plan, cell size or shared error, the runs themselves are processed again.
    same = (held.plan_sha256, held.grid, held.shared_sigma_m) == (plan.sha256, grid, shared_sigma_m)
    return held if same else None


def _identity(run: CoverRun) -> str:
    """UUID and number of moments, which distinguishes a run from a copy made while it was recorded."""
    stated: Any = run.provenance["run"]
    return f"{stated}:{len(run.rows)}"
