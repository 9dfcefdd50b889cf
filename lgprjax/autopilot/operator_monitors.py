"""The operator's hands and feet: buttons, contacts, brake and torque as events of the mode machine. Faults 32 to 34.

Overrides act on the first status; engaging and releasing need two in a row. A button that was down at the start of the
watch does not count as pressed. Anything unreadable hands the vehicle back as the override does, and acknowledges
nothing: a separate event distinguishes it from a press.
"""

from typing import NamedTuple

from lgprjax.autopilot.modes import Event
from lgprjax.autopilot.monitors import Dwell, Watch, as_watch, beyond, counted_step_s, step_dwell

OVERRIDE_FIRST, OVERRIDE_SECOND, ESTOP, STEERING, PLUS, MINUS, BRAKE_TAP = 1, 2, 4, 8, 16, 32, 64
"""Bits of ``controller_status.buttons`` in data_schema/wire.toml."""

CONTACTS_S = 0.08
"""Time of equal contacts of the override after which a wire is cut or a contact stuck. A press passes faster."""
SILENT_S = 0.1
FIRST_STATUS_S = 1.0
"""Time within which the controller must be received for the first time."""
TORQUE_S = 0.06
TORQUE_LET_GO = 0.7
"""Share of the threshold below which the hands have released the wheel."""
HELD_S = 0.5

_PRESSES = (
    (STEERING, Event.STEERING_BUTTON),
    (PLUS, Event.CRUISE_PLUS),
    (MINUS, Event.CRUISE_MINUS),
)


class OperatorContact(NamedTuple):
    """Torque on the steering wheel in the box's newest status, N m, and whether a foot was on the brake in any status
    since the last tick."""

    torque_nm: float
    brake_pedal: bool


class ButtonState(NamedTuple):
    """State between ticks.

    Attributes:
        last: buttons of the last status.
        down: engaging buttons that are down.
        received: whether the controller has been received.
        unreceived_s: time since the watch began, until the controller is received.
        resting: number of statuses in a row with the override at rest.
        override, estop, brake: inputs reported to the mode machine; ``override`` is pressed or assumed to be.
        braked_s: time for which the brake has been pressed.
        freed: number of ticks in a row with the brake free.
        contacts, torque, unread: findings.
    """

    last: int = 0
    down: int = STEERING | PLUS | MINUS
    received: bool = False
    unreceived_s: float = 0.0
    resting: int = 0
    override: bool = False
    estop: bool = False
    brake: bool = False
    braked_s: float = 0.0
    freed: int = 0
    contacts: Dwell = Dwell()
    torque: Dwell = Dwell()
    unread: Dwell = Dwell()


def step_buttons(
    state: ButtonState,
    *,
    statuses: tuple[int, ...],
    controller_age_s: float,
    hands: OperatorContact,
    override_torque_nm: float,
    engaged: bool,
    step_s: float,
) -> tuple[ButtonState, list[Event], Watch]:
    """State, events in their order, and findings of a tick.

    Args:
        state: state of the last tick.
        statuses: ``buttons`` of every status of the controller that was accepted since the last tick, oldest first.
        controller_age_s: time since the newest status; infinite before the first.
        hands: contacts reported by the box.
        override_torque_nm: torque that overrides.
        engaged: whether the autopilot drives, so that hands already on the wheel override.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    events: list[Event] = []
    for buttons in statuses:
        state = _take_status(state, buttons, events)
    state = state._replace(unreceived_s=state.unreceived_s + step_s)
    silent = (state.received or state.unreceived_s >= FIRST_STATUS_S) and not 0.0 <= controller_age_s <= SILENT_S
    alike = state.received and _contacts_alike(state.last)
    contacts = step_dwell(state.contacts, alike, step_s, on_s=CONTACTS_S, off_s=0.0)
    state = state._replace(contacts=contacts)
    if silent or contacts.on:
        # Two statuses at rest release it, not one.
        state = state._replace(resting=0)
        if not state.override:
            events.append(Event.OVERRIDE_ASSUMED)
            state = state._replace(override=True)
    state = _take_brake(state, hands, events, step_s)
    state = _take_torque(state, hands.torque_nm, override_torque_nm, engaged, events, step_s)
    bits = (
        contacts.on * Watch.OVERRIDE_CONTACTS | silent * Watch.CONTROLLER_SILENT | state.unread.on * Watch.TORQUE_UNREAD
    )
    return state, events, as_watch(bits)


def _contacts_alike(buttons: int) -> bool:
    return bool(buttons & OVERRIDE_FIRST) == bool(buttons & OVERRIDE_SECOND)


def _take_status(state: ButtonState, buttons: int, events: list[Event]) -> ButtonState:
    """One status of the controller."""
    twice = buttons & state.last
    neither = ~(buttons | state.last)
    down = state.down
    # The first status has no predecessor to compare with.
    if state.received:
        for bit, event in _PRESSES:
            if twice & bit and not down & bit:
                events.append(event)
                down |= bit
            elif neither & bit:
                down &= ~bit
    resting = state.resting + 1 if buttons & (OVERRIDE_FIRST | OVERRIDE_SECOND) == OVERRIDE_SECOND else 0
    override, estop = state.override, state.estop
    if buttons & (OVERRIDE_FIRST | OVERRIDE_SECOND) == OVERRIDE_FIRST and not override:
        events.append(Event.OVERRIDE_PRESSED)
        override = True
    elif override and resting >= 2:
        events.append(Event.OVERRIDE_RELEASED)
        override = False
    if buttons & ESTOP and not estop:
        events.append(Event.ESTOP_PRESSED)
        estop = True
    elif estop and state.received and neither & ESTOP:
        events.append(Event.ESTOP_RELEASED)
        estop = False
    return state._replace(last=buttons, down=down, received=True, resting=resting, override=override, estop=estop)


def _take_brake(state: ButtonState, hands: OperatorContact, events: list[Event], step_s: float) -> ButtonState:
    """Brake pedal, or the controller's button for it."""
    pressed = hands.brake_pedal or bool(state.last & BRAKE_TAP)
    if not pressed:
        freed = state.freed + 1
        if state.brake and freed >= 2:
            events.append(Event.BRAKE_RELEASED)
            return state._replace(brake=False, braked_s=0.0, freed=freed)
        return state._replace(freed=freed)
    if not state.brake:
        events.append(Event.BRAKE_TAPPED)
    held_s = state.braked_s + step_s
    if state.braked_s < HELD_S <= held_s + 1e-9:
        events.append(Event.BRAKE_HELD)
        held_s = max(held_s, HELD_S)
    return state._replace(brake=True, braked_s=held_s, freed=0)


def _take_torque(
    state: ButtonState, torque_nm: float, threshold_nm: float, engaged: bool, events: list[Event], step_s: float
) -> ButtonState:
    """Hands on the wheel; reported once, and again if something is engaged with them still on it."""
    unread = step_dwell(state.unread, torque_nm != torque_nm, step_s, on_s=TORQUE_S)
    bound = threshold_nm * TORQUE_LET_GO if state.torque.on else threshold_nm
    torque = step_dwell(state.torque, beyond(torque_nm, bound), step_s, on_s=TORQUE_S, off_s=0.0)
    if torque.on and (engaged or not state.torque.on):
        events.append(Event.STEERING_TORQUE)
    return state._replace(torque=torque, unread=unread)
