"""Every watch of a skid-steer vehicle at work: line, tool, tracks, remote control and buttons, each tick."""

import math
from typing import NamedTuple

from lgprjax.autopilot import Event
from lgprjax.autopilot.watch_buttons import ButtonState, Hands, step_buttons
from lgprjax.autopilot.watch_findings import Severity, Watch, severity_of
from lgprjax.autopilot.watch_line import LineWatchState, step_line_watch
from lgprjax.autopilot.watch_motion import MotionState, step_motion
from lgprjax.runtime.config import ControlTable
from lgprjax.runtime.control.skid.findings import Found, severity_of_found
from lgprjax.runtime.control.skid.senses import SkidSensed
from lgprjax.runtime.control.skid.watch_tool import ToolBelief, ToolReading, ToolWatchState, step_tool_watch
from lgprjax.runtime.control.skid.watch_tracks import TrackWatchState, step_track_watch
from lgprjax.runtime.control.vehicle_kind import Operator

DRIVE = 1
"""Bit of ``engage`` in a skid_command; 4 cuts the power as in a drive_command."""
MARK_CORNER = 128
"""Bit of ``controller_status.buttons`` beside those that all vehicles have."""
REMOTE_SILENT_S = 0.98
"""Fault 35: found within a second, by the tick."""
_OFF_LINE_M = 0.5


class SkidSent(NamedTuple):
    """The command of the last tick, in the order of a skid_command."""

    left_mps: float
    right_mps: float
    tool: int
    depth_m: float
    engage: int


class SkidWatched(NamedTuple):
    """What the watches say of a tick.

    Attributes:
        bits, found: findings that all vehicles share, and those of this kind; severity: the largest of both.
        events: of buttons and motion, in their order.
        corner: the button that marks a corner was pressed.
        reading: of the tool; ``None`` before the box was heard.
    """

    bits: Watch
    found: Found
    severity: Severity
    events: list[Event]
    corner: bool
    reading: ToolReading | None


class SkidWatches:
    """The watches' states.

    Args:
        control: of the configuration.
        tool: what is asked of the tool.
    """

    def __init__(self, control: ControlTable, tool: ToolBelief) -> None:
        self._control, self._belief = control, tool
        self._line, self._motion, self._buttons = LineWatchState(), MotionState(), ButtonState()
        self._tool, self._tracks = ToolWatchState(), TrackWatchState()
        self._corner_down, self._last = True, 0
        self._held = Found(0)

    def step(self, sensed: SkidSensed, sent: SkidSent, operator: Operator, *, cross_m: float) -> SkidWatched:
        """A tick.

        Args:
            sensed: of the tick.
            sent: command of the last one.
            operator: since the last one.
            cross_m: off the line, of the last tick.
        """
        box, step_s = sensed.box, sensed.step_s
        drives = bool(sent.engage & DRIVE)
        state, engaged = (0, 0) if box is None else (box.bits("state"), box.bits("engaged"))
        self._line, bits = step_line_watch(
            self._line,
            status_age_s=sensed.box_age_s,
            box_state=state,
            box_engaged=engaged,
            told_engaged=sent.engage & DRIVE,
            step_s=step_s,
        )
        # Its drives stand by themselves: there is no brake to be tested.
        bits &= ~Watch.BRAKE_UNTESTED
        speed = 0.5 * (sensed.left_mps + sensed.right_mps)
        reading = None if box is None else ToolReading(bool(box.bits("tool") & 1), box.number("depth_m"))
        self._tool, found = step_tool_watch(
            self._belief, self._tool, reading, told_on=drives and bool(sent.tool), speed_mps=speed, step_s=step_s
        )
        self._tracks, more = step_track_watch(
            self._tracks,
            told_mps=(sent.left_mps, sent.right_mps),
            measured_mps=(sensed.left_mps, sensed.right_mps),
            drives=drives and bool(engaged & DRIVE),
            step_s=step_s,
        )
        found |= more
        if drives and sent.tool and abs(cross_m) > _OFF_LINE_M:
            found |= Found.OFF_LINE
        # Stopping takes the cause of most of them away: what stopped it is said until it is let go.
        found = self._held = (self._held | found) if drives else Found(0)
        if REMOTE_SILENT_S < operator.age_s < math.inf:
            found |= Found.REMOTE_SILENT
        self._buttons, pressed, seen = step_buttons(
            self._buttons,
            statuses=operator.statuses,
            # A line that falls silent is the remote link's fault: stopped in order, not taken for the override.
            controller_age_s=0.0 if math.isfinite(operator.age_s) else math.inf,
            hands=Hands(0.0, False),
            override_torque_nm=self._control.override_torque_nm,
            engaged=drives,
            step_s=step_s,
        )
        bits |= seen
        self._motion, moved = step_motion(
            self._motion, speed_mps=speed, fastest_engage_mps=self._control.fastest_engage_mps, step_s=step_s
        )
        severity = max(severity_of(bits), severity_of_found(found))
        return SkidWatched(bits, found, severity, [*pressed, *moved], self._corner(operator), reading)

    def _corner(self, operator: Operator) -> bool:
        """Pressed: two statuses in a row, as every button that does something; once a press."""
        pressed = False
        for buttons in operator.statuses:
            if buttons & self._last & MARK_CORNER:
                pressed |= not self._corner_down
                self._corner_down = True
            elif not (buttons | self._last) & MARK_CORNER:
                self._corner_down = False
            self._last = buttons
        return pressed
