"""The mode machine as tables, found by trying every event in every state that can be reached.

The whole state space is too large for that, most of it for reasons that do not meet: three processes that are watched
alike, ten reasons to refuse. It is gone through in views, each with the events that bear on one another; the other
inputs stand as they do on a vehicle that is ready to drive. Time passes with ``TICK`` only, by so much that a held
button counts as stuck and that failures are forgotten.
"""

from collections import defaultdict
from collections.abc import Iterator
from functools import cache
from pathlib import Path

from lgprjax.autopilot.modes import (
    CLEARS,
    FAILURES_WITHIN_S,
    FATAL,
    MOTIONS,
    PLACES,
    WATCHED,
    Action,
    EngagementInhibit,
    Event,
    Mode,
    ModeEvent,
    ModeState,
    step_modes,
)

PAGE = Path(__file__).parents[1] / "docs" / "modes_table.md"
_LONG_S = 2.0 * FAILURES_WITHIN_S
_START = (Event.ROUTE_NEAR, Event.MOVING, Event.SOURCES_PRESENT, Event.HEALTH_GOOD)
_HANDS = (
    Event.BOOT_DONE,
    Event.CHECKS_PASSED,
    Event.STEERING_BUTTON,
    Event.CRUISE_PLUS,
    Event.OVERRIDE_PRESSED,
    Event.OVERRIDE_RELEASED,
    Event.OVERRIDE_ASSUMED,
    Event.TICK,
)
_VIEWS: tuple[tuple[Event, ...], ...] = (
    (
        *_HANDS,
        Event.CRUISE_MINUS,
        Event.CHECKS_FAILED,
        Event.STEERING_TORQUE,
        Event.BRAKE_TAPPED,
        Event.BRAKE_HELD,
        Event.BRAKE_RELEASED,
        Event.ESTOP_PRESSED,
        Event.ESTOP_RELEASED,
        Event.ERROR_RAISED,
        Event.ERROR_CLEARED,
    ),
    (
        *_HANDS,
        Event.ESTOP_PRESSED,
        Event.ESTOP_RELEASED,
        Event.HEALTH_STOP,
        Event.HEALTH_GOOD,
        Event.SOURCE_MISSING,
        Event.SOURCES_PRESENT,
        *PLACES,
        *MOTIONS,
    ),
    *(
        (*_HANDS, Event.ESTOP_PRESSED, Event.ESTOP_RELEASED, died, process.relaunched)
        for died, process in (*FATAL.items(), *WATCHED.items())
    ),
    (*_HANDS, Event.REGISTRATION_DIED, Event.REGISTRATION_RELAUNCHED),
)

Transition = tuple[ModeState, Event, ModeState, tuple[Action, ...]]


@cache
def every_transition() -> tuple[Transition, ...]:
    """Every state that can be reached, with every event of its view: before, event, after, actions."""
    return tuple(_transitions())


def _transitions() -> Iterator[Transition]:
    for view in _VIEWS:
        start = ModeState()
        for event in _START:
            start, _ = step_modes(start, ModeEvent(event, 0.0))
        known, waiting = {start}, [start]
        while waiting:
            state = waiting.pop()
            for event in view:
                passed_s = _LONG_S if event is Event.TICK else 0.0
                after, actions = step_modes(state, ModeEvent(event, passed_s))
                after = _at_zero(after)
                yield state, event, after, actions
                if after not in known:
                    known.add(after)
                    waiting.append(after)


def mode_changes() -> dict[tuple[Mode, Event], frozenset[Mode]]:
    """Modes that an event can lead to from a mode."""
    found: dict[tuple[Mode, Event], set[Mode]] = defaultdict(set)
    for before, event, after, _ in every_transition():
        found[before.mode, event].add(after.mode)
    return {key: frozenset(modes) for key, modes in found.items()}


def describe_modes() -> str:
    """Markdown: a table of modes and events, and a table of the changes of mode."""
    changes = mode_changes()
    arrows: dict[tuple[Mode, Mode], list[Event]] = defaultdict(list)
    for (before, event), modes in changes.items():
        for after in modes - {before}:
            arrows[before, after].append(event)
    lines = [
        "# Mode transition table",
        "",
        "This page lists every transition of the [mode machine](modes.md). `PYTHONPATH=tests python -m mode_diagram`",
        "generates it: the script tries every event in every reachable state of `step_modes`. A test compares the page",
        "with the function.",
        "",
        "Rows are events, columns are modes before the event, and cells list the modes after it. · means no change of",
        "mode. If a cell lists several modes, the result depends on other inputs: engaging, for example, needs every",
        "condition of `inhibit_of`.",
        "",
    ]
    lines += ["| event | " + " | ".join(mode.name for mode in Mode) + " |", "| --- " * (len(Mode) + 1) + "|"]
    for event in Event:
        cells = [_cell(mode, changes.get((mode, event), frozenset({mode}))) for mode in Mode]
        lines.append(f"| {_word(event)} | " + " | ".join(cells) + " |")
    lines += ["", "## Faults that hold ERROR", "", "| fault | cleared by |", "| --- | --- |"]
    lines += [f"| `{fault.name}` | {_word(event)} |" for event, fault in CLEARS.items()]
    lines += ["", "## Changes of mode", "", "| from | to | events | events that may lead there |", "| --- " * 4 + "|"]
    for (before, after), events in sorted(arrows.items()):
        words: dict[bool, list[str]] = {True: [], False: []}
        for event in sorted(events, key=lambda event: event.value):
            words[len(changes[before, event]) == 1].append(_word(event))
        always, sometimes = (", ".join(of) for of in words.values())
        lines.append(f"| {before.name} | {after.name} | {always} | {sometimes} |")
    return "\n".join([*lines, ""])


def _at_zero(state: ModeState) -> ModeState:
    """The same state with its times counted from now and without what no event asks about: equal states are one."""
    now_s = state.time_s
    pressed_s = max(state.override_since_s - now_s, -_LONG_S) if state.override_pressed else 0.0
    recent = tuple((event, at_s - now_s) for event, at_s in state.failures if now_s - at_s < FAILURES_WITHIN_S)
    return state._replace(time_s=0.0, override_since_s=pressed_s, failures=recent, inhibit=EngagementInhibit.NONE)


def _word(event: Event) -> str:
    return event.name.lower().replace("_", " ")


def _cell(mode: Mode, modes: frozenset[Mode]) -> str:
    return ", ".join("·" if after is mode else after.name for after in sorted(modes))


if __name__ == "__main__":
    PAGE.write_text(describe_modes(), encoding="utf-8")
