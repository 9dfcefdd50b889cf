"""A controller that falls silent, from its statuses to the bits of the command: it acknowledges nothing."""

import pytest

from lgprjax.autopilot import Event, Mode
from lgprjax.autopilot.operator_monitors import ButtonState, OperatorContact, step_buttons
from lgprjax.runtime.control.modes import CUT, PEDALS, STEERING, ModeKeeper

REST, PRESSED, ESTOP = 2, 1, 4
TO_READY = (
    Event.BOOT_DONE,
    Event.CHECKS_PASSED,
    Event.ROUTE_NEAR,
    Event.MOVING,
    Event.SOURCES_PRESENT,
    Event.HEALTH_GOOD,
)
TO_SPEED = (*TO_READY, Event.STEERING_BUTTON, Event.CRUISE_PLUS)


class Hand:
    """The operator's controller and the modes, a tick at a time."""

    def __init__(self, *events: Event, after_death: bool = False) -> None:
        self.keeper = ModeKeeper(after_death=after_death, speed_step_mps=0.5)
        self._state, self._time_s, self._silent_s = ButtonState(), 10.0, 0.0
        if not after_death:
            self.hear(REST, REST, REST)
        self.tell(*events)

    def tell(self, *events: Event) -> None:
        for event in events:
            self.keeper.tell(event, self._time_s, 2.0)

    def hear(self, *statuses: int) -> None:
        """A status each tick."""
        for status in statuses:
            self._silent_s = 0.0
            self._tick((status,), 0.01)

    def silence(self, seconds: float, *, never_heard: bool = False) -> None:
        for _ in range(round(seconds / 0.02)):
            self._silent_s += 0.02
            self._tick((), float("inf") if never_heard else self._silent_s)

    def _tick(self, statuses: tuple[int, ...], age_s: float) -> None:
        self._time_s += 0.02
        self._state, events, _ = step_buttons(
            self._state,
            statuses=statuses,
            controller_age_s=age_s,
            hands=OperatorContact(0.0, False),
            override_torque_nm=4.0,
            engaged=bool(self.keeper.engage & (STEERING | PEDALS)),
            step_s=0.02,
        )
        self.tell(*events)

    def lose(self, how: str) -> None:
        """The button cannot be read for a while, and then again."""
        if how == "silent":
            self.silence(0.14)
        else:
            self.hear(*[0] * 6)
        assert self.keeper.state.override_pressed
        self.hear(REST, REST, REST)
        assert not self.keeper.state.override_pressed


@pytest.mark.parametrize("how", ["silent", "contacts alike"])
def test_power_cut_for_a_fault_stays_cut(how: str) -> None:
    hand = Hand(*TO_SPEED, Event.ERROR_RAISED)
    hand.keeper.cut()
    hand.tell(Event.ERROR_CLEARED)
    hand.lose(how)
    assert (hand.keeper.mode, hand.keeper.engage, hand.keeper.lit) == (Mode.ERROR, CUT, True)
    hand.hear(PRESSED)
    assert (hand.keeper.mode, hand.keeper.engage, hand.keeper.lit) == (Mode.READY, 0, False)


@pytest.mark.parametrize("how", ["silent", "contacts alike"])
def test_a_released_emergency_stop_keeps_the_power_cut(how: str) -> None:
    hand = Hand(*TO_SPEED)
    hand.hear(REST | ESTOP, REST | ESTOP, REST, REST)
    assert not hand.keeper.state.estop_pressed
    hand.keeper.checks_requested = False
    hand.lose(how)
    assert (hand.keeper.mode, hand.keeper.engage) == (Mode.EMERGENCY_STOP, CUT)
    assert not hand.keeper.checks_requested
    hand.hear(PRESSED)
    assert (hand.keeper.mode, hand.keeper.engage) == (Mode.MANUAL, 0)
    assert hand.keeper.checks_requested


def test_a_relaunched_control_stays_in_error_until_a_press() -> None:
    hand = Hand(Event.BOOT_DONE, Event.CONTROL_RELAUNCHED, after_death=True)
    hand.silence(1.2, never_heard=True)
    assert hand.keeper.state.override_pressed
    hand.hear(REST, REST)
    modes = [hand.keeper.mode]
    hand.hear(PRESSED)
    assert [*modes, hand.keeper.mode] == [Mode.ERROR, Mode.CHECKS]


@pytest.mark.parametrize("events", [TO_SPEED[:-1], TO_SPEED])
def test_a_silent_controller_takes_the_vehicle_at_once(events: tuple[Event, ...]) -> None:
    hand = Hand(*events)
    assert hand.keeper.engage & STEERING
    hand.silence(0.1)
    assert hand.keeper.engage & STEERING
    hand.silence(0.02)
    assert (hand.keeper.mode, hand.keeper.engage) == (Mode.MANUAL, 0)
    hand.hear(REST, REST)
    assert (hand.keeper.mode, hand.keeper.engage) == (Mode.MANUAL, 0)
