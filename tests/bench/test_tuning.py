"""The benchmark of a whole study: peers that compute the same, records of made-up runs, what is missing is said."""

import math
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import tuning
from benchmarks.__main__ import main
from benchmarks.process import ProgramError
from benchmarks.records import Record
from benchmarks.tuning import TuningPlan, run_tuning, tuning_records
from benchmarks.tuning_peers import TUNING_PEERS, numpy_draws, scipy_fit
from benchmarks.tuning_problem import MOST_LOGS, VEHICLE, TuningProblem, load_tuning, save_tuning
from lgprjax.batch.vehicles import chassis_of
from lgprjax.formats import read_vehicle
from lgprjax.tuning.logged_look_ahead import WeakSchedule, drawn_vehicles, judge_drawn
from lgprjax.tuning.look_ahead import TrialCourses
from lgprjax.tuning.loop import NAMES, WIDTH, LoopLogs, LoopPrior, loop_model, places_of
from lgprjax.tuning.loop_fit import fit_loop
from lgprjax.vehicle import LookAhead, ProportionalRear, arc_course, line_course

TINY = TuningPlan(logs=2, draws=32, steps=2, repeats=1, single=2, threads=1, limit_s=900.0)
TRUE = np.array([0.2, 0.08, 0.45, 0.0035, 0.0, 0.6, 0.003, 0.0, 0.01])
STEPS = 4096


def by_key(records: list[Record]) -> dict[str, Record]:
    found = {record.key: record for record in records}
    assert len(found) == len(records)
    return found


def single(values: Any) -> jax.Array:
    return jnp.asarray(values, jnp.float32)


@pytest.fixture(scope="module")
def logs() -> tuple[LoopPrior, LoopLogs]:
    """Two drives that the model itself makes, with white noise; the second ends early."""
    prior = LoopPrior(
        single(TRUE * [0.8, 1.2, 1.1, 1.0, 1.0, 1.05, 1.2, 1.0, 1.0]), single(WIDTH), *single([3.8, 0.005])
    )
    draw, time_s = np.random.default_rng(3), 0.02 * np.arange(STEPS)
    command = np.stack([0.3 * np.sign(np.sin(time_s)), 0.1 * np.sin(time_s) + 0.05 * np.sin(0.3 * time_s)])
    speed = np.stack([2.0 + 0.5 * np.sin(0.3 * time_s), 4.5 + 0.5 * np.sin(0.2 * time_s)])
    used = np.ones((2, STEPS), bool)
    used[1, 3000:] = False
    none = np.zeros((2, STEPS))
    numbers = [single(values) for values in (command, none + 1.0, speed, none, none)]
    first = jnp.asarray(none + np.arange(STEPS) == 0)
    logs = LoopLogs._make([*numbers, jnp.asarray(used), jnp.asarray(used), first])
    front, rate = (np.asarray(part) for part in loop_model(prior, logs, places_of(prior, single(TRUE))))
    noisy = (front + 0.003 * draw.normal(size=front.shape), rate + 0.01 * draw.normal(size=rate.shape) + 0.002)
    return prior, logs._replace(front_rad=single(noisy[0]), yaw_rate_radps=single(noisy[1]))


@pytest.fixture(scope="module")
def problem(logs: tuple[LoopPrior, LoopLogs]) -> TuningProblem:
    """Of these drives; the draws are about the truth, judged by this project."""
    prior, drives = logs
    fit = fit_loop(prior, drives)
    draws = single(TRUE * (1.0 + 0.03 * np.random.default_rng(4).normal(size=(4, 9))))
    believed = chassis_of(read_vehicle(VEHICLE), VEHICLE)
    assert isinstance(believed.rear, ProportionalRear)
    trials = TrialCourses((line_course(120.0), arc_course(25.0, 2.0 * np.pi)), (2.0, 4.0), duration_s=20.0)
    shares = single([1.0, 0.5])
    schedule = WeakSchedule(LookAhead(*single([2.5, 4.0, 2.0, 4.0])), single(0.5))
    judged = judge_drawn(drawn_vehicles(believed, prior, draws), trials, schedule, shares)
    law = (believed.wheelbase_m, believed.anchor_m, believed.rear.ratio, believed.largest_angle_rad)
    return TuningProblem(
        **{name: np.asarray(field) for name, field in (drives._asdict() | prior._asdict()).items()},
        found=np.array([one.value for one in fit.numbers.values()]),
        sigma=np.array([one.sigma for one in fit.numbers.values()]),
        draws=np.asarray(draws),
        believed=np.array([*map(float, law), float(believed.characteristic_speed_mps)]),
        ahead_m=np.array([[2.5], [4.0]]) * np.array([1.0, 0.5**-0.5]),
        speeds_mps=np.array([2.0, 4.0]),
        shares=np.array([1.0, 0.5]),
        offsets_m=np.array(trials.offsets_m),
        rows_0=np.asarray(trials.paths[0].rows),
        rows_1=np.asarray(trials.paths[1].rows),
        paths=np.array([[float(v) for v in path[1:]] for path in trials.paths]),
        settings=np.array([400, 0.05, trials.effort_m2, 4]),
        cost_m=np.asarray(judged.cost_m),
    )


