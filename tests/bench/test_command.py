"""``python -m benchmarks`` as a person meets it: what is printed, what is written, what is refused."""

import json
from pathlib import Path

import pytest

from benchmarks import HardSetConfig, registration
from benchmarks.__main__ import main
from benchmarks.peers import PEERS
from benchmarks.registration import PeerRun, Plan

TINY = Plan(
    HardSetConfig(maps=1, scans=3),
    (
        PeerRun("ours", "this_project", 3),
        PeerRun("control", "numba_control", 3),
        PeerRun("swarm", "pyswarms_peer", 1),
    ),
    threads=(1,),
    latency_scans=0,
    tiles=False,
    stages=False,
    kilometres=(),
)


def status_of(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def test_tiny_run_prints_and_writes_what_it_found(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr(registration, "QUICK", TINY)
    for name in ("numba_control", "pyswarms_peer"):
        monkeypatch.setitem(PEERS, name, "no_such_package")
    path = tmp_path / "figures.json"
    assert status_of("registration", "--quick", "--json", path) == 0
    shown = capsys.readouterr().out
    assert "rough" in shown
    lacking = 'package no_such_package is not installed: pip install "lgprjax[bench]"'
    assert f"missing: numba_control: {lacking}" in shown
    assert f"missing: pyswarms_peer: {lacking}" in shown
    assert "not measured" not in shown
    figures = json.loads(path.read_text(encoding="utf-8"))
    assert figures["quick"] is True
    assert figures["machine"] in shown
    ours = figures["peers"][0]
    assert (ours["role"], ours["problems"]) == ("ours", 3)
    assert ours["successes"] >= 2
    assert ours["batch_ms"] > 0.0
    records = {record["key"]: record for record in figures["records"]}
    assert records["success"]["value"] == pytest.approx(100.0 * ours["successes"] / 3)
    assert records["single / control"]["value"] is None
    assert records["single / control"]["met"] is False


@pytest.mark.parametrize("option", ["--json", "--figure"])
def test_output_is_refused_before_anything_runs(
    option: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    taken = tmp_path / "taken"
    taken.write_text("mine", encoding="utf-8")
    assert status_of("registration", option, taken) == 1
    assert "one that exists" in capsys.readouterr().err
    assert taken.read_text(encoding="utf-8") == "mine"
    assert status_of("registration", option, tmp_path / "no" / "such.json") == 1
    assert "no such folder" in capsys.readouterr().err


def test_unknown_benchmark_is_usage(capsys: pytest.CaptureFixture[str]) -> None:
    assert status_of("mapping") == 2
    assert "registration" in capsys.readouterr().err
