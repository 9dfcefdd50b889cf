"""The benchmark of a whole drive: records of made-up runs, and its program on a short drive."""

import json
from pathlib import Path
from typing import Any

import pytest

from benchmarks.whole_drive import drive_records, main
from canon.site import Site


def run_of(seconds: float, **more: Any) -> dict[str, Any]:
    return {"scans": 1000, "ok": 0.5, "seconds": seconds, "compile_s": 2.0, "peak_rss_mb": 900.0, **more}


def test_compiling_is_told_apart_and_goals_are_held() -> None:
    runs = {
        "first process": run_of(14.0),
        "default": run_of(2.6, parts={"reading": 0.1}),
        "single scans": run_of(3.0),
        "windows of 4 m": run_of(4.0),
        "3 channels on 20 lines": run_of(7.0),
        "command": {"seconds": 5.0},
    }
    records = {record.key: record for record in drive_records(runs, 2)}
    assert records["drive/default"].value == pytest.approx(0.6)
    assert records["drive/default"].met is True
    assert records["drive/3 channels on 20 lines"].met is False
    assert records["drive/windows of 4 m / single scans"].value == pytest.approx(2.0)
    assert records["drive/windows of 4 m / single scans"].met is False
    assert records["drive/compile, second process"].met is True
    assert records["drive/command"].value == pytest.approx(5.0)
    assert records["drive/of it: reading"].value == pytest.approx(0.1)
    assert "drive/first process" not in records


def test_runs_that_failed_leave_no_records() -> None:
    assert drive_records({}, 2) == []
    assert [record.key for record in drive_records({"default": run_of(2.6)}, 2)] == [
        "drive/default",
        "drive/compile, second process",
    ]


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
