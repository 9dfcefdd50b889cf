"""``python -m benchmarks`` as a person meets it: what is printed, what is written, what is refused."""

import json
from datetime import UTC, date, datetime
from pathlib import Path
from typing import Any

import pytest

from bench.test_made_up_runs import STUDY
from benchmarks import rollouts, tuning
from benchmarks.__main__ import main
from benchmarks.process import ProgramError
from benchmarks.rollout_peers import ROLLOUT_PEERS
from benchmarks.rollouts import RolloutPlan
from benchmarks.tuning import TuningPlan
from benchmarks.tuning_peers import TUNING_PEERS
from refusals import printed_refusal


def status_of(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def test_what_ran_is_written_and_what_is_missing_or_fails_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A study of which one peer's package is missing and the other one's process fails."""

    def some(module: str, *_: object, **__: object) -> dict[str, Any]:
        if module.endswith("this_project"):
            return STUDY
        raise ProgramError(f"{module}: boom")

    monkeypatch.setattr(tuning, "run_program", some)
    monkeypatch.setattr(tuning, "simulate_logs", lambda *_: [])
    monkeypatch.setattr(tuning, "QUICK_TUNING", TuningPlan(logs=2, draws=32, steps=2, repeats=1, single=2, threads=1))
    monkeypatch.setitem(TUNING_PEERS, "numpy_draws", "no_such_package")
    path = tmp_path / "t.json"
    assert status_of("tuning", "--quick", "--json", path) == 0
    shown = capsys.readouterr().out
    told = json.loads(path.read_text(encoding="utf-8"))
    assert told["quick"] is True
    assert told["machine"] in shown
    assert date.fromisoformat(told["date"]) <= datetime.now(UTC).date()
    assert ("commit" in told) is (Path(__file__).parents[2] / ".git").exists()
    lacking, failed = sorted(told["not_measured"], key=lambda line: "boom" in line)
    assert failed == "benchmarks.tuning_peers.scipy_fit: boom"
    assert "numpy_draws" in lacking
    assert "no_such_package" in lacking
    assert lacking in shown
    assert failed in shown
    (whole,) = (record for record in told["records"] if record["key"] == "whole study, 20 logs, 4,096 draws")
    assert whole["value"] == 40.0


def test_a_benchmark_of_which_nothing_runs_still_ends_well(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def fail(module: str, *_: object, **__: object) -> dict[str, float]:
        raise ProgramError(f"{module}: boom")

    monkeypatch.setattr(rollouts, "run_program", fail)
    monkeypatch.setattr(
        rollouts, "QUICK_ROLLOUTS", RolloutPlan(24, 40, rounds=1, repeats=1, many_lanes=30, many_steps=20)
    )
    monkeypatch.setitem(ROLLOUT_PEERS, "numba_lanes", "no_such_package")
    assert status_of("rollouts", "--quick") == 0
    shown = capsys.readouterr().out
    assert "benchmarks.rollout_peers.this_project: boom" in shown
    assert "no_such_package" in shown


@pytest.mark.parametrize("option", ["--json", "--figure"])
def test_an_output_is_refused_before_anything_runs(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = tmp_path / "taken"
    taken.write_text("mine", encoding="utf-8")
    assert status_of("registration", option, taken) == 1
    printed_refusal(capsys.readouterr().err).check("output", "--force", file=taken)
    assert taken.read_text(encoding="utf-8") == "mine"
    assert status_of("registration", option, tmp_path / "no" / "such.json") == 1
    printed_refusal(capsys.readouterr().err).check("output", file="such.json")


def test_what_a_benchmark_does_not_know_is_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("mapping") == 2
    assert "registration" in capsys.readouterr().err
    assert status_of("archive", "--device", "gpu") == 1
    printed_refusal(capsys.readouterr().err).check("option", "registration", file="--device", found="archive")
    assert status_of("rollouts", "--figure", tmp_path / "f.png") == 1
    printed_refusal(capsys.readouterr().err).check("option", "closed-loop", file="--figure", found="rollouts")
