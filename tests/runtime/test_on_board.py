"""The operator's hands, processes that die, and what navigation loses, in the closed loop of the runtime.

At other moments of the drive, and to the end of the route: ``validation/loops/test_on_board.py``.
"""

import json
import math
from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from canon.course_loop import DRIVE, OnboardLoop
from canon.course_moments import ENGAGED, Moment, follow, goes_on, stops
from lgprjax.autopilot import EngagementInhibit, Event, Mode
from lgprjax.autopilot.monitors import Watch
from lgprjax.navigation import Reason
from lgprjax.run_records import FIX, Record, RecordKind, Source
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.core import ControlCore
from lgprjax.runtime.control.setup import Loaded
from lgprjax.simulation.devices.boxes import POWER_CUT
from lgprjax.simulation.devices.world import CourseWorld

STEER: dict[str, Any] = {"do": "press", "button": "steering", "for_s": 0.3}


def test_engaged_again_soon_after_the_override_the_place_is_searched_anew(moments: dict[str, Moment]) -> None:
    """Before anything can be engaged, however soon the steering button follows."""
    after = follow(moments["bend"], 0.12, script=[{"do": "press", "button": "override", "for_s": 0.06}])
    assert after.mode(Mode.MANUAL) <= 0.1
    again = follow(Moment(after.loop, moments["bend"].shared), 0.5, script=[STEER])
    assert again.mode(Mode.STEERING) <= 0.3, again.told
    pilot = again.loop.kind.pilot
    assert pilot.on_route
    assert pilot.code == int(pilot.result.code)


def test_the_override_button_gives_the_vehicle_back_at_once(moments: dict[str, Moment]) -> None:
    after = follow(moments["bend"], 0.8, script=[{"do": "press", "button": "override", "for_s": 0.4}])
    assert after.mode(Mode.MANUAL) <= 0.1
    assert after.engaged(0) <= 0.1
    assert after.loop.mode is Mode.READY


def test_hands_on_the_wheel_give_the_vehicle_back(moments: dict[str, Moment]) -> None:
    after = follow(moments["bend"], 0.6, script=[{"do": "torque", "nm": 8.0, "for_s": 0.5}])
    assert after.mode(Mode.MANUAL) <= 0.15
    assert not int(after.last["engage"])


def test_a_tap_on_the_brake_leaves_the_steering_engaged_and_a_held_brake_nothing(moments: dict[str, Moment]) -> None:
    tapped = follow(moments["straight"], 0.6, script=[{"do": "brake_tap", "for_s": 0.2}])
    assert tapped.mode(Mode.STEERING) <= 0.1
    assert tapped.loop.mode is Mode.STEERING
    assert int(tapped.last["engage"]) == 1
    held = follow(moments["straight"], 0.9, script=[{"do": "brake_tap", "for_s": 1.5}])
    assert held.mode(Mode.MANUAL) <= 0.7


def test_the_emergency_stop_cuts_the_power_and_needs_arming_anew(moments: dict[str, Moment]) -> None:
    after = follow(moments["straight"], 2.0, script=[{"do": "press", "button": "estop", "for_s": 2.2}])
    assert after.engaged(4) <= 0.1
    assert after.loop.mode is Mode.EMERGENCY_STOP
    assert after.speed_at(2.0) < 0.1
    # Released, nothing can be engaged before an override press and the checks.
    loop = after.loop
    loop.run(1.0)
    assert loop.mode is Mode.EMERGENCY_STOP
    assert int(loop.rows[-1]["engage"]) == 4


def test_with_the_emergency_stop_held_at_boot_nothing_is_engaged(
    world: CourseWorld, config: RuntimeConfig, loaded: Loaded
) -> None:
    script = [{"at_s": 0.1, **STEER}, {"after": {"mode": 7, "for_s": 1.0}, **STEER}]
    loop = OnboardLoop(world, config, loaded, script, [{"kind": "estop_held", "at_s": 0.0}])
    loop.stage._pressed = lambda: 4 | 2  # type: ignore[method-assign]
    loop.run(2.5)
    assert loop.mode is Mode.EMERGENCY_STOP
    assert all(not int(row["engage"]) & 3 for row in loop.rows)


