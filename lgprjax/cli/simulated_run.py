"""What a simulated run was worth: the truth of the devices against the recording of the runtime."""

from pathlib import Path
from typing import Any

import numpy as np
from rich.table import Table

from lgprjax.cli.progress import console

_FOOT_M = 0.3048
_ENGAGED = (3, 4)


def figures_of(folder: Path) -> dict[str, Any]:
    """Figures of a run's folder.

    Sensor to servo: from a scan's start to the arrival, at the box, of the first command made with its fix.
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
    events: list[str] = []
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
        elif record.kind is Kind.EVENT:
            events.append(record.payload.decode())
    figures: dict[str, Any] = {"ticks": len(ticks), "scans": scans, "searched": len(fixes)}
    if fixes:
        codes = np.array([int(fix["code"]) for fix in fixes])
        figures["ok_share"] = float(np.mean(codes == Code.OK))
        figures["most_waiting"] = int(max(int(fix["waiting"]) for fix in fixes))
        figures["largest_gap_scans"] = int(np.diff([int(fix["scan"]) for fix in fixes]).max(initial=1))
    period = np.diff([mono for _, mono in ticks]) / 1e6
    if len(period):
        for name, share in (("p50", 50.0), ("p99", 99.0), ("p99_9", 99.9), ("largest", 100.0)):
            figures[f"period_{name}_ms"] = float(np.percentile(period, share))
    begun = dict(ticks)
    late = np.array([(begun[tick] - scan_ns) / 1e6 for tick, scan_ns in used if tick in begun])
    if len(late):
        for name, share in (("p50", 50.0), ("p99", 99.0), ("largest", 100.0)):
            figures[f"scan_to_command_{name}_ms"] = float(np.percentile(late, share))
    modes = np.array([int(plan["mode"]) for plan in plans])
    figures["modes"] = {str(mode): int(np.sum(modes == mode)) for mode in np.unique(modes)}
    truth = folder / "truth.npz"
    if truth.exists() and len(plans):
        figures |= _against_truth(truth, np.array(plan_ns), plans, modes)
    return figures


def _against_truth(path: Path, plan_ns: np.ndarray, plans: list[np.void], modes: np.ndarray) -> dict[str, Any]:
    with np.load(path) as truth:
        mono = truth["mono_ns"]
        cross, way = (
            np.asarray(truth["cross_m"], np.float64),
            np.hypot(np.diff(truth["x_m"], prepend=truth["x_m"][0]), np.diff(truth["y_m"], prepend=truth["y_m"][0])),
        )
        told = {name: float(truth[name]) for name in ("cpu_s", "render_s", "late_ticks") if name in truth}
        seconds = float(mono[-1] - mono[0]) / 1e9
        x, y, yaw = (np.asarray(truth[name], np.float64) for name in ("x_m", "y_m", "yaw_rad"))
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
        pose = np.array([plan["pose"] for plan in plans], np.float64)[at]
        off = np.stack([pose[:, 0] - x, pose[:, 1] - y], axis=1)
        located = np.cos(yaw) * off[:, 1] - np.sin(yaw) * off[:, 0]
        figures["located_cross_rms_m"] = float(np.sqrt(np.mean(located[on] ** 2)))
    return figures


def print_figures(figures: dict[str, Any], folder: Path) -> None:
    """As a table."""
    table = Table("simulated run", "", title=str(folder))
    for name, value in figures.items():
        shown = f"{value:.4g}" if isinstance(value, float) else str(value)
        table.add_row(name.replace("_", " "), shown)
    console.print(table, highlight=False, markup=False)
