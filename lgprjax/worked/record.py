"""A recorded run of a field as a record of the ground worked."""

import json
from collections.abc import Callable, Iterator, Sequence
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Bool, Float, Int, UInt16

from lgprjax import __version__
from lgprjax.autopilot.modes import ENGAGED
from lgprjax.coverage import (
    LEVELS,
    CellGrid,
    Field,
    Tool,
    ToolMoment,
    cell_states,
    field_of_polygon,
    grid_of_field,
    init_worked,
    run_worked,
)
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats.run_log import read_run, read_run_record
from lgprjax.formats.worked import (
    FULL,
    CoverChannels,
    CoverEvents,
    CoverPasses,
    CoverStops,
    CoverSwaths,
    WorkedCells,
    WorkedRecord,
)
from lgprjax.frames import LocalFrame, body_to_local
from lgprjax.recordings.run_signals import RowGatherer, rising
from lgprjax.run_records import LONGEST_COVER_STEP_NS, RecordKind, ToolBits, payload_type
from lgprjax.run_segment import segments_of
from lgprjax.worked.evidence import Evidence, evidence_json, shared_error
from lgprjax.worked.plans import PlanFile

# Coverage data of a recorded run of a skid-steer vehicle.


class RunEvent(NamedTuple):
    """An event reported by a program on board, with its time."""

    utc_ns: int
    text: str


class CoverRun(NamedTuple):
    """A run as input of a coverage record.

    Attributes:
        name: name of the run's folder.
        utc_ns: UTC of each moment by the onboard computer, strictly rising, ns.
        rows: ``cover`` payloads, one per moment.
        events: events of the programs, in order.
        provenance: UUID, completeness, and SHA-256 of each segment.
        plan_sha256: SHA-256 of the plan driven; ``None`` if unknown.
        folder: folder of the run.
        machine: identity of the machine; ``None`` if unknown.
        without_plan: frame and tool of a run without a plan; ``None`` for other runs.
    """

    name: str
    utc_ns: Int[np.ndarray, " moment"]
    rows: np.ndarray
    events: tuple[RunEvent, ...]
    provenance: dict[str, Any]
    plan_sha256: str | None
    folder: Path
    machine: str | None = None
    without_plan: "PlanlessRun | None" = None


class PlanlessRun(NamedTuple):
    """Frame, tool and vehicle stated by a run without a plan.

    Attributes:
        frame: local frame of the run's positions.
        tool: tool that worked.
        vehicle: name and SHA-256 of the vehicle file.
    """

    frame: LocalFrame
    tool: Tool
    vehicle: dict[str, str]


NOT_MEASURED = "not measured"
"""Provenance of a run in which the operation of the tool was not measured."""


def read_cover_run(folder: str | Path) -> CoverRun:
    """Read a run; damaged or lost data are left out, as its provenance states.

    Args:
        folder: folder of the run.

    Raises:
        InputError: the folder holds no run, no clock, or no moment of coverage.
    """
    reading = read_run(folder)
    clock = reading.clock
    if clock is None:
        raise InputError(reading.folder, "segments", "a complete segment header, or run.json", "neither")
    gathered = RowGatherer(payload_type("cover"))
    events: list[RunEvent] = []
    header: dict[str, Any] = {}
    anchor: Any = None
    utc_of_mono_ns = clock[0] - clock[1]
    for _, data in reading:
        record = read_run_record(data)
        if record is None:
            continue
        if record.kind is RecordKind.COVER:
            gathered.add(record.mono_ns, record.payload)
        elif record.kind is RecordKind.EVENT:
            events.append(RunEvent(record.mono_ns + utc_of_mono_ns, _line(record.payload)))
            anchor = anchor or _object(record.payload).get("anchor")
        elif record.kind is RecordKind.HEADER and not header.get("plan_sha256"):
            header |= _object(record.payload)
            anchor = anchor or header.get("anchor")
    kept = rising(gathered.times_ns, np.ones(len(gathered.rows), bool))
    if not kept.any():
        expected = "records of what a tool worked (a run of a skid-steer vehicle or a hand cart)"
        raise InputError(reading.folder, "cover", expected, "none")
    found = reading.summary
    plan, machine = (_text(header.get(name)) for name in ("plan_sha256", "machine"))
    planless = None if plan is not None or "tool" not in header else _planless(reading.folder, header, anchor)
    return CoverRun(
        name=reading.folder.resolve().name,
        utc_ns=gathered.times_ns[kept] + utc_of_mono_ns,
        rows=gathered.rows[kept],
        events=tuple(events),
        provenance={
            "run": str(found.run),
            "folder": reading.folder.resolve().name,
            "complete": found.complete,
            "segments": [
                {"file": path.name, "sha256": file_hash(path)} for path in segments_of(reading.folder).values()
            ],
            **({"tool": NOT_MEASURED} if header.get("mode") == "record" else {}),
        },
        plan_sha256=plan,
        folder=reading.folder,
        machine=machine,
        without_plan=planless,
    )


