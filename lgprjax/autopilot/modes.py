"""Operating modes: one pure function from a state and an event to the next state and actions.

The modes and their order are LL's (its figure 4). The operator drives in every mode but STEERING and SPEED. The
override button always gives the vehicle back: pressed in STEERING or SPEED it leads to MANUAL in one step, as do
steering torque and a held brake; released, with nothing wrong, it leads from MANUAL to READY. A button that cannot be
read gives the vehicle back too, but only a press acknowledges. An error or a dead control process leads to ERROR, after
handing over, which only the button leaves for READY, once nothing is wrong any more. The emergency stop cuts the
actuators' power, so that the system checks must pass again after it.

Time is the host's monotonic clock; a decreasing time is ignored.
"""

import math
from enum import Enum, IntEnum, IntFlag, auto
from typing import NamedTuple

# Events and actions of the mode machine, and groups of related events.


class Mode(IntEnum):
    """Modes of driving. An actuator is engaged only in STEERING and SPEED."""

    BOOT = 0
    CHECKS = 1
    READY = 2
    STEERING = 3
    SPEED = 4
    MANUAL = 5
    ERROR = 6
    EMERGENCY_STOP = 7


ENGAGED = (Mode.STEERING, Mode.SPEED)


class Event(Enum):
    """Events. Buttons and pedals report both edges; everything else reports a change.

    ``BRAKE_TAPPED`` is the brake being pressed, ``BRAKE_HELD`` its remaining pressed, ``ERROR_CLEARED`` the end of the
    last error raised. ``OVERRIDE_ASSUMED`` is the override button being unreadable, by its contacts or a silent
    controller, without a press. ``ROUTE_NEAR`` is within 10 m of the chosen path, at a unique place and aligned with
    it.
    """

    BOOT_DONE = auto()
    CHECKS_PASSED = auto()
    CHECKS_FAILED = auto()
    STEERING_BUTTON = auto()
    CRUISE_PLUS = auto()
    CRUISE_MINUS = auto()
    OVERRIDE_PRESSED = auto()
    OVERRIDE_RELEASED = auto()
    OVERRIDE_ASSUMED = auto()
    STEERING_TORQUE = auto()
    BRAKE_TAPPED = auto()
    BRAKE_HELD = auto()
    BRAKE_RELEASED = auto()
    ESTOP_PRESSED = auto()
    ESTOP_RELEASED = auto()
    ROUTE_NEAR = auto()
    ROUTE_OFF = auto()
    ROUTE_WRONG_HEADING = auto()
    ROUTE_AMBIGUOUS = auto()
    ROUTE_GONE = auto()
    STANDING = auto()
    MOVING = auto()
    TOO_FAST = auto()
    SOURCE_MISSING = auto()
    SOURCES_PRESENT = auto()
    HEALTH_STOP = auto()
    HEALTH_GOOD = auto()
    ERROR_RAISED = auto()
    ERROR_CLEARED = auto()
    CONTROL_DIED = auto()
    CONTROL_RELAUNCHED = auto()
    DRIVE_BY_WIRE_DIED = auto()
    DRIVE_BY_WIRE_RELAUNCHED = auto()
    REGISTRATION_DIED = auto()
    REGISTRATION_RELAUNCHED = auto()
    RECORDER_DIED = auto()
    RECORDER_RELAUNCHED = auto()
    DISPLAY_DIED = auto()
    DISPLAY_RELAUNCHED = auto()
    MONITOR_DIED = auto()
    MONITOR_RELAUNCHED = auto()
    TICK = auto()


class Check(Enum):
    """A system check that failed."""

    NONE = auto()
    DRIVE_BY_WIRE = auto()
    STEERING_SENSORS = auto()
    BRAKE = auto()
    GNSS_INS = auto()
    LGPR = auto()
    ROUTE = auto()
    PARAMETERS = auto()
    STORAGE = auto()
    SECOND_MASTER = auto()


