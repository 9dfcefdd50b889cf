"""What a simulated run was worth: the truth of the devices against the recording of the runtime."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from lgprjax.cli.progress import console

_FOOT_M = 0.3048
_ENGAGED = (3, 4)


def figures_of(folder: Path) -> dict[str, Any]:
    """Figures of a run's folder.

    Scan to command: from a scan's start to the begin of the tick that commands with its fix.
    """
    from lgprjax.formats import read_run
    from lgprjax.registration import Code
    from lgprjax.runtime.records import FIX, PLAN, Kind, Source, unpack

    ticks: list[tuple[int, int]] = []
    plans: list[np.void] = []
    plan_ns: list[int] = []
    fixes: list[np.void] = []
    used: list[tuple[int, int]] = []
    scans = 0
    memory: list[tuple[float, float]] = []
    for _, data in read_run(folder):
        record = unpack(data)
        if record.kind is Kind.TICK:
            ticks.append((record.tick, record.mono_ns))
        elif record.kind is Kind.PLAN:
            plans.append(np.frombuffer(record.payload, PLAN)[0])
            plan_ns.append(record.mono_ns)
        elif record.kind is Kind.FIX and record.tick == 0:
            fixes.append(np.frombuffer(record.payload, FIX)[0])
        elif record.kind is Kind.FIX:
            fix = np.frombuffer(record.payload, FIX)[0]
            used.append((record.tick, int(fix["scan_ns"])))
        elif record.kind is Kind.PORT_IN and record.source is Source.RADAR:
            scans += record.payload[3] == 0x12
        elif record.kind is Kind.MONITOR and record.tick > 0:
            held = [value for value in json.loads(record.payload).get("rss_mb", {}).values() if value is not None]
            memory.append((record.mono_ns / 1e9, float(sum(held))))
    figures: dict[str, Any] = {"ticks": len(ticks), "scans": scans, "searched": len(fixes)}
    modes = np.array([int(plan["mode"]) for plan in plans])
    speeds = np.array([abs(float(plan["speed_mps"])) for plan in plans])
    # What is told of the search is told of tracking: engaged, and moving.
    tracking = np.isin(modes, _ENGAGED) & (speeds > 0.1)

    def tracked(scan_ns: np.ndarray) -> np.ndarray:
        return tracking[np.clip(np.searchsorted(plan_ns, scan_ns), 0, len(plan_ns) - 1)]

    if fixes and len(plans):
        found = np.array(fixes, FIX)
        on = tracked(found["scan_ns"])
        if on.any():
            figures["ok_share"] = float(np.mean(found["code"][on] == Code.OK))
            figures["most_waiting"] = int(found["waiting"][on].max())
            gaps = np.diff(found["scan"].astype(np.int64))[on[1:] & on[:-1]]
            figures["largest_gap_scans"] = int(gaps.max(initial=1))
            figures["missed_scans"] = int(np.sum(gaps - 1))
    period = np.diff([mono for _, mono in ticks]) / 1e6
    if len(period):
        for name, share in (("p50", 50.0), ("p99", 99.0), ("p99_9", 99.9), ("largest", 100.0)):
            figures[f"period_{name}_ms"] = float(np.percentile(period, share))
    begun = dict(ticks)
    late = np.array([(begun[tick] - scan_ns) / 1e6 for tick, scan_ns in used if tick in begun])
    if len(late) and len(plans):
        late = late[tracked(np.array([scan_ns for tick, scan_ns in used if tick in begun]))]
    if len(late):
        for name, share in (("p50", 50.0), ("p99", 99.0), ("largest", 100.0)):
            figures[f"scan_to_command_{name}_ms"] = float(np.percentile(late, share))
    figures |= _memory(memory)
    figures["modes"] = {str(mode): int(np.sum(modes == mode)) for mode in np.unique(modes)}
    truth = folder / "truth.npz"
    if truth.exists() and len(plans):
        figures |= _against_truth(truth, np.array(plan_ns), plans, modes)
    return figures


def _memory(memory: list[tuple[float, float]]) -> dict[str, float]:
    """Memory of all processes together, and how it grows in the run's second half: rings are used up by then."""
    settled = np.array(memory[len(memory) // 2 :])
    if len(settled) < 60:
        return {}
    slope = np.polyfit(settled[:, 0] - settled[0, 0], settled[:, 1], 1)[0]
    return {"memory_mb": float(settled[-1, 1]), "memory_growth_mb_per_h": float(3600.0 * slope)}


def _against_truth(path: Path, plan_ns: np.ndarray, plans: list[np.void], modes: np.ndarray) -> dict[str, Any]:
    with np.load(path) as truth:
        mono = truth["mono_ns"]
        cross, way = (
            np.asarray(truth["cross_m"], np.float64),
            np.hypot(np.diff(truth["x_m"], prepend=truth["x_m"][0]), np.diff(truth["y_m"], prepend=truth["y_m"][0])),
        )
        told = {name: float(truth[name]) for name in ("cpu_s", "render_s", "late_ticks") if name in truth}
        seconds = float(mono[-1] - mono[0]) / 1e9
    at = np.clip(np.searchsorted(plan_ns, mono) - 1, 0, len(plans) - 1)
    on = np.isin(modes[at], _ENGAGED)
    figures: dict[str, Any] = {f"devices_{name}": value for name, value in told.items()}
    figures["devices_cpu_share"] = told.get("cpu_s", float("nan")) / max(seconds, 1e-9)
    if on.any():
        weight = way[on] / max(way[on].sum(), 1e-9)
        figures["engaged_way_m"] = float(way[on].sum())
        figures["tracking_rms_m"] = float(np.sqrt(np.sum(cross[on] ** 2 * weight)))
        figures["tracking_largest_m"] = float(np.abs(cross[on]).max())
        figures["within_foot"] = float(np.sum(weight * (np.abs(cross[on]) <= _FOOT_M)))
    return figures


def print_figures(figures: dict[str, Any], folder: Path) -> None:
    """As a table."""
    table = Table("simulated run", "", title=str(folder))
    for name, value in figures.items():
        shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        table.add_row(name.replace("_", " "), shown)
    console.print(table, highlight=False, markup=False)