def _line(payload: bytes) -> str:
    """JSON on one line; invalid JSON is kept as text."""
    text = payload.decode("utf-8", "replace")
    try:
        return json.dumps(json.loads(text))
    except json.JSONDecodeError:
        return json.dumps(text)


def _object(payload: bytes) -> dict[str, Any]:
    """The payload's JSON object; empty if it holds none."""
    try:
        found = json.loads(payload)
    except ValueError:
        return {}
    return found if isinstance(found, dict) else {}


def _text(stated: object) -> str | None:
    return stated if isinstance(stated, str) else None


def _planless(folder: Path, header: dict[str, Any], anchor: Any) -> PlanlessRun:
    """Frame, tool and vehicle from the header and the events of a run without a plan.

    Raises:
        InputError: the frame of its positions is missing, or the tool is damaged.
    """
    try:
        frame = LocalFrame(*(float(each) for each in anchor))
    except TypeError:
        expected = "the event with the anchor of its positions, as there is no plan"
        raise InputError(folder, "anchor", expected, "none") from None
    try:
        tool = Tool(**{name: float(header["tool"][name]) for name in Tool._fields})
        vehicle = {name: str(header["vehicle"][name]) for name in ("name", "sha256")}
    except (KeyError, TypeError, ValueError):
        raise InputError(folder, "header", "tool and vehicle of a run without a plan", "none") from None
    return PlanlessRun(frame, tool, vehicle)


def _in_frame(run: CoverRun, frame: LocalFrame) -> CoverRun:
    """A run with its positions in another frame; a run with a plan is already in the plan's frame."""
    if run.without_plan is None or run.without_plan.frame == frame:
        return run
    own, rows = run.without_plan.frame, run.rows.copy()
    latitude, longitude, height = own.to_geodetic(rows["x_m"], rows["y_m"], np.zeros(len(rows)))
    rows["x_m"], rows["y_m"], _ = frame.to_local(latitude, longitude, height)
    rows["yaw_rad"] = frame.yaw_of_heading(own.heading_of_yaw(rows["yaw_rad"], longitude), longitude)
    return run._replace(rows=rows)


# Passes, tracks of the tool and stops of recorded runs: stretches of consecutive moments.

_POINT_M = 0.2
# Stops separated by less than this time, s, are one.
_SAME_STOP_S = 1.0


def passes_of_runs(runs: Sequence[CoverRun], tool: Tool, t0_ns: int) -> tuple[CoverPasses, CoverSwaths]:
    """Passes, which are stretches of one swath over which cells counted, and the tool centre's track on each.

    Args:
        runs: runs in order.
        tool: tool that worked.
        t0_ns: UTC origin of times, ns.
    """
    found: list[tuple[float, ...]] = []
    points: list[Float[np.ndarray, "point 3"]] = [np.zeros((0, 3))]
    for number, run in enumerate(runs):
        rows, time_s = run.rows, 1e-9 * (run.utc_ns - t0_ns).astype(np.float64)
        east, north = body_to_local(rows["x_m"], rows["y_m"], rows["yaw_rad"], tool.ahead_m, tool.left_m)
        counts = ((rows["tool"] & ToolBits.COUNTS) != 0) & np.isfinite(east) & np.isfinite(north)
        other = (np.diff(rows["line"]) != 0) | (np.diff(rows["mode"].astype(np.int16)) != 0)
        changes = np.union1d(np.flatnonzero(other) + 1, _holes(run))
        for first, last in _stretches(counts, changes):
            of = slice(first, last + 1)
            way = np.stack([east[of], north[of]], axis=1)
            step_m = np.hypot(*np.diff(way, axis=0).T)
            depth, speed = rows["depth_m"][of].astype(np.float64), rows["speed_mps"][of].astype(np.float64)
            figures = (step_m.sum(), tool.width_m, depth.mean(), depth.min(), speed.mean(), speed.max())
            kept = _thinned(step_m)
            points.append(np.column_stack([np.full(np.count_nonzero(kept), len(found)), way[kept]]))
            found.append((number, rows["line"][first], time_s[first], time_s[last], *figures))
    table = np.array(found, np.float64).reshape(len(found), len(CoverPasses._fields))
    run_of, line, *others = table.T
    swath = np.concatenate(points)
    return (
        CoverPasses(run_of.astype(np.uint16), line.astype(np.int32), *others),
        CoverSwaths(swath[:, 0].astype(np.uint32), swath[:, 1], swath[:, 2]),
    )