class ModeEvent(NamedTuple):
    """An event with its monotonic time, and the failed check, if any."""

    event: Event
    time_s: float
    check: Check = Check.NONE


class Action(Enum):
    """Actions of the host.

    ``WARN`` shows the state's faults or its engagement inhibit. ``STOP_CONTROLLED`` hands the brake to the autopilot in
    STEERING too, until ``RELEASE_ACTUATORS``.
    """

    RUN_CHECKS = auto()
    RELEASE_ACTUATORS = auto()
    RELEASE_PEDALS = auto()
    ENGAGE_STEERING = auto()
    ENGAGE_SPEED = auto()
    LOCK_SPEED = auto()
    RAISE_SPEED = auto()
    LOWER_SPEED = auto()
    STOP_CONTROLLED = auto()
    CUT_POWER = auto()
    RESTORE_POWER = auto()
    LIGHT_BUTTON = auto()
    DARKEN_BUTTON = auto()
    WARN = auto()
    RELAUNCH_CONTROL = auto()
    RELAUNCH_DRIVE_BY_WIRE = auto()
    RELAUNCH_REGISTRATION = auto()
    RELAUNCH_RECORDER = auto()
    RELAUNCH_DISPLAY = auto()
    RELAUNCH_MONITOR = auto()


class Fault(IntFlag):
    """Faults that hold ERROR, each until its own event clears it."""

    RAISED = 1
    CHECKS = 2
    CONTROL = 4
    DRIVE_BY_WIRE = 8
    RECORDER = 16
    DISPLAY = 32
    MONITOR = 64


class PathOffset(Enum):
    """Place of the vehicle relative to the chosen path."""

    NO_PATH = auto()
    NEAR = auto()
    OFF_ROUTE = auto()
    WRONG_HEADING = auto()
    AMBIGUOUS = auto()


class MeasuredSpeed(Enum):
    """Motion of the vehicle; the host decides what is too fast to engage."""

    UNKNOWN = auto()
    STANDING = auto()
    MOVING = auto()
    TOO_FAST = auto()


class EngagementInhibit(Enum):
    """Why a button did not engage."""

    NONE = auto()
    ESTOP = auto()
    CHECKS = auto()
    OVERRIDE_STUCK = auto()
    OVERRIDE_PRESSED = auto()
    NOT_READY = auto()
    NOT_STEERING = auto()
    NO_SPEED_CONTROL = auto()
    STOPPING = auto()
    BRAKE_PRESSED = auto()
    SOURCE_MISSING = auto()
    TOO_FAST = auto()
    HEALTH = auto()
    NO_PATH = auto()
    OFF_ROUTE = auto()
    WRONG_HEADING = auto()
    AMBIGUOUS = auto()


class Process(NamedTuple):
    """A process that may die: its fault, the event of its return, and the action that restarts it."""

    fault: Fault
    relaunched: Event
    relaunch: Action


FATAL = {
    Event.CONTROL_DIED: Process(Fault.CONTROL, Event.CONTROL_RELAUNCHED, Action.RELAUNCH_CONTROL),
    Event.DRIVE_BY_WIRE_DIED: Process(
        Fault.DRIVE_BY_WIRE, Event.DRIVE_BY_WIRE_RELAUNCHED, Action.RELAUNCH_DRIVE_BY_WIRE
    ),
}
"""An error at once."""
WATCHED = {
    Event.RECORDER_DIED: Process(Fault.RECORDER, Event.RECORDER_RELAUNCHED, Action.RELAUNCH_RECORDER),
    Event.DISPLAY_DIED: Process(Fault.DISPLAY, Event.DISPLAY_RELAUNCHED, Action.RELAUNCH_DISPLAY),
    Event.MONITOR_DIED: Process(Fault.MONITOR, Event.MONITOR_RELAUNCHED, Action.RELAUNCH_MONITOR),
}
"""Relaunched while driving continues, until they fail too often."""
CLEARS = {process.relaunched: process.fault for process in (*FATAL.values(), *WATCHED.values())} | {
    Event.ERROR_CLEARED: Fault.RAISED,
    Event.CHECKS_PASSED: Fault.CHECKS,
}
"""The fault that an event ends."""
PLACES = {
    Event.ROUTE_NEAR: PathOffset.NEAR,
    Event.ROUTE_OFF: PathOffset.OFF_ROUTE,
    Event.ROUTE_WRONG_HEADING: PathOffset.WRONG_HEADING,
    Event.ROUTE_AMBIGUOUS: PathOffset.AMBIGUOUS,
    Event.ROUTE_GONE: PathOffset.NO_PATH,
}
MOTIONS = {
    Event.STANDING: MeasuredSpeed.STANDING,
    Event.MOVING: MeasuredSpeed.MOVING,
    Event.TOO_FAST: MeasuredSpeed.TOO_FAST,
}


