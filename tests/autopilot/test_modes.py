"""Modes: the course of a drive, every refusal, and what no sequence of events can bring about."""

import math

import pytest
from hypothesis import settings
from hypothesis import strategies as st
from hypothesis.stateful import RuleBasedStateMachine, initialize, invariant, rule

from lgprjax.autopilot import (
    Action,
    Check,
    EngagementInhibit,
    Event,
    Fault,
    MeasuredSpeed,
    Mode,
    ModeEvent,
    ModeState,
    PathOffset,
    operator_drives,
    step_modes,
)
from mode_diagram import every_transition, mode_changes

TO_READY = (
    Event.BOOT_DONE,
    Event.CHECKS_PASSED,
    Event.ROUTE_NEAR,
    Event.MOVING,
    Event.SOURCES_PRESENT,
    Event.HEALTH_GOOD,
)
TO_STEERING = (*TO_READY, Event.STEERING_BUTTON)
TO_SPEED = (*TO_STEERING, Event.CRUISE_PLUS)
REARM = (Event.OVERRIDE_PRESSED, Event.OVERRIDE_RELEASED)


def after(*events: Event, start: ModeState | None = None, time_s: float = 0.0) -> tuple[ModeState, tuple[Action, ...]]:
    """State after events at one time, and the last one's actions."""
    state = start or ModeState()
    actions: tuple[Action, ...] = ()
    for event in events:
        state, actions = step_modes(state, ModeEvent(event, time_s))
    return state, actions


def test_from_boot_to_a_driven_speed_and_back() -> None:
    course = [
        (Event.BOOT_DONE, Mode.CHECKS, (Action.RUN_CHECKS,)),
        (Event.CHECKS_PASSED, Mode.READY, ()),
        (Event.ROUTE_NEAR, Mode.READY, ()),
        (Event.STANDING, Mode.READY, ()),
        (Event.SOURCES_PRESENT, Mode.READY, ()),
        (Event.HEALTH_GOOD, Mode.READY, ()),
        (Event.STEERING_BUTTON, Mode.STEERING, (Action.ENGAGE_STEERING,)),
        (Event.MOVING, Mode.STEERING, ()),
        (Event.CRUISE_MINUS, Mode.SPEED, (Action.LOCK_SPEED, Action.ENGAGE_SPEED)),
        (Event.CRUISE_PLUS, Mode.SPEED, (Action.RAISE_SPEED,)),
        (Event.CRUISE_MINUS, Mode.SPEED, (Action.LOWER_SPEED,)),
        (Event.STEERING_BUTTON, Mode.SPEED, ()),
        (Event.BRAKE_TAPPED, Mode.STEERING, (Action.RELEASE_PEDALS,)),
        (Event.BRAKE_RELEASED, Mode.STEERING, ()),
        (Event.CRUISE_PLUS, Mode.SPEED, (Action.LOCK_SPEED, Action.ENGAGE_SPEED)),
        (Event.OVERRIDE_PRESSED, Mode.MANUAL, (Action.RELEASE_ACTUATORS,)),
        (Event.OVERRIDE_RELEASED, Mode.READY, (Action.DARKEN_BUTTON,)),
    ]
    state = ModeState()
    for time_s, (event, mode, actions) in enumerate(course):
        state, found = step_modes(state, ModeEvent(event, float(time_s)))
        assert (state.mode, found) == (mode, actions), event


@pytest.mark.parametrize(
    "event", [Event.OVERRIDE_PRESSED, Event.OVERRIDE_ASSUMED, Event.STEERING_TORQUE, Event.BRAKE_HELD]
)
def test_the_operator_takes_over_in_one_step(event: Event) -> None:
    for engaged in (TO_STEERING, TO_SPEED):
        state, actions = after(*engaged, event)
        assert state.mode is Mode.MANUAL
        assert Action.RELEASE_ACTUATORS in actions


def test_override_gives_the_vehicle_back_from_every_state_that_can_be_reached() -> None:
    override = {Event.OVERRIDE_PRESSED, Event.OVERRIDE_ASSUMED}
    takes_over = {*override, Event.STEERING_TORQUE, Event.BRAKE_HELD}
    seen = set()
    for before, event, state, actions in every_transition():
        if event not in takes_over:
            continue
        seen.add((event, before.mode))
        assert operator_drives(state)
        if not operator_drives(before) or event in override:
            assert Action.RELEASE_ACTUATORS in actions
        if event in override and before.mode not in (Mode.ERROR, Mode.EMERGENCY_STOP):
            assert state.mode is Mode.MANUAL
        elif event not in override:
            assert state.mode is (before.mode if operator_drives(before) else Mode.MANUAL)
    assert seen == {(event, mode) for event in takes_over for mode in Mode}


