"""A skid-steer vehicle in the closed loop of the runtime: its plan, its faults with their times, its corners.

Numbers are those of the fault list in docs/onboard.md. Faults begin on a line, with the tool on; those that begin in a
turn, and whole fields: ``validation/loops/test_field.py``.
"""

import json
import math
from pathlib import Path

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from canon.field import Moments, before_the_start, drive_to_moments, make_field
from canon.field_loop import BEGIN_NS, FieldLoop
from lgprjax.autopilot import Mode
from lgprjax.autopilot.fence import pad_fence
from lgprjax.autopilot.modes import Action
from lgprjax.frames import LocalFrame
from lgprjax.run_records import RecordKind, StopBits, ToolBits
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.core import ControlCore
from lgprjax.runtime.control.modes import ModeKeeper
from lgprjax.runtime.control.program import header_record
from lgprjax.runtime.control.skid.setup import load_skid
from lgprjax.runtime.control.skid.watches import SKID_FINDINGS, SkidFound
from lgprjax.simulation.devices import field_stage
from refusals import refused


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Field, plan and configurations."""
    made = tmp_path_factory.mktemp("field")
    make_field(made)
    return made


@pytest.fixture(scope="module")
def moments(folder: Path) -> Moments:
    """A drive on a line and in a turn."""
    file = folder / "small.run.toml"
    return drive_to_moments(file, load_skid(read_config(file)))


def found_after(loop: FieldLoop, first: int, bit: SkidFound) -> float:
    return loop.when(first, lambda row: bool(int(row["found"]) & bit))


def stops(loop: FieldLoop, first: int) -> bool:
    """A controlled stop: engaged until it stands, the tool off at once, then the operator's."""
    over_s = loop.when(first, lambda row: Mode(int(row["mode"])) is Mode.MANUAL)
    at_ns = loop.times_ns[first - 1] + over_s * 1e9
    truth = loop.stage.truth.arrays()
    speed = np.interp(at_ns, truth["mono_ns"], truth["speed_mps"]) if over_s < math.inf else math.inf
    return bool(abs(speed) < 0.12) and not loop.stage.drive_box.command.tool


def counted(loop: FieldLoop, since_s: float) -> bool:
    """Whether any cell was counted after a time."""
    return any(
        int(row["tool"]) & ToolBits.COUNTS for time_ns, row in loop.covers if (time_ns - BEGIN_NS) / 1e9 > since_s
    )


def test_it_drives_its_line_with_the_tool_on_and_turns_with_it_off(moments: Moments) -> None:
    line, turn = moments.line, moments.turn
    assert int(line.rows[-1]["tool"]) == 1
    assert int(line.covers[-1][1]["tool"]) == 15
    assert int(line.covers[-1][1]["stop"]) == 0
    assert int(turn.rows[-1]["tool"]) == 0
    assert not int(turn.covers[-1][1]["tool"]) & ToolBits.COUNTS
    true = line.stage.moved
    assert np.hypot(*(line.rows[-1]["pose"][:2] - (true.x_m, true.y_m))) < 0.06
    assert abs(float(line.rows[-1]["cross_m"])) < 0.05
    assert len(line.covers) == pytest.approx(line.time_s * 10.0, abs=12)


def test_it_goes_on_without_gnss(moments: Moments) -> None:
    loop = moments.at("line")
    first = len(loop.rows)
    loop.inject({"kind": "gnss_off", "for_s": 30.0})
    loop.run(10.0)
    assert {int(row["mode"]) for row in loop.rows[first:]} == {int(Mode.SPEED)}
    assert loop.state["field"]["gnss_age_s"] > 8.0
    true = loop.stage.moved
    off = np.hypot(*(loop.rows[-1]["pose"][:2] - (true.x_m, true.y_m)))
    assert off < 4.0 * float(loop.rows[-1]["sigma"][:2].max())
    loop.within_limits(first)


