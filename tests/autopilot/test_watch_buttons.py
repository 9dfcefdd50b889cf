"""Buttons, contacts, brake and torque: what reaches the mode machine, and when."""

import math
from itertools import chain

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.autopilot.modes import Event
from lgprjax.autopilot.monitors import Watch
from lgprjax.autopilot.operator_monitors import ButtonState, OperatorContact, step_buttons

REST = 2
"""controller_status.buttons with nothing pressed: the override's second contact is closed."""
PRESSED = 1
FREE = OperatorContact(0.0, False)


def after(
    ticks: list[tuple[int, ...]],
    state: ButtonState | None = None,
    *,
    age_s: float = 0.01,
    hands: OperatorContact = FREE,
    engaged: bool = False,
) -> tuple[ButtonState, list[list[Event]], Watch]:
    """State, events tick by tick, and the last findings."""
    state = state or ButtonState()
    events: list[list[Event]] = []
    bits = Watch(0)
    for statuses in ticks:
        state, found, bits = step_buttons(
            state,
            statuses=statuses,
            controller_age_s=age_s,
            hands=hands,
            override_torque_nm=4.0,
            engaged=engaged,
            step_s=0.02,
        )
        events.append(found)
    return state, events, bits


def at_rest() -> ButtonState:
    return after([(REST,)] * 3)[0]


def test_nothing_happens_at_rest() -> None:
    assert after([(REST,)] * 50)[1:] == ([[]] * 50, Watch(0))


def test_the_override_acts_at_once_and_lets_go_after_two_statuses() -> None:
    state, events, _ = after([(PRESSED,), (PRESSED,), (REST,), (REST,)], at_rest())
    assert events == [[Event.OVERRIDE_PRESSED], [], [], [Event.OVERRIDE_RELEASED]]
    assert not state.override


def test_a_press_between_two_ticks_is_not_lost() -> None:
    assert after([(PRESSED, REST)], at_rest())[1] == [[Event.OVERRIDE_PRESSED]]


def test_contacts_that_change_one_after_the_other_are_a_press_and_no_fault() -> None:
    _, events, bits = after([(3,), (3,), (PRESSED,)], at_rest())
    assert events == [[], [], [Event.OVERRIDE_PRESSED]]
    assert bits == Watch(0)


def test_contacts_alike_for_a_tenth_of_a_second_are_assumed_to_be_a_press() -> None:
    for alike in (0, 3):
        state, events, bits = after([(alike,)] * 5, at_rest())
        assert [len(found) for found in events] == [0, 0, 0, 1, 0]
        assert events[3] == [Event.OVERRIDE_ASSUMED]
        assert bits == Watch.OVERRIDE_CONTACTS
        _, events, bits = after([(REST,), (REST,)], state)
        assert events == [[], [Event.OVERRIDE_RELEASED]]
        assert bits == Watch(0)


def test_a_silent_controller_gives_the_vehicle_back_without_a_press() -> None:
    for age_s in (0.12, math.inf, math.nan, -1.0):
        state, events, bits = after([()], at_rest(), age_s=age_s)
        assert events == [[Event.OVERRIDE_ASSUMED]]
        assert bits == Watch.CONTROLLER_SILENT
        assert after([(REST,), (REST,)], state)[1] == [[], [Event.OVERRIDE_RELEASED]]


def test_a_press_counts_only_once_the_button_was_seen_at_rest_again() -> None:
    """A contact that flickers while it is broken is nobody's press."""
    state, events, _ = after([()], at_rest(), age_s=0.12)
    assert events == [[Event.OVERRIDE_ASSUMED]]
    _, events, _ = after([(PRESSED,), (REST,), (REST,), (PRESSED,)], state)
    assert events == [[], [], [Event.OVERRIDE_RELEASED], [Event.OVERRIDE_PRESSED]]


def test_a_controller_that_was_never_heard_has_a_second() -> None:
    _, events, bits = after([()] * 50, age_s=math.inf)
    assert events == [[]] * 49 + [[Event.OVERRIDE_ASSUMED]]
    assert bits == Watch.CONTROLLER_SILENT


