"""Evaluation of a simulated run: true poses of the devices against the recording of the runtime."""

import json
import math
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

if TYPE_CHECKING:
    from lgprjax.report import TimingPicture
    from lgprjax.runtime.config import RuntimeConfig


# Latency from scan to command in the recording of a run.

ENGAGED = (3, 4)
"""Modes in which the autopilot steers."""
COMMAND_MS = 100.0
"""Limit of the time from the start of a scan to the resulting command."""
_MOVING_MPS = 0.1
_SCANS = (0x12, 0x15)
"""Frame types radar_scan and radar_sweep; see data_schema/wire.toml."""


class RunRecords(NamedTuple):
    """Records of a run; times in nanoseconds of the computer's monotonic clock.

    Attributes:
        scans: number of scans received from the radar.
        tick_ns: start times of the ticks of the control loop.
        plans, plan_ns: decisions of the ticks (``runtime.records.PLAN``), and their times.
        fixes, fix_ns: fixes of the registered scans (``runtime.records.FIX``), and the times when they were ready.
        used_ns: for every command with a fix, start of the scan and start of the tick.
        memory: seconds, and MB of all processes.
    """

    scans: int
    tick_ns: Int[np.ndarray, " tick"]
    plans: np.ndarray
    plan_ns: Int[np.ndarray, " plan"]
    fixes: np.ndarray
    fix_ns: Int[np.ndarray, " fix"]
    used_ns: Int[np.ndarray, "used 2"]
    memory: Float[np.ndarray, "moment 2"]

    @property
    def period_ms(self) -> Float[np.ndarray, " step"]:
        """Period of the control loop."""
        return np.asarray(np.diff(self.tick_ns) / 1e6)

    @property
    def fix_ms(self) -> Float[np.ndarray, " fix"]:
        """Time from the start of a scan to its fix, while tracking."""
        scan_ns = self.fixes["scan_ns"]
        return np.asarray((self.fix_ns - scan_ns)[self.tracking(scan_ns)] / 1e6)

    @property
    def command_ms(self) -> Float[np.ndarray, " command"]:
        """Time from the start of a scan to the start of the tick that uses its fix, while tracking."""
        scan_ns, begin_ns = self.used_ns.T
        return np.asarray((begin_ns - scan_ns)[self.tracking(scan_ns)] / 1e6)

    def tracking(self, time_ns: Int[np.ndarray, " time"]) -> Bool[np.ndarray, " time"]:
        """Whether the vehicle was engaged and moving."""
        if not len(self.plans):
            return np.zeros(len(time_ns), bool)
        on = np.isin(self.plans["mode"], ENGAGED) & (np.abs(self.plans["speed_mps"]) > _MOVING_MPS)
        return np.asarray(on[np.clip(np.searchsorted(self.plan_ns, time_ns), 0, len(on) - 1)])


def read_records(folder: Path) -> RunRecords:
    """Read the records of a run.

    Raises:
        InputError: the folder has no recording.
    """
    from lgprjax.formats import read_run
    from lgprjax.run_records import FIX, PLAN, RecordKind, Source, fix_row, unpack

    begun: dict[int, int] = {}
    ticks, plan_ns, fix_ns = [], [], []
    plans, fixes = [], []
    used: list[tuple[int, int]] = []
    memory: list[tuple[float, float]] = []
    scans = 0
    for _, data in read_run(folder):
        record = unpack(data)
        if record.kind is RecordKind.TICK:
            begun[record.tick] = record.mono_ns
            ticks.append(record.mono_ns)
        elif record.kind is RecordKind.PLAN:
            plans.append(np.frombuffer(record.payload, PLAN)[0])
            plan_ns.append(record.mono_ns)
        elif record.kind is RecordKind.FIX and record.tick == 0:
            fixes.append(fix_row(record.payload))
            fix_ns.append(record.mono_ns)
        elif record.kind is RecordKind.FIX:
            used.append((int(fix_row(record.payload)["scan_ns"]), record.tick))
        elif record.kind is RecordKind.PORT_IN and record.source is Source.RADAR:
            scans += record.payload[3] in _SCANS
        elif record.kind is RecordKind.MONITOR and record.tick > 0:
            held = [value for value in json.loads(record.payload).get("rss_mb", {}).values() if value is not None]
            memory.append((record.mono_ns / 1e9, float(sum(held))))
    return RunRecords(
        scans=scans,
        tick_ns=np.array(ticks, np.int64),
        plans=np.array(plans, PLAN),
        plan_ns=np.array(plan_ns, np.int64),
        fixes=np.array(fixes, FIX),
        fix_ns=np.array(fix_ns, np.int64),
        used_ns=np.array([(scan_ns, begun[tick]) for scan_ns, tick in used if tick in begun], np.int64).reshape(-1, 2),
        memory=np.array(memory, np.float64).reshape(-1, 2),
    )