# State of the mode machine, and reasons against engaging.


class ModeState(NamedTuple):
    """State of the mode machine.

    Attributes:
        mode: present mode.
        time_s: latest time received.
        booted: whether the computer has started.
        checks_passed: whether the last run of the system checks passed.
        failed_check: failed check; NONE otherwise.
        faults: faults that prevent leaving ERROR.
        place: position relative to the route, from the planner.
        motion: motion of the vehicle.
        sources_present: whether the sources that navigation needs to engage are present.
        health_good: whether navigation requests no stop.
        brake_pressed, override_pressed, estop_pressed: operator inputs.
        override_since_s: time at which the override button was pressed, or assumed to be.
        override_stuck: whether the button was held for too long, since before the end of the boot, or assumed; until
            released.
        registration_dead: whether registration has failed; driving continues on GNSS and INS.
        failures: deaths of supervised processes in the last minute, each by its event and its time.
        stopping: whether a controlled stop runs; it ends at standstill, in MANUAL.
        inhibit: reason why the last press of a button did not engage; NONE if it did.
        speed_control: whether the autopilot has throttle and brake. Without them SPEED is never engaged, and a handover
            replaces controlled stops.
    """

    mode: Mode = Mode.BOOT
    time_s: float = 0.0
    booted: bool = False
    checks_passed: bool = False
    failed_check: Check = Check.NONE
    faults: Fault = Fault(0)
    place: PathOffset = PathOffset.NO_PATH
    motion: MeasuredSpeed = MeasuredSpeed.UNKNOWN
    sources_present: bool = False
    health_good: bool = False
    brake_pressed: bool = False
    override_pressed: bool = False
    estop_pressed: bool = False
    override_since_s: float = 0.0
    override_stuck: bool = False
    registration_dead: bool = False
    failures: tuple[tuple[Event, float], ...] = ()
    stopping: bool = False
    inhibit: EngagementInhibit = EngagementInhibit.NONE
    speed_control: bool = True


def operator_drives(state: ModeState) -> bool:
    """Whether all actuators are released."""
    return state.mode not in ENGAGED


def inhibit_of(state: ModeState) -> EngagementInhibit:
    """Why engaging is inhibited now, the most important reason first; NONE if it is allowed."""
    reasons = (
        (state.estop_pressed or state.mode is Mode.EMERGENCY_STOP, EngagementInhibit.ESTOP),
        (not state.checks_passed, EngagementInhibit.CHECKS),
        (state.override_stuck, EngagementInhibit.OVERRIDE_STUCK),
        (state.override_pressed, EngagementInhibit.OVERRIDE_PRESSED),
        (state.mode not in (Mode.READY, *ENGAGED), EngagementInhibit.NOT_READY),
        (state.stopping, EngagementInhibit.STOPPING),
        (state.brake_pressed, EngagementInhibit.BRAKE_PRESSED),
        (state.motion is MeasuredSpeed.UNKNOWN or not state.sources_present, EngagementInhibit.SOURCE_MISSING),
        (state.motion is MeasuredSpeed.TOO_FAST, EngagementInhibit.TOO_FAST),
        (not state.health_good, EngagementInhibit.HEALTH),
        (state.place is PathOffset.NO_PATH, EngagementInhibit.NO_PATH),
        (state.place is PathOffset.OFF_ROUTE, EngagementInhibit.OFF_ROUTE),
        (state.place is PathOffset.WRONG_HEADING, EngagementInhibit.WRONG_HEADING),
        (state.place is PathOffset.AMBIGUOUS, EngagementInhibit.AMBIGUOUS),
    )
    return next((reason for applies, reason in reasons if applies), EngagementInhibit.NONE)