@pytest.mark.parametrize(
    ("script", "inhibit"),
    [
        ([{"at_s": 0.1, "do": "drive", "speed_mps": 6.0}, {"at_way_m": 40.0, **STEER}], EngagementInhibit.TOO_FAST),
        (
            [
                {"at_s": 0.1, "do": "drive", "speed_mps": 2.0},
                {"at_way_m": 6.0, "do": "brake_tap", "for_s": 1.5},
                {"at_way_m": 6.3, **STEER},
            ],
            EngagementInhibit.BRAKE_PRESSED,
        ),
    ],
)
def test_what_may_not_be_engaged_is_refused_with_its_reason(
    world: CourseWorld, config: RuntimeConfig, loaded: Loaded, script: list[dict[str, Any]], inhibit: EngagementInhibit
) -> None:
    loop = OnboardLoop(world, config, loaded, script, [])
    assert loop.run(16.0, until=lambda at: at.core.modes.state.inhibit is inhibit)
    loop.run(0.3)
    assert all(not int(row["engage"]) & 3 for row in loop.rows)


def test_standing_in_rain_the_first_press_engages_the_steering(
    world: CourseWorld, config: RuntimeConfig, loaded: Loaded
) -> None:
    """Its heading is confirmed by fixes, of correlations that are low and no chance."""
    loop = OnboardLoop(world, config, loaded, [{"at_s": 0.1, **STEER}], [], fix_match=(0.25, 1e-9))
    assert loop.run(16.0, until=lambda at: at.mode is Mode.STEERING)
    assert not any(int(row["reasons"]) & Reason.LGPR_FADED for row in loop.rows)


def test_a_heading_that_is_turned_round_engages_nothing(
    world: CourseWorld, config: RuntimeConfig, loaded: Loaded
) -> None:
    loop = OnboardLoop(world, config, loaded, DRIVE, [{"kind": "heading_reversed", "at_s": 0.0}], fixes=False)
    assert loop.run(
        14.0, until=lambda at: bool(at.rows) and bool(int(at.rows[-1]["watch"]) & Watch.HEADING_CONTRADICTED)
    )
    # The operator presses the button only now.
    assert loop.run(14.0, until=lambda at: at.stage._known.last.travel_m > 7.0)
    assert all(not int(row["engage"]) & 3 for row in loop.rows)


def lose_fixes(loop: OnboardLoop) -> None:
    loop._lost = lambda _: True


def misplace(east_m: float) -> Callable[[OnboardLoop], None]:
    def change(loop: OnboardLoop) -> None:
        loop._wrong = lambda _: (east_m, 0.0)

    return change


def test_without_scans_the_vehicle_slows_down_as_the_sigma_of_gnss_grows(moments: dict[str, Moment]) -> None:
    """GNSS of this course wanders by 0.3 m over a minute: known at first from LGPR, then less and less."""
    after = follow(moments["fast"], 14.0, change=lose_fixes)
    assert after.reason(Reason.LGPR_SILENT) <= 1.7
    assert goes_on(after), after.told
    rows = np.array(after.loop.rows[after.first - 1 :])
    sigma_m, wanted_mps = rows["sigma_cross_m"], rows["wanted_mps"]
    bounded, uncertain = sigma_m < 0.1, sigma_m > 0.115
    assert np.sum(bounded) > 125
    assert wanted_mps[bounded].min() >= 0.99 * wanted_mps[0]
    np.testing.assert_array_less(wanted_mps[uncertain], 2.0 * 0.05 / (sigma_m[uncertain] - 0.1) + 0.02)
    assert uncertain[-1]


def match_as(correlation: float, p_false: float) -> Callable[[OnboardLoop], None]:
    def change(loop: OnboardLoop) -> None:
        loop._match = (correlation, p_false)

    return change


def test_low_correlations_that_are_no_chance_are_driven_by(moments: dict[str, Moment]) -> None:
    """Rain takes most of the correlation and leaves it far above what other ground gives."""
    dry, rain = (follow(moments["fast"], 2.0, change=match_as(each, 1e-9)) for each in (0.8, 0.25))
    assert rain.reason(Reason.LGPR_FADED) == math.inf
    assert goes_on(rain), rain.told
    # How high a correlation is decides nothing at all.
    assert [row.tobytes() for row in rain.loop.rows] == [row.tobytes() for row in dry.loop.rows]


