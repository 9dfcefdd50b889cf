"""Earlier runs taken up: the place where the last moment counted, a map that is the record's, machines side by side."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from drawn_field import Drive, cover_rows, drawn_plan, write_cover_run
from lgprjax.coverage.resume import RoutePlace
from lgprjax.formats.coverage_files import read_taken_up, write_taken_up
from lgprjax.worked.plans import PlanFile
from lgprjax.worked.record import CoverRun, record_cover
from lgprjax.worked.resume import TAKEN_UP, last_place, runs_by_plan, take_up
from refusals import refused

_CELL_M = 0.1
USUAL: dict[str, Any] = {"cell_m": _CELL_M, "level": 0.95, "shared_sigma_m": 0.0}


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> PlanFile:
    return drawn_plan(tmp_path_factory.mktemp("plan"))


def drawn_run(
    folder: Path,
    plan: PlanFile,
    lines: range,
    *,
    keep: int | None = None,
    begin_s: float = 0.0,
    machine: str | None = None,
) -> Path:
    """A run along lines of the plan, cut after so many moments: the power went."""
    rows, time_s = cover_rows(Drive(tuple((line, 0.5 + line) for line in lines)))
    kept = slice(0, keep)
    write_cover_run(folder, rows[kept], time_s[kept], begin_s=begin_s, plan_sha256=plan.sha256, machine=machine)
    return folder


def test_a_run_that_was_cut_is_taken_up_where_it_ended(tmp_path: Path, plan: PlanFile) -> None:
    drawn_run(tmp_path / "one", plan, range(3), keep=330)
    (run,) = runs_by_plan(tmp_path, plan)
    counted = np.flatnonzero((run.rows["tool"] & 8) != 0)[-1]
    row = run.rows[counted]
    last = last_place(plan, [run])
    assert last is not None
    line = plan.plan.pattern.lines[last.line]
    assert last.line == int(row["line"])
    centre = np.array([row["x_m"] + 0.8 * np.cos(row["yaw_rad"]), row["y_m"] + 0.8 * np.sin(row["yaw_rad"])])
    along = (line.end_m - line.start_m) / line.length_m
    assert last.along_m == pytest.approx(float((centre - line.start_m) @ along), abs=0.01)
    held = take_up(plan, [run], **USUAL)
    assert held.resumption.place.line == last.line
    assert held.resumption.place.along_m == pytest.approx(max(last.along_m - 1.0, 0.0))
    record = record_cover([plan], [run], cell_m=_CELL_M)
    held = take_up(plan, [run], cell_m=_CELL_M, level=0.95)
    np.testing.assert_array_equal(np.floor(held.probability.astype(np.float64) * 65535), record.cells.probability)


def test_what_was_taken_up_is_not_gone_through_again(tmp_path: Path, plan: PlanFile) -> None:
    drawn_run(tmp_path / "a", plan, range(2))
    (first,) = runs_by_plan(tmp_path, plan)
    held = take_up(plan, [first], **USUAL)
    drawn_run(tmp_path / "b", plan, range(2, 4), begin_s=900.0)
    write_taken_up(tmp_path / "b" / TAKEN_UP, held)
    again = read_taken_up(tmp_path / "b" / TAKEN_UP)
    assert again._replace(probability=held.probability) == held
    np.testing.assert_array_equal(again.probability, held.probability)
    runs = runs_by_plan(tmp_path, plan)
    done: list[int] = []
    both = take_up(plan, runs, **USUAL, progress=done.append)
    assert sum(done) == len(runs[1].rows)
    alone = [take_up(plan, [run._replace(folder=tmp_path)], **USUAL) for run in runs]
    np.testing.assert_array_equal(both.probability, np.maximum(*(each.probability for each in alone)))
    assert len(both.runs) == 2
    # A map that was made with less doubt of the positions is no evidence where more is called for.
    done.clear()
    doubted = take_up(plan, runs, cell_m=_CELL_M, level=0.95, shared_sigma_m=0.3, progress=done.append)
    assert sum(done) == sum(len(run.rows) for run in runs)
    assert (doubted.probability >= 0.95).sum() < 0.5 * (both.probability >= 0.95).sum()


def test_a_run_that_was_copied_while_it_grew_is_read_again(tmp_path: Path, plan: PlanFile) -> None:
    """Machine B began with half of A's run: what A did in the afternoon is in the map as soon as the rest is there."""
    drawn_run(tmp_path / "half" / "a", plan, range(3), keep=330)
    half = take_up(plan, runs_by_plan(tmp_path / "half", plan), **USUAL)
    drawn_run(tmp_path / "whole" / "a", plan, range(3))
    drawn_run(tmp_path / "whole" / "b", plan, range(3, 4), begin_s=900.0)
    write_taken_up(tmp_path / "whole" / "b" / TAKEN_UP, half)
    runs = runs_by_plan(tmp_path / "whole", plan)
    held = take_up(plan, runs, **USUAL)
    alone = [take_up(plan, [run._replace(folder=tmp_path)], **USUAL) for run in runs]
    np.testing.assert_array_equal(held.probability, np.maximum(*(each.probability for each in alone)))
    assert (held.probability > half.probability).any()
    assert len(held.runs) == 2
    # Then it is known whole, and a file of a program that did not count moments has it read once more.
    write_taken_up(tmp_path / "whole" / "b" / TAKEN_UP, held)
    done: list[int] = []
    take_up(plan, runs, progress=done.append, **USUAL)
    assert sum(done) == 0
    old = held._replace(runs=tuple(each.partition(":")[0] for each in held.runs))
    write_taken_up(tmp_path / "whole" / "b" / TAKEN_UP, old)
    assert take_up(plan, runs, progress=done.append, **USUAL).runs == held.runs
    assert sum(done) == sum(len(run.rows) for run in runs)