STUCK_AFTER_S = 10.0
"""An override button held for longer counts as stuck."""
FAILURES = 3
"""Failures of one recorder, display or monitor within ``FAILURES_WITHIN_S`` that make an error."""
FAILURES_WITHIN_S = 60.0

Step = tuple[ModeState, tuple[Action, ...]]


def step_modes(state: ModeState, happening: ModeEvent) -> Step:
    """State after an event, and actions of the host, in order.

    Every event is allowed in every state. Only ``Action.ENGAGE_STEERING`` and ``Action.ENGAGE_SPEED`` engage, and each
    only if ``inhibit_of`` returns NONE.
    """
    event = happening.event
    time_s = max(state.time_s, happening.time_s) if math.isfinite(happening.time_s) else state.time_s
    state, stuck = _notice_stuck(state._replace(time_s=time_s))
    if event in PLACES:
        state, actions = _stop_if_lost(state._replace(place=PLACES[event]))
    elif event in MOTIONS:
        state, actions = _end_stop(state._replace(motion=MOTIONS[event]))
    elif event in FATAL:
        state, actions = _fail(state, FATAL[event].fault, (FATAL[event].relaunch,))
    elif event in WATCHED:
        state, actions = _watched_died(state, event)
    else:
        state, actions = _others(state, happening)
    return state, stuck + actions


def _others(state: ModeState, happening: ModeEvent) -> Step:
    """Events that have a rule of their own."""
    match happening.event:
        case Event.BOOT_DONE:
            # A button that was down all along does not express the operator's present intention.
            state = state._replace(booted=True, override_stuck=state.override_pressed)
            if state.mode is not Mode.BOOT:
                return state, ()
            return state._replace(mode=Mode.CHECKS), (Action.RUN_CHECKS,)
        case Event.CHECKS_PASSED:
            return _checks_passed(state)
        case Event.CHECKS_FAILED:
            return _fail(state._replace(checks_passed=False, failed_check=happening.check), Fault.CHECKS)
        case Event.ERROR_RAISED:
            return _fail(state, Fault.RAISED)
        case Event.STEERING_BUTTON:
            return _steering_button(state)
        case Event.CRUISE_PLUS | Event.CRUISE_MINUS:
            return _cruise_button(state, happening.event)
        case Event.OVERRIDE_PRESSED:
            return _override_pressed(state)
        case Event.OVERRIDE_RELEASED:
            return _override_released(state)
        case Event.OVERRIDE_ASSUMED:
            return _override_assumed(state)
        case Event.ESTOP_PRESSED:
            state = state._replace(mode=Mode.EMERGENCY_STOP, estop_pressed=True, checks_passed=False, stopping=False)
            return state, (Action.CUT_POWER, Action.RELEASE_ACTUATORS, Action.LIGHT_BUTTON, Action.WARN)
        case Event.STEERING_TORQUE:
            return _hand_over(state)
        case Event.BRAKE_HELD:
            return _hand_over(state._replace(brake_pressed=True))
        case Event.BRAKE_TAPPED:
            state = state._replace(brake_pressed=True)
            if state.mode is not Mode.SPEED:
                return state, ()
            # A controlled stop keeps the brake.
            return state._replace(mode=Mode.STEERING), () if state.stopping else (Action.RELEASE_PEDALS,)
        case Event.REGISTRATION_DIED:
            return state._replace(registration_dead=True), (Action.RELAUNCH_REGISTRATION, Action.WARN)
        case Event.HEALTH_STOP:
            return _stop_if_lost(state._replace(health_good=False))
    return _noted(state, happening.event), ()