def test_error_and_emergency_stop_are_left_as_they_must_be() -> None:
    left = set()
    for before, event, state, actions in every_transition():
        if before.mode is Mode.ERROR and state.mode is not Mode.ERROR:
            assert event is Event.ESTOP_PRESSED or (event is Event.OVERRIDE_PRESSED and not before.faults)
            left.add(state.mode)
        if before.mode is Mode.EMERGENCY_STOP and state.mode is not Mode.EMERGENCY_STOP:
            assert event is Event.OVERRIDE_PRESSED
            assert not before.estop_pressed
            assert state.mode is (Mode.ERROR if before.faults else Mode.MANUAL)
            assert not state.checks_passed
            assert Action.RESTORE_POWER in actions
    assert left == {Mode.READY, Mode.CHECKS, Mode.BOOT, Mode.EMERGENCY_STOP}


def test_an_override_that_cannot_be_read_acknowledges_nothing() -> None:
    """Neither its beginning nor its end: error and emergency stop stay, and nothing is done but to release."""
    seen = set()
    for before, event, state, actions in every_transition():
        if event is not Event.OVERRIDE_ASSUMED:
            continue
        seen.add(before.mode)
        assert actions == (Action.RELEASE_ACTUATORS,)
        assert (state.faults, state.checks_passed) == (before.faults, before.checks_passed)
        freed, then = step_modes(state, ModeEvent(Event.OVERRIDE_RELEASED, 0.0))
        if before.mode in (Mode.ERROR, Mode.EMERGENCY_STOP):
            assert state.mode is before.mode
        if before.mode not in (Mode.BOOT, Mode.CHECKS, Mode.READY):
            assert (freed.mode, then) == (state.mode, ())
    assert seen == set(Mode)


def test_after_a_silence_that_took_the_vehicle_ready_takes_a_press() -> None:
    for engaged in (TO_STEERING, TO_SPEED):
        state, _ = after(*engaged, Event.OVERRIDE_ASSUMED, Event.OVERRIDE_RELEASED)
        assert state.mode is Mode.MANUAL
        assert after(*REARM, start=state)[0].mode is Mode.READY


def test_a_controller_that_is_heard_late_stops_no_start() -> None:
    late = after(Event.BOOT_DONE, Event.OVERRIDE_ASSUMED, *TO_READY[1:])[0]
    assert (late.mode, after(Event.STEERING_BUTTON, start=late)[0].inhibit) == (
        Mode.MANUAL,
        EngagementInhibit.OVERRIDE_PRESSED,
    )
    assert after(Event.OVERRIDE_RELEASED, start=late)[0].mode is Mode.READY


def test_every_entry_of_error_is_lit_and_told_and_hands_over() -> None:
    entered = 0
    for before, event, state, actions in every_transition():
        if state.mode is Mode.ERROR and before.mode not in (Mode.ERROR, Mode.EMERGENCY_STOP):
            entered += 1
            assert {Action.LIGHT_BUTTON, Action.WARN, Action.RELEASE_ACTUATORS} <= set(actions), event
    assert entered > 100


@pytest.mark.parametrize(
    ("died", "back", "relaunch"),
    [
        (Event.CONTROL_DIED, Event.CONTROL_RELAUNCHED, Action.RELAUNCH_CONTROL),
        (Event.DRIVE_BY_WIRE_DIED, Event.DRIVE_BY_WIRE_RELAUNCHED, Action.RELAUNCH_DRIVE_BY_WIRE),
    ],
)
def test_after_a_dead_control_process_ready_takes_relaunch_and_override(
    died: Event, back: Event, relaunch: Action
) -> None:
    state, actions = after(*TO_SPEED, died)
    assert state.mode is Mode.ERROR
    assert Action.RELEASE_ACTUATORS in actions
    assert actions[-1] is relaunch
    assert after(*REARM, start=state)[0].mode is Mode.ERROR
    assert after(back, start=state)[0].mode is Mode.ERROR
    assert after(Event.ERROR_CLEARED, *REARM, start=state)[0].mode is Mode.ERROR
    assert after(back, Event.OVERRIDE_PRESSED, start=state)[0].mode is Mode.READY
    # Both dead: both must be back.
    both = after(Event.CONTROL_DIED, Event.DRIVE_BY_WIRE_DIED, back, start=state)[0]
    assert after(*REARM, start=both)[0].mode is Mode.ERROR