def test_another_machine_began_at_a_later_line(tmp_path: Path, plan: PlanFile) -> None:
    drawn_run(tmp_path / "other", plan, range(3, 5))
    runs = runs_by_plan(tmp_path, plan)
    held = take_up(plan, runs, **USUAL, place=RoutePlace(0, 0.0))
    assert held.resumption.place == RoutePlace(0, 0.0)
    assert {each.line for each in held.resumption.worked} <= {3, 4}
    assert held.resumption.worked
    with refused("start line", "1 to 5", file="f.cover.geojson", found=9):
        take_up(plan, runs, **USUAL, place=RoutePlace(8, 0.0))
    with refused("start metre", "8.00", found=8):
        take_up(plan, runs, **USUAL, place=RoutePlace(0, 8.0))
    with refused("resume", found="--gaps"):
        take_up(plan, [drawn(tmp_path, plan)], **USUAL)


def test_each_of_two_machines_goes_on_where_it_was_itself(tmp_path: Path, plan: PlanFile) -> None:
    """The other one's last moment is the newer: begun there, all between the two would be left out."""
    drawn_run(tmp_path / "a", plan, range(2), keep=330, machine="flail 1")
    drawn_run(tmp_path / "b", plan, range(3, 5), keep=330, begin_s=900.0, machine="flail 2")
    runs = runs_by_plan(tmp_path, plan)
    assert [run.machine for run in runs] == ["flail 1", "flail 2"]
    held = [take_up(plan, runs, machine=each, **USUAL) for each in ("flail 1", "flail 2")]
    assert [each.resumption.place.line for each in held] == [1, 4]
    np.testing.assert_array_equal(held[0].probability, held[1].probability)
    with refused("resume", "flail 3", found="--start-line"):
        take_up(plan, runs, machine="flail 3", **USUAL)
    # Its share ends with its third line: nothing of the others' is driven, whoever has done it.
    own = take_up(plan, runs, machine="flail 1", last_line=2, **USUAL)
    assert [(each.line, each.low_m) for each in own.resumption.worked if each.line > 2] == [(3, 0.0), (4, 0.0)]
    with refused("end line", "2 to 5", found=1):
        take_up(plan, runs, machine="flail 1", last_line=0, **USUAL)
    # Who recorded before machines were told is taken as one's own.
    old = [run._replace(machine=None) for run in runs]
    assert take_up(plan, old, machine="flail 3", **USUAL).resumption.place.line == 4


def drawn(folder: Path, plan: PlanFile) -> CoverRun:
    drawn_run(folder / "end" / "run", plan, range(4, 5), begin_s=5000.0)
    run = runs_by_plan(folder / "end", plan)[0]
    # The tool's centre beyond the last line's end.
    line = plan.plan.pattern.lines[4]
    along = (line.end_m - line.start_m) / line.length_m
    rows = run.rows.copy()
    at = np.flatnonzero((rows["tool"] & 8) != 0)[-1]
    rows["x_m"][at], rows["y_m"][at] = line.end_m - 0.79 * along
    return run._replace(rows=rows)


def test_a_file_that_is_damaged_is_refused(tmp_path: Path) -> None:
    path = tmp_path / TAKEN_UP
    with refused("file", file=path):
        read_taken_up(path)
    path.write_bytes(b"PK\x03\x04 half")
    with refused("file", file=path):
        read_taken_up(path)
    np.savez(path, head=np.array("{}"))
    with refused("file", file=path, found="probability"):
        read_taken_up(path)
