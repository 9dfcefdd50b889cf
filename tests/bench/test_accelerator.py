"""An accelerator beside two cores: records of made-up runs, the program on what there is, what is missing is said."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from benchmarks import accelerator, on_accelerator
from benchmarks.__main__ import main
from benchmarks.accelerator import QUICK_ACCELERATOR, AcceleratorPlan, Ran, run_accelerator
from benchmarks.registration import HardSetConfig, make_hard_set, save_hard_set
from benchmarks.rollout_problem import make_problem, save_problem
from canon.site import Site

DEVICE = {"bandwidth": 4e12, "platform": "gpu", "device": "a card"}


def test_registration_is_told_with_its_floor_and_how_far_the_poses_are_apart() -> None:
    figures = {"scans": 3, "right": 3, "on_device_us": 0.5, "host_to_host_us": 2.0, "bytes": 4e5, **DEVICE}
    there = Ran(figures, {"pose": np.zeros((3, 5))})
    moved = np.zeros((3, 5))
    moved[1, :2] = 3e-3, 4e-3
    here = Ran({**figures, "host_to_host_us": 100.0}, {"pose": moved})
    records = {record.key: record for record in accelerator.registration_records(there, here, 2)}
    assert records["gpu/registration / 2 cores"].value == pytest.approx(200.0)
    assert records["gpu/registration / 2 cores"].met is True
    assert records["gpu/registration / 2 cores, host to host"].value == pytest.approx(50.0)
    assert records["gpu/registration, floor by bytes"].value == pytest.approx(0.1)
    assert "20% of the time" in records["gpu/registration, floor by bytes"].note
    assert records["gpu/registration, apart"].value == pytest.approx(5.0)
    assert records["gpu/registration, apart"].met is False
    assert "1 of 3 by more than 1 mm" in records["gpu/registration, apart"].note


def test_a_drive_agrees_in_codes_and_where_both_are_ok_in_position() -> None:
    pose = np.zeros((3, 5))
    there = Ran({"first_s": 50.0, "each_ms": 1.0}, {"code": np.array(["ok", "ok", "low"]), "pose": pose})
    other = pose.copy()
    other[:, 0] = 1e-4, 9.0, 9.0
    here = Ran({"each_ms": 2.0}, {"code": np.array(["ok", "low", "low"]), "pose": other})
    records = {record.key: record for record in accelerator.drive_records(there, here, 2)}
    assert records["gpu/drive, equal codes"].value == pytest.approx(200.0 / 3.0)
    assert records["gpu/drive, apart"].value == pytest.approx(0.1)


def run_here(problem: str, files: list[Path], tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Any, Any]:
    """The program in this process, on the processor."""
    import json

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


def test_without_an_accelerator_nothing_is_measured_and_it_is_said(tmp_path: Path) -> None:
    plan = AcceleratorPlan(HardSetConfig(maps=1, scans=2), lanes=16, steps=4)
    outcome = run_accelerator("rollouts", plan, tmp_path, lambda _: None)
    assert outcome.records == []
    assert outcome.not_measured == ["rollouts: JAX finds no accelerator here"]
    assert QUICK_ACCELERATOR.lanes < 1e5


def test_benchmarks_that_no_accelerator_runs_are_refused(capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as stopped:
        main(["archive", "--device", "gpu"])
    assert stopped.value.code == 1
    assert "registration, rollouts or drive" in capsys.readouterr().err
