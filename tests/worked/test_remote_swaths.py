"""Ground worked by remote control: what its record claims, against where the true tool was, in the closed loop."""

import math
from collections.abc import Iterable
from pathlib import Path

import numpy as np
import pytest
from scipy import ndimage

from canon.field import FRAME, make_field
from canon.field_loop import FieldLoop
from lgprjax.autopilot import Mode
from lgprjax.coverage import CellState
from lgprjax.frames import body_to_local
from lgprjax.run_records import ToolBits
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.skid.setup import load_skid
from lgprjax.simulation.devices.faults import ScriptItem
from lgprjax.simulation.devices.field_stage import RemoteHands, Teleoperator
from lgprjax.worked.evidence import Evidence
from lgprjax.worked.layers import grid_of, way_by_driver
from lgprjax.worked.plans import open_cover_plan
from lgprjax.worked.record import CoverRun, record_cover
from true_cells import true_cells

_LENGTH_M, _SPACING_M, _DEPTH_M = 6.0, 0.96, 0.15
_SIGMAS = 1.645
"""Of the position, by which a place must be within the tool's edge to be claimed at 95 %."""
_RAISED_M = (2.0, 3.5)
"""Stretch of the third swath that the operator drives with the tool raised."""
_MARK = {
    "name": "M", "sigma_m": 0.0, "latitude_deg": FRAME.latitude_deg, "longitude_deg": FRAME.longitude_deg,
    "measured_latitude_deg": FRAME.latitude_deg, "measured_longitude_deg": FRAME.longitude_deg,
}  # fmt: skip
_CHECKED = Evidence.model_validate({"control_point": [{**_MARK, "when": when} for when in ("before", "after")]})


class WorkingOperator(Teleoperator):
    """Lowers the tool on every other way: to and fro along the swaths, and raises it on the ways between them."""

    def step(self, running: Iterable[ScriptItem], x_m: float, y_m: float, yaw_rad: float, step_s: float) -> RemoteHands:
        hands = super().step(running, x_m, y_m, yaw_rad, step_s)
        along = self._rest_s <= 0.0 and self.arrivals % 2 == 1 and abs(math.sin(yaw_rad)) < 0.1
        raised = self.arrivals == 5 and _RAISED_M[0] < x_m < _RAISED_M[1]
        tool_m = _DEPTH_M if along and not raised else None
        return hands._replace(remote=hands.remote._replace(tool_m=tool_m))


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("remote")
    make_field(made)
    return made


@pytest.fixture(scope="module")
def loop(folder: Path) -> FieldLoop:
    """Four swaths to and fro by remote control; nothing is ever engaged."""
    config = read_config(folder / "small.run.toml")
    ends = (0.0, _LENGTH_M)
    places = [(ends[(line + end) % 2], 1.0 + line * _SPACING_M) for line in range(4) for end in range(2)]
    script = [{"at_s": 0.2, "do": "drive_to", "x_m": x, "y_m": y, "speed_mps": 0.7} for x, y in places]
    driven = FieldLoop(config, load_skid(config), (-6.0, 0.9, 0.0), script, [])
    driven.stage.operator = WorkingOperator()
    assert driven.run(180.0, until=lambda each: each.stage.operator.arrivals == len(places)), driven.events
    return driven


@pytest.mark.parametrize(
    ("evidence", "shared_m", "least"), [(None, 0.05, 0.84), (_CHECKED, 0.01, 0.91)], ids=["no control point", "checked"]
)
def test_what_is_driven_by_remote_control_is_recorded(
    folder: Path, loop: FieldLoop, evidence: Evidence | None, shared_m: float, least: float
) -> None:
    """All of the way; of the ground all but its edges, which no position of such a sigma can be sure of."""
    assert {int(row["mode"]) for row in loop.rows}.isdisjoint({int(Mode.STEERING), int(Mode.SPEED)})
    rows, times_ns = np.array([row for _, row in loop.covers]), np.array([time_ns for time_ns, _ in loop.covers])
    plan = open_cover_plan(folder / "small.cover.geojson")
    told = {"run": "u", "folder": "remote", "complete": True, "segments": []}
    run = CoverRun("remote", times_ns, rows, (), told, plan.sha256, folder)
    record = record_cover([plan], [run], evidence=evidence)
    grid, tool, claimed = grid_of(record), plan.plan.tool, record.cells.state[0] == CellState.PROCESSED

    truth = loop.stage.truth.arrays()
    works = (truth["turns"] > 0.5) & (np.abs(truth["depth_m"] - _DEPTH_M) < 0.03)
    poses = np.stack([truth[name] for name in ("x_m", "y_m", "yaw_rad")], axis=1)
    worked = true_cells(grid, tool, poses, works)
    # The middle of the tool, along all of its way.
    east, north, yaw = poses[works].T
    x, y = body_to_local(east, north, yaw, tool.ahead_m, tool.left_m)
    row, column = (np.floor((at - low) / grid.cell_m).astype(int) for at, low in ((y, grid.north_m), (x, grid.east_m)))
    there = (column >= 0) & (column < grid.east_cells)
    middle = float(np.mean(claimed[row[there], column[there]]))

    counts = (rows["tool"] & ToolBits.COUNTS) != 0
    # Ten moments a second, a hundred ticks.
    assert counts.sum() / 10.0 == pytest.approx(works.sum() / 100.0, abs=1.0)
    sigma_m = math.hypot(float(np.sqrt(rows["covariance"][counts][:, 1, 1].mean())), shared_m)
    deep = ndimage.distance_transform_edt(worked) * grid.cell_m > _SIGMAS * sigma_m + 2.0 * grid.cell_m
    share = float(np.mean(claimed[worked]))
    print(
        f"{shared_m:g} m of shared error: middle of the tool {100 * middle:.1f} %, ground {100 * share:.1f} %"
        f", inside its edges {100 * np.mean(claimed[deep]):.2f} % of {worked.sum() * grid.cell_m**2:.1f} m2"
    )
    assert middle > 0.97
    assert share > least
    assert np.mean(claimed[deep]) > 0.999
    # Nothing that was not worked, the stretch with the tool raised included.
    assert not (claimed & ~worked).any()
    assert list(way_by_driver(record).values()) == pytest.approx([4 * _LENGTH_M], rel=0.1)
