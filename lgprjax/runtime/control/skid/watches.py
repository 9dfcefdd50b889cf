"""All watches of a skid-steer vehicle, run in each tick: line, tool, tracks, remote control and buttons."""

import math
from enum import IntFlag
from typing import NamedTuple

from lgprjax.autopilot import Event
from lgprjax.autopilot.monitors import (
    FINDINGS,
    SILENT_S,
    Dwell,
    Finding,
    Severity,
    Watch,
    counted_step_s,
    severity_of,
    step_dwell,
)
from lgprjax.autopilot.operator_monitors import OperatorContact
from lgprjax.run_records import StopBits
from lgprjax.runtime.config import ControlTable
from lgprjax.runtime.control.skid.senses import SkidSensed
from lgprjax.runtime.control.vehicle_kind import Operator
from lgprjax.runtime.control.watches import SharedWatches

# Findings specific to a skid-steer vehicle: bits, severities, words, stops.


class SkidFound(IntFlag):
    """One bit a finding, as in ``skid_plan.found`` of ``data_schema/run_log.toml``."""

    REMOTE_SILENT = 1
    EDGE = 2
    TOOL_OFF = 4
    TOOL_DEPTH = 8
    LEFT_DEAD = 16
    RIGHT_DEAD = 32
    HEADING_UNKNOWN = 64
    UNCERTAIN = 128
    OFF_LINE = 256


SKID_FINDINGS = {
    SkidFound.REMOTE_SILENT: Finding(Severity.STOP, "remote control is silent: stopping", refuses=True),
    SkidFound.EDGE: Finding(Severity.STOP, "the fence would be crossed: stopping before it", refuses=False),
    SkidFound.TOOL_OFF: Finding(Severity.STOP, "tool does not turn: stopping, cells are not counted", refuses=False),
    SkidFound.TOOL_DEPTH: Finding(
        Severity.STOP, "tool at a wrong depth: stopping, cells are not counted", refuses=False
    ),
    SkidFound.LEFT_DEAD: Finding(Severity.STOP, "left track or its sensor has failed", refuses=True),
    SkidFound.RIGHT_DEAD: Finding(Severity.STOP, "right track or its sensor has failed", refuses=True),
    SkidFound.HEADING_UNKNOWN: Finding(
        Severity.STOP, "heading not known: drive straight by remote control", refuses=True
    ),
    # Requests of the estimate come as navigation's reaction.
    SkidFound.UNCERTAIN: Finding(Severity.CONTINUE, "position too uncertain: no GNSS for too long?", refuses=False),
    SkidFound.OFF_LINE: Finding(Severity.STOP, "off the working line: stopping", refuses=False),
}
"""Of a skid-steer vehicle alone; those that do not refuse arise while it drives."""


_STOPS = {
    SkidFound.REMOTE_SILENT: StopBits.OPERATOR,
    SkidFound.EDGE: StopBits.EDGE,
    SkidFound.TOOL_OFF: StopBits.TOOL,
    SkidFound.TOOL_DEPTH: StopBits.TOOL,
    SkidFound.LEFT_DEAD: StopBits.WHEELS,
    SkidFound.RIGHT_DEAD: StopBits.WHEELS,
    SkidFound.HEADING_UNKNOWN: StopBits.HEADING,
    SkidFound.UNCERTAIN: StopBits.POSITION,
    SkidFound.OFF_LINE: StopBits.OFF_LINE,
}
_BOX = (
    Watch.LINE_SILENT
    | Watch.BAD_FRAMES
    | Watch.DEFAULTS_ACT
    | Watch.BUS_OFF
    | Watch.SECOND_SENDER
    | Watch.ACTUATOR_FAULT
)
_OPERATOR = Watch.OVERRIDE_CONTACTS | Watch.CONTROLLER_SILENT


def stops_of(found: SkidFound, watch: Watch) -> StopBits:
    """Findings as stop bits of ``COVER``."""
    stops = StopBits(0)
    for bit in found:
        stops |= _STOPS.get(bit, StopBits(0))
    if watch & _BOX:
        stops |= StopBits.BOX
    return stops | StopBits.OPERATOR if watch & _OPERATOR else stops


