"""Routes that pass a lane several times, driven by RTK alone on the stage of a course."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from canon.course_loop import OnboardLoop
from lgprjax.autopilot import EngagementInhibit, Mode
from lgprjax.navigation import RouteSpeeds, RouteTrack, legs_of_track, make_route_path
from lgprjax.run_records import Record, RecordKind, Source
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.setup import LaidRoute, Loaded, load
from lgprjax.simulation.devices.world import CourseWorld
from runtime.test_gnss_alone import FASTER, by_rtk

LANE_M = 30.0
_STEP_M, _RADIUS_M = 0.25, 14.0
_PRESS = {"do": "press", "button": "steering", "for_s": 0.3}


def _walk(turns: list[tuple[float, float]]) -> Float[np.ndarray, "point 3"]:
    """x, y and heading of a path from the origin eastward: lengths and curvatures."""
    x, y, yaw = 0.0, 0.0, 0.0
    rows = [(x, y, yaw)]
    for length_m, curvature in turns:
        count = round(length_m / _STEP_M)
        for _ in range(count):
            step = length_m / count
            yaw += 0.5 * step * curvature
            x, y = x + step * np.cos(yaw), y + step * np.sin(yaw)
            yaw += 0.5 * step * curvature
            rows.append((x, y, yaw))
    return np.array(rows)


def _points(shape: str) -> Float[np.ndarray, "point 3"]:
    bend, third, lane = 1.0 / _RADIUS_M, _RADIUS_M * np.pi / 3.0, (LANE_M, 0.0)
    if shape == "out and back":
        # 60° right, 300° left, 60° right: turned round, on the same lane.
        return _walk([lane, (third, -bend), (5.0 * third, bend), (third, -bend), lane])
    # Two loops that share a lane, which is passed three times in the same direction.
    left, right = ([(3.0 * third, side), lane, (3.0 * third, side)] for side in (bend, -bend))
    return _walk([lane, *left, lane, *right, lane])


class Overlapping(NamedTuple):
    """A route on a stage: its configuration and files, and its points with headings in the map's frame."""

    config: RuntimeConfig
    loaded: Loaded
    points: Float[np.ndarray, "point 3"]

    def loop(self, world: CourseWorld, script: list[dict[str, Any]] | None = None) -> OnboardLoop:
        """The vehicle, which its driver lets roll along the lane."""
        rolls = [{"at_s": 0.2, "do": "drive", "speed_mps": 1.5}]
        return OnboardLoop(world, self.config, self.loaded, script or rolls, [], fixes=False, gnss_slow_m=0.02)


def of_shape(world: CourseWorld, config: RuntimeConfig, folder: Path, shape: str) -> Overlapping:
    """The route of a shape, whose lane begins where the vehicle stands."""
    alone = by_rtk(config, folder, with_map=False)
    loaded = load(alone)
    x, y, yaw = world.start(2.0).pose
    local, lead_m = _points(shape), world.laid.spec.array_x_m
    cos, sin = np.cos(yaw), np.sin(yaw)
    along = local[:, 0] + lead_m - 2.0
    east, north = x + cos * along - sin * local[:, 1], y + sin * along + cos * local[:, 1]
    points = np.stack([east, north, local[:, 2] + yaw], axis=1)
    legs, gears = legs_of_track(RouteTrack("lane", points[:, :2], points[:, 2]))
    path = make_route_path(legs, gears, loaded.setup.autopilot.chassis, RouteSpeeds(4.0))
    lane = LaidRoute("lane.route.toml", path, float(path.legs.length_m[0]), [], "")
    return Overlapping(alone, loaded._replace(routes=[lane]), points)