def test_35_a_remote_control_that_is_silent_stops_it_within_a_second(moments: Moments) -> None:
    loop = moments.at("line")
    first, begun_s = len(loop.rows), loop.time_s
    loop.inject({"kind": "line_silent", "line": "controller"})
    loop.run(3.0)
    assert found_after(loop, first, SkidFound.REMOTE_SILENT) <= 1.0
    assert stops(loop, first), loop.events[-5:]
    assert not counted(loop, begun_s + 1.2)
    assert int(loop.covers[-1][1]["stop"]) & StopBits.OPERATOR
    loop.within_limits(first)


def test_36_it_stops_before_an_edge_that_it_would_cross(moments: Moments) -> None:
    loop = moments.at("line")
    first = len(loop.rows)
    true = loop.stage.moved
    # Across the way of the tool, so far ahead that it can be kept.
    ahead_m = 1.35 + 1.6
    x = true.x_m + ahead_m * math.cos(true.yaw_rad)
    corners = np.array([[-40.0, -40.0], [x, -40.0], [x, 40.0], [-40.0, 40.0]])
    pilot = loop.kind.pilot
    pilot._loaded = moments.loaded._replace(fence=pad_fence(corners))
    # It slows down on the way there.
    assert loop.run(20.0, until=lambda each: each.mode is Mode.MANUAL)
    assert found_after(loop, first, SkidFound.EDGE) < 20.0
    assert stops(loop, first), loop.events[-5:]
    truth = loop.stage.truth.arrays()
    tool = moments.loaded.setup.tool
    front, half = tool.ahead_m + 0.5 * tool.length_m, 0.5 * tool.width_m
    cos, sin = np.cos(truth["yaw_rad"]), np.sin(truth["yaw_rad"])
    for side in (-half, half):
        assert float(np.max(truth["x_m"] + cos * front - sin * side)) < float(corners[:, 0].max())
    assert loop.core.modes.state.mode is Mode.MANUAL
    loop.within_limits(first)


@pytest.mark.parametrize(
    ("fault", "bit"),
    [({"kind": "tool_stops"}, SkidFound.TOOL_OFF), ({"kind": "tool_depth", "m": 0.1}, SkidFound.TOOL_DEPTH)],
)
def test_37_a_tool_that_does_not_work_stops_it_and_counts_nothing(
    moments: Moments, fault: dict[str, object], bit: SkidFound
) -> None:
    loop = moments.at("line")
    first, begun_s = len(loop.rows), loop.time_s
    loop.inject(fault)
    loop.run(2.0)
    assert found_after(loop, first, bit) <= 0.2
    assert stops(loop, first), loop.events[-5:]
    assert not counted(loop, begun_s + 0.21)
    assert any(int(row["stop"]) & StopBits.TOOL for _, row in loop.covers[-40:])
    loop.within_limits(first)


def test_engaged_beside_its_line_it_stops_and_its_tool_never_works(moments: Moments) -> None:
    loop = moments.at("line")
    loop.act({"do": "press", "button": "override", "for_s": 0.3})
    loop.run(1.0)
    assert loop.mode is Mode.READY
    heading = float(loop.rows[-1]["pose"][2])
    x_m, y_m = (float(each) for each in loop.rows[-1]["pose"][:2])
    aside_m = 2.0
    place = {"x_m": x_m + 6.0 * math.cos(heading) + aside_m * math.sin(heading),
             "y_m": y_m + 6.0 * math.sin(heading) - aside_m * math.cos(heading)}  # fmt: skip
    loop.act({"do": "drive_to", **place, "speed_mps": 0.7})
    loop.run(10.0)
    first = len(loop.rows)
    for button in ("steering", "plus"):
        loop.act({"do": "press", "button": button, "for_s": 0.3})
        loop.run(0.6)
    loop.run(3.0)
    driven = loop.rows[first:]
    assert any(int(row["mode"]) == Mode.SPEED for row in driven), loop.events[-5:]
    assert not any(int(row["tool"]) for row in driven)
    assert found_after(loop, first, SkidFound.OFF_LINE) < 3.0
    assert int(driven[-1]["mode"]) == Mode.MANUAL


