"""The page on modes is the one that the function gives, and tells what is known of the modes."""

from lgprjax.autopilot import Event, Mode
from mode_diagram import PAGE, describe_modes, every_transition, mode_changes


def test_the_page_is_the_function_s() -> None:
    assert PAGE.read_text(encoding="utf-8") == describe_modes()


def test_every_event_and_every_mode_is_in_it() -> None:
    tried = {(state.mode, event) for state, event, _, _ in every_transition()}
    assert {event for _, event in tried} == set(Event)
    assert {mode for mode, _ in tried} == set(Mode)
    page = describe_modes()
    assert all(f"| {event.name.lower().replace('_', ' ')} |" in page for event in Event)


def test_it_tells_the_main_road() -> None:
    changes = mode_changes()
    assert changes[Mode.BOOT, Event.BOOT_DONE] == {Mode.CHECKS}
    assert changes[Mode.CHECKS, Event.CHECKS_PASSED] == {Mode.READY}
    assert changes[Mode.READY, Event.STEERING_BUTTON] == {Mode.READY, Mode.STEERING}
    assert changes[Mode.STEERING, Event.CRUISE_PLUS] == {Mode.STEERING, Mode.SPEED}
    assert changes[Mode.SPEED, Event.BRAKE_TAPPED] == {Mode.STEERING}
    assert changes[Mode.SPEED, Event.OVERRIDE_PRESSED] == {Mode.MANUAL}