def test_a_dead_registration_changes_no_mode() -> None:
    state, actions = after(*TO_SPEED, Event.REGISTRATION_DIED)
    assert (state.mode, state.registration_dead) == (Mode.SPEED, True)
    assert actions == (Action.RELAUNCH_REGISTRATION, Action.WARN)
    assert not after(Event.REGISTRATION_RELAUNCHED, start=state)[0].registration_dead


WATCHED = [
    (Event.RECORDER_DIED, Event.RECORDER_RELAUNCHED, Action.RELAUNCH_RECORDER, Fault.RECORDER),
    (Event.DISPLAY_DIED, Event.DISPLAY_RELAUNCHED, Action.RELAUNCH_DISPLAY, Fault.DISPLAY),
    (Event.MONITOR_DIED, Event.MONITOR_RELAUNCHED, Action.RELAUNCH_MONITOR, Fault.MONITOR),
]


@pytest.mark.parametrize(("died", "back", "relaunch", "fault"), WATCHED)
def test_a_watched_process_may_fail_twice_a_minute(died: Event, back: Event, relaunch: Action, fault: Fault) -> None:
    state, _ = after(*TO_SPEED)
    for time_s in (10.0, 40.0, 70.5, 100.7):  # never three within 60 s
        state, actions = step_modes(state, ModeEvent(died, time_s))
        assert (state.mode, actions) == (Mode.SPEED, (relaunch, Action.WARN))
        others = [other for other, *_ in WATCHED if other is not died]
        assert after(*others, start=state, time_s=time_s)[0].mode is Mode.SPEED
    state, actions = step_modes(state, ModeEvent(died, 130.4))
    assert state.mode is Mode.ERROR
    assert state.faults == fault
    assert relaunch in actions
    assert after(*REARM, start=state, time_s=131.0)[0].mode is Mode.ERROR
    assert after(back, *REARM, start=state, time_s=131.0)[0].mode is Mode.READY


def test_failed_checks_are_an_error_until_they_pass() -> None:
    state, _ = after(*TO_READY)
    state, _ = step_modes(state, ModeEvent(Event.CHECKS_FAILED, 0.0, Check.BRAKE))
    assert (state.mode, state.failed_check, state.faults) == (Mode.ERROR, Check.BRAKE, Fault.CHECKS)
    state, actions = after(*REARM[:1], start=state)
    assert (state.mode, actions) == (Mode.ERROR, (Action.RELEASE_ACTUATORS, Action.RUN_CHECKS))
    state, _ = after(Event.OVERRIDE_RELEASED, Event.CHECKS_PASSED, Event.OVERRIDE_PRESSED, start=state)
    assert (state.mode, state.failed_check) == (Mode.READY, Check.NONE)


def test_an_emergency_stop_needs_release_override_and_checks() -> None:
    state, actions = after(*TO_SPEED, Event.ESTOP_PRESSED)
    assert state.mode is Mode.EMERGENCY_STOP
    assert {Action.CUT_POWER, Action.RELEASE_ACTUATORS} <= set(actions)
    for events in (REARM, (Event.ESTOP_RELEASED,), (Event.CHECKS_PASSED, Event.ESTOP_RELEASED, Event.STEERING_BUTTON)):
        assert after(*events, start=state)[0].mode is Mode.EMERGENCY_STOP
    state, actions = after(Event.ESTOP_RELEASED, Event.OVERRIDE_PRESSED, start=state)
    assert (state.mode, actions[1:]) == (Mode.MANUAL, (Action.RESTORE_POWER, Action.RUN_CHECKS))
    assert after(Event.OVERRIDE_RELEASED, start=state)[0].mode is Mode.CHECKS
    assert after(Event.OVERRIDE_RELEASED, Event.CHECKS_PASSED, start=state)[0].mode is Mode.READY