class OverlapDrive(NamedTuple):
    """A drive: the loop after it, the place that was chosen, and the route's points."""

    loop: OnboardLoop
    place: str
    points: Float[np.ndarray, "point 3"]

    def check(self) -> None:
        """Engaged at the chosen place, driven to that end of the route, along it all the way; the choice recorded."""
        events = [json.loads(event) for _, event in self.loop.events]
        assert {"route": "lane.route.toml", "place": self.place} in events
        at_m, travel = float(self.place.split()[0]), 1.0 if self.place.endswith("along") else -1.0
        arc = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(self.points[:, :2], axis=0).T))])
        truth, rows = self.loop.stage.truth.arrays(), np.array(self.loop.rows)
        modes = rows["mode"][np.clip(np.searchsorted(self.loop.times_ns, truth["mono_ns"]) - 1, 0, len(rows) - 1)]
        on = np.isin(modes, (Mode.STEERING, Mode.SPEED))
        lead_m, yaw = self.loop.stage.world.laid.spec.array_x_m, truth["yaw_rad"][on]
        anchor = np.stack([truth["x_m"][on] + lead_m * np.cos(yaw), truth["y_m"][on] + lead_m * np.sin(yaw)], axis=1)
        # Followed from the chosen place on, never searched anew.
        now_m, off_m = at_m, []
        for place, heading in zip(anchor, yaw, strict=True):
            near = np.flatnonzero(np.abs(arc - now_m) < 4.0)
            row = near[np.argmin(np.hypot(*(self.points[near, :2] - place).T))]
            assert travel * (arc[row] - now_m) > -1.0
            now_m = arc[row]
            turned = heading - self.points[row, 2] - (0.0 if travel > 0.0 else np.pi)
            assert np.cos(turned) > 0.5
            (east, north), way = place - self.points[row, :2], self.points[row, 2]
            off_m.append(float(np.cos(way) * north - np.sin(way) * east))
        assert abs(now_m - (arc[-1] if travel > 0.0 else 0.0)) < 1.0
        # Its bends begin at once, as no road's do. It is engaged beside the lane.
        settled = np.array(off_m)[np.cumsum(np.hypot(*np.diff(anchor, axis=0, prepend=anchor[:1]).T)) > 15.0]

        assert np.sqrt(np.mean(np.square(settled))) < 0.15
        assert np.abs(settled).max() < 0.3048


def drive_overlapping(
    world: CourseWorld, made: Overlapping, number: int, *, by_buttons: bool = False, for_s: float = 90.0
) -> OverlapDrive:
    """Refused at first, then engaged at one of the places, in their order along the route.

    Args:
        world: the stage.
        made: the route.
        number: of the place.
        by_buttons: of the controller; else on the page.
        for_s: time limit.
    """
    script = [{"at_s": 0.2, "do": "drive", "speed_mps": 1.5}, {"at_way_m": 5.0, **_PRESS}]
    ways_m = 7.0 + 0.7 * np.arange(number + 1)
    presses = [{"at_way_m": float(way_m), "do": "press", "button": "plus", "for_s": 0.2} for way_m in ways_m]
    script += [*(presses if by_buttons else []), {"at_way_m": 12.0, **_PRESS}]
    script += [{"after": {"mode": 3, "for_s": 1.0}, "do": "press", "button": "plus", "for_s": 0.3}, *FASTER]
    loop = made.loop(world, script)
    assert loop.run(30.0, until=lambda at: at.core.modes.state.inhibit is EngagementInhibit.AMBIGUOUS), loop.events
    assert loop.run(10.0, until=lambda at: at.stage._known.last.travel_m > 6.5)
    assert loop.mode is Mode.READY
    offered = sorted(loop.kind.state(5)["places"], key=lambda place: float(place["place"].split()[0]))
    if not by_buttons:
        asked = json.dumps({"select_route": "lane.route.toml", "place": offered[number]["place"]}).encode()
        loop._came.append(Record(RecordKind.REQUEST, Source.DISPLAY, 0, loop._now_ns, asked))
    assert loop.run(for_s, until=lambda at: at.mode is Mode.MANUAL), loop.events
    chosen = [json.loads(event) for _, event in loop.events if '"place"' in event and '"route"' in event]
    assert abs(float(chosen[-1]["place"].split()[0]) - float(offered[number]["place"].split()[0])) < 6.0
    return OverlapDrive(loop, chosen[-1]["place"], made.points)
