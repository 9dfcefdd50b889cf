"""Records of made-up jobs whose sums a reader can do by hand."""

from lgprjax.batch.jobs import CellTally, DriveFigures, JobCost, JobRecord

MAP_SHA256 = "m" * 64


def cell(east: int, north: int, tried: int, ok: int, error_m: float | None = None, at_s: float = 1.0) -> CellTally:
    """A cell of one drive in which every ok fix is wrong by ``error_m``; None where no truth is known."""
    judged = 0 if error_m is None else ok
    return CellTally(
        east=east,
        north=north,
        tried=tried,
        ok=ok,
        judged=judged,
        square_m2=judged * (error_m or 0.0) ** 2,
        largest_m=(error_m or 0.0) if judged else 0.0,
        largest_s=at_s if judged else 0.0,
        declined_s=at_s if ok < tried else None,
    )


def figures(counts: dict[str, int], *, rms_m: float | None = None, wrong: int = 0, **more: float) -> DriveFigures:
    """A drive of so many scans by code, its ok fixes wrong by ``rms_m`` across and half of it along."""
    scans, tried = sum(counts.values()), sum(n for code, n in counts.items() if code != "no_window")
    return DriveFigures(
        scans=scans,
        tried=tried,
        counts=counts,
        way_m=more.get("way_m", 10.0),
        correlation_ok=0.8,
        correlation_at_truth=None if rms_m is None else 0.75,
        judged=0 if rms_m is None else counts.get("ok", 0),
        wrong=None if rms_m is None else wrong,
        rms_along_m=None if rms_m is None else 0.5 * rms_m,
        rms_cross_m=rms_m,
        largest_m=None if rms_m is None else more.get("largest_m", 2.0 * rms_m),
        milliseconds_per_scan=more.get("milliseconds_per_scan", 1.0),
    )


def done(name: str, told: DriveFigures, *cells: CellTally, compiled: int = 0, worker: str = "here:1") -> JobRecord:
    """The record of a job that is done."""
    return JobRecord(
        name=name,
        state="done",
        key=f"key of {name}",
        drive=f"{name}.drive.h5",
        drive_sha256="d" * 64,
        map="m.map.h5",
        map_sha256=MAP_SHA256,
        settings={"search_m": 1.5, "window_m": 0.0, "time_scale": 1.0, "own_thresholds": None},
        version="0",
        outputs={f"{name}.fixes.csv": "c" * 64, f"{name}.fixes.h5": "h" * 64},
        figures=told,
        cells=cells,
        cost=JobCost(seconds=2.0, search_s=1.5, compiled=compiled, peak_rss_mb=500.0, worker=worker),
    )


def failed(name: str, error: str) -> JobRecord:
    """The record of a job that failed."""
    bare: dict[str, object] = {"outputs": {}, "figures": None, "cells": (), "cost": None}
    return done(name, figures({"ok": 1})).model_copy(update={"state": "failed", "error": error, **bare})