def test_a_button_held_at_boot_engages_nothing() -> None:
    held = after(Event.OVERRIDE_PRESSED, *TO_READY, Event.STEERING_BUTTON)[0]
    assert (held.mode, held.inhibit) == (Mode.MANUAL, EngagementInhibit.OVERRIDE_STUCK)
    # Coming free arms nothing; a press of its own does.
    free = after(Event.OVERRIDE_RELEASED, Event.STEERING_BUTTON, start=held)[0]
    assert (free.mode, free.inhibit) == (Mode.MANUAL, EngagementInhibit.NOT_READY)
    assert after(*REARM, Event.STEERING_BUTTON, start=free)[0].mode is Mode.STEERING
    stopped = after(Event.ESTOP_PRESSED, *TO_READY, Event.STEERING_BUTTON)[0]
    assert (stopped.mode, stopped.inhibit) == (Mode.EMERGENCY_STOP, EngagementInhibit.ESTOP)


def test_a_button_held_too_long_is_stuck() -> None:
    state, _ = after(*TO_READY, Event.OVERRIDE_PRESSED, time_s=5.0)
    held, actions = step_modes(state, ModeEvent(Event.TICK, 15.0))
    assert (held.override_stuck, actions) == (False, ())
    held, actions = step_modes(state, ModeEvent(Event.TICK, 15.01))
    assert (held.override_stuck, actions) == (True, (Action.WARN,))
    assert step_modes(held, ModeEvent(Event.TICK, 16.0))[1] == ()
    # Told again while it is down, it was pressed when it was.
    again, _ = step_modes(state, ModeEvent(Event.OVERRIDE_PRESSED, 14.0))
    assert step_modes(again, ModeEvent(Event.TICK, 15.01))[0].override_stuck


def test_engaging_is_refused_with_its_reason() -> None:
    for events, inhibit in (
        ((Event.ROUTE_OFF,), EngagementInhibit.OFF_ROUTE),
        ((Event.ROUTE_WRONG_HEADING,), EngagementInhibit.WRONG_HEADING),
        ((Event.ROUTE_AMBIGUOUS,), EngagementInhibit.AMBIGUOUS),
        ((Event.ROUTE_GONE,), EngagementInhibit.NO_PATH),
        ((Event.TOO_FAST,), EngagementInhibit.TOO_FAST),
        ((Event.BRAKE_TAPPED,), EngagementInhibit.BRAKE_PRESSED),
        ((Event.BRAKE_HELD,), EngagementInhibit.BRAKE_PRESSED),
        ((Event.SOURCE_MISSING,), EngagementInhibit.SOURCE_MISSING),
        ((Event.HEALTH_STOP,), EngagementInhibit.HEALTH),
        ((Event.STEERING_BUTTON, Event.STEERING_TORQUE), EngagementInhibit.NOT_READY),
        ((Event.ERROR_RAISED,), EngagementInhibit.NOT_READY),
        ((Event.ERROR_RAISED, Event.ERROR_CLEARED, Event.OVERRIDE_PRESSED), EngagementInhibit.OVERRIDE_PRESSED),
        ((Event.CHECKS_FAILED,), EngagementInhibit.CHECKS),
        ((Event.ESTOP_PRESSED, Event.ESTOP_RELEASED), EngagementInhibit.ESTOP),
    ):
        state, actions = after(*TO_READY, *events, Event.STEERING_BUTTON)
        assert operator_drives(state), inhibit
        assert (state.inhibit, actions) == (inhibit, (Action.WARN,))


def test_before_the_checks_nothing_engages_and_speed_needs_steering() -> None:
    assert after(*TO_READY[2:], Event.STEERING_BUTTON)[0].inhibit is EngagementInhibit.CHECKS
    assert after(*TO_READY, Event.CRUISE_PLUS)[0].inhibit is EngagementInhibit.NOT_STEERING
    assert after(*TO_READY[:3], Event.STEERING_BUTTON)[0].inhibit is EngagementInhibit.SOURCE_MISSING
    # The reason is gone once a button has engaged something.
    state, _ = after(*TO_READY, Event.CRUISE_PLUS, Event.STEERING_BUTTON)
    assert (state.mode, state.inhibit) == (Mode.STEERING, EngagementInhibit.NONE)
    state, _ = after(Event.BRAKE_TAPPED, Event.CRUISE_PLUS, start=state)
    assert (state.mode, state.inhibit) == (Mode.STEERING, EngagementInhibit.BRAKE_PRESSED)