def test_high_correlations_that_any_ground_gives_slow_the_vehicle_down_without_gnss(
    moments: dict[str, Moment],
) -> None:
    after = follow(moments["fast"], 1.4, faults=[{"kind": "gnss_off"}], change=match_as(0.8, 1.0))
    # More scans than not of the last two seconds, which the beginning tenth of them may cut short.
    assert 0.8 <= after.reason(Reason.LGPR_FADED) <= 1.2
    assert goes_on(after), after.told
    assert float(after.last["wanted_mps"]) <= 2.0


@pytest.mark.parametrize("fixes", [True, False])
def test_after_a_lock_the_autopilot_is_engaged_without_gnss(
    world: CourseWorld, config: RuntimeConfig, loaded: Loaded, fixes: bool
) -> None:
    """GNSS is gone before the button is pressed; without LGPR's fixes the press is refused."""
    plus = {"after": {"mode": 3, "for_s": 1.0}, "do": "press", "button": "plus", "for_s": 0.3}
    script = [{"at_s": 0.2, "do": "drive", "speed_mps": 2.0}, {"at_way_m": 10.0, **STEER}, plus]
    loop = OnboardLoop(world, config, loaded, script, [{"kind": "gnss_off", "at_way_m": 7.0}], fixes=fixes)
    assert loop.run(40.0, until=lambda at: at.stage._known.last.travel_m > 9.5)
    assert int(loop.rows[-1]["reasons"]) & Reason.GNSS_SILENT
    first = len(loop.rows)
    loop.run(4.0)
    modes = {Mode(int(row["mode"])) for row in loop.rows[first:]}
    if not fixes:
        assert not modes & {Mode.STEERING, Mode.SPEED}
        assert loop.core.modes.state.inhibit is EngagementInhibit.SOURCE_MISSING
        return
    assert loop.mode is Mode.SPEED
    # Nothing slows it: the error is bounded by the ground alone.
    assert not int(loop.rows[-1]["watch"])
    assert all(int(row["reasons"]) & Reason.GNSS_SILENT for row in loop.rows[first:])
    assert max(abs(float(row["cross_track_m"])) for row in loop.rows[-50:]) < 0.2


def test_fixes_of_a_wrong_place_do_not_move_the_vehicle(moments: dict[str, Moment]) -> None:
    after = follow(moments["bend"], 3.0, change=misplace(1.5))
    assert after.reason(Reason.LGPR_REJECTED | Reason.CONFLICT) <= 1.0
    assert after.largest_off_m < 0.3048, after.told
    assert goes_on(after) or stops(after)


def test_with_a_dead_odometer_a_controlled_stop_brakes_until_the_vehicle_stands(moments: dict[str, Moment]) -> None:
    """The wheels say zero from the beginning; GNSS, which carried the speed, is lost while the vehicle still drives."""
    faults = [{"kind": "odometer_dead"}]
    driven = follow(moments["straight"], 1.5, faults=faults)
    assert goes_on(driven), driven.told
    assert driven.speed_at(1.5) > 1.0
    gone = [*faults, {"kind": "gnss_off"}]
    after = follow(Moment(driven.loop, moments["straight"].shared), 7.0, faults=gone, change=lose_fixes)
    assert any("STOP_CONTROLLED" in event for _, event in after.loop.events), after.told
    assert max(float(row["command"][2]) for row in after.loop.rows[after.first :]) > 0.1
    assert after.watch(Watch.SPEED_UNKNOWN) < 2.0
    over_s = after.mode(Mode.MANUAL, Mode.ERROR)
    assert over_s == math.inf or abs(after.speed_at(over_s)) < 0.1, after.told
    assert after.speed_at(7.0) < 0.1


def test_an_odometer_that_dies_with_gnss_does_not_end_the_stop_once_its_finding_clears(
    moments: dict[str, Moment],
) -> None:
    """Without GNSS nothing goes on saying that its zero is wrong."""
    faults = [{"kind": "odometer_dead"}, {"kind": "gnss_off"}]
    after = follow(moments["fast"], 9.0, faults=faults, change=lose_fixes)
    assert after.when(lambda row: bool(row["command"][2] > 0.3)) < 3.0, after.told
    assert not int(after.last["watch"]) & Watch.SPEED_UNKNOWN
    over_s = after.mode(Mode.MANUAL)
    assert over_s < 9.0, after.told
    assert abs(after.speed_at(over_s)) < 0.1, after.told


