"""The record of a field: what runs worked adds up by the largest, and nothing is claimed that no moment told of."""

import hashlib
import json
from pathlib import Path

import numpy as np
import pytest

from drawn_field import UTC_NS, Drive, cover_rows, drawn_plan, write_cover_run
from lgprjax.formats import CoverPlan, WorkedRecord, stop_words
from lgprjax.frames import LocalFrame
from lgprjax.worked.evidence import UNCHECKED_SIGMA_M, Evidence
from lgprjax.worked.layers import cover_figures, way_by_driver
from lgprjax.worked.plans import PlanFile
from lgprjax.worked.record import CoverRun, moments_of_run, read_cover_run, record_cover, whole_down
from refusals import refused

_CELL_M = 0.1
_MARK = {
    "name": "M", "sigma_m": 0.0, "latitude_deg": 40.0, "longitude_deg": -100.0,
    "measured_latitude_deg": 40.0, "measured_longitude_deg": -100.0,
}  # fmt: skip
CHECKED = Evidence.model_validate({"control_point": [{**_MARK, "when": when} for when in ("before", "after")]})
"""A base that stands where it says: what is left is a centimetre of mounts."""
_PLAN = "ab" * 32
_LINES = tuple((line, 0.5 + line) for line in range(5))


@pytest.fixture(scope="module")
def plan(tmp_path_factory: pytest.TempPathFactory) -> CoverPlan:
    return drawn_plan(tmp_path_factory.mktemp("plan")).plan


def run_of(folder: Path, drive: Drive, *, begin_s: float = 0.0, cut: slice | None = None) -> CoverRun:
    rows, time_s = cover_rows(drive)
    if cut is not None:
        rows, time_s = np.delete(rows, cut), np.delete(time_s, cut)
    write_cover_run(folder, rows, time_s, begin_s=begin_s, plan_sha256=_PLAN)
    return read_cover_run(folder)


def record_of(plan: CoverPlan, *runs: CoverRun) -> WorkedRecord:
    return record_cover([PlanFile(Path("p.cover.geojson"), _PLAN, plan)], runs, cell_m=_CELL_M, evidence=CHECKED)


def column(record: WorkedRecord, north_m: float, east_m: float = 4.0) -> float:
    """Probability of the cell at a place."""
    cells = record.cells
    at = int((north_m - cells.north_m) / _CELL_M), int((east_m - cells.east_m) / _CELL_M)
    return float(cells.probability[at]) / 65535


def test_a_run_is_read_as_it_was_recorded(tmp_path: Path) -> None:
    rows, time_s = cover_rows(Drive(_LINES[:1], stop_s=3.0))
    write_cover_run(tmp_path / "a", rows, time_s)
    run = read_cover_run(tmp_path / "a")
    for name in rows.dtype.names or ():
        np.testing.assert_array_equal(run.rows[name], rows[name])
    np.testing.assert_allclose((run.utc_ns - UTC_NS) * 1e-9, time_s, atol=1e-6)
    digest = hashlib.sha256((tmp_path / "a" / "0000.lgprun").read_bytes()).hexdigest()
    assert run.provenance["segments"] == [{"file": "0000.lgprun", "sha256": digest}]
    assert run.provenance["complete"] is True
    assert [json.loads(event.text)["event"] for event in run.events] == ["speed_engaged", "route_done"]


def test_a_well_known_pass_works_its_width_and_no_more(tmp_path: Path, plan: CoverPlan) -> None:
    record = record_of(plan, run_of(tmp_path / "a", Drive(_LINES[:1])))
    # The tool is 1 m wide about 0.5 m; cells 0.05 m from its edge are 3.5 sigma within.
    assert all(column(record, north_m) > 0.999 for north_m in (0.15, 0.45, 0.85))
    assert all(column(record, north_m) < 0.001 for north_m in (-0.15, 1.15, 2.5))
    (low, high) = cover_figures(record).layers
    assert (low.level, high.level) == (0.95, 0.996)
    assert abs(low.processed_m2 - 8.0) < 0.9
    assert high.processed_m2 <= low.processed_m2
    assert low.processed_m2 + low.uncertain_m2 + low.not_processed_m2 == pytest.approx(40.0, abs=1e-6)


def test_runs_add_up_by_the_largest(tmp_path: Path, plan: CoverPlan) -> None:
    sure = run_of(tmp_path / "sure", Drive(_LINES[:3], sigma_m=0.02), begin_s=0.0)
    vague = run_of(tmp_path / "vague", Drive(_LINES[1:], sigma_m=0.2), begin_s=500.0)
    each = [record_of(plan, run).cells.probability for run in (sure, vague)]
    both = record_of(plan, vague, sure)
    np.testing.assert_array_equal(both.cells.probability, np.maximum(*each))
    assert (each[0] > each[1]).any()
    assert (each[1] > each[0]).any()
    # In the order of the work, whatever the order they were named in.
    assert [run["folder"] for run in both.provenance["runs"]] == ["sure", "vague"]
    assert set(both.channels.run.tolist()) == {0, 1}
    assert both.channels.time_s[both.channels.run == 1].min() == pytest.approx(500.0, abs=1e-6)


