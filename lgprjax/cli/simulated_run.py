"""Evaluation of a simulated run: true poses of the devices against the recording of the runtime."""

import json
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int
from rich.table import Table

from lgprjax.cli.terminal import console

if TYPE_CHECKING:
    from lgprjax.report import TimingPicture


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


_SHOWN: tuple[tuple[str, str, float, tuple[str, ...]], ...] = (
    ("control ticks", "{:.0f}", 1.0, ("ticks",)),
    ("control period, median", "{:.1f} ms", 1.0, ("period_p50_ms",)),
    (
        "control period: p99, p99.9, max",
        "{:.1f} ms",
        1.0,
        ("period_p99_ms", "period_p99_9_ms", "period_largest_ms"),
    ),
    ("scans: received, registered", "{:.0f}", 1.0, ("scans", "searched")),
    ("scans: missed while tracking", "{:.0f}", 1.0, ("missed_scans",)),
    ("longest gap between fixes", "{:.0f} scans", 1.0, ("largest_gap_scans",)),
    ("longest queue", "{:.0f} scans", 1.0, ("most_waiting",)),
    ("ok fixes, share of search stops", "{:.2f} %", 100.0, ("ok_share",)),
    ("scan to command, median", "{:.1f} ms", 1.0, ("scan_to_command_p50_ms",)),
    ("scan to command: p99, max", "{:.1f} ms", 1.0, ("scan_to_command_p99_ms", "scan_to_command_largest_ms")),
    ("memory of all processes", "{:.0f} MB", 1.0, ("memory_mb",)),
    ("memory growth in the second half", "{:.0f} MB/h", 1.0, ("memory_growth_mb_per_h",)),
    ("simulated devices: processor time, rendering", "{:.1f} s", 1.0, ("devices_cpu_s", "devices_render_s")),
    ("simulated devices: share of one core", "{:.1f} %", 100.0, ("devices_cpu_share",)),
    ("simulated devices: late ticks", "{:.0f}", 1.0, ("devices_late_ticks",)),
    ("distance engaged", "{:.1f} m", 1.0, ("engaged_way_m",)),
    ("cross-track error from the baseline: RMS, max", "{:.1f} cm", 100.0, ("tracking_rms_m", "tracking_largest_m")),
    ("distance within 1 ft of the baseline", "{:.2f} %", 100.0, ("within_foot",)),
    ("swaths: planned, completed", "{:.0f}", 1.0, ("passes", "passes_driven")),
    ("operator overrides", "{:.0f}", 1.0, ("times_taken_over",)),
    ("distance to go", "{:.1f} m", 1.0, ("to_go_m",)),
    ("time with a GNSS position", "{:.1f} %", 100.0, ("share_fixed",)),
    ("position error with GNSS: RMS", "{:.1f} cm", 100.0, ("position_rms_fixed_m",)),
    ("position error: RMS, max", "{:.1f} cm", 100.0, ("position_rms_m", "position_largest_m")),
    ("cross-track error with GNSS: RMS", "{:.1f} cm", 100.0, ("cross_track_rms_fixed_m",)),
    ("cross-track error: RMS, max", "{:.1f} cm", 100.0, ("cross_track_rms_m", "cross_track_largest_m")),
    ("heading error: RMS, max", "{:.2f}°", 1.0, ("heading_rms_deg", "heading_largest_deg")),
    (
        "squared error over variance: x, y, yaw",
        "{:.2f}",
        1.0,
        tuple(f"squared_error_over_variance_{name}" for name in ("x", "y", "yaw")),
    ),
    (
        "share of the field at 95 %: processed, not processed",
        "{:.1f} %",
        100.0,
        ("worked_share_95", "not_worked_share_95"),
    ),
)
"""Rows of the table: label, number format, factor, names of the figures."""


def figure_rows(figures: dict[str, Any]) -> list[tuple[str, str]]:
    """Labels and values with units, of the figures that the run has."""
    from lgprjax.autopilot import Mode

    rows = []
    for words, form, scale, names in _SHOWN:
        found = [figures[name] for name in names if name in figures]
        if found:
            rows.append((words, ", ".join(form.format(scale * value) for value in found)))
    modes = figures.get("modes", {})
    ticks = max(sum(modes.values()), 1)
    shares = [f"{Mode(int(mode)).name} {100.0 * count / ticks:.1f} %" for mode, count in modes.items()]
    return [*rows, ("share of time per mode", ", ".join(shares))] if shares else rows


def print_figures(figures: dict[str, Any], folder: Path) -> None:
    """Print as a table."""
    table = Table("simulated run", "value", title=str(folder))
    for row in figure_rows(figures):
        table.add_row(*row)
    console.print(table, highlight=False, markup=False)