def stops_of_runs(runs: Sequence[CoverRun], t0_ns: int) -> CoverStops:
    """Stretches of time with a reason to stop; stretches less than a second apart are merged.

    A stretch that ends before anything was engaged or worked in a run is left out, because the heading is unknown until
    the vehicle has been driven to its start.

    Args:
        runs: runs in order.
        t0_ns: UTC origin of times.
    """
    found: list[tuple[float, ...]] = []
    for number, run in enumerate(runs):
        time_s = 1e-9 * (run.utc_ns - t0_ns).astype(np.float64)
        bits = run.rows["stop"]
        last_end = -np.inf
        under_way = ((run.rows["tool"] & ToolBits.COUNTS) != 0) | np.isin(run.rows["mode"], ENGAGED)
        begun = np.append(np.flatnonzero(under_way), len(bits))[0]
        for first, last in _stretches(bits != 0, _holes(run)):
            if last < begun:
                continue
            reasons = int(np.bitwise_or.reduce(bits[first : last + 1]))
            if time_s[first] - last_end <= _SAME_STOP_S:
                begin = found.pop()
                found.append((*begin[:2], time_s[last], *begin[3:5], int(begin[5]) | reasons))
            else:
                place = run.rows["x_m"][first], run.rows["y_m"][first]
                found.append((number, time_s[first], time_s[last], *place, reasons))
            last_end = time_s[last]
    run_of, begin_s, end_s, east_m, north_m, reason = np.array(found, np.float64).reshape(len(found), 6).T
    return CoverStops(run_of.astype(np.uint16), begin_s, end_s, east_m, north_m, reason.astype(np.uint16))


def _holes(run: CoverRun) -> Int[np.ndarray, " hole"]:
    """Indices of moments that follow a gap of the recording."""
    return np.flatnonzero(np.diff(run.utc_ns) > LONGEST_COVER_STEP_NS) + 1