def test_nothing_is_worked_where_the_tool_does_not_count(tmp_path: Path, plan: CoverPlan) -> None:
    for bits in (0, 3, 7):
        record = record_of(plan, run_of(tmp_path / str(bits), Drive(_LINES[:1], tool=bits)))
        assert record.cells.probability.max() == 0
        assert len(record.passes.run) == 0
        assert cover_figures(record).layers[0].processed_m2 == 0.0


def test_nothing_is_claimed_across_a_hole_in_the_recording(tmp_path: Path, plan: CoverPlan) -> None:
    # Half a second is missing in the middle of the line: 0.2 m of way, less than the tool is long.
    rows, _ = cover_rows(Drive(_LINES[:1]))
    middle = int(np.argmin(np.abs(rows["x_m"][:200] + 0.8 - 4.0)))
    whole = record_of(plan, run_of(tmp_path / "whole", Drive(_LINES[:1])))
    run = run_of(tmp_path / "cut", Drive(_LINES[:1]), cut=slice(middle, middle + 5))
    on = moments_of_run(run)[-1]
    assert np.flatnonzero(~on).tolist()[0] == middle
    assert np.count_nonzero(on) == np.count_nonzero(run.rows["tool"] == 15)
    cut = record_of(plan, run)
    assert (cut.cells.probability <= whole.cells.probability).all()
    assert column(cut, 0.45, 2.0) > 0.999
    assert len(whole.passes.run) == 1
    # Nor does a pass, or the drawn swath, run across it: the way from the last moment before to the first after.
    assert len(cut.passes.run) == 2
    across = np.hypot(*(rows[name][middle + 5] - rows[name][middle - 1] for name in ("x_m", "y_m")))
    assert across > 0.1
    assert cut.passes.length_m.sum() == pytest.approx(whole.passes.length_m[0] - across, abs=1e-3)
    assert set(cut.swaths.number) == {0, 1}


def test_one_missing_moment_is_a_hole(tmp_path: Path) -> None:
    run = run_of(tmp_path / "cut", Drive(_LINES[:1]), cut=slice(100, 101))
    assert np.flatnonzero(~moments_of_run(run)[-1]).tolist()[:1] == [100]


def test_a_pose_that_is_no_number_claims_nothing(tmp_path: Path, plan: CoverPlan) -> None:
    rows, time_s = cover_rows(Drive(_LINES[:1]))
    rows["covariance"][:, 0, 0] = np.nan
    write_cover_run(tmp_path / "a", rows, time_s, plan_sha256=_PLAN)
    record = record_of(plan, read_cover_run(tmp_path / "a"))
    assert record.cells.probability.max() == 0


def test_a_pass_by_hand_counts_as_what_it_is(tmp_path: Path, plan: CoverPlan) -> None:
    rows, time_s = cover_rows(Drive(_LINES[:3]))
    by_hand = rows["line"] == 1
    rows["mode"][~by_hand], rows["mode"][by_hand] = 4, 5
    # Measured turning and at its depth, and told on by nobody here; on no line of the plan.
    rows["tool"][by_hand], rows["line"][by_hand] = 14, -1
    write_cover_run(tmp_path / "a", rows, time_s, plan_sha256=_PLAN)
    record = record_of(plan, read_cover_run(tmp_path / "a"))
    assert record.passes.line.tolist() == [0, -1, 2]
    ways = way_by_driver(record)
    assert list(ways.values()) == pytest.approx([18.0, 9.0], abs=0.1)
    assert column(record, 1.45) > 0.999
    # Nobody measured a mark: the same pass, claimed over less.
    plain = record_cover([PlanFile(Path("p"), _PLAN, plan)], [read_cover_run(tmp_path / "a")], cell_m=_CELL_M)
    sure = record.cells.probability > 40_000
    assert (plain.cells.probability <= record.cells.probability + 1)[sure].all()
    assert cover_figures(plain).layers[0].processed_m2 < cover_figures(record).layers[0].processed_m2 - 1.0
    assert plain.provenance["evidence"]["shared_error"]["a"]["sigma_m"] == UNCHECKED_SIGMA_M


def test_passes_stops_and_events_are_told(tmp_path: Path, plan: CoverPlan) -> None:
    record = record_of(plan, run_of(tmp_path / "a", Drive(_LINES[:3], stop_s=4.0)))
    passes = record.passes
    # The stop parts the first line in two.
    assert passes.line.tolist() == [0, 0, 1, 2]
    np.testing.assert_allclose(passes.length_m.sum(), 3 * 9.0, atol=0.3)
    np.testing.assert_allclose(passes.depth_mean_m, 0.15, atol=1e-6)
    np.testing.assert_allclose(passes.speed_largest_mps, 0.4, atol=1e-6)
    for number, line in enumerate(passes.line):
        of = record.swaths.number == number
        np.testing.assert_allclose(record.swaths.north_m[of], 0.5 + line, atol=1e-9)
        way = np.hypot(np.diff(record.swaths.east_m[of]), np.diff(record.swaths.north_m[of])).sum()
        assert way == pytest.approx(passes.length_m[number], abs=1e-6)
    stops = record.stops
    assert len(stops.run) == 1
    assert stops.end_s[0] - stops.begin_s[0] == pytest.approx(3.9, abs=1e-6)
    assert stops.reasons.tolist() == [1]
    assert cover_figures(record).stops == {stop_words(1): 1}
    assert len(record.events.text) == 2
    assert record.events.east_m[0] == pytest.approx(record.channels.x_m[0])