def _noted(state: ModeState, event: Event) -> ModeState:
    """Events that only change the known conditions."""
    match event:
        case Event.ESTOP_RELEASED:
            return state._replace(estop_pressed=False)
        case Event.BRAKE_RELEASED:
            return state._replace(brake_pressed=False)
        case Event.HEALTH_GOOD:
            return state._replace(health_good=True)
        case Event.SOURCE_MISSING | Event.SOURCES_PRESENT:
            return state._replace(sources_present=event is Event.SOURCES_PRESENT)
        case Event.REGISTRATION_RELAUNCHED:
            return state._replace(registration_dead=False)
    return state._replace(faults=state.faults & ~CLEARS.get(event, Fault(0)))


def _resting_mode(state: ModeState) -> Mode:
    """Resting mode of the computer with nothing wrong."""
    if not state.booted:
        return Mode.BOOT
    return Mode.READY if state.checks_passed else Mode.CHECKS


def _notice_stuck(state: ModeState) -> Step:
    held = state.override_pressed and state.time_s - state.override_since_s > STUCK_AFTER_S
    if held and not state.override_stuck:
        return state._replace(override_stuck=True), (Action.WARN,)
    return state, ()


def _hand_over(state: ModeState) -> Step:
    """Hand over to the operator, if anything is engaged."""
    if operator_drives(state):
        return state, ()
    return state._replace(mode=Mode.MANUAL, stopping=False), (Action.RELEASE_ACTUATORS, Action.WARN)


def _hold_override(state: ModeState) -> ModeState:
    since_s = state.override_since_s if state.override_pressed else state.time_s
    return state._replace(override_pressed=True, override_since_s=since_s, stopping=False)


def _override_assumed(state: ModeState) -> Step:
    """Gives the vehicle back and acknowledges nothing: an error stays, power that is cut stays cut."""
    # On the way to READY no press is awaited: a controller that connects late continues there. In other modes the end
    # of the silence must not arm either.
    underway = state.mode in (Mode.BOOT, Mode.CHECKS, Mode.READY)
    keeps = state.mode in (Mode.ERROR, Mode.EMERGENCY_STOP)
    state = _hold_override(state)._replace(
        mode=state.mode if keeps else Mode.MANUAL, override_stuck=state.override_stuck or not underway
    )
    return state, (Action.RELEASE_ACTUATORS,)


def _override_pressed(state: ModeState) -> Step:
    state = _hold_override(state)
    release = (Action.RELEASE_ACTUATORS,)
    if state.mode is Mode.EMERGENCY_STOP:
        if state.estop_pressed:
            return state, release
        after = Mode.ERROR if state.faults else Mode.MANUAL
        return state._replace(mode=after), (*release, Action.RESTORE_POWER, Action.RUN_CHECKS)
    if state.mode is Mode.ERROR:
        if state.faults or state.override_stuck:
            # Failed checks are run again at the operator's request; nothing else would clear them.
            return state, (*release, Action.RUN_CHECKS) if Fault.CHECKS in state.faults else release
        after = _resting_mode(state)
        run = (Action.RUN_CHECKS,) if after is Mode.CHECKS else ()
        return state._replace(mode=after), (*release, Action.DARKEN_BUTTON, *run)
    return state._replace(mode=Mode.MANUAL), release


