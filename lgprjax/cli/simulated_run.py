"""What a simulated run was worth: the truth of the devices against the recording of the runtime."""

from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Int
from rich.table import Table

from lgprjax.cli.progress import console
from lgprjax.cli.run_records import ENGAGED, RunRecords

_FOOT_M = 0.3048


def figures_of(records: RunRecords, folder: Path) -> dict[str, Any]:
    """Figures of a run's records, and of the truth in its folder.

    Scan to command: from a scan's start to the begin of the tick that commands with its fix.
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
        figures["ok_share"] = float(np.mean(found["code"][on] == Code.OK))
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
    """Memory of all processes together, and how it grows in the run's second half: rings are used up by then."""
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