def test_a_position_that_is_too_uncertain_stops_it(moments: Moments) -> None:
    loop = moments.at("line")
    first = len(loop.rows)
    setup = moments.loaded.setup
    health = setup.health._replace(stop_sigma_m=jnp.float32(0.03))
    pilot = loop.kind.pilot
    pilot._loaded = moments.loaded._replace(setup=setup._replace(health=health))
    loop.inject({"kind": "gnss_off"})
    assert loop.run(12.0, until=lambda each: each.mode is Mode.MANUAL)
    assert found_after(loop, first, SkidFound.UNCERTAIN) < 12.0
    assert stops(loop, first), loop.events[-5:]
    loop.within_limits(first)


@pytest.mark.parametrize(("fault", "bit"), [("left_dead", SkidFound.LEFT_DEAD), ("right_dead", SkidFound.RIGHT_DEAD)])
def test_14_a_track_whose_sensor_is_dead_stops_it(moments: Moments, fault: str, bit: SkidFound) -> None:
    loop = moments.at("line")
    first = len(loop.rows)
    loop.inject({"kind": fault})
    loop.run(2.5)
    assert found_after(loop, first, bit) <= 0.7
    assert loop.mode is Mode.MANUAL, loop.events[-5:]
    loop.within_limits(first)


@pytest.mark.parametrize(
    "fault",
    [
        {"kind": "line_silent", "line": "drive_by_wire"},
        {"kind": "line_corrupt", "line": "drive_by_wire"},
        {"kind": "supply_sag", "v": 5.0, "for_s": 2.0},
    ],
)
def test_23_24_without_its_box_it_is_an_error(moments: Moments, fault: dict[str, object]) -> None:
    loop = moments.at("line")
    first = len(loop.rows)
    loop.inject(fault)
    loop.run(0.6)
    within_s = 0.4 if fault["kind"] == "supply_sag" else 0.3
    assert loop.when(first, lambda row: Mode(int(row["mode"])) is Mode.ERROR) <= within_s, loop.events[-5:]
    assert not int(loop.rows[-1]["engage"]) & 1
    assert not int(loop.rows[-1]["tool"])


def test_ground_counts_by_remote_control_only_while_the_box_is_heard(
    moments: Moments, monkeypatch: pytest.MonkeyPatch
) -> None:
    step, depth_m = field_stage.step_tool, float(moments.loaded.belief.depth_m)
    # The operator has the tool work, whatever the computer last told the box.
    monkeypatch.setattr(field_stage, "step_tool", lambda state, _, *others: step(state, depth_m, *others))
    loop = moments.at("line")
    loop.act({"do": "press", "button": "override"})
    loop.run(2.0)
    assert not int(loop.rows[-1]["engage"])
    assert counted(loop, loop.time_s - 0.3)
    loop.inject({"kind": "line_silent", "line": "drive_by_wire"})
    loop.run(1.5)
    box = loop.kind.senses.box
    assert box is not None
    last_s = (box.arrival_ns - BEGIN_NS) / 1e9
    assert loop.time_s - last_s > 1.0
    assert loop.state["field"]["gnss_age_s"] < 2.0
    assert counted(loop, last_s - 0.3)
    assert not counted(loop, last_s + 0.1)
    # Nobody knows what the tool does: neither the record nor the page says a depth.
    assert math.isnan(float(loop.covers[-1][1]["depth_m"]))
    assert (loop.state["field"]["turns"], loop.state["field"]["depth_right"]) == (None, None)


