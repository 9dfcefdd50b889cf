"""The measuring programs: each computes what the others do, on little, in this process or in its own."""

import json
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import on_accelerator
from benchmarks.accuracy import fit_fix_errors
from benchmarks.long_map import RepeatedRoad
from benchmarks.map_precision import recode, size_of
from benchmarks.registration import HardSetConfig, make_hard_set, save_hard_set
from benchmarks.rollout_peers import ROLLOUT_PEERS
from benchmarks.rollout_problem import make_problem, save_problem
from benchmarks.rollouts import RolloutPlan, read_pose, run_rollouts
from benchmarks.stored_road import write_road
from benchmarks.tuning import TuningPlan, run_tuning
from benchmarks.tuning_peers import numpy_draws, scipy_fit
from benchmarks.tuning_problem import MOST_LOGS, VEHICLE, TuningProblem, load_tuning, save_tuning
from benchmarks.whole_drive import main
from canon.map import write_made_map
from canon.site import Site
from lgprjax.formats import MAP_PRECISIONS, MapFile, read_vehicle
from lgprjax.recordings.vehicles import chassis_of
from lgprjax.scene import FixErrors, init_fix_errors, step_fix_errors
from lgprjax.subsurface import GroundMap
from lgprjax.tuning.logged_look_ahead import WeakSchedule, drawn_vehicles, judge_drawn
from lgprjax.tuning.look_ahead import TrialCourses
from lgprjax.tuning.loop import NAMES, WIDTH, LoopLogs, LoopPrior, loop_model, places_of
from lgprjax.tuning.loop_fit import fit_loop
from lgprjax.vehicle import LookAhead, ProportionalRear, arc_course, line_course

ROLLOUTS = RolloutPlan(24, 40, rounds=1, repeats=1, many_lanes=30, many_steps=20, threads=1, limit_s=300.0)
TUNING = TuningPlan(logs=2, draws=32, steps=2, repeats=1, single=2, threads=1, limit_s=900.0)
TRUE = np.array([0.2, 0.08, 0.45, 0.0035, 0.0, 0.6, 0.003, 0.0, 0.01])
STEPS = 4096


