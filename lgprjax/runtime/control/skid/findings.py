"""What the watches of a skid-steer vehicle find beside what all vehicles share: bits, severities, words, stops."""

from enum import IntFlag

from lgprjax.autopilot.watch_findings import Severity, Watch
from lgprjax.runtime.records import StopBits


class Found(IntFlag):
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


SEVERITY = {
    Found.REMOTE_SILENT: Severity.STOP,
    Found.EDGE: Severity.STOP,
    Found.TOOL_OFF: Severity.STOP,
    Found.TOOL_DEPTH: Severity.STOP,
    Found.LEFT_DEAD: Severity.STOP,
    Found.RIGHT_DEAD: Severity.STOP,
    Found.HEADING_UNKNOWN: Severity.STOP,
    # What the estimate asks for comes as navigation's reaction.
    Found.UNCERTAIN: Severity.CONTINUE,
    Found.OFF_LINE: Severity.STOP,
}
"""What each finding asks for while the computer drives."""

TEXT = {
    Found.REMOTE_SILENT: "remote control is silent: stopping",
    Found.EDGE: "the edge would be crossed: stopping before it",
    Found.TOOL_OFF: "tool does not turn: stopping, cells are not counted",
    Found.TOOL_DEPTH: "tool at a wrong depth: stopping, cells are not counted",
    Found.LEFT_DEAD: "left track or its sensor is dead",
    Found.RIGHT_DEAD: "right track or its sensor is dead",
    Found.HEADING_UNKNOWN: "heading not known: drive straight by remote control",
    Found.UNCERTAIN: "position too uncertain: no GNSS for too long?",
    Found.OFF_LINE: "off the line with the tool on: stopping",
}
"""Each finding in plain words."""

REFUSING = Found.REMOTE_SILENT | Found.LEFT_DEAD | Found.RIGHT_DEAD | Found.HEADING_UNKNOWN
"""Findings with which nothing may be engaged; the others arise while it drives."""

_STOPS = {
    Found.REMOTE_SILENT: StopBits.OPERATOR,
    Found.EDGE: StopBits.EDGE,
    Found.TOOL_OFF: StopBits.TOOL,
    Found.TOOL_DEPTH: StopBits.TOOL,
    Found.LEFT_DEAD: StopBits.WHEELS,
    Found.RIGHT_DEAD: StopBits.WHEELS,
    Found.HEADING_UNKNOWN: StopBits.HEADING,
    Found.UNCERTAIN: StopBits.POSITION,
    Found.OFF_LINE: StopBits.OFF_LINE,
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


def severity_of_found(found: Found) -> Severity:
    """The largest that findings ask for; CONTINUE for none."""
    return max((SEVERITY[bit] for bit in found), default=Severity.CONTINUE)


def describe_found(found: Found) -> list[str]:
    """Findings in plain words, the weightiest first."""
    return [TEXT[bit] for bit in sorted(found, key=lambda bit: (-SEVERITY[bit], bit))]


def stops_of(found: Found, watch: Watch) -> StopBits:
    """Findings as ``COVER`` tells them."""
    stops = StopBits(0)
    for bit in found:
        stops |= _STOPS.get(bit, StopBits(0))
    if watch & _BOX:
        stops |= StopBits.BOX
    return stops | StopBits.OPERATOR if watch & _OPERATOR else stops
