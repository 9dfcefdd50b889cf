"""Operating modes: one pure function from a state and something that happened to the next state and what to do.

The modes and their order are LL's (its figure 4). The operator drives in every mode but STEERING and SPEED. The
override button always gives the vehicle back: pressed in STEERING or SPEED it leads to MANUAL in one step, as steering
torque and a held brake do; let go again, with nothing wrong, it leads from MANUAL to READY. An error or a dead control
process leads to ERROR, which has handed over already and which only the button, once nothing is wrong any more, leaves
for READY. The emergency stop takes the actuators' power, so that the system checks must pass again after it.

Time is the host's monotonic clock; it never runs backwards here, whatever it says.
"""

import math

from lgprjax.autopilot.mode_events import (
    CLEARS,
    FATAL,
    MOTIONS,
    PLACES,
    WATCHED,
    Action,
    Check,
    Event,
    Fault,
    Happening,
    Mode,
    Motion,
    Place,
    Refusal,
)
from lgprjax.autopilot.mode_state import ModeState, operator_drives, refusal_of

STUCK_AFTER_S = 10.0
"""An override button held for longer counts as stuck."""
FAILURES = 3
"""Failures of one recorder, display or monitor within ``FAILURES_WITHIN_S`` that make an error."""
FAILURES_WITHIN_S = 60.0

Step = tuple[ModeState, tuple[Action, ...]]


def step_modes(state: ModeState, happening: Happening) -> Step:
    """State after something happened, and what the host is to do, in this order.

    Every event is allowed in every state. Nothing is engaged but by ``Action.ENGAGE_STEERING`` and
    ``Action.ENGAGE_SPEED``, and each only where ``refusal_of`` has no reason against it.
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


def _others(state: ModeState, happening: Happening) -> Step:
    """Events that have a rule of their own."""
    match happening.event:
        case Event.BOOT_DONE:
            # A button that was down all along says nothing about what the operator wants now.
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
    """Events that change what is known and nothing else."""
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
    """Where the vehicle's computer waits with nothing wrong."""
    if not state.booted:
        return Mode.BOOT
    return Mode.READY if state.checks_passed else Mode.CHECKS


def _notice_stuck(state: ModeState) -> Step:
    held = state.override_pressed and state.time_s - state.override_since_s > STUCK_AFTER_S
    if held and not state.override_stuck:
        return state._replace(override_stuck=True), (Action.WARN,)
    return state, ()


def _hand_over(state: ModeState) -> Step:
    """To the operator, if anything is engaged."""
    if operator_drives(state):
        return state, ()
    return state._replace(mode=Mode.MANUAL, stopping=False), (Action.RELEASE_ACTUATORS, Action.WARN)


def _override_pressed(state: ModeState) -> Step:
    since_s = state.override_since_s if state.override_pressed else state.time_s
    state = state._replace(override_pressed=True, override_since_s=since_s, stopping=False)
    release = (Action.RELEASE_ACTUATORS,)
    if state.mode is Mode.EMERGENCY_STOP:
        if state.estop_pressed:
            return state, release
        after = Mode.ERROR if state.faults else Mode.MANUAL
        return state._replace(mode=after), (*release, Action.RESTORE_POWER, Action.RUN_CHECKS)
    if state.mode is Mode.ERROR:
        if state.faults or state.override_stuck:
            # Failed checks are run again at the operator's wish; nothing else would clear them.
            return state, (*release, Action.RUN_CHECKS) if Fault.CHECKS in state.faults else release
        after = _resting_mode(state)
        run = (Action.RUN_CHECKS,) if after is Mode.CHECKS else ()
        return state._replace(mode=after), (*release, Action.DARKEN_BUTTON, *run)
    return state._replace(mode=Mode.MANUAL), release


def _override_released(state: ModeState) -> Step:
    stuck = state.override_stuck
    pressed = state.override_pressed
    state = state._replace(override_pressed=False, override_stuck=False)
    # A button that came free by itself arms nothing: it takes a press of its own.
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
    """To ERROR; the emergency stop stays what it is."""
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
    refusal = refusal_of(state)
    if refusal is not Refusal.NONE:
        return state._replace(refusal=refusal), (Action.WARN,)
    if not operator_drives(state):
        return state, ()
    return state._replace(mode=Mode.STEERING, refusal=Refusal.NONE), (Action.ENGAGE_STEERING,)


def _cruise_button(state: ModeState, event: Event) -> Step:
    refusal = refusal_of(state)
    if refusal is Refusal.NONE and operator_drives(state):
        refusal = Refusal.NOT_STEERING
    if refusal is not Refusal.NONE:
        return state._replace(refusal=refusal), (Action.WARN,)
    if state.mode is Mode.SPEED:
        return state, (Action.RAISE_SPEED if event is Event.CRUISE_PLUS else Action.LOWER_SPEED,)
    return state._replace(mode=Mode.SPEED, refusal=Refusal.NONE), (Action.LOCK_SPEED, Action.ENGAGE_SPEED)


def _stop_if_lost(state: ModeState) -> Step:
    """A controlled stop where the autopilot drives and the route or the estimate no longer carries it."""
    if operator_drives(state) or state.stopping or (state.health_good and state.place is Place.NEAR):
        return state, ()
    if state.motion is Motion.STANDING:
        return _hand_over(state)
    return state._replace(stopping=True), (Action.STOP_CONTROLLED, Action.WARN)


def _end_stop(state: ModeState) -> Step:
    return _hand_over(state) if state.stopping and state.motion is Motion.STANDING else (state, ())