def timing_of(records: RunRecords, title: str) -> "TimingPicture":
    """Times of a run, for the picture."""
    from lgprjax.report import StageTimes, TimingPicture

    return TimingPicture(
        title=title,
        stages=(
            StageTimes("scan to fix", records.fix_ms),
            StageTimes("scan to command", records.command_ms, COMMAND_MS),
            StageTimes("control period", records.period_ms),
        ),
        note=(
            f"{records.scans} scans, {len(records.fixes)} registered. Times run from the start of a scan to its fix, "
            "or to the start of the tick with the command, while engaged and moving; the control period covers the run."
        ),
    )


_FOOT_M = 0.3048


def figures_of(records: RunRecords, folder: Path) -> dict[str, Any]:
    """Figures of the records of a run, and of the true poses in its folder.

    Scan to command: time from the start of a scan to the start of the tick that uses its fix.
    """
    from lgprjax.registration import Code

    figures: dict[str, Any] = {
        "ticks": len(records.tick_ns),
        "scans": records.scans,
        "searched": len(records.fixes),
    }
    found = records.fixes
    on = records.tracking(found["scan_ns"])
    if on.any():
        # Scans between the stops of a search have no fix.
        stops = found["code"][on & (found["code"] != Code.NO_WINDOW)]
        figures["ok_share"] = float(np.mean(stops == Code.OK)) if len(stops) else 0.0
        figures["most_waiting"] = int(found["waiting"][on].max())
        gaps = np.diff(found["scan"].astype(np.int64))[on[1:] & on[:-1]]
        figures["largest_gap_scans"] = int(gaps.max(initial=1))
        figures["missed_scans"] = int(np.sum(gaps - 1))
    for name, values, shares in (
        ("period", records.period_ms, (("p50", 50.0), ("p99", 99.0), ("p99_9", 99.9), ("largest", 100.0))),
        ("scan_to_command", records.command_ms, (("p50", 50.0), ("p99", 99.0), ("largest", 100.0))),
    ):
        if len(values):
            figures |= {f"{name}_{word}_ms": float(np.percentile(values, share)) for word, share in shares}
    figures |= _memory(records.memory)
    modes = records.plans["mode"].astype(int)
    figures["modes"] = {str(mode): int(np.sum(modes == mode)) for mode in np.unique(modes)}
    truth = folder / "truth.npz"
    if truth.exists() and len(modes):
        figures |= _against_truth(truth, records.plan_ns, modes)
    return figures