def test_without_gnss_and_scans_the_vehicle_stops(moments: dict[str, Moment]) -> None:
    after = follow(moments["bend"], 6.0, faults=[{"kind": "gnss_off"}], change=lose_fixes)
    # GNSS counts as lost after half a second, LGPR after a second and a half without a fix.
    assert after.reason(Reason.POSITION_LOST) <= 1.7
    assert stops(after), after.told
    assert after.largest_off_m < 0.3048


def test_a_brake_without_effect_in_a_stop_is_an_emergency(moments: dict[str, Moment]) -> None:
    faults = [{"kind": "gnss_off"}, {"kind": "brake_dead"}]
    after = follow(moments["fast"], 4.5, faults=faults, change=lose_fixes)
    assert after.watch(Watch.BRAKE_DEAD) < 4.0, after.told
    assert after.engaged(4) < 4.0


def test_an_estimate_that_is_no_number_is_held_for_a_step_and_handed_over(moments: dict[str, Moment]) -> None:
    def spoil(loop: OnboardLoop) -> None:
        state = loop.kind.pilot._state
        assert state is not None
        filters = state.navigator.filters
        estimate = filters.estimate._replace(mean=jnp.full_like(filters.estimate.mean, jnp.nan))
        navigator = state.navigator._replace(filters=filters._replace(estimate=estimate))
        loop.kind.pilot._state = jax.tree.map(lambda leaf: leaf, state._replace(navigator=navigator))

    after = follow(moments["bend"], 0.3, change=spoil)
    assert after.mode(Mode.ERROR) <= 0.07, after.told
    assert not int(after.last["engage"])


def test_one_late_tick_is_counted_and_three_are_an_error(moments: dict[str, Moment]) -> None:
    def late(*at_s: float) -> Callable[[OnboardLoop], None]:
        def change(loop: OnboardLoop) -> None:
            loop.held_up = [(loop.time_s + begin, loop.time_s + begin + 0.055) for begin in at_s]

        return change

    assert goes_on(follow(moments["bend"], 1.0, change=late(0.3)))
    after = follow(moments["bend"], 1.0, change=late(0.3, 0.5, 0.7))
    assert after.mode(Mode.ERROR) <= 0.85, after.told


def test_a_control_loop_that_hangs_leaves_the_box_to_its_defaults(moments: dict[str, Moment]) -> None:
    def hang(loop: OnboardLoop) -> None:
        loop.held_up = [(loop.time_s, loop.time_s + 1.0)]

    loop = moments["fast"].copy()
    hang(loop)
    loop.run(0.25)
    assert not loop.stage.drive_box.orders(loop._now_ns).steering
    before = loop.stage._known.last.speed_mps
    loop.run(0.7)
    assert loop.stage._known.last.speed_mps < before - 0.5


def relaunch(loop: OnboardLoop, config: RuntimeConfig, loaded: Loaded) -> int:
    """The control process dies, and another one takes its place after two seconds; number of its first row."""
    loop.held_up = [(loop.time_s, loop.time_s + 2.0)]
    loop.run(1.9)
    loop.core = ControlCore(config, loaded, session=78, after_death=True)
    # As the supervisor tells every new control process.
    for name in ("recorder", "registration"):
        loop.tell({"ready": name})
    loop.tick = 0
    return len(loop.rows)


def test_a_control_loop_that_was_relaunched_is_never_engaged_by_itself(
    moments: dict[str, Moment], config: RuntimeConfig, loaded: Loaded
) -> None:
    """Power that was cut before stays cut."""
    for cut in (False, True):
        loop = moments["straight"].copy()
        if cut:
            loop.core.modes.tell(Event.ERROR_RAISED, loop.time_s, 0.0)
            loop.core.modes.cut()
            loop.run(0.1)
            assert loop.stage.drive_box.held == POWER_CUT
        first = relaunch(loop, config, loaded)
        loop.run(2.0)
        assert {Mode(int(row["mode"])) for row in loop.rows[first:]} == {Mode.ERROR}
        assert {int(row["engage"]) for row in loop.rows[first:]} <= {0, POWER_CUT}
        assert (loop.stage.drive_box.held == POWER_CUT) is cut
        assert loop.stage.drive_box.orders(loop._now_ns).cut is cut