def test_scipy_finds_what_this_project_finds(problem: TuningProblem) -> None:
    found = scipy_fit.fit(problem)
    assert np.max(np.abs(found - problem.found) / problem.sigma) < 0.5
    for name in ("lag_s", "delay_s", "rear_ratio"):
        assert found[NAMES.index(name)] == pytest.approx(TRUE[NAMES.index(name)], rel=0.1), name


def test_numpy_drives_as_this_project_does(problem: TuningProblem) -> None:
    tables = [
        numpy_draws.Table(rows, numbers)
        for rows, numbers in zip((problem.rows_0, problem.rows_1), problem.paths, strict=True)
    ]
    together = numpy_draws.costs(problem, tables, 0, 4)
    np.testing.assert_allclose(together, problem.cost_m, atol=5e-4)
    np.testing.assert_allclose(numpy_draws.costs(problem, tables, 2, 3), together[2:3], rtol=1e-9)


def test_a_problem_comes_back(problem: TuningProblem, tmp_path: Path) -> None:
    save_tuning(tmp_path / "p.npz", problem)
    for one, other in zip(problem, load_tuning(tmp_path / "p.npz"), strict=True):
        np.testing.assert_array_equal(one, other)


OURS: dict[str, Any] = {
    **{"first_s": 90.0, "taken_s": [50.0, 40.0], "cpu_s": 44.0, "fit_s": 10.0, "judge_s": 2.0},
    **{"logs": 20, "driven_s": 700.0, "draws": 4096, "threads": 2, "peak_rss_mb": 900.0},
}
FOUND: dict[str, dict[str, Any]] = {
    "this_project": OURS,
    "scipy_fit": {"fit_s": 35.0, "apart": 0.2},
    "numpy_draws": {
        "single_s": 900.0,
        "single_draws": 64,
        "all_s": 30.0,
        "mean_m": 0.4,
        "mean_apart_m": 2e-3,
        "apart_m": 3e-3,
    },
}


def test_the_study_stands_beside_its_goal_and_its_peers() -> None:
    records = by_key(tuning_records(FOUND))
    whole = records["whole study, 20 logs, 4,096 draws"]
    assert (whole.value, whole.met) == (40.0, True)
    assert "40 to 50 s in 2 runs" in whole.note
    assert records["identification / scipy.optimize"].value == pytest.approx(3.5)
    assert records["cost / per-draw NumPy loop"].value == pytest.approx(450.0)
    assert records["cost / NumPy, draws at once"].value == pytest.approx(15.0)
    assert records["cost, apart from NumPy"].met is False
    assert math.isclose(records["the first one in a process"].value, 90.0)


def test_without_the_study_there_is_nothing_and_without_a_peer_the_rest() -> None:
    assert tuning_records({}) == []
    alone = by_key(tuning_records({"this_project": OURS}))
    assert not [key for key in alone if "NumPy" in key or "scipy" in key]


def test_what_is_missing_or_fails_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def some(module: str, *_: object, **__: object) -> dict[str, Any]:
        if module.endswith("this_project"):
            return OURS
        raise ProgramError(f"{module}: its process ended with 1: boom")

    monkeypatch.setattr(tuning, "run_program", some)
    monkeypatch.setattr(tuning, "simulate_logs", lambda *_: [])
    monkeypatch.setattr(tuning, "QUICK_TUNING", TINY)
    monkeypatch.setitem(TUNING_PEERS, "numpy_draws", "no_such_package")
    with pytest.raises(SystemExit) as stopped:
        main(["tuning", "--quick", "--json", str(tmp_path / "t.json")])
    assert stopped.value.code == 0
    shown = capsys.readouterr().out
    assert "whole study, 20 logs, 4,096 draws" in shown
    assert 'numpy_draws: package no_such_package is not installed: pip install "lgprjax[bench]"' in shown
    assert "not measured: benchmarks.tuning_peers.scipy_fit: its process ended with 1: boom" in shown
    assert (tmp_path / "t.json").is_file()


@pytest.mark.campaign
def test_every_program_computes_what_the_others_do(tmp_path: Path) -> None:
    outcome = run_tuning(TINY, tmp_path, lambda _: None)
    assert outcome.not_measured == []
    records = by_key(outcome.records)
    assert records["numbers, apart from scipy.optimize"].met is True
    assert records["cost, apart from NumPy"].met is True
    assert TINY.logs < MOST_LOGS
    assert records["whole study, 2 logs, 32 draws"].value > 0.0
