"""The rollout benchmark: programs that end in the same place, records of made-up runs, what is missing is said."""

import math
from pathlib import Path
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from benchmarks import rollouts
from benchmarks.__main__ import main
from benchmarks.process import ProgramError, run_program
from benchmarks.records import Record
from benchmarks.rollout_operations import operations_a_step
from benchmarks.rollout_peers import ROLLOUT_PEERS
from benchmarks.rollout_problem import as_rollout, load_problem, make_problem, save_problem
from benchmarks.rollouts import (
    RolloutPlan,
    difference_records,
    gradient_records,
    memory_records,
    read_pose,
    run_rollouts,
    speed_records,
)

TINY = RolloutPlan(24, 40, rounds=1, repeats=1, many_lanes=30, many_steps=20, threads=1, limit_s=300.0)


def by_key(records: list[Record]) -> dict[str, Record]:
    found = {record.key: record for record in records}
    assert len(found) == len(records)
    return found


def ran(best_s: float, **more: float) -> dict[str, float]:
    figures = {"best_s": best_s, "median_s": best_s, "vehicle_steps": 1e6, "threads": 2.0, "peak_rss_mb": 300.0}
    return {**figures, **more}


OURS = {"operations": 400.0, "peak_operations": 1e11, "value_s": 0.1, "gradient_lanes": 64.0}
RUNS = {
    "this_project": [ran(0.02, **OURS, value_and_gradient_s=0.4), ran(0.04, **OURS, value_and_gradient_s=0.6)],
    "numba_blocks": [ran(0.03), ran(0.10)],
    "numba_lanes": [ran(0.20), ran(0.20)],
    "plain_python": [ran(100.0), ran(100.0)],
}


def test_ratios_are_medians_over_rounds_and_the_goal_stands_on_the_faster_numba() -> None:
    records = by_key(speed_records(RUNS))
    assert records["throughput, this_project"].value == pytest.approx(37.5)
    assert records["throughput / numba_blocks"].value == pytest.approx(2.0)
    assert records["throughput / numba_blocks"].met is True
    assert "1.5 to 2.5 in 2 rounds" in records["throughput / numba_blocks"].note
    assert records["throughput / numba_lanes"].goal is None
    assert records["throughput / plain_python"].value == pytest.approx(3750.0)
    assert records["floor, arithmetic alone"].value == pytest.approx(250.0)
    swapped = {**RUNS, "numba_blocks": RUNS["numba_lanes"], "numba_lanes": RUNS["numba_blocks"]}
    assert by_key(speed_records(swapped))["throughput / numba_lanes"].goal == 1.5


def test_without_numba_the_goal_is_not_met() -> None:
    records = by_key(speed_records({**RUNS, "numba_blocks": [], "numba_lanes": []}))
    assert math.isnan(records["throughput / numba_blocks"].value)
    assert records["throughput / numba_blocks"].met is False


def test_differences_are_the_largest_distance() -> None:
    ours, theirs = np.zeros((4, 3)), np.zeros((4, 2))
    theirs[:2, 1] = 3e-3, 4e-3
    ours[:2, 2] = 1.0
    (record,) = difference_records({"this_project": ours, "plain_python": theirs})
    assert record.value == pytest.approx(5.0)
    assert record.met is False


def test_gradient_and_memory_stand_beside_their_goals() -> None:
    (gradient,) = gradient_records(RUNS["this_project"])
    assert gradient.value == pytest.approx(5.0)
    assert gradient.met is True
    (memory,) = memory_records({"seconds": 2.0, "peak_rss_mb": 4100.0, "finite_share": 1.0}, RolloutPlan())
    assert memory.key == "memory, 1,000,000 lanes x 2,000 steps"
    assert memory.met is False


def test_operations_of_a_loop_are_counted_once_a_step() -> None:
    def loop(x: jax.Array) -> Any:
        return jax.lax.fori_loop(0, 7, lambda _, value: jnp.sqrt(value * value + 1.0) / 3.0, x) - 2.0

    # The counter's own addition is one of a scan's body too.
    assert operations_a_step(jax.make_jaxpr(loop)(jnp.float32(1.0))) == 4 + 1


def test_problem_comes_back_and_is_the_same_from_the_same_seed(tmp_path: Path) -> None:
    problem = make_problem(5, 10, 3)
    save_problem(tmp_path / "p.npz", problem)
    for one, other in zip(problem, load_problem(tmp_path / "p.npz"), strict=True):
        np.testing.assert_array_equal(one, other)
    assert not np.array_equal(problem.lanes, make_problem(5, 10, 4).lanes)
    spec, path, lane, start = as_rollout(problem, 10)
    assert spec.steps == 10
    assert start.x_m.shape == lane.speed_mps.shape == (5,)
    assert float(path.length_m) > 10 * 0.05 * 5.0


@pytest.mark.campaign
def test_every_program_ends_where_the_others_do(tmp_path: Path) -> None:
    heard: list[str] = []
    outcome = run_rollouts(TINY, tmp_path, heard.append)
    assert outcome.not_measured == []
    assert set(ROLLOUT_PEERS) <= {line.split(",")[0] for line in heard}
    records = by_key(outcome.records)
    for name in ROLLOUT_PEERS:
        assert records[f"throughput, {name}"].value > 0.0
        if name != "this_project":
            assert records[f"final states, apart from {name}"].value < 1.0
    # The lanes moved, and did not all come to one place.
    pose = read_pose(tmp_path / "this_project.npz")
    assert np.ptp(pose[0]) > 1.0
    assert records["value and gradient / value"].value > 0.5
    assert records["memory, 30 lanes x 20 steps"].value > 0.05


def test_what_is_missing_or_fails_is_said(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(module: str, *_: object, **__: object) -> dict[str, float]:
        raise ProgramError(f"{module}: its process ended with 1: boom")

    monkeypatch.setattr(rollouts, "run_program", fail)
    monkeypatch.setattr(rollouts, "QUICK_ROLLOUTS", TINY)
    monkeypatch.setitem(ROLLOUT_PEERS, "numba_lanes", "no_such_package")
    with pytest.raises(SystemExit) as stopped:
        main(["rollouts", "--quick"])
    assert stopped.value.code == 0
    shown = capsys.readouterr().out
    assert 'numba_lanes: package no_such_package is not installed: pip install "lgprjax[bench]"' in shown
    assert "not measured: benchmarks.rollout_peers.this_project: its process ended with 1: boom" in shown
    with pytest.raises(SystemExit) as stopped:
        main(["rollouts", "--figure", str(tmp_path / "f.png")])
    assert stopped.value.code == 1
    assert "expected the benchmark registration, closed-loop or runtime, found rollouts" in capsys.readouterr().err


def test_program_that_cannot_read_its_problem_says_so(tmp_path: Path) -> None:
    with pytest.raises(ProgramError, match=r"none\.npz"):
        run_program(
            "benchmarks.rollout_peers.plain_python",
            [str(tmp_path / "none.npz"), str(tmp_path / "out.npz"), "--steps", "1", "--threads", "1"],
            threads=1,
        )