def _stretches(held: Bool[np.ndarray, " moment"], changes: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last moment of each stretch in which a condition holds, split where a key changes."""
    begins = held & ~np.concatenate([[False], held[:-1]])
    begins[changes] |= held[changes]
    starts = np.flatnonzero(begins)
    ends = np.concatenate([starts[1:], [len(held)]]) if len(starts) else starts
    for start, end in zip(starts, ends, strict=True):
        yield int(start), int(start + np.flatnonzero(held[start:end])[-1])


def _thinned(step_m: Float[np.ndarray, " step"]) -> Bool[np.ndarray, " moment"]:
    """Moments about ``_POINT_M`` of travel apart, including the first and the last."""
    way_m = np.concatenate([[0.0], np.cumsum(step_m)])
    kept = np.concatenate([[True], np.diff(np.floor(way_m / _POINT_M)) > 0.0])
    kept[-1] = True
    return kept


_BLOCK = 256
_OUTLINE_M = 0.01


def record_cover(
    plans: Sequence[PlanFile],
    runs: Sequence[CoverRun],
    *,
    cell_m: float = 0.05,
    levels: Sequence[float] = LEVELS,
    evidence: Evidence | None = None,
    progress: Callable[[int], None] | None = None,
) -> WorkedRecord:
    """The record of a field.

    Cells beyond the perimeter are kept for one tool width, so that work there is visible.

    Args:
        plans: plans of the field; the first defines it, others are for its gaps. All have the same tool. Without a plan
            the perimeter is the convex outline of the tool's passes.
        runs: runs over the field, each by one of the plans or without a plan.
        cell_m: side of a cell.
        levels: levels of confidence at which cells are classified, in rising order.
        evidence: task, people, finds and control points.
        progress: function called with the number of moments done, at intervals.

    Raises:
        InputError: a control point names an unknown run, there is no run, a run is given twice or was driven by another
            plan, the plans are of different fields or tools, or the cells are too small for the field.
    """
    ordered = sorted(runs, key=lambda run: int(run.utc_ns[0]))
    _check_runs(plans, ordered)
    if plans:
        _check_plans(plans)
        plan = plans[0].plan
        ground = _Ground(
            plan.name,
            plan.frame,
            plan.pattern.field,
            plan.tool,
            {"name": plan.vehicle_name, "sha256": plan.vehicle_sha256},
        )
    else:
        ground = _ground_of_runs(ordered)
    ordered = [_in_frame(run, ground.frame) for run in ordered]
    held = Evidence() if evidence is None else evidence
    names = [run.name for run in ordered]
    for number, point in enumerate(held.control_point, start=1):
        if point.run is not None and point.run not in names:
            raise InputError("evidence", f"control_point[{number}].run", "one of " + ", ".join(names), point.run)
    t0_ns = int(ordered[0].utc_ns[0])
    grid = grid_of_field(ground.field, cell_m, ground.tool.width_m)
    best = np.zeros(grid.shape, np.float32)
    for run in ordered:
        shared = shared_error(held.control_point, run.name)
        best = np.maximum(best, probability_of_run(grid, ground.tool, run, progress, shared.sigma_m))
    numbers = whole_down(best)
    kept = numbers / FULL
    t0 = datetime(1970, 1, 1, tzinfo=UTC) + timedelta(microseconds=t0_ns // 1000)
    passes, swaths = passes_of_runs(ordered, ground.tool, t0_ns)
    return WorkedRecord(
        name=ground.name,
        frame=ground.frame,
        perimeter_m=ground.field.perimeter_m,
        tool=ground.tool,
        t0_utc=t0.isoformat(),
        cells=WorkedCells(
            east_m=grid.east_m,
            north_m=grid.north_m,
            cell_m=grid.cell_m,
            probability=numbers,
            level=np.array(levels),
            state=np.stack([cell_states(kept, level) for level in levels]),
        ),
        channels=_channels(ordered, t0_ns),
        passes=passes,
        swaths=swaths,
        stops=stops_of_runs(ordered, t0_ns),
        events=_events(ordered, t0_ns),
        provenance={
            "program": f"lgprjax {__version__}",
            "step": "cover record",
            "plan": None if not plans else told_of_plan(plans[0]),
            "other_plans": [told_of_plan(each) for each in plans[1:]],
            "vehicle": ground.vehicle,
            "runs": [{**run.provenance, "plan_sha256": run.plan_sha256} for run in ordered],
            "combined": "the largest probability of any pass of any run, per cell",
            "evidence": evidence_json(held, names),
        },
    )


def whole_down(probability: Float[np.ndarray, "north east"]) -> UInt16[np.ndarray, "north east"]:
    """Probabilities as whole numbers of 1/65535, rounded down; NaN becomes 0."""
    known = np.clip(np.nan_to_num(np.asarray(probability, np.float64)), 0.0, 1.0)
    return np.floor(known * FULL).astype(np.uint16)


def moments_of_run(run: CoverRun) -> tuple[np.ndarray, ...]:
    """Fields of ``ToolMoment`` over a run, on the host; a gap of the recording gets a non-counting moment."""
    rows = run.rows
    holes = _holes(run)
    on = np.insert((rows["tool"] & ToolBits.COUNTS) != 0, holes, False)
    # A single moment that does not count ends a pass.
    kept = on | np.concatenate([[True], on[:-1]])

    def filled(name: str) -> np.ndarray:
        values = np.asarray(rows[name], np.float32)
        return np.asarray(np.insert(values, holes, values[holes], axis=0)[kept])

    return *(filled(name) for name in ToolMoment._fields[:-1]), on[kept]


def probability_of_run(
    grid: CellGrid,
    tool: Tool,
    run: CoverRun,
    progress: Callable[[int], None] | None,
    shared_sigma_m: float,
) -> Float[np.ndarray, "north east"]:
    """The worked map of one run, computed by the step that keeps the map on board."""
    shared = jnp.float32(shared_sigma_m)
    moments = moments_of_run(run)
    count, state = len(moments[-1]), init_worked(grid)
    if progress is not None:
        progress(len(run.rows) - count)
    for start in range(0, count, _BLOCK):
        block = [each[start : start + _BLOCK] for each in moments]
        short = _BLOCK - len(block[0])
        # Padded with non-counting moments, so that one compiled size serves every run.
        full = [np.concatenate([each, np.repeat(each[-1:], short, axis=0)]) for each in block]
        full[-1] &= np.arange(_BLOCK) < _BLOCK - short
        state = run_worked(grid, tool, state, ToolMoment(*(jnp.asarray(each) for each in full)), shared)
        jax.block_until_ready(state.probability)
        if progress is not None:
            progress(min(_BLOCK, count - start))
    return np.asarray(state.probability)


class _Ground(NamedTuple):
    """Field, frame, tool and vehicle of a record."""

    name: str
    frame: LocalFrame
    field: Field
    tool: Tool
    vehicle: dict[str, str]


def told_of_plan(plan: PlanFile) -> dict[str, str]:
    """File name and SHA-256 of a plan, for the provenance."""
    return {"file": plan.path.name, "sha256": plan.sha256}


def _ground_of_runs(runs: Sequence[CoverRun]) -> _Ground:
    """Ground of runs without a plan: the convex outline of their passes, in the frame of the first run.

    Raises:
        InputError: no moment of any run counted.
    """
    first = runs[0].without_plan
    assert first is not None
    tool, corners = first.tool, [np.zeros((0, 2))]
    for run in runs:
        rows = _in_frame(run, first.frame).rows
        rows = rows[(rows["tool"] & ToolBits.COUNTS) != 0]
        for ahead, left in ((-0.5, -0.5), (-0.5, 0.5), (0.5, 0.5), (0.5, -0.5)):
            at = (tool.ahead_m + ahead * tool.length_m, tool.left_m + left * tool.width_m)
            corners.append(np.stack(body_to_local(rows["x_m"], rows["y_m"], rows["yaw_rad"], *at), axis=1))
    places = np.concatenate(corners)
    outline = shapely.MultiPoint(places[np.isfinite(places).all(axis=1)]).convex_hull.simplify(_OUTLINE_M)
    if outline.geom_type != "Polygon":
        raise InputError(runs[0].name, "cover", "moments at which the tool worked, with a known heading", "none")
    # A centimetre more, for what the simplification cut off.
    ring = np.asarray(outline.buffer(_OUTLINE_M, join_style="mitre").exterior.coords)[:-1]
    return _Ground("no plan", first.frame, field_of_polygon(ring, name=runs[0].name), tool, first.vehicle)


def _check_plans(plans: Sequence[PlanFile]) -> None:
    """Refuse plans with different anchors, whose cells do not coincide."""
    first = plans[0].plan
    for path, _, plan in plans[1:]:
        if plan.frame != first.frame or plan.tool != first.tool:
            expected = f"anchor and tool of {plans[0].path.name} (made by lgprjax cover plan --gaps from its record)"
            raise InputError(path, "plan", expected, "others")


def _check_runs(plans: Sequence[PlanFile], runs: Sequence[CoverRun]) -> None:
    if not runs:
        raise InputError(plans[0].path if plans else "runs", "runs", "at least one recorded run", "none")
    known = {plan.sha256 for plan in plans}
    tool = plans[0].plan.tool if plans else None if runs[0].without_plan is None else runs[0].without_plan.tool
    seen: dict[str, str] = {}
    for run in runs:
        if run.without_plan is not None:
            if run.without_plan.tool != tool:
                whose = plans[0].path.name if plans else runs[0].name
                raise InputError(run.name, "tool", f"the tool of {whose}, {tool}", f"{run.without_plan.tool}")
        elif run.plan_sha256 not in known:
            expected = "a run by this plan, by another one given with --plan, or without a plan"
            found = "none named by the run" if run.plan_sha256 is None else f"the plan {run.plan_sha256[:12]}..."
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
        # The newest earlier moment; before the first one the position is unknown.
        before = np.searchsorted(run.utc_ns, utc_ns, side="right") - 1
        place = np.stack([run.rows["x_m"][before], run.rows["y_m"][before]], axis=1)
        time_s.append(_seconds(utc_ns, t0_ns))
        places.append(np.where(before[:, None] >= 0, place, np.nan))
        text += [event.text for event in run.events]
    east_m, north_m = np.concatenate(places).T
    return CoverEvents(number, np.concatenate(time_s), east_m, north_m, tuple(text))
