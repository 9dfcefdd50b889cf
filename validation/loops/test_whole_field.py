"""A field of 30 x 20 m worked from the start to its last line in lock step, by the bytes of every line.

The plan, the vehicle and GNSS's outages are those of ``onboard/field.run.toml``.
"""

import math
from collections.abc import Callable
from pathlib import Path

import numpy as np

from canon.field import VEHICLE, before_the_start
from canon.field_loop import FieldLoop
from lgprjax.autopilot import Mode
from lgprjax.coverage import CellState, cell_states, grid_of_field, inside_cells
from lgprjax.coverage.field import Field
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.skid.setup import load_skid
from lgprjax.runtime.coverage.worked_map import WorkedMap
from lgprjax.worked.plans import PlanOptions, make_cover_plan, save_cover_plan

ONBOARD = VEHICLE.parent
INCH_M = 0.0254


def test_a_whole_field_is_worked_with_gps_off_a_third_of_the_time(
    tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    plan = make_cover_plan(ONBOARD / "field.geojson", VEHICLE, PlanOptions(order="zamboni"))
    assert plan is not None
    save_cover_plan(tmp_path / "field.cover.geojson", plan)
    text = (ONBOARD / "field.run.toml").read_text(encoding="utf-8").replace("../out/onboard/", "")
    (tmp_path / "field.run.toml").write_text(
        text.replace('"made_up', f'"{ONBOARD}/made_up').replace('"field.geojson"', f'"{ONBOARD}/field.geojson"'),
        encoding="utf-8",
    )
    config = read_config(tmp_path / "field.run.toml")
    loaded = load_skid(config)
    assert config.simulation is not None
    pose, way = before_the_start(loaded)
    script = [way, *config.simulation.script[1:]]
    loop = FieldLoop(config, loaded, pose, script, config.simulation.faults)
    assert loop.run(120.0, lambda at: at.mode is Mode.SPEED), loop.events[-5:]
    loop.run(2400.0, lambda at: at.mode is not Mode.SPEED)
    rows, covers = np.array(loop.rows), loop.covers

    # The plan's end hands over, and nothing did before it.
    drives = rows["mode"] == int(Mode.SPEED)
    assert rows["to_go_m"][drives][-1] < 1.0, loop.events[-5:]
    assert set(rows["line"][drives]) == set(range(-1, loaded.lines))
    assert not [row for _, row in covers[:-20] if int(row["mode"]) == int(Mode.SPEED) and int(row["stop"])]

    truth, at_ns = loop.stage.truth.arrays(), np.array(loop.times_ns)[drives]
    x, y, yaw, fixed = (np.interp(at_ns, truth["mono_ns"], truth[n]) for n in ("x_m", "y_m", "yaw_rad", "gnss_on"))
    believed = rows["pose"][drives]
    off_m = np.hypot(believed[:, 0] - x, believed[:, 1] - y)
    turned = np.degrees(np.abs(np.angle(np.exp(1j * (believed[:, 2] - yaw)))))
    inch = math.sqrt(np.mean(off_m[fixed > 0.5] ** 2))
    record_property("position_with_rtk_cm", round(100.0 * inch, 2))
    record_property("largest_heading_deg", round(float(turned.max()), 2))
    assert 0.6 < np.mean(fixed > 0.5) < 0.75
    assert inch < INCH_M
    assert turned.max() < 1.0

    field = Field(loaded.perimeter_m)
    grid = grid_of_field(field, 0.1, loaded.setup.tool.width_m)
    held = WorkedMap(grid, loaded.setup.tool, 0.0)
    for time_ns, cover in covers:
        held.take(cover, time_ns)
    worked = cell_states(held.probability(), 0.95)[inside_cells(field, grid)] == CellState.PROCESSED
    record_property("worked_percent", round(100.0 * float(np.mean(worked)), 2))
    assert np.mean(worked) > 0.98