def test_27_an_estimate_that_is_no_number_stops_it(moments: Moments) -> None:
    loop = moments.at("line")
    first = len(loop.rows)
    pilot = loop.kind.pilot
    state = pilot._state
    assert state is not None
    filtered = state.filter
    estimate = filtered.estimate._replace(mean=jnp.full_like(filtered.estimate.mean, jnp.nan))
    pilot._state = jax.tree.map(lambda leaf: leaf, state._replace(filter=filtered._replace(estimate=estimate)))
    loop.run(3.0)
    assert stops(loop, first), loop.events[-5:]
    assert not int(loop.rows[-1]["engage"])
    # Begun anew at the next fix, its heading unknown.
    assert int(loop.rows[-1]["known"]) == 1
    assert not counted(loop, (loop.times_ns[first] - BEGIN_NS) / 1e9)
    loop.within_limits(first)


def test_32_33_the_operator_takes_it_at_once(moments: Moments) -> None:
    loop = moments.at("line")
    first = len(loop.rows)
    loop.act({"do": "press", "button": "override"})
    loop.run(0.5)
    assert loop.when(first, lambda row: Mode(int(row["mode"])) is Mode.MANUAL) <= 0.1
    loop = moments.at("turn")
    first = len(loop.rows)
    loop.act({"do": "press", "button": "estop"})
    loop.run(1.0)
    assert loop.when(first, lambda row: int(row["engage"]) == 4) <= 0.1
    assert abs(loop.stage.moved.speed_mps) < 0.05


def test_a_brake_tap_makes_it_stand_held_and_plus_goes_on(moments: Moments) -> None:
    loop = moments.at("line")
    loop.act({"do": "brake_tap"})
    loop.run(2.5)
    assert loop.mode is Mode.STEERING
    assert abs(loop.stage.moved.speed_mps) < 0.03
    assert int(loop.rows[-1]["engage"]) == 1
    assert not int(loop.rows[-1]["tool"])
    before_m = loop.stage.moved.x_m
    loop.act({"do": "press", "button": "plus"})
    loop.run(4.0)
    assert loop.stage.moved.x_m > before_m + 0.5
    assert int(loop.rows[-1]["mode"]) == Mode.SPEED


def test_26_three_late_ticks_are_an_error(moments: Moments) -> None:
    loop = moments.at("line")
    loop.held_up = [(loop.time_s + begin, loop.time_s + begin + 0.055) for begin in (0.3, 0.5, 0.7)]
    loop.run(1.2)
    assert loop.mode is Mode.ERROR


def test_without_the_map_of_cells_it_drives_slowly_and_stops_where_it_is_mandatory(moments: Moments) -> None:
    loop = moments.at("line")
    loop.tell({"died": "coverage", "why": "signal 9"})
    loop.run(2.5)
    assert loop.mode is Mode.SPEED
    assert float(loop.rows[-1]["speed_mps"]) < 0.25
    assert len(loop.state["warnings"]) == len(moments.line.state["warnings"]) + 1
    loop = moments.at("line")
    first = len(loop.rows)
    loop.core.processes.mandatory = True
    loop.tell({"died": "coverage", "why": "signal 9"})
    loop.run(3.0)
    assert stops(loop, first), loop.events[-5:]


def test_engaging_is_refused_until_the_heading_is_known(moments: Moments) -> None:
    pose, way = before_the_start(moments.loaded)
    script = [{"at_s": 0.3, "do": "press", "button": "steering"}, {**way, "at_s": 1.2}]
    loop = FieldLoop(moments.config, moments.loaded, pose, script, [])
    loop.run(2.4)
    assert loop.mode is Mode.READY
    assert loop.state["refusal_text"] == SKID_FINDINGS[SkidFound.HEADING_UNKNOWN].text
    assert not any(int(row["engage"]) for row in loop.rows)
    assert loop.run(12.0, until=lambda each: bool(int(each.rows[-1]["known"]) & 2))
    assert not loop.run(0.3)
    assert loop.state["refusal"] == "NONE"