def test_registration_that_dies_degrades_and_comes_back(moments: dict[str, Moment]) -> None:
    def die(loop: OnboardLoop) -> None:
        loop.tell({"died": "registration", "why": "signal 9"})
        lose_fixes(loop)

    after = follow(moments["fast"], 2.0, change=die)
    assert goes_on(after), after.told
    assert [after.loop.core.modes.state.registration_dead] == [True]
    # Positions bound the error: their sigma decides on the speed.
    assert float(after.last["wanted_mps"]) <= float(moments["fast"].loop.rows[-1]["wanted_mps"]) + 0.1
    after.loop.tell({"ready": "registration"})
    after.loop._lost = lambda _: False
    after.loop.run(2.0)
    assert after.loop.mode is Mode.SPEED
    assert [after.loop.core.modes.state.registration_dead] == [False]
    assert float(after.loop.rows[-1]["wanted_mps"]) > 2.0


@pytest.mark.parametrize("mandatory", [False, True])
def test_a_recorder_that_dies_is_an_error_the_third_time_where_it_is_mandatory(
    moments: dict[str, Moment], mandatory: bool
) -> None:
    def die(loop: OnboardLoop) -> None:
        loop.core.processes.mandatory = mandatory
        loop.tell({"died": "recorder", "why": "exit 1"})
        loop.tell({"ready": "recorder"})

    once = follow(moments["straight"], 0.4, change=die)
    assert goes_on(once)
    die(once.loop)
    once.loop.run(0.4)
    assert once.loop.mode in ENGAGED
    die(once.loop)
    once.loop.run(0.2)
    assert once.loop.mode is (Mode.ERROR if mandatory else Mode.SPEED)


def test_where_recording_is_mandatory_the_vehicle_stops_without_it(moments: dict[str, Moment]) -> None:
    def fail(loop: OnboardLoop) -> None:
        loop.core.processes.mandatory = True
        loop.tell({"left": "recorder", "why": "too little space"})

    after = follow(moments["straight"], 4.0, change=fail)
    assert stops(after), after.told


def test_a_route_is_chosen_only_while_the_operator_drives(moments: dict[str, Moment]) -> None:
    def ask(loop: OnboardLoop) -> None:
        name = loop.kind._panel._routes[0].name
        payload = json.dumps({"select_route": name}).encode()
        loop._came.append(Record(RecordKind.REQUEST, Source.DISPLAY, 0, loop._now_ns, payload))

    after = follow(moments["straight"], 0.3, change=ask)
    assert after.loop.mode is Mode.SPEED
    assert any(json.loads(event).get("refused") == "route" for _, event in after.loop.events)
    manual = follow(moments["straight"], 0.5, script=[{"do": "press", "button": "override", "for_s": 0.3}])
    ask(manual.loop)
    manual.loop.run(0.3)
    assert any("route" in json.loads(event) for _, event in manual.loop.events)


def test_records_of_an_older_run_are_replayed_to_the_same_commands(moments: dict[str, Moment]) -> None:
    """Fixes of runs before layout 1.2 end before the probability of a false match."""
    one, other = moments["fast"].copy(), moments["fast"].copy()
    step, stripped = other.core.step, 0

    def without(tick: int, now_ns: int, came: list[Record]) -> list[Record]:
        nonlocal stripped
        old = [each._replace(payload=each.payload[:-4]) if each.kind is RecordKind.FIX else each for each in came]
        stripped += sum(len(each.payload) < FIX.itemsize for each in old if each.kind is RecordKind.FIX)
        return list(step(tick, now_ns, old))

    other.core.step = without  # type: ignore[method-assign]
    one.run(1.0)
    other.run(1.0)
    assert stripped > 40
    # To the bit: a replay is the drive.
    assert [row.tobytes() for row in one.rows] == [row.tobytes() for row in other.rows]
    assert np.isfinite(one.rows[-1]["pose"]).all()
    assert np.isfinite(one.rows[-1]["cross_track_m"])