def _memory(memory: Float[np.ndarray, "moment 2"]) -> dict[str, float]:
    """Memory of all processes, and its growth in the second half of the run, when the buffers are full."""
    settled = memory[len(memory) // 2 :]
    if len(settled) < 60:
        return {}
    slope = np.polyfit(settled[:, 0] - settled[0, 0], settled[:, 1], 1)[0]
    return {"memory_mb": float(settled[-1, 1]), "memory_growth_mb_per_h": float(3600.0 * slope)}


def _against_truth(path: Path, plan_ns: Int[np.ndarray, " plan"], modes: Int[np.ndarray, " plan"]) -> dict[str, Any]:
    with np.load(path) as truth:
        mono = truth["mono_ns"]
        cross, way = (
            np.asarray(truth["cross_m"], np.float64),
            np.hypot(np.diff(truth["x_m"], prepend=truth["x_m"][0]), np.diff(truth["y_m"], prepend=truth["y_m"][0])),
        )
        told = {name: float(truth[name]) for name in ("cpu_s", "render_s", "late_ticks") if name in truth}
        seconds = float(mono[-1] - mono[0]) / 1e9
    at = np.clip(np.searchsorted(plan_ns, mono) - 1, 0, len(modes) - 1)
    on = np.isin(modes[at], ENGAGED)
    figures: dict[str, Any] = {f"devices_{name}": value for name, value in told.items()}
    # In lock step the processor time of the devices is not measured.
    if "cpu_s" in told:
        figures["devices_cpu_share"] = told["cpu_s"] / max(seconds, 1e-9)
    if on.any():
        weight = way[on] / max(way[on].sum(), 1e-9)
        figures["engaged_way_m"] = float(way[on].sum())
        figures["tracking_rms_m"] = float(np.sqrt(np.sum(cross[on] ** 2 * weight)))
        figures["tracking_largest_m"] = float(np.abs(cross[on]).max())
        figures["within_foot"] = float(np.sum(weight * (np.abs(cross[on]) <= _FOOT_M)))
    return figures


# Figures of a run in a field.

_SPEED = 4


def field_figures(folder: Path, config: "RuntimeConfig") -> dict[str, Any]:
    """Figures of a run: true poses of the simulated devices against the recording of the runtime.

    Tracking and estimation errors are evaluated while the plan is driven.

    Raises:
        InputError: a file of the run cannot be used.
    """
    from lgprjax.formats import read_run
    from lgprjax.run_records import COVER, SKID_PLAN, RecordKind, unpack
    from lgprjax.runtime.control.skid.setup import load_skid

    ticks: list[int] = []
    plans: list[tuple[int, np.void]] = []
    covers: list[tuple[int, np.void]] = []
    for _, data in read_run(folder):
        record = unpack(data)
        if record.kind is RecordKind.TICK:
            ticks.append(record.mono_ns)
        elif record.kind is RecordKind.SKID_PLAN:
            plans.append((record.mono_ns, np.frombuffer(record.payload, SKID_PLAN)[0]))
        elif record.kind is RecordKind.COVER:
            covers.append((record.mono_ns, np.frombuffer(record.payload, COVER)[0]))
    figures: dict[str, Any] = {"ticks": len(ticks)}
    period = np.diff(np.array(ticks, np.float64)) / 1e6
    if len(period):
        shares = (("p50", 50.0), ("p99", 99.0), ("p99_9", 99.9), ("largest", 100.0))
        figures |= {f"period_{name}_ms": float(np.percentile(period, share)) for name, share in shares}
    if not plans:
        return figures
    rows = np.array([row for _, row in plans], SKID_PLAN)
    figures["modes"] = {str(mode): int(np.sum(rows["mode"] == mode)) for mode in np.unique(rows["mode"])}
    drives = rows["mode"] == _SPEED
    loaded = load_skid(config)
    figures["passes"], figures["passes_driven"] = loaded.lines, _passes(rows, drives)
    figures["times_taken_over"] = int(np.sum(np.diff(drives.astype(int)) == -1))
    # The vehicle passes the end by some centimetres.
    figures["to_go_m"] = max(float(rows["to_go_m"][drives][-1]), 0.0) if drives.any() else math.nan
    truth = folder / "truth.npz"
    if truth.exists() and drives.any():
        times_ns = np.array([time_ns for time_ns, _ in plans])
        figures |= _field_against_truth(truth, times_ns[drives], rows[drives])
    if covers and loaded.name is not None:
        figures |= _worked(config, covers)
    return figures


def _passes(rows: np.ndarray, drives: np.ndarray) -> int:
    """Number of swaths driven to their end."""
    lines = rows["line"][drives & (rows["line"] >= 0)]
    if not len(lines):
        return 0
    ended = bool(rows["to_go_m"][drives][-1] < 1.0)
    return len(np.unique(lines)) - (0 if ended else 1)


def _field_against_truth(path: Path, times_ns: np.ndarray, rows: np.ndarray) -> dict[str, float]:
    with np.load(path) as truth:
        at = {name: np.interp(times_ns, truth["mono_ns"], truth[name]) for name in ("x_m", "y_m", "yaw_rad")}
        fixed = np.interp(times_ns, truth["mono_ns"], truth["gnss_on"]) > 0.5
        told = {f"devices_{name}": float(truth[name]) for name in ("cpu_share", "late_ticks") if name in truth}
    pose = rows["pose"]
    off = pose[:, :2] - np.stack([at["x_m"], at["y_m"]], axis=1)
    turned = np.degrees((pose[:, 2] - at["yaw_rad"] + np.pi) % (2.0 * np.pi) - np.pi)
    # To the left of travel: the route's own direction is the estimate's minus its error.
    way = pose[:, 2] - rows["heading_error_rad"]
    cross = rows["cross_m"] - (np.cos(way) * off[:, 1] - np.sin(way) * off[:, 0])
    line = rows["line"] >= 0
    nees = (
        np.concatenate([off, np.radians(turned)[:, None]], axis=1) ** 2 / np.maximum(rows["sigma"], 1e-9) ** 2
    ).mean(axis=0)
    figures = {
        "position_rms_fixed_m": _rms(np.hypot(*off[fixed].T)),
        "position_rms_m": _rms(np.hypot(*off.T)),
        "position_largest_m": float(np.hypot(*off.T).max()),
        "cross_track_rms_fixed_m": _rms(cross[line & fixed]),
        "cross_track_rms_m": _rms(cross[line]),
        "cross_track_largest_m": float(np.abs(cross[line]).max()) if line.any() else math.nan,
        "heading_rms_deg": _rms(turned),
        "heading_largest_deg": float(np.abs(turned).max()),
        "share_fixed": float(np.mean(fixed)),
    }
    squares = {
        f"squared_error_over_variance_{name}": float(value) for name, value in zip(("x", "y", "yaw"), nees, strict=True)
    }
    return {**figures, **squares, **told}


def _worked(config: "RuntimeConfig", covers: "list[tuple[int, np.void]]") -> dict[str, float]:
    """Share of the field processed at 95 %, by the rule of the coverage map, earlier runs included."""
    from lgprjax.coverage import CellState, cell_states, grid_of_field, inside_cells
    from lgprjax.coverage.field import Field
    from lgprjax.runtime.control.skid.setup import load_skid
    from lgprjax.runtime.coverage.worked_map import WorkedMap

    assert config.coverage is not None
    loaded = load_skid(config)
    field = Field(loaded.perimeter_m)
    grid = grid_of_field(field, config.coverage.cell_m, loaded.setup.tool.width_m)
    held = WorkedMap(grid, loaded.setup.tool, config.coverage.shared_sigma_m)
    if loaded.taken_up is not None:
        held.take_up(loaded.taken_up.grid, loaded.taken_up.probability)
    for time_ns, cover in covers:
        held.take(cover, time_ns)
    inside = inside_cells(field, grid)
    states = cell_states(held.probability(), 0.95)[inside]
    return {
        "worked_share_95": float(np.mean(states == CellState.PROCESSED)),
        "not_worked_share_95": float(np.mean(states == CellState.NOT_PROCESSED)),
    }


def _rms(values: "Float[np.ndarray, '...']") -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else math.nan
