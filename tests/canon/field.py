"""A small field with its plan and configuration, and a drive of it at moments from which faults take their course."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from canon.field_loop import FieldLoop
from lgprjax.autopilot import Mode
from lgprjax.frames import LocalFrame
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.control.skid.setup import SkidLoaded
from lgprjax.worked.plans import PlanOptions, make_cover_plan, save_cover_plan

VEHICLE = Path(__file__).resolve().parents[2] / "onboard" / "made_up_flail.vehicle.toml"
FRAME = LocalFrame(48.0, 11.0, 0.0)
CORNERS_M = np.array([[0.0, 0.0], [12.0, 0.0], [12.0, 6.0], [0.0, 6.0]])
BEHIND_M = 7.0
CONFIG = f"""
name = "small"
vehicle = "{VEHICLE}"
[coverage]
PLAN
speed_mps = 0.5
[ports]
drive_by_wire = {{ url = "/dev/null" }}
controller = {{ url = "/dev/null" }}
gnss = {{ url = "/dev/null" }}
[sensors]
gnss_delay_s = 0.1
gnss_period_s = 1.0
"""


class Moments(NamedTuple):
    """A drive on a line with the tool on, and in the turn after it; config and files are shared by all."""

    config: RuntimeConfig
    loaded: SkidLoaded
    line: FieldLoop
    turn: FieldLoop

    def at(self, name: str) -> FieldLoop:
        """A copy of a moment, to go on by itself."""
        moment: FieldLoop = getattr(self, name)
        return moment.copy(self.config, self.loaded)


def make_field(folder: Path) -> Path:
    """Field, plan and configuration; the configuration's path."""
    latitude, longitude, _ = FRAME.to_geodetic(CORNERS_M[:, 0], CORNERS_M[:, 1], np.zeros(4))
    ring = [[float(east), float(north)] for east, north in zip(longitude, latitude, strict=True)]
    polygon = {"type": "Polygon", "coordinates": [[*ring, ring[0]]]}
    text = json.dumps({"type": "Feature", "properties": {}, "geometry": polygon})
    (folder / "small.geojson").write_text(text, encoding="utf-8")
    plan = make_cover_plan(folder / "small.geojson", VEHICLE, PlanOptions(order="boustrophedon"))
    assert plan is not None
    save_cover_plan(folder / "small.cover.geojson", plan)
    file = folder / "small.run.toml"
    file.write_text(CONFIG.replace("PLAN", 'plan = "small.cover.geojson"'), encoding="utf-8")
    (folder / "corners.run.toml").write_text(CONFIG.replace("PLAN", ""), encoding="utf-8")
    return file


def before_the_start(loaded: SkidLoaded) -> tuple[tuple[float, float, float], dict[str, Any]]:
    """A pose straight before the plan's start, and the operator's way from there to it."""
    x, y, yaw = (float(number) for number in np.asarray(loaded.route.rows[0, :3], np.float64))
    pose = (x - BEHIND_M * float(np.cos(yaw)), y - BEHIND_M * float(np.sin(yaw)), yaw)
    return pose, {"at_s": 0.2, "do": "drive_to", "x_m": x, "y_m": y, "speed_mps": 0.7}


def drive_to_moments(file: Path, loaded: SkidLoaded) -> Moments:
    """The operator drives to the start and engages; then the plan is driven."""
    config = read_config(file)
    pose, way = before_the_start(loaded)
    script = [
        way,
        {"at_arrival": 1, "do": "press", "button": "steering", "for_s": 0.3},
        {"after": {"mode": int(Mode.STEERING), "for_s": 0.6}, "do": "press", "button": "plus", "for_s": 0.3},
    ]
    loop = FieldLoop(config, loaded, pose, script, [])
    assert loop.run(40.0, until=lambda each: each.stage.moved.x_m > 3.0), loop.events
    assert loop.mode is Mode.SPEED, loop.events
    line = loop.copy(config, loaded)
    assert loop.run(60.0, until=lambda each: int(each.rows[-1]["line"]) == -1), loop.events
    assert loop.run(2.0) is False
    return Moments(config, loaded, line, loop)
