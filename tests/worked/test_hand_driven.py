"""Ground worked by remote control without a plan: the live map, its record, and that nothing is ever commanded."""

import json
from pathlib import Path

import numpy as np
import pytest
import shapely

from canon.commands import run as run_words
from drawn_field import write_cover_run
from lgprjax.autopilot import Mode
from lgprjax.coverage import CellState, cell_states
from lgprjax.formats import read_worked
from lgprjax.frames import body_to_local
from lgprjax.run_records import ToolBits
from lgprjax.runtime.coverage import worked_map
from lgprjax.runtime.coverage.worked_map import OpenMap
from lgprjax.wire import decode
from lgprjax.worked.layers import cover_figures, grid_of
from lgprjax.worked.plans import open_cover_plan
from lgprjax.worked.record import read_cover_run, record_cover
from refusals import refused
from true_cells import true_cells
from worked.hand_driven import HandDriven, drive_by_hand

SHARED_M = 0.05
"""An axis; no control point was measured."""


@pytest.fixture(scope="module")
def driven(tmp_path_factory: pytest.TempPathFactory) -> HandDriven:
    return drive_by_hand(tmp_path_factory.mktemp("hand"))


def test_nothing_is_commanded(driven: HandDriven) -> None:
    frames = [decode(raw) for _, _, sent in driven.loop.ticks for raw in sent]
    commands = [frame for frame in frames if frame.name == "skid_command"]
    assert len(commands) > 1000
    assert {
        float(frame.number(name)) for frame in commands for name in ("left_mps", "right_mps", "tool", "engage")
    } == {0.0}
    assert {int(row["mode"]) for row in driven.loop.rows}.isdisjoint({int(Mode.STEERING), int(Mode.SPEED)})
    assert driven.loop.state["refusal_text"]
    assert len(driven.loop.state.get("path") or driven.loop.kind._panel._points) > 20


def test_the_record_has_the_way_and_no_ground_beside_it(driven: HandDriven, tmp_path: Path) -> None:
    record_file = tmp_path / "r.worked.h5"
    done = run_words("cover", "record", driven.run, "-o", record_file)
    assert done.status == 0, done.err
    record = read_worked(record_file)
    grid, claimed = grid_of(record), record.cells.state[0] == CellState.PROCESSED
    assert (record.frame, record.tool) == (driven.anchor, driven.loaded.setup.tool)
    poses, works = driven.truth()
    assert not (claimed & ~true_cells(grid, record.tool, poses, works)).any()
    share = driven.middle_claimed(grid, claimed)
    print(f"way of the tool's middle recorded: {100 * share:.2f} %")
    assert share >= 0.95
    # Ten moments a second while it worked: nothing of the table is missing either.
    counts = (record.channels.tool & ToolBits.COUNTS) != 0
    assert counts.sum() / 10.0 == pytest.approx(works.sum() / 100.0, abs=0.5)
    assert len(record.passes.run) == 2
    assert sum(record.passes.length_m) == pytest.approx(2 * 6.0, abs=0.6)
    # The field is the convex outline of where the tool truly was.
    east, north, yaw = poses[works].T
    corners = [
        np.stack(body_to_local(east, north, yaw, record.tool.ahead_m + ahead, record.tool.left_m + left), axis=1)
        for ahead in (-0.5 * record.tool.length_m, 0.5 * record.tool.length_m)
        for left in (-0.5 * record.tool.width_m, 0.5 * record.tool.width_m)
    ]
    outline_m2 = shapely.MultiPoint(np.concatenate(corners)).convex_hull.area
    assert cover_figures(record).area_m2 == pytest.approx(outline_m2, rel=0.05)
    done = run_words("cover", "export", record_file, "-o", tmp_path / "out")
    assert done.status == 0, done.err
    shapes = json.loads((tmp_path / "out" / "r.geojson").read_text(encoding="utf-8"))
    assert {each["properties"]["layer"] for each in shapes["features"]} >= {"perimeter", "swaths", "processed_p95"}


