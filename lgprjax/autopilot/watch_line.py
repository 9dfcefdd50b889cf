"""The drive-by-wire box and its line, by what its status says. Faults 23, 24 and 41.

Its bits are those of ``drive_status`` in data_schema/wire.toml.
"""

from enum import IntFlag
from typing import NamedTuple

from lgprjax.autopilot.watch_dwell import Dwell, counted_step_s, step_dwell
from lgprjax.autopilot.watch_findings import Watch, as_watch

SILENT_S = 0.1
"""Ten statuses of the box, and half of the time after which the box lets go by itself."""
HELD_S = 0.1
"""After it was told to engage, the box must say that it holds."""
FAULT_S = 0.2
"""An actuator's fault must last longer than a sag of the supply, which a vehicle rides through."""


class BoxState(IntFlag):
    """Bits of ``drive_status.state``."""

    DEFAULTS = 1
    BAD_FRAMES = 2
    SECOND_SENDER = 4
    SERVO_FAULT = 8
    THROTTLE_FAULT = 16
    BRAKE_FAULT = 32
    BUS_OFF = 64
    BRAKE_TESTED = 128
    NO_POWER = 256


_BITS = (
    (int(BoxState.BAD_FRAMES), int(Watch.BAD_FRAMES)),
    (int(BoxState.SECOND_SENDER), int(Watch.SECOND_SENDER)),
    (int(BoxState.BUS_OFF), int(Watch.BUS_OFF)),
)
_FAULTS = int(BoxState.SERVO_FAULT | BoxState.THROTTLE_FAULT | BoxState.BRAKE_FAULT | BoxState.NO_POWER)


class LineWatchState(NamedTuple):
    """What is carried from tick to tick: for how long the box has not held what it was told to, and told of a fault."""

    let_go: Dwell = Dwell()
    fault: Dwell = Dwell()


def step_line_watch(
    state: LineWatchState, *, status_age_s: float, box_state: int, box_engaged: int, told_engaged: int, step_s: float
) -> tuple[LineWatchState, Watch]:
    """State and findings of a tick.

    Args:
        state: of the last tick.
        status_age_s: since the newest status that was accepted came; none yet: infinite.
        box_state, box_engaged: ``state`` and ``engaged`` of that status.
        told_engaged: steering and pedals bits of ``engage`` as sent in the last tick.
        step_s: since the last tick.
    """
    step_s = counted_step_s(step_s)
    lets_go = told_engaged != 0 and (box_state & BoxState.DEFAULTS != 0 or told_engaged & ~box_engaged != 0)
    let_go = step_dwell(state.let_go, lets_go, step_s, on_s=HELD_S)
    fault = step_dwell(state.fault, box_state & _FAULTS != 0, step_s, on_s=FAULT_S, off_s=0.0)
    bits = (
        fault.on * Watch.ACTUATOR_FAULT
        | let_go.on * Watch.DEFAULTS_ACT
        | (not 0.0 <= status_age_s <= SILENT_S) * Watch.LINE_SILENT
    )
    for box_bits, bit in _BITS:
        if box_state & box_bits:
            bits |= bit
    if not box_state & BoxState.BRAKE_TESTED:
        bits |= Watch.BRAKE_UNTESTED
    return LineWatchState(let_go, fault), as_watch(bits)
