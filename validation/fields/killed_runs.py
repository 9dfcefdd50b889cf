"""Runs of a field that are cut off at random moments and taken up with ``--resume``.

The vehicle's own control loop drives, recordings end torn, and the record of all of them is held against where the tool
truly was.
"""

import struct
from pathlib import Path
from typing import NamedTuple
from uuid import UUID

import numpy as np
from jaxtyping import Bool, Float

from canon.field import BEHIND_M, CONFIG, FRAME, VEHICLE
from canon.field_loop import BEGIN_NS, FieldLoop
from formats.run_log_sample import RUN, head_bytes, own_bytes, record_bytes
from lgprjax.autopilot import Mode
from lgprjax.cli.run import Run
from lgprjax.coverage import CellState, Tool, inside_cells
from lgprjax.coverage.swaths import Line
from lgprjax.frames import body_to_local
from lgprjax.run_records import Record, RecordKind, ToolBits
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.control.program import header_record
from lgprjax.runtime.control.skid.setup import SkidLoaded, load_skid
from lgprjax.worked.layers import grid_of
from lgprjax.worked.plans import PlanOptions, make_cover_plan, open_cover_plan, save_cover_plan
from lgprjax.worked.record import read_cover_run, record_cover
from lgprjax.worked.resume import runs_by_plan
from true_cells import true_cells

_CELL_M = 0.1
_UTC_NS = 1_800_000_000_000_000_000
_LOST_S = 0.4
"""The recorder has its file on the disk every 0.2 s; a busy disk may take as long again."""


class Session(NamedTuple):
    """What one run came to.

    Attributes:
        poses: true ones of the reference point, a row a tick; on: whether the tool truly worked.
        recorded, counted: moments that counted, in the recording and before its end was torn off.
        done: the plan's end was reached.
    """

    poses: Float[np.ndarray, "tick 3"]
    on: Bool[np.ndarray, " tick"]
    recorded: int
    counted: int
    done: bool


def make_plan(folder: Path, length_m: float, width_m: float) -> Path:
    """Field, plan and configuration; the configuration's path."""
    corners = np.array([[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m]])
    latitude, longitude, _ = FRAME.to_geodetic(corners[:, 0], corners[:, 1], np.zeros(4))
    rows = "\n".join(f"{each[0]:.12f},{each[1]:.12f}" for each in zip(latitude, longitude, strict=True))
    (folder / "f.csv").write_text(f"latitude_deg,longitude_deg\n{rows}\n", encoding="utf-8")
    plan = make_cover_plan(folder / "f.csv", VEHICLE, PlanOptions(order="boustrophedon", confidence=0.95))
    assert plan is not None
    save_cover_plan(folder / "f.cover.geojson", plan)
    more = f'plan = "f.cover.geojson"\ncell_m = {_CELL_M}'
    (folder / "f.run.toml").write_text(
        CONFIG.replace("PLAN", more) + '[recording]\nfolder = "runs"\n', encoding="utf-8"
    )
    return folder / "f.run.toml"


def drive(config: RuntimeConfig, loaded: SkidLoaded, number: int, kill_after_s: float | None) -> tuple[Session, bytes]:
    """A run until it is killed so many seconds after it was engaged, or the plan's end; the second is its recording."""
    x, y, yaw = (float(each) for each in np.asarray(loaded.route.rows[0, :3], np.float64))
    pose = (x - BEHIND_M * np.cos(yaw), y - BEHIND_M * np.sin(yaw), yaw)
    # The operator brings the vehicle behind the place and drives straight towards it, which finds the heading.
    script = [
        {"at_s": 0.2, "do": "drive_to", "x_m": x, "y_m": y, "speed_mps": 0.7},
        {"at_arrival": 1, "do": "press", "button": "steering", "for_s": 0.3},
        {"after": {"mode": int(Mode.STEERING), "for_s": 0.6}, "do": "press", "button": "plus", "for_s": 0.3},
    ]
    loop = FieldLoop(config, loaded, pose, script, [], seed=100 + number)
    assert loop.run(60.0, lambda at: at.mode is Mode.SPEED), loop.events[-5:]
    limit_s = 6.0 * float(loaded.route.length_m) if kill_after_s is None else kill_after_s
    done = loop.run(limit_s, lambda at: at.mode is not Mode.SPEED)
    assert done == (float(loop.rows[-1]["to_go_m"]) < 1.0), loop.events[-5:]
    truth = loop.stage.truth.arrays()
    on = (truth["turns"] > 0.5) & (np.abs(truth["depth_m"] - loaded.belief.depth_m) <= loaded.belief.tolerance_m)
    poses = np.stack([truth[name] for name in ("x_m", "y_m", "yaw_rad")], axis=1)
    kept, counted = _recording(config, loaded, loop, number, torn=not done)
    return Session(poses, on, 0, counted, done), kept