# The tool compared with its command: off, or at a wrong depth, while the vehicle moves. Fault 37.

RISES_S = 1.5
"""Time from switching a tool on until it turns at its depth; nothing counts as worked meanwhile."""
WRONG_S = 0.1
_MOVES_MPS = 0.02


class ToolReading(NamedTuple):
    """Newest fresh status of the box: whether the tool turns, and its depth."""

    turns: bool
    depth_m: float


class ToolBelief(NamedTuple):
    """Commanded depth of the tool, and its tolerance."""

    depth_m: float
    tolerance_m: float


class ToolWatchState(NamedTuple):
    """State carried from tick to tick: time since the tool was switched on, and pending findings."""

    commanded_s: float = 0.0
    off: Dwell = Dwell()
    depth: Dwell = Dwell()


def depth_right(belief: ToolBelief, depth_m: float) -> bool:
    """Whether a depth is the commanded one; NaN is not."""
    return abs(depth_m - belief.depth_m) <= belief.tolerance_m


def step_tool_watch(
    belief: ToolBelief,
    state: ToolWatchState,
    reading: ToolReading | None,
    *,
    commanded_on: bool,
    speed_mps: float,
    step_s: float,
) -> tuple[ToolWatchState, SkidFound]:
    """State and findings of a tick.

    Args:
        belief: commanded state of the tool.
        state: state of the last tick.
        reading: reading of the tool; ``None`` before the box has reported, and while it is silent.
        commanded_on: whether the last command turned the tool on.
        speed_mps: speed of the vehicle; NaN counts as moving.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    commanded_s = state.commanded_s + step_s if commanded_on else 0.0
    # Once it has been right the start-up time is over.
    risen = reading is not None and reading.turns and depth_right(belief, reading.depth_m)
    commanded_s = max(commanded_s, RISES_S) if commanded_on and risen else commanded_s
    matters = commanded_on and commanded_s >= RISES_S and not abs(speed_mps) <= _MOVES_MPS
    off = step_dwell(
        state.off, matters and not (reading is not None and reading.turns), step_s, on_s=WRONG_S, off_s=0.0
    )
    deep = reading is not None and math.isfinite(reading.depth_m) and depth_right(belief, reading.depth_m)
    depth = step_dwell(state.depth, matters and not deep, step_s, on_s=WRONG_S, off_s=0.0)
    found = (SkidFound.TOOL_OFF if off.on else SkidFound(0)) | (SkidFound.TOOL_DEPTH if depth.on else SkidFound(0))
    return ToolWatchState(commanded_s, off, depth), found


# Tracks compared with their command: one that does not move, or whose sensor does not. Fault 14.

DEAD_S = 0.5
_ASKED_MPS = 0.08
_SHARE = 0.25


class TrackWatchState(NamedTuple):
    """State carried from tick to tick: pending findings, left and right."""

    left: Dwell = Dwell()
    right: Dwell = Dwell()


def step_track_watch(
    state: TrackWatchState,
    *,
    commanded_mps: tuple[float, float],
    measured_mps: tuple[float, float],
    drives: bool,
    step_s: float,
) -> tuple[TrackWatchState, SkidFound]:
    """State and findings of a tick.

    Args:
        state: state of the last tick.
        commanded_mps: left and right speed of the last command.
        measured_mps: left and right measured speed; NaN counts as standstill.
        drives: whether the box was commanded to drive, and does.
        step_s: time since the last tick.
    """
    step_s = counted_step_s(step_s)
    dwells: list[Dwell] = []
    for dwell, commanded, measured in zip(state, commanded_mps, measured_mps, strict=True):
        moves = math.isfinite(measured) and measured * math.copysign(1.0, commanded) >= _SHARE * abs(commanded)
        dead = drives and abs(commanded) >= _ASKED_MPS and not moves
        dwells.append(step_dwell(dwell, dead, step_s, on_s=DEAD_S, off_s=0.0))
    found = (SkidFound.LEFT_DEAD if dwells[0].on else SkidFound(0)) | (
        SkidFound.RIGHT_DEAD if dwells[1].on else SkidFound(0)
    )
    return TrackWatchState(*dwells), found


DRIVE = 1
"""Bit of ``engage`` in a skid_command; 4 cuts the power as in a drive_command."""
MARK_CORNER = 128
"""Bit of ``controller_status.buttons`` in addition to those of all vehicles."""
REMOTE_SILENT_S = 0.98
"""Fault 35: found within a second."""


class SkidSent(NamedTuple):
    """The command of the last tick, in the order of a skid_command."""

    left_mps: float
    right_mps: float
    tool: int
    depth_m: float
    engage: int


class SkidWatched(NamedTuple):
    """Results of the watches in a tick.

    Attributes:
        bits, found: findings common to all vehicles, and those of this kind.
        severity: largest severity of all findings.
        events: events of buttons and motion, in their order.
        corner: whether the button that marks a corner was pressed.
        reading: reading of the tool; ``None`` before the box was received, and while it is silent.
    """

    bits: Watch
    found: SkidFound
    severity: Severity
    events: list[Event]
    corner: bool
    reading: ToolReading | None


class SkidWatches:
    """The watches' states.

    Args:
        control: control table of the configuration.
        tool: commanded state of the tool.
    """

    def __init__(self, control: ControlTable, tool: ToolBelief) -> None:
        # Its drives hold at standstill, so there is no brake to test.
        self._shared, self._belief = SharedWatches(control, DRIVE, tests_brake=False), tool
        self._tool, self._tracks = ToolWatchState(), TrackWatchState()
        self._corner_down, self._last = True, 0
        self._held = SkidFound(0)

    def step(self, sensed: SkidSensed, sent: SkidSent, operator: Operator, *, off_line: bool) -> SkidWatched:
        """Run a tick.

        Args:
            sensed: sensor data of the tick.
            sent: command of the last tick.
            operator: operator inputs since the last tick.
            off_line: whether the plan wanted the tool in the last tick, too far from its line.
        """
        box, step_s = sensed.box, sensed.step_s
        drives = bool(sent.engage & DRIVE)
        state, engaged = (0, 0) if box is None else (box.bits("state"), box.bits("engaged"))
        speed = 0.5 * (sensed.left_mps + sensed.right_mps)
        # The last status of a silent box is not a present measurement: it would count ground as worked for ever.
        heard = box is not None and 0.0 <= sensed.box_age_s <= SILENT_S
        reading = ToolReading(bool(box.bits("tool") & 1), box.number("depth_m")) if box is not None and heard else None
        self._tool, found = step_tool_watch(
            self._belief, self._tool, reading, commanded_on=drives and bool(sent.tool), speed_mps=speed, step_s=step_s
        )
        self._tracks, more = step_track_watch(
            self._tracks,
            commanded_mps=(sent.left_mps, sent.right_mps),
            measured_mps=(sensed.left_mps, sensed.right_mps),
            drives=drives and bool(engaged & DRIVE),
            step_s=step_s,
        )
        found |= more
        if drives and off_line:
            found |= SkidFound.OFF_LINE
        # Stopping removes the cause of most of them: the reason of the stop is reported until release.
        found = self._held = (self._held | found) if drives else SkidFound(0)
        if REMOTE_SILENT_S < operator.age_s < math.inf:
            found |= SkidFound.REMOTE_SILENT
        bits, events = self._shared.step(
            status_age_s=sensed.box_age_s,
            box=(state, engaged),
            engage=sent.engage,
            statuses=operator.statuses,
            # A silent line is a fault of the remote link: a controlled stop, not an override.
            controller_age_s=0.0 if math.isfinite(operator.age_s) else math.inf,
            hands=OperatorContact(0.0, False),
            speed_mps=speed,
            step_s=step_s,
        )
        severity = max(severity_of(bits, FINDINGS), severity_of(found, SKID_FINDINGS))
        return SkidWatched(bits, found, severity, events, self._corner(operator), reading)

    def _corner(self, operator: Operator) -> bool:
        """Pressed: two statuses in a row, like every active button; once per press."""
        pressed = False
        for buttons in operator.statuses:
            if buttons & self._last & MARK_CORNER:
                pressed |= not self._corner_down
                self._corner_down = True
            elif not (buttons | self._last) & MARK_CORNER:
                self._corner_down = False
            self._last = buttons
        return pressed