@pytest.mark.parametrize(
    ("bit", "event"), [(8, Event.STEERING_BUTTON), (16, Event.CRUISE_PLUS), (32, Event.CRUISE_MINUS)]
)
def test_buttons_that_engage_need_two_statuses_and_tell_one_press(bit: int, event: Event) -> None:
    down = REST | bit
    _, events, _ = after([(down,), (REST,), (down,), (down,), (down,), (REST,), (REST,), (down, down)], at_rest())
    assert events == [[], [], [], [event], [], [], [], [event]]


def test_a_button_held_since_the_start_has_not_been_pressed() -> None:
    assert after([(REST | 8,)] * 20)[1] == [[]] * 20


def test_a_button_of_which_the_release_bounces_is_pressed_once() -> None:
    down = REST | 16
    assert list(chain(*after([(down,), (down,), (REST,), (down,), (down,)], at_rest())[1])) == [Event.CRUISE_PLUS]


def test_the_emergency_stop_acts_at_once_and_held_at_the_start_too() -> None:
    down = REST | 4
    assert after([(down,)])[1] == [[Event.ESTOP_PRESSED]]
    assert after([(down,), (down,), (REST,), (REST,)], at_rest())[1] == [
        [Event.ESTOP_PRESSED],
        [],
        [],
        [Event.ESTOP_RELEASED],
    ]


@pytest.mark.parametrize("by_controller", [False, True])
def test_the_brake_is_tapped_held_and_let_go(by_controller: bool) -> None:
    buttons = (REST | 64,) if by_controller else (REST,)
    hands = FREE if by_controller else OperatorContact(0.0, True)
    state, events, _ = after([buttons] * 40, at_rest(), hands=hands)
    assert events[0] == [Event.BRAKE_TAPPED]
    assert events[24] == [Event.BRAKE_HELD]
    assert sum(len(found) for found in events) == 2
    state, events, _ = after([(REST,), (REST,)], state)
    assert events == [[], [Event.BRAKE_RELEASED]]
    assert after([(REST,)], state, hands=OperatorContact(0.0, True))[1] == [[Event.BRAKE_TAPPED]]


def test_torque_takes_the_vehicle_within_three_ticks() -> None:
    for torque_nm in (4.5, -9.0, math.inf):
        _, events, bits = after([(REST,)] * 6, at_rest(), hands=OperatorContact(torque_nm, False))
        assert events == [[], [], [Event.STEERING_TORQUE], [], [], []]
        assert bits == Watch(0)


def test_hands_that_stay_on_the_wheel_take_what_is_engaged_then() -> None:
    state, _, _ = after([(REST,)] * 6, at_rest(), hands=OperatorContact(5.0, False))
    assert after([(REST,)], state, hands=OperatorContact(3.0, False), engaged=True)[1] == [[Event.STEERING_TORQUE]]
    assert after([(REST,)], state, hands=OperatorContact(2.0, False), engaged=True)[1] == [[]]


def test_a_torque_that_is_no_number_takes_the_vehicle_and_is_found() -> None:
    _, events, bits = after([(REST,)] * 3, at_rest(), hands=OperatorContact(math.nan, False))
    assert events == [[], [], [Event.STEERING_TORQUE]]
    assert bits == Watch.TORQUE_UNREAD


def test_a_light_hand_takes_nothing() -> None:
    assert after([(REST,)] * 20, at_rest(), hands=OperatorContact(3.9, False))[1] == [[]] * 20


@settings(max_examples=30, deadline=None)
@given(st.lists(st.lists(st.integers(0, 65535), max_size=3), max_size=40))
def test_presses_and_releases_take_turns_and_a_press_is_never_missed(ticks: list[list[int]]) -> None:
    events = list(chain(*after([tuple(statuses) for statuses in ticks])[1]))
    override, assumed = Event.OVERRIDE_PRESSED, Event.OVERRIDE_ASSUMED
    for pressed, released in (
        ((override, assumed), Event.OVERRIDE_RELEASED),
        ((Event.ESTOP_PRESSED,), Event.ESTOP_RELEASED),
    ):
        edges = [event in pressed for event in events if event in (*pressed, released)]
        assert edges == [number % 2 == 0 for number in range(len(edges))]
    flat = list(chain(*ticks))
    assert (Event.ESTOP_PRESSED in events) == any(buttons & 4 for buttons in flat)
    if any(buttons & 3 == 1 for buttons in flat):
        assert override in events or assumed in events