def _override_released(state: ModeState) -> Step:
    stuck = state.override_stuck
    pressed = state.override_pressed
    state = state._replace(override_pressed=False, override_stuck=False)
    # A stuck button that is released does not arm: that takes a new press.
    if state.mode is not Mode.MANUAL or stuck or not pressed:
        return state, ()
    after = _resting_mode(state)
    run = (Action.RUN_CHECKS,) if after is Mode.CHECKS else ()
    return state._replace(mode=after), (Action.DARKEN_BUTTON, *run)


def _checks_passed(state: ModeState) -> Step:
    # Without power or before the end of the boot nothing can have been checked.
    if not state.booted or state.mode is Mode.EMERGENCY_STOP:
        return state, ()
    faults = state.faults & ~CLEARS[Event.CHECKS_PASSED]
    mode = Mode.READY if state.mode is Mode.CHECKS else state.mode
    return state._replace(mode=mode, checks_passed=True, failed_check=Check.NONE, faults=faults), ()


def _fail(state: ModeState, fault: Fault, more: tuple[Action, ...] = ()) -> Step:
    """Change to ERROR; an emergency stop is unchanged."""
    mode = state.mode if state.mode is Mode.EMERGENCY_STOP else Mode.ERROR
    state = state._replace(mode=mode, faults=state.faults | fault, stopping=False)
    return state, (Action.RELEASE_ACTUATORS, Action.LIGHT_BUTTON, Action.WARN, *more)


def _watched_died(state: ModeState, event: Event) -> Step:
    """Relaunched with the mode kept; the third time within a minute it is an error."""
    recent = tuple(known for known in state.failures if state.time_s - known[1] < FAILURES_WITHIN_S)
    same = [known for known in recent if known[0] is event][-(FAILURES - 1) :]
    others = tuple(known for known in recent if known[0] is not event)
    state = state._replace(failures=(*others, *same, (event, state.time_s)))
    relaunch = (WATCHED[event].relaunch,)
    if len(same) < FAILURES - 1:
        return state, (*relaunch, Action.WARN)
    return _fail(state, WATCHED[event].fault, relaunch)


def _steering_button(state: ModeState) -> Step:
    inhibit = inhibit_of(state)
    if inhibit is not EngagementInhibit.NONE:
        return state._replace(inhibit=inhibit), (Action.WARN,)
    if not operator_drives(state):
        return state, ()
    return state._replace(mode=Mode.STEERING, inhibit=EngagementInhibit.NONE), (Action.ENGAGE_STEERING,)


def _cruise_button(state: ModeState, event: Event) -> Step:
    inhibit = inhibit_of(state)
    if not state.speed_control:
        inhibit = EngagementInhibit.NO_SPEED_CONTROL
    elif inhibit is EngagementInhibit.NONE and operator_drives(state):
        inhibit = EngagementInhibit.NOT_STEERING
    if inhibit is not EngagementInhibit.NONE:
        return state._replace(inhibit=inhibit), (Action.WARN,)
    if state.mode is Mode.SPEED:
        return state, (Action.RAISE_SPEED if event is Event.CRUISE_PLUS else Action.LOWER_SPEED,)
    return state._replace(mode=Mode.SPEED, inhibit=EngagementInhibit.NONE), (Action.LOCK_SPEED, Action.ENGAGE_SPEED)


def _stop_if_lost(state: ModeState) -> Step:
    """A controlled stop if the autopilot drives and route or estimate are no longer sufficient.

    Without a brake to stop with the operator must take over at once: the button lights up as in ERROR.
    """
    if operator_drives(state) or state.stopping or (state.health_good and state.place is PathOffset.NEAR):
        return state, ()
    if not state.speed_control:
        state, actions = _hand_over(state)
        return state, (*actions, Action.LIGHT_BUTTON)
    if state.motion is MeasuredSpeed.STANDING:
        return _hand_over(state)
    return state._replace(stopping=True), (Action.STOP_CONTROLLED, Action.WARN)


def _end_stop(state: ModeState) -> Step:
    return _hand_over(state) if state.stopping and state.motion is MeasuredSpeed.STANDING else (state, ())