def run_here(problem: str, files: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """The program in this process, on the processor."""
    monkeypatch.setattr(on_accelerator, "hold_to", lambda _: None)
    monkeypatch.setattr(on_accelerator, "_COPIED", {"cpu": 1 << 10})
    out, results = tmp_path / "out.json", tmp_path / "results.npz"
    arguments = ["on_accelerator", str(out), problem, str(results), *map(str, files), "--threads", "1"]
    monkeypatch.setattr("sys.argv", arguments)
    on_accelerator.main()
    with np.load(results) as arrays:
        return json.loads(out.read_text(encoding="utf-8")), dict(arrays)


def test_the_program_finds_the_poses_of_the_hard_set(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file = tmp_path / "hard_set.npz"
    hard_set = make_hard_set(0, HardSetConfig(maps=1, scans=5))
    save_hard_set(file, hard_set)
    figures, results = run_here("registration", [file], tmp_path, monkeypatch)
    assert figures["right"] == int(np.sum(np.hypot(*(results["pose"] - hard_set.truth)[:, :2].T) <= 0.1)) >= 4
    # 4,059 samples of a byte, and planes of 61 by 61 places and 384 decoys in single precision, twice.
    assert figures["bytes"] == 11 * 369 + 2 * 4 * 5 * (61 * 61 + 384)


def test_the_program_rolls_out_and_counts_the_bytes_of_a_step(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    file, steps = tmp_path / "problem.npz", tmp_path / "steps"
    save_problem(file, make_problem(16, 30, 0))
    steps.write_text("30", encoding="utf-8")
    figures, results = run_here("rollouts", [file, steps], tmp_path, monkeypatch)
    assert figures["vehicle_steps"] == 480
    assert results["pose"].shape == (2, 16)
    # Eight numbers of state and seven sums are read and written; what a lane's vehicle is, is read.
    assert 2 * 4 * 15 < figures["bytes"] < 2 * 4 * 15 + 4 * 40


def test_the_program_registers_a_drive(site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    figures, results = run_here("drive", [site.map, site.logs["live"]], tmp_path, monkeypatch)
    assert len(results["code"]) == len(results["pose"]) == figures["scans"]
    assert np.mean(results["code"] == "ok") > 0.8
    assert 0.0 < figures["each_ms"] < 1e3 * figures["first_s"]


def test_the_program_registers_a_drive_and_tells_every_part(
    site: Site, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("benchmarks.whole_drive.hold_to", lambda _: None)
    out = tmp_path / "told.json"
    main([str(out), str(site.map), str(site.logs["live"]), "--threads", "1", "--profile"])
    told = json.loads(out.read_text(encoding="utf-8"))
    assert told["ok"] > 0.8
    assert told["scans"] > 500
    assert all(seconds > 0.0 for seconds in told["parts"].values())
    assert sum(told["parts"].values()) < 3.0 * told["seconds"]


def test_every_program_ends_where_the_others_do(tmp_path: Path) -> None:
    heard: list[str] = []
    outcome = run_rollouts(ROLLOUTS, tmp_path, heard.append)
    assert outcome.not_measured == []
    assert set(ROLLOUT_PEERS) <= {line.split(",")[0] for line in heard}
    records = {record.key: record for record in outcome.records}
    for name in ROLLOUT_PEERS:
        assert records[f"throughput, {name}"].value > 0.0
        if name != "this_project":
            assert records[f"final states, apart from {name}"].value < 1.0
    # The lanes moved, and did not all come to one place.
    pose = read_pose(tmp_path / "this_project.npz")
    assert np.ptp(pose[0]) > 1.0
    assert records["value and gradient / value"].value > 0.5
    assert records["memory, 30 lanes x 20 steps"].value > 0.05


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


def test_a_study_and_its_peers_compute_the_same(tmp_path: Path) -> None:
    outcome = run_tuning(TUNING, tmp_path, lambda _: None)
    assert outcome.not_measured == []
    records = {record.key: record for record in outcome.records}
    assert records["numbers, apart from scipy.optimize"].met is True
    assert records["cost, apart from NumPy"].met is True
    assert TUNING.logs < MOST_LOGS
    assert records["whole study, 2 logs, 32 draws"].value > 0.0


def test_a_map_coded_anew_is_what_it_would_have_been(tmp_path: Path) -> None:
    full, direct, again = (tmp_path / f"{name}.map.h5" for name in ("full", "direct", "again"))
    write_made_map(full, MAP_PRECISIONS["full"], stations=700)
    write_made_map(direct, MAP_PRECISIONS["standard"], stations=700)
    with MapFile.open(full) as source:
        recode(source, again, MAP_PRECISIONS["standard"])
    a, b = size_of(direct, full), size_of(again, full)
    assert a.correlation == pytest.approx(b.correlation, abs=1e-4)
    assert 0.98 < a.correlation < 0.9995
    assert a.trace_bytes == pytest.approx(b.trace_bytes, rel=0.01)
    assert a.numbers == 1400 * 5 * 40
    assert a.length_m == pytest.approx(2 * 699 * 0.04, rel=0.02)
    assert size_of(full, full).correlation == pytest.approx(1.0)


def test_a_road_laid_twice_is_the_repeated_road(tmp_path: Path) -> None:
    path, once, twice = tmp_path / "road.map.h5", RepeatedRoad(40.0, 40.0), RepeatedRoad(80.0, 40.0)
    write_road(path, once, 2, MAP_PRECISIONS["full"])
    with MapFile.open(path) as source:
        assert len(source.places) == len(twice.pose)
        np.testing.assert_allclose(source.pose, twice.pose, atol=1e-4)
        np.testing.assert_allclose(source.tile_frame, twice.tile_frame, atol=1e-9)
        stored, held = (GroundMap(each, half_along_m=3.0, half_cross_m=3.0) for each in (source, twice))
        number = len(source.tile_frame) // 2
        a, b = (np.asarray(each.tile(number).coefficients) for each in (stored, held))
        np.testing.assert_allclose(a, b, atol=0.01 * np.abs(b).max())
    assert list(tmp_path.iterdir()) == [path]


_WAY_M = 0.1


def _model() -> FixErrors:
    def row(*values: float) -> jax.Array:
        return jnp.asarray(values, jnp.float32)

    return FixErrors(
        slow_sigma=row(0.02, 0.03, 0.004),
        slow_m=jnp.float32(2.0),
        white_sigma=row(0.03, 0.01, 0.002),
        bias=row(0.01, -0.02, 0.001),
        reported_sigma=row(0.03, 0.03, 0.005),
        found_m=jnp.float32(6.0),
        lost_m=jnp.float32(1.5),
        strength=jnp.float32(0.8),
        p_false=jnp.float32(1e-9),
    )


def test_the_error_model_of_fixes_finds_what_fixes_were_drawn_from() -> None:
    model, scans = _model(), 40_000
    keys = jax.random.split(jax.random.key(1), scans)

    def step(state, key):  # type: ignore[no-untyped-def]
        state, error = step_fix_errors(model, state, key, jnp.float32(_WAY_M))
        return state, (state.found, error)

    _, (found, error) = jax.jit(lambda start: jax.lax.scan(step, start, keys))(
        init_fix_errors(model, jax.random.key(2))
    )
    travel = _WAY_M * np.arange(scans)
    ok = np.asarray(found)
    fit = fit_fix_errors(travel, ok, np.asarray(error, np.float64), np.where(ok, 0.8, 0.4), np.where(ok, 1e-9, 1.0))
    assert ok.mean() == pytest.approx(6.0 / 7.5, abs=0.03)
    assert fit.bias == pytest.approx([0.01, -0.02, 0.001], abs=0.003)
    assert fit.slow_sigma == pytest.approx([0.02, 0.03, 0.004], rel=0.12)
    assert fit.white_sigma == pytest.approx([0.03, 0.01, 0.002], rel=0.15)
    assert fit.slow_m == pytest.approx(2.0, rel=0.25)
    assert fit.found_m == pytest.approx(6.0, rel=0.12)
    assert fit.lost_m == pytest.approx(1.5, rel=0.12)
    assert fit.strength == 0.8
    assert fit.p_false == 1e-9