@pytest.mark.parametrize(
    ("engaged", "lost"),
    [(TO_SPEED, Event.HEALTH_STOP), (TO_STEERING, Event.ROUTE_OFF), (TO_SPEED, Event.ROUTE_WRONG_HEADING)]
    + [(TO_STEERING, Event.ROUTE_AMBIGUOUS), (TO_SPEED, Event.ROUTE_GONE)],
)
def test_a_controlled_stop_ends_standing_in_manual(engaged: tuple[Event, ...], lost: Event) -> None:
    state, actions = after(*engaged, lost)
    assert (state.mode, state.stopping) == (after(*engaged)[0].mode, True)
    assert actions == (Action.STOP_CONTROLLED, Action.WARN)
    # It goes on when its reason is gone, and is not asked for twice.
    again, actions = after(lost, Event.HEALTH_GOOD, Event.ROUTE_NEAR, Event.MOVING, start=state)
    assert (again.stopping, actions) == (True, ())
    refused = after(Event.CRUISE_PLUS, start=again)[0]
    assert (refused.inhibit, refused.mode) == (EngagementInhibit.STOPPING, state.mode)
    ended, actions = after(Event.STANDING, start=again)
    assert (ended.mode, ended.stopping) == (Mode.MANUAL, False)
    assert Action.RELEASE_ACTUATORS in actions
    assert after(Event.OVERRIDE_PRESSED, start=state)[0] == state._replace(
        mode=Mode.MANUAL, stopping=False, override_pressed=True
    )


def test_a_brake_tap_in_a_controlled_stop_leaves_the_brake_on() -> None:
    state, actions = after(*TO_SPEED, Event.HEALTH_STOP, Event.BRAKE_TAPPED)
    assert (state.mode, state.stopping, actions) == (Mode.STEERING, True, ())


def test_standing_already_a_stop_is_over_at_once() -> None:
    state, actions = after(*TO_STEERING, Event.STANDING, Event.HEALTH_STOP)
    assert (state.mode, state.stopping) == (Mode.MANUAL, False)
    assert Action.RELEASE_ACTUATORS in actions


def test_time_never_runs_back_nor_away() -> None:
    state, _ = after(*TO_SPEED, time_s=100.0)
    for time_s in (-1e9, 0.0, math.nan, math.inf, -math.inf):
        assert step_modes(state, ModeEvent(Event.TICK, time_s))[0].time_s == 100.0


class AnyDrive(RuleBasedStateMachine):
    """Whatever happens in whatever order; a record of its own says what may be engaged."""

    speed_control = True

    @initialize()
    def begin(self) -> None:
        self.state = ModeState(speed_control=self.speed_control)
        self.time_s = 0.0
        self.near = self.checked = self.booted = self.estop = False
        self.pressed_s: float | None = None
        self.at_boot = False
        self.standing_faults: set[str] = set()

    @rule(event=st.sampled_from(list(Event)), passed_s=st.sampled_from([0.0, 0.1, 11.0, 70.0]))
    def happen(self, event: Event, passed_s: float) -> None:
        self.time_s += passed_s
        self.tell(event)

    @rule()
    def drive_up(self) -> None:
        for event in (Event.ESTOP_RELEASED, Event.BRAKE_RELEASED, Event.ERROR_CLEARED, *REARM, *TO_SPEED):
            self.tell(event)

    def tell(self, event: Event) -> None:
        before = self.state
        was_held = self.pressed_s is not None and self.time_s - self.pressed_s > 10.0
        self.state, actions = step_modes(before, ModeEvent(event, self.time_s))
        assert self.state.mode in mode_of_diagram(before.mode, event)
        engages = {Action.ENGAGE_STEERING, Action.ENGAGE_SPEED} & set(actions)
        if not self.speed_control:
            leaves_the_pedals_alone(before, event, self.state, actions)
        if engages:
            assert self.near
            assert self.checked
            assert not self.estop
            assert self.pressed_s is None
            assert not was_held
            assert not self.at_boot
            assert not self.standing_faults
        if not operator_drives(self.state) and operator_drives(before):
            assert engages == {Action.ENGAGE_STEERING}
        if before.mode is Mode.ERROR and self.state.mode not in (Mode.ERROR, Mode.EMERGENCY_STOP):
            assert event is Event.OVERRIDE_PRESSED
            assert not self.standing_faults
        self.record(event)

    def record(self, event: Event) -> None:
        name = event.name
        if name.startswith("ROUTE_"):
            self.near = event is Event.ROUTE_NEAR
        elif event is Event.BOOT_DONE:
            self.booted = True
            self.at_boot = self.pressed_s is not None
        elif event is Event.CHECKS_PASSED and self.booted and self.state.mode is not Mode.EMERGENCY_STOP:
            self.checked = True
        elif event in (Event.CHECKS_FAILED, Event.ESTOP_PRESSED):
            self.checked = False
            self.estop |= event is Event.ESTOP_PRESSED
        elif event is Event.ESTOP_RELEASED:
            self.estop = False
        elif event in (Event.OVERRIDE_PRESSED, Event.OVERRIDE_ASSUMED):
            self.pressed_s = self.time_s if self.pressed_s is None else self.pressed_s
        elif event is Event.OVERRIDE_RELEASED:
            self.pressed_s, self.at_boot = None, False
        elif event in (Event.CONTROL_DIED, Event.DRIVE_BY_WIRE_DIED, Event.ERROR_RAISED):
            self.standing_faults.add(name.rsplit("_", 1)[0])
        elif name.endswith("_RELAUNCHED") or event is Event.ERROR_CLEARED:
            self.standing_faults.discard(name.rsplit("_", 1)[0])

    @invariant()
    def a_fault_leaves_the_operator_driving(self) -> None:
        if self.standing_faults or self.estop or self.pressed_s is not None:
            assert operator_drives(self.state)
        if self.state.mode is Mode.READY:
            assert self.checked
            assert not self.standing_faults