def test_the_live_map_is_the_record(driven: HandDriven, monkeypatch: pytest.MonkeyPatch) -> None:
    """Though its window has moved with the tool: this one is small, and moves each metre."""
    monkeypatch.setattr(worked_map, "_WINDOW_TOOLS", 5.0)
    record = record_cover([], [read_cover_run(driven.run)])
    live = OpenMap(0.05, record.tool, SHARED_M)
    for at_ns, row in driven.loop.covers:
        live.take(row, at_ns)
    assert not live.full
    recorded, shown = grid_of(record), live.probability()
    rows, columns = (
        round((own - other) / 0.05)
        for own, other in ((recorded.north_m, live.grid.north_m), (recorded.east_m, live.grid.east_m))
    )
    same = shown[rows : rows + recorded.north_cells, columns : columns + recorded.east_cells]
    assert same.shape == recorded.shape
    assert np.abs(same - record.cells.probability / 65535.0).max() < 2e-3
    assert (cell_states(shown, 0.95) == CellState.PROCESSED).sum() == pytest.approx(
        (record.cells.state[0] == CellState.PROCESSED).sum(), rel=2e-3
    )


def test_a_live_map_that_is_full_says_so_and_keeps_what_it_has(
    driven: HandDriven, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(worked_map, "_WINDOW_TOOLS", 5.0)
    live = OpenMap(0.05, driven.loaded.setup.tool, SHARED_M)
    monkeypatch.setattr(worked_map, "_MOST_CELLS", 2 * live._side**2)
    areas, full = [0.0], [False]
    for at_ns, row in driven.loop.covers:
        live.take(row, at_ns)
        if int(row["tool"]) & ToolBits.COUNTS:
            areas.append(float(np.sum(live.probability() > 0.95)))
            full.append(live.full)
    assert any(full)
    assert areas[full.index(True)] > 1000
    assert np.all(np.diff(areas) >= 0.0)
    assert live.grid.north_cells * live.grid.east_cells <= 2 * live._side**2


def test_a_run_without_a_plan_counts_for_a_plan_made_later(driven: HandDriven) -> None:
    """Its positions are in a frame of their own, and the plan in another."""
    plan = open_cover_plan(driven.run.parent / "small.cover.geojson")
    record = record_cover([plan], [read_cover_run(driven.run)])
    alone = record_cover([], [read_cover_run(driven.run)])
    assert record.frame != alone.frame
    areas = [float(np.sum(each.cells.state[0] == CellState.PROCESSED)) for each in (record, alone)]
    assert areas[0] == pytest.approx(areas[1], rel=0.01)


def test_runs_that_do_not_belong_together_are_refused(driven: HandDriven, tmp_path: Path) -> None:
    run = read_cover_run(driven.run)
    with refused("run", driven.run.name):
        record_cover([], [run, run])
    rows = np.array([row for _, row in driven.loop.covers][:50])
    assert run.without_plan is not None
    tool = run.without_plan.tool
    header = {"version": "0", "plan_sha256": None, "vehicle": run.without_plan.vehicle, "tool": tool._asdict()}
    write_cover_run(tmp_path / "nowhere", rows, 0.1 * np.arange(50), header=header)
    with refused("anchor", "none"):
        read_cover_run(tmp_path / "nowhere")
    anchor = [48.0, 11.0, 500.0]
    wider = header | {"tool": tool._replace(width_m=2.0)._asdict()}
    write_cover_run(tmp_path / "wider", rows, 0.1 * np.arange(50), header=wider, anchor=anchor, begin_s=900.0)
    with refused("tool", "2.0"):
        record_cover([], [run, read_cover_run(tmp_path / "wider")])
    write_cover_run(tmp_path / "planned", rows, 0.1 * np.arange(50), plan_sha256="ab" * 32, begin_s=1900.0)
    with refused("plan", "abab"):
        record_cover([], [read_cover_run(tmp_path / "planned")])
    rows["tool"] = 0
    write_cover_run(tmp_path / "idle", rows, 0.1 * np.arange(50), header=header, anchor=anchor, begin_s=2900.0)
    with refused("cover", "none"):
        record_cover([], [read_cover_run(tmp_path / "idle")])