def _recording(
    config: RuntimeConfig, loaded: SkidLoaded, loop: FieldLoop, number: int, *, torn: bool
) -> tuple[bytes, int]:
    """The segment as the recorder would have left it, and how many moments had counted."""
    rng = np.random.default_rng(number)
    run = UUID(int=RUN.int ^ number)
    header = header_record(config, loaded, 77, BEGIN_NS, after_death=False)
    told = [(BEGIN_NS, _packed(header))]
    counted = 0
    for time_ns, row in loop.covers:
        counted += int(bool(int(row["tool"]) & ToolBits.COUNTS))
        told.append((time_ns, _packed(Record(RecordKind.COVER, header.source, 1, time_ns, row.tobytes()))))
    end_ns = told[-1][0] - (int(1e9 * rng.uniform(0.0, _LOST_S)) if torn else 0)
    parts = [
        head_bytes(0, 0, utc_ns=_UTC_NS + number * 10**14, mono_ns=BEGIN_NS, run=run),
        own_bytes(0, run=run, dropped={"control_log": 0}),
    ]
    parts += [record_bytes(at + 1, data, run=run) for at, (time_ns, data) in enumerate(told) if time_ns <= end_ns]
    whole = b"".join(parts)
    return (whole[: len(whole) - int(rng.integers(1, len(parts[-1])))] if torn else whole), counted


def _packed(record: Record) -> bytes:
    head = struct.pack("<BBHIQ", record.kind, record.source, 0, record.tick, record.mono_ns)
    return head + record.payload


def _extent_m(line: Line, tool: Tool, rows: np.ndarray) -> tuple[float, float]:
    """From where to where along a line the tool's rectangle was."""
    along = (line.end_m - line.start_m) / line.length_m
    east, north = body_to_local(rows["x_m"], rows["y_m"], rows["yaw_rad"], tool.ahead_m, tool.left_m)
    ahead_m = (np.stack([east, north], axis=1) - line.start_m) @ along
    return float(ahead_m.min()) - 0.5 * tool.length_m, float(ahead_m.max()) + 0.5 * tool.length_m


def work_through(folder: Path, length_m: float, width_m: float, *, kills: int, seed: int) -> str:
    """A field worked by runs of which the first ones are cut off; what came of it, in a line."""
    file = make_plan(folder, length_m, width_m)
    plan = open_cover_plan(folder / "f.cover.geojson")
    rng = np.random.default_rng(seed)
    config = read_config(file)
    session_s = float(load_skid(config).route.length_m) / (kills + 1) / 0.4
    sessions: list[Session] = []
    for number in range(3 * kills + 3):
        run_folder = folder / "runs" / f"f-{number:03d}"
        at = Run(file, resume=bool(number))._resumed(config, run_folder)
        loaded = load_skid(at)
        kill_s = float(rng.uniform(0.2, 1.2)) * session_s if number < kills else None
        session, recording = drive(at, loaded, number, kill_s)
        run_folder.mkdir(parents=True, exist_ok=True)
        (run_folder / "0000.lgprun").write_bytes(recording)
        run = read_cover_run(run_folder)
        sessions.append(session._replace(recorded=int(np.count_nonzero(run.rows["tool"] & ToolBits.COUNTS))))
        if session.done:
            break
    runs = runs_by_plan(folder / "runs", plan)
    assert len(runs) == len(sessions) == kills + 1

    # What was torn off is at most what a disk may lose, at ten moments a second.
    lost = [each.counted - each.recorded for each in sessions]
    assert min(lost) >= 0
    assert max(lost) <= 10 * _LOST_S + 2

    record = record_cover([plan], runs, cell_m=_CELL_M)
    grid, pattern, tool = grid_of(record), plan.plan.pattern, plan.plan.tool
    over = np.any([true_cells(grid, tool, each.poses, each.on) for each in sessions], axis=0)
    inside = inside_cells(pattern.field, grid)
    claimed = [state == CellState.PROCESSED for state in record.cells.state]

    # Of each line, how often each centimetre was under the tool of a run while it counted.
    repeated_m = omitted_m = 0.0
    for number, line in enumerate(pattern.lines):
        times = np.zeros(round(100.0 * line.length_m), np.int64)
        for run in runs:
            rows = run.rows[((run.rows["tool"] & ToolBits.COUNTS) != 0) & (run.rows["line"] == number)]
            if len(rows):
                low_m, high_m = _extent_m(line, tool, rows)
                times[max(round(100.0 * low_m), 0) : round(100.0 * high_m)] += 1
        repeated_m += 0.01 * float(np.sum(np.maximum(times - 1, 0)))
        omitted_m += 0.01 * float(np.sum(times == 0))
    way_m = sum(line.length_m for line in pattern.lines)
    shares = [round(100.0 * float(np.mean(each[inside])), 3) for each in claimed]
    false = [int(np.sum(each & ~over)) for each in claimed]
    told = (
        f"{len(runs)} runs over {way_m:.0f} m of lines: {sum(lost)} counted moments lost with torn ends, "
        f"{repeated_m:.2f} m driven twice ({repeated_m / kills:.2f} m a kill), {omitted_m:.2f} m by no run; "
        f"processed {shares} %, of the claimed cells {false} false; "
        f"claimed {0.01 * np.sum(claimed[0]):.1f} m2, truly worked {0.01 * np.sum(over):.1f} m2"
    )
    assert repeated_m < 2.0 * kills
    assert omitted_m < 0.05
    assert false == [0, 0]
    assert np.mean(claimed[0][inside]) > 0.999
    return told