class AnySteeringOnlyDrive(AnyDrive):
    """The same of a kit without throttle and brake."""

    speed_control = False


def leaves_the_pedals_alone(before: ModeState, event: Event, state: ModeState, actions: tuple[Action, ...]) -> None:
    """No action on a pedal; what is lost while it steers is handed over at once, with light and warning."""
    assert state.mode is not Mode.SPEED
    assert not state.stopping
    assert not {
        Action.ENGAGE_SPEED,
        Action.LOCK_SPEED,
        Action.RAISE_SPEED,
        Action.LOWER_SPEED,
        Action.RELEASE_PEDALS,
        Action.STOP_CONTROLLED,
    } & set(actions)
    if event in (Event.CRUISE_PLUS, Event.CRUISE_MINUS):
        assert (state.mode, state.inhibit) == (before.mode, EngagementInhibit.NO_SPEED_CONTROL)
        assert actions[-1:] == (Action.WARN,)
    lost = event is Event.HEALTH_STOP or (event.name.startswith("ROUTE_") and event is not Event.ROUTE_NEAR)
    if lost and not operator_drives(before):
        assert state.mode is Mode.MANUAL
        assert {Action.RELEASE_ACTUATORS, Action.WARN, Action.LIGHT_BUTTON} <= set(actions)


CHANGES = mode_changes()


def mode_of_diagram(mode: Mode, event: Event) -> frozenset[Mode]:
    """Where the diagram says that an event may lead; what is in none of its views changes nothing."""
    return CHANGES.get((mode, event), frozenset({mode}))


TestAnyDrive = AnyDrive.TestCase
TestAnySteeringOnlyDrive = AnySteeringOnlyDrive.TestCase
TestAnyDrive.settings = TestAnySteeringOnlyDrive.settings = settings(
    max_examples=30, stateful_step_count=60, deadline=None
)


def test_a_kit_without_pedals_hands_over_where_others_stop() -> None:
    for lost in (Event.HEALTH_STOP, Event.ROUTE_OFF, Event.ROUTE_WRONG_HEADING, Event.ROUTE_GONE):
        state, actions = after(*TO_STEERING, lost, start=ModeState(speed_control=False))
        assert (state.mode, actions) == (
            Mode.MANUAL,
            (Action.RELEASE_ACTUATORS, Action.WARN, Action.LIGHT_BUTTON),
        )
        freed, then = after(*REARM, start=state)
        assert (freed.mode, Action.DARKEN_BUTTON in then) == (Mode.READY, True)


def test_what_a_new_state_knows_engages_nothing() -> None:
    fresh = ModeState()
    assert (fresh.place, fresh.motion, fresh.mode) == (PathOffset.NO_PATH, MeasuredSpeed.UNKNOWN, Mode.BOOT)
    assert operator_drives(fresh)
