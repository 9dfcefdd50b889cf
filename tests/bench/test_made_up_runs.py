"""Records of every benchmark from made-up figures: the worst decides, what did not run is told."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from archive_records import done, figures
from benchmarks import accelerator, coverage
from benchmarks.accelerator import AcceleratorPlan, Ran, drive_records, registration_records, run_accelerator
from benchmarks.archive import ArchivePlan, Run, archive_records
from benchmarks.closed_loop import drive_records as loop_records
from benchmarks.closed_loop import many_records
from benchmarks.coverage import CoveragePlan, coverage_records, run_coverage
from benchmarks.process import ProgramError
from benchmarks.records import Record
from benchmarks.registration import HardSetConfig
from benchmarks.rollouts import RolloutPlan, difference_records, gradient_records, memory_records, speed_records
from benchmarks.tuning import tuning_records
from benchmarks.whole_drive import drive_records as whole_drive_records


def by_key(records: list[Record]) -> dict[str, Record]:
    found = {record.key: record for record in records}
    assert len(found) == len(records)
    return found


def test_an_accelerator_is_told_with_its_floor_and_how_far_results_are_apart() -> None:
    device = {"bandwidth": 4e12, "platform": "gpu", "device": "a card"}
    told = {"scans": 3, "right": 3, "on_device_us": 0.5, "host_to_host_us": 2.0, "bytes": 4e5, **device}
    moved = np.zeros((3, 5))
    moved[1, :2] = 3e-3, 4e-3
    there, here = Ran(told, {"pose": np.zeros((3, 5))}), Ran({**told, "host_to_host_us": 100.0}, {"pose": moved})
    records = by_key(registration_records(there, here, 2))
    assert records["gpu/registration / 2 cores"].value == pytest.approx(200.0)
    assert records["gpu/registration / 2 cores"].met is True
    assert records["gpu/registration / 2 cores, host to host"].value == pytest.approx(50.0)
    assert records["gpu/registration, floor by bytes"].value == pytest.approx(0.1)
    assert "20%" in records["gpu/registration, floor by bytes"].note
    assert records["gpu/registration, apart"].value == pytest.approx(5.0)
    assert records["gpu/registration, apart"].met is False
    assert "1 of 3" in records["gpu/registration, apart"].note
    # Drives agree in codes, and in position where both are ok.
    pose, other = np.zeros((3, 5)), np.zeros((3, 5))
    other[:, 0] = 1e-4, 9.0, 9.0
    there = Ran({"first_s": 50.0, "each_ms": 1.0}, {"code": np.array(["ok", "ok", "low"]), "pose": pose})
    here = Ran({"each_ms": 2.0}, {"code": np.array(["ok", "low", "low"]), "pose": other})
    records = by_key(drive_records(there, here, 2))
    assert records["gpu/drive, equal codes"].value == pytest.approx(200.0 / 3.0)
    assert records["gpu/drive, apart"].value == pytest.approx(0.1)


def test_without_an_accelerator_nothing_is_measured_and_it_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(accelerator, "_run", lambda *_: Ran({"platform": "cpu", "device": "cpu"}, {}))
    plan = AcceleratorPlan(HardSetConfig(maps=1, scans=2), lanes=16, steps=4)
    outcome = run_accelerator("rollouts", plan, tmp_path, lambda _: None)
    assert outcome.records == []
    (line,) = outcome.not_measured
    assert line.startswith("rollouts: ")


ARCHIVE = ArchivePlan(drives=2, workers=(1, 2))
JOBS = [done("a", figures({"ok": 4}), compiled=50), done("b", figures({"ok": 4}))]
OUTPUTS = {"a.fixes.csv": "1", "b.fixes.csv": "2"}


def test_an_archives_runs_are_held_against_the_first() -> None:
    runs = {
        "1 worker": Run(20.0, OUTPUTS, JOBS),
        "2 workers": Run(10.0, OUTPUTS, [JOBS[0], JOBS[1].model_copy(update={"attempts": 2})]),
        "nothing to do": Run(3.0, OUTPUTS, JOBS),
        "x": Run(20.0, {"a.fixes.csv": "1", "b.fixes.csv": "9"}, JOBS),
        "y": Run(20.0, {"a.fixes.csv": "1"}, JOBS),
    }
    records = by_key(archive_records(runs, ARCHIVE))
    assert records["archive/1 worker"].value == pytest.approx(6.0)
    assert records["archive/2 workers / 1 worker"].value == pytest.approx(2.0)
    assert records["archive/nothing to do"].met is True
    assert records["archive/files unlike, 2 workers"].met is True
    for name in ("x", "y"):
        unlike = records[f"archive/files unlike, {name}"]
        assert (unlike.value, unlike.met) == (1, False)
    assert records["archive/workers a drive, most"].value == 2
    assert records["archive/search a drive"].value == pytest.approx(1500.0)
    assert records["archive/beside the search"].value == pytest.approx(500.0)
    assert records["archive/drives that compiled late"].value == 0
    late = [*JOBS, done("c", figures({"ok": 4}), compiled=1)]
    records = by_key(archive_records({"1 worker": Run(20.0, OUTPUTS, late)}, ARCHIVE))
    assert records["archive/drives that compiled late"].met is False
    assert archive_records({}, ARCHIVE) == []


def _loop_figures(**more: Any) -> dict[str, Any]:
    errors = {"rms_m": 0.06, "largest_m": 0.2, "within_foot": 1.0, "relative_cross_mean_m": 0.02}
    errors |= {"located_cross_rms_m": 0.03, "switch_cross_rms_m": 0.04, "gnss_ins_cross_rms_m": 0.2}
    shares = {"ok_share": 0.9, "degraded_share": 0.01, "engaged_share": 0.99}
    steering = {"largest_steering_step_rad": 0.02, "steering_limit_rad": 0.024}
    drive = {"way_m": 1600.0, "speed_mps": 4.4, "seconds": 200.0, "wrong_fixes": 0, "finished": True}
    return {**errors, **shares, **steering, **drive, "nees_position": 0.9, "nees_yaw": 1.1, **more}


def test_of_drives_in_closed_loop_the_worst_decides() -> None:
    done = [("clear", _loop_figures()), ("clear", _loop_figures(rms_m=0.12, engaged_share=0.9, wrong_fixes=2))]
    done += [("GNSS off", _loop_figures(finished=False)), ("snow", _loop_figures(relative_cross_mean_m=0.31))]
    records = by_key(loop_records([*done, ("GNSS 2 m", _loop_figures())]))
    assert records["clear: tracking, RMS"].value == 0.12
    assert records["clear: tracking, RMS"].met is False
    assert records["clear: tracking, largest"].met is True
    assert records["clear: engaged, of the way"].met is False
    assert records["clear: wrong by over 0.3 m"].value == 2.0
    assert records["clear: wrong by over 0.3 m"].met is False
    assert records["clear: largest steering step / limit"].value == pytest.approx(0.02 / 0.024)
    assert records["GNSS off: finished"].met is False
    # Days are told beside what was published, those that were published.
    assert records["snow: relative accuracy"].goal == 0.29
    assert records["snow: relative accuracy"].met is False
    assert records["GNSS 2 m: relative accuracy"].goal is None
    assert not any(key.startswith("rain") for key in records)


def test_a_thousand_kilometres_are_reckoned_from_what_ran() -> None:
    found = {"kilometres": 500.0, "seconds": 120.0, "first_block_s": 30.0, "times_real_time": 900.0, "rms_m": 0.05}
    found |= {"rms_95_m": 0.06, "largest_m": 0.3, "within_foot": 1.0, "nees_position": 1.0, "nees_yaw": 1.0}
    records = by_key(many_records({**found, "stopped": 0.0, "peak_rss_mb": 900.0}))
    assert records["error model: 1,000 km take"].value == pytest.approx(4.0)
    assert records["error model: 1,000 km take"].met is True


def test_the_worked_area_stands_beside_its_goals(monkeypatch: pytest.MonkeyPatch) -> None:
    levels = {"cached_made_s": 3.0, "cached_ms": 0.25, "cached_m2": 90.0, "ours_m2": 99.0}
    levels["cached_beyond_ours_cells"] = 0.0
    told = {"cells": 4e6, "moments": 2000.0, "draws": 1e4, "p50_ms": 2.5, "p99_ms": 12.0, "max_ms": 20.0}
    told |= {"map_mb": 16.0, "peak_rss_mb": 400.0, "brute_force_ms": 1000.0}
    told |= {f"{name}_{level}": value for name, value in levels.items() for level in ("0.95", "0.996")}
    records = by_key(coverage_records(told))
    assert records["step, median"].met is True
    assert records["step, p99"].met is False
    assert records["steps in a period"].value == pytest.approx(40.0)
    assert records["brute force / step"].value == pytest.approx(400.0)
    assert records["cached shapes / step, 0.95"].value == pytest.approx(0.1)
    assert records["area / cached shapes, 0.996"].value == pytest.approx(1.1)
    assert records["cells of cached shapes alone, 0.95"].met is True

    def fails(*_: object, **__: object) -> dict[str, float]:
        raise ProgramError("benchmarks.worked_area: boom")

    monkeypatch.setattr(coverage, "run_program", fails)
    outcome = run_coverage(CoveragePlan(10, 10), lambda _: None)
    assert (outcome.records, outcome.not_measured) == ([], ["benchmarks.worked_area: boom"])


def _rolled(best_s: float, **more: float) -> dict[str, float]:
    told = {"best_s": best_s, "median_s": best_s, "vehicle_steps": 1e6, "threads": 2.0, "peak_rss_mb": 300.0}
    return {**told, **more}


_OURS = {"operations": 400.0, "peak_operations": 1e11, "value_s": 0.1, "gradient_lanes": 64.0}
ROLLOUTS = {
    "this_project": [
        _rolled(0.02, **_OURS, value_and_gradient_s=0.4),
        _rolled(0.04, **_OURS, value_and_gradient_s=0.6),
    ],
    "numba_blocks": [_rolled(0.03), _rolled(0.10)],
    "numba_lanes": [_rolled(0.20), _rolled(0.20)],
    "plain_python": [_rolled(100.0), _rolled(100.0)],
}


def test_rollouts_are_medians_over_rounds_and_the_goal_stands_on_the_faster_numba() -> None:
    records = by_key(speed_records(ROLLOUTS))
    assert records["throughput, this_project"].value == pytest.approx(37.5)
    assert records["throughput / numba_blocks"].value == pytest.approx(2.0)
    assert records["throughput / numba_blocks"].met is True
    assert "1.5 to 2.5" in records["throughput / numba_blocks"].note
    assert records["throughput / numba_lanes"].goal is None
    assert records["throughput / plain_python"].value == pytest.approx(3750.0)
    assert records["floor, arithmetic alone"].value == pytest.approx(250.0)
    swapped = {**ROLLOUTS, "numba_blocks": ROLLOUTS["numba_lanes"], "numba_lanes": ROLLOUTS["numba_blocks"]}
    assert by_key(speed_records(swapped))["throughput / numba_lanes"].goal == 1.5
    none = by_key(speed_records({**ROLLOUTS, "numba_blocks": [], "numba_lanes": []}))["throughput / numba_blocks"]
    assert math.isnan(none.value)
    assert none.met is False


def test_rollouts_apart_gradients_and_memory_stand_beside_their_goals() -> None:
    ours, theirs = np.zeros((4, 3)), np.zeros((4, 2))
    theirs[:2, 1] = 3e-3, 4e-3
    ours[:2, 2] = 1.0
    (record,) = difference_records({"this_project": ours, "plain_python": theirs})
    assert record.value == pytest.approx(5.0)
    assert record.met is False
    (gradient,) = gradient_records(ROLLOUTS["this_project"])
    assert gradient.value == pytest.approx(5.0)
    assert gradient.met is True
    (memory,) = memory_records({"seconds": 2.0, "peak_rss_mb": 4100.0, "finite_share": 1.0}, RolloutPlan())
    assert memory.key == "memory, 1,000,000 lanes x 2,000 steps"
    assert memory.met is False


STUDY: dict[str, Any] = {
    **{"first_s": 90.0, "taken_s": [50.0, 40.0], "cpu_s": 44.0, "fit_s": 10.0, "judge_s": 2.0},
    **{"logs": 20, "driven_s": 700.0, "draws": 4096, "threads": 2, "peak_rss_mb": 900.0},
}


def test_a_study_stands_beside_its_goal_and_its_peers() -> None:
    draws = {"single_s": 900.0, "single_draws": 64, "all_s": 30.0, "mean_m": 0.4, "mean_apart_m": 2e-3, "apart_m": 3e-3}
    peers = {"scipy_fit": {"fit_s": 35.0, "apart": 0.2}, "numpy_draws": draws}
    records = by_key(tuning_records({"this_project": STUDY, **peers}))
    whole = records["whole study, 20 logs, 4,096 draws"]
    assert (whole.value, whole.met) == (40.0, True)
    assert "40 to 50 s" in whole.note
    assert records["identification / scipy.optimize"].value == pytest.approx(3.5)
    assert records["cost / per-draw NumPy loop"].value == pytest.approx(450.0)
    assert records["cost / NumPy, draws at once"].value == pytest.approx(15.0)
    assert records["cost, apart from NumPy"].met is False
    assert math.isclose(records["the first one in a process"].value, 90.0)
    assert tuning_records({}) == []
    alone = by_key(tuning_records({"this_project": STUDY}))
    assert not [key for key in alone if "NumPy" in key or "scipy" in key]


def test_of_a_whole_drive_compiling_is_told_apart_and_goals_are_held() -> None:
    def run(seconds: float, **more: Any) -> dict[str, Any]:
        return {"scans": 1000, "ok": 0.5, "seconds": seconds, "compile_s": 2.0, "peak_rss_mb": 900.0, **more}

    runs = {
        "first process": run(14.0),
        "default": run(2.6, parts={"reading": 0.1}),
        "single scans": run(3.0),
        "windows of 4 m": run(4.0),
        "3 channels on 20 lines": run(7.0),
        "command": {"seconds": 5.0},
    }
    records = by_key(whole_drive_records(runs, 2))
    assert records["drive/default"].value == pytest.approx(0.6)
    assert records["drive/default"].met is True
    assert records["drive/3 channels on 20 lines"].met is False
    assert records["drive/windows of 4 m / single scans"].value == pytest.approx(2.0)
    assert records["drive/windows of 4 m / single scans"].met is False
    assert records["drive/compile, second process"].met is True
    assert records["drive/command"].value == pytest.approx(5.0)
    assert records["drive/of it: reading"].value == pytest.approx(0.1)
    assert "drive/first process" not in records
    assert whole_drive_records({}, 2) == []
    alone = whole_drive_records({"default": run(2.6)}, 2)
    assert [record.key for record in alone] == ["drive/default", "drive/compile, second process"]