def test_what_was_missing_before_the_first_work_is_no_stop(tmp_path: Path, plan: CoverPlan) -> None:
    rows, time_s = cover_rows(Drive(_LINES[:2], stop_s=4.0))
    rows["tool"][:30], rows["stop"][:30] = 0, 8 | 16
    write_cover_run(tmp_path / "a", rows, time_s, plan_sha256=_PLAN)
    stops = record_of(plan, read_cover_run(tmp_path / "a")).stops
    assert stops.reasons.tolist() == [1]
    rows["tool"] = 0
    write_cover_run(tmp_path / "b", rows, time_s, begin_s=900.0, plan_sha256=_PLAN)
    assert not len(record_of(plan, read_cover_run(tmp_path / "b")).stops.run)
    # Engaged, and stopped by a tool that never worked: that is told.
    rows["mode"][20:] = 4
    write_cover_run(tmp_path / "c", rows, time_s, begin_s=1800.0, plan_sha256=_PLAN)
    assert len(record_of(plan, read_cover_run(tmp_path / "c")).stops.run) == 2


def test_the_sentence_is_markovs_bound(tmp_path: Path, plan: CoverPlan) -> None:
    record = record_of(plan, run_of(tmp_path / "a", Drive(_LINES, sigma_m=0.1)))
    cells = record.cells
    rows, columns = np.nonzero(cells.state[0] == 2)
    north = cells.north_m + _CELL_M * (rows + 0.5)
    east = cells.east_m + _CELL_M * (columns + 0.5)
    inside = (east > 0.0) & (east < 8.0) & (north > 0.0) & (north < 5.0)
    missed = 1.0 - cells.probability[rows, columns][inside] / 65535.0
    layer = cover_figures(record).layers[0]
    assert layer.mean_miss == pytest.approx(missed.mean(), rel=1e-9)
    assert layer.worked_share == pytest.approx(1.0 - missed.mean() / 0.05, rel=1e-9)
    assert 0.0 < layer.worked_share < 1.0
    assert "95 %" in layer.sentence
    assert "clear" not in layer.sentence


def test_probabilities_are_rounded_down() -> None:
    values = np.array([[0.0, 0.95, np.nextafter(np.float32(0.95), np.float32(0.0)), 1.0, np.nan, 1.5]], np.float32)
    numbers = whole_down(values.astype(np.float64))
    assert numbers.dtype == np.uint16
    assert (numbers[0, :4] / 65535.0 <= values[0, :4].astype(np.float64)).all()
    assert numbers[0].tolist() == [0, 62258, 62258, 65535, 0, 65535]


def test_what_cannot_be_recorded_is_one_line(tmp_path: Path, plan: CoverPlan) -> None:
    run = run_of(tmp_path / "a", Drive(_LINES[:1]))
    with refused("run", file="a", found="a"):
        record_of(plan, run, run)
    with refused("runs", file="p.cover.geojson"):
        record_of(plan)
    with refused("cells", file="grid"):
        record_cover([PlanFile(Path("p"), _PLAN, plan)], [run], cell_m=0.0005)
    rows, time_s = cover_rows(Drive(_LINES[:1]))
    write_cover_run(tmp_path / "none", rows[:0], time_s[:0])
    with refused("cover", file="none"):
        read_cover_run(tmp_path / "none")
    with refused(file="absent"):
        read_cover_run(tmp_path / "absent")


def test_a_run_counts_by_its_own_plan_only(tmp_path: Path, plan: CoverPlan) -> None:
    rows, time_s = cover_rows(Drive(_LINES[:1]))
    for name, told, found in (("other", "cd" * 32, "cdcdcdcdcdcd"), ("mute", None, None)):
        write_cover_run(tmp_path / name, rows, time_s, plan_sha256=told)
        with refused("plan", "--plan", file=name, found=found):
            record_of(plan, read_cover_run(tmp_path / name))
    # Named beside the first, the other plan is good; about another anchor its cells would lie elsewhere.
    other = read_cover_run(tmp_path / "other")
    both = [PlanFile(Path("p.cover.geojson"), _PLAN, plan), PlanFile(Path("g.cover.geojson"), "cd" * 32, plan)]
    record = record_cover(both, [other], cell_m=_CELL_M)
    assert record.provenance["other_plans"] == [{"file": "g.cover.geojson", "sha256": "cd" * 32}]
    moved = plan._replace(frame=LocalFrame(40.0001, -100.0, 0.0))
    with refused("plan", "p.cover.geojson", "--gaps", file="g.cover.geojson"):
        record_cover([both[0], both[1]._replace(plan=moved)], [other], cell_m=_CELL_M)