def test_corners_are_marked_by_remote_control_without_a_plan(folder: Path, moments: Moments) -> None:
    config = read_config(folder / "corners.run.toml")
    loaded, planned = load_skid(config), moments.loaded.route
    # As many rows as the plan's, all of them empty: its program is compiled already.
    empty = loaded.route._replace(rows=jnp.zeros_like(planned.rows), line=jnp.full_like(planned.line, -1))
    loaded = loaded._replace(route=empty)
    script = [
        {"at_s": 0.2, "do": "press", "button": "corner"},
        {"at_s": 0.6, "do": "drive_to", "x_m": 6.0, "y_m": 0.0, "speed_mps": 0.7},
        {"at_arrival": 1, "do": "press", "button": "corner"},
        {"at_arrival": 1, "do": "press", "button": "steering", "for_s": 0.4},
    ]
    loop = FieldLoop(config, loaded, (0.0, 0.0, 0.0), script, [])
    loop.run(16.0)
    # The first one while its heading was not known.
    assert [json.loads(event)["refused"] for _, event in loop.events if '"refused"' in event] == ["corner"]
    (corner,) = loop.corners
    x, y, _ = loop.stage._frame.to_local(
        np.array([corner["latitude_deg"]]), np.array([corner["longitude_deg"]]), np.array([corner["height_m"]])
    )
    assert math.hypot(float(x[0]) - loop.stage.moved.x_m, float(y[0]) - loop.stage.moved.y_m) < 0.08
    assert 0.005 < corner["sigma_m"] < 0.1
    assert loop.mode is Mode.READY
    assert loop.state["refusal"] != "NONE"
    assert loop.state["refusal_text"] == loop.kind.inhibit_text()
    assert not any(int(row["engage"]) for row in loop.rows)


def test_a_relaunched_loop_without_a_plan_keeps_its_frame(folder: Path) -> None:
    """And states it no second time; its header does, for the record and for a replay."""
    config, anchor = read_config(folder / "corners.run.toml"), [48.0, 11.0, 500.0]
    fresh, again = load_skid(config), load_skid(config, anchor=anchor)
    core = ControlCore(config, again, session=78, after_death=True)
    assert core.kind.senses.frame == LocalFrame(*anchor)  # type: ignore[attr-defined]
    assert core.kind.notes() == []
    headers = [
        json.loads(header_record(config, loaded, 78, 1, after_death=dead, anchor=at).payload)
        for loaded, dead, at in ((fresh, False, None), (again, True, anchor))
    ]
    assert ["anchor" in header for header in headers] == [False, True]
    assert headers[1]["anchor"] == anchor
    assert headers[0]["tool"]["width_m"] == fresh.setup.tool.width_m


def test_the_same_records_give_the_same_frames_to_the_bit(moments: Moments) -> None:
    loop = moments.line
    core = ControlCore(moments.config, moments.loaded, session=77, after_death=False)
    for number, (now_ns, came, sent) in enumerate(loop.ticks, 1):
        out = [record.payload for record in core.step(number, now_ns, came) if record.kind is RecordKind.PORT_OUT]
        assert out == sent, number
    assert len(loop.ticks) > 500
    assert json.loads(json.dumps(loop.state))["field"]["line"] == 1


def test_a_plan_with_turns_that_the_vehicle_cannot_drive_is_refused(folder: Path, tmp_path: Path) -> None:
    """Its file was corrected since the plan was made, or the plan is of another machine with the same tool."""
    config = read_config(folder / "small.run.toml")
    text = config.path(config.vehicle).read_text(encoding="utf-8")
    assert "smallest_radius_m = 1.5" in text
    wider = tmp_path / "wider.vehicle.toml"
    wider.write_text(text.replace("smallest_radius_m = 1.5", "smallest_radius_m = 2.5"), encoding="utf-8")
    with refused("turns", 2.5, "wider.vehicle.toml"):
        load_skid(config.model_copy(update={"vehicle": str(wider)}))


def test_plus_locks_the_speed_that_is_configured_and_no_more() -> None:
    keeper = ModeKeeper(after_death=False, speed_step_mps=0.25)
    keeper._act(Action.LOCK_SPEED, 0.15)
    assert keeper.set_speed_mps == 0.15
