"""A skid-steer vehicle in the closed loop of the runtime: faults that begin in a turn, and a field without faults."""

import math

import numpy as np
import pytest

from canon.field import Moments, drive_to_moments, make_field
from lgprjax.autopilot import Mode
from lgprjax.autopilot.fence import pad_fence
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.skid.setup import load_skid
from lgprjax.runtime.control.skid.watches import SkidFound


@pytest.fixture(scope="module")
def moments(tmp_path_factory: pytest.TempPathFactory) -> Moments:
    """A drive on a line and in a turn."""
    file = make_field(tmp_path_factory.mktemp("field"))
    return drive_to_moments(file, load_skid(read_config(file)))


@pytest.mark.parametrize(
    ("fault", "mode", "within_s"),
    [
        ({"kind": "line_silent", "line": "controller"}, Mode.MANUAL, 4.0),
        ({"kind": "line_silent", "line": "drive_by_wire"}, Mode.ERROR, 0.3),
        ({"kind": "line_corrupt", "line": "drive_by_wire"}, Mode.ERROR, 0.3),
        ({"kind": "bus_off"}, Mode.ERROR, 0.3),
        ({"kind": "supply_sag", "v": 5.0, "for_s": 2.0}, Mode.ERROR, 0.4),
    ],
)
@pytest.mark.parametrize("where", ["line", "turn"])
def test_it_is_handed_over_in_time(
    moments: Moments, where: str, fault: dict[str, object], mode: Mode, within_s: float
) -> None:
    loop = moments.at(where)
    first = len(loop.rows)
    loop.inject(fault)
    loop.run(4.0)
    assert loop.when(first, lambda row: Mode(int(row["mode"])) is mode) <= within_s, loop.events[-5:]
    assert not int(loop.rows[-1]["tool"])
    assert abs(loop.stage.moved.speed_mps) < 0.12
    loop.within_limits(first)


def test_in_a_turn_it_stops_before_an_edge_that_it_would_cross(moments: Moments) -> None:
    loop = moments.at("turn")
    first, true = len(loop.rows), loop.stage.moved
    ahead_m = 1.35 + 1.6
    x, y = true.x_m + ahead_m * math.cos(true.yaw_rad) + 0.4, true.y_m - ahead_m
    corners = np.array([[-40.0, y], [x, y], [x, 40.0], [-40.0, 40.0]])
    loop.kind.pilot._loaded = moments.loaded._replace(fence=pad_fence(corners))
    # It slows down on the way there to a tenth.
    loop.run(40.0)
    assert loop.when(first, lambda row: bool(int(row["found"]) & SkidFound.EDGE)) < 40.0
    assert loop.mode is Mode.MANUAL, loop.events[-5:]
    truth, tool = loop.stage.truth.arrays(), moments.loaded.setup.tool
    front, half = tool.ahead_m + 0.5 * tool.length_m, 0.5 * tool.width_m
    cos, sin = np.cos(truth["yaw_rad"]), np.sin(truth["yaw_rad"])
    for side in (-half, half):
        assert float(np.max(truth["x_m"] + cos * front - sin * side)) < x
    loop.within_limits(first)


def test_a_field_is_driven_without_intervention(moments: Moments) -> None:
    loop = moments.at("line")
    loop.inject({"kind": "gnss_off", "at_s": 30.0, "for_s": 30.0, "every_s": 90.0})
    assert loop.run(600.0, until=lambda each: each.mode is not Mode.SPEED)
    assert float(loop.rows[-2]["to_go_m"]) < 1.0, loop.events[-5:]
    assert {int(row["line"]) for row in loop.rows} >= set(range(moments.loaded.lines))
