"""Texts of the runtime: refusals, faults, reasons of navigation's health, causes of changes of mode."""

import math
from collections.abc import Sequence
from enum import IntFlag

from lgprjax.autopilot import EngagementInhibit, Event, Fault, Limited, SkidLimited
from lgprjax.autopilot.monitors import FINDINGS, Severity, Watch
from lgprjax.navigation import STOPPING, Reason

REFUSALS = {
    EngagementInhibit.NONE: "",
    EngagementInhibit.ESTOP: "emergency stop is pressed: release it, then press override",
    EngagementInhibit.CHECKS: "system checks have not passed",
    EngagementInhibit.OVERRIDE_STUCK: "override button is stuck or cannot be read",
    EngagementInhibit.OVERRIDE_PRESSED: "override button is pressed",
    EngagementInhibit.NOT_READY: "not ready: press and release override",
    EngagementInhibit.NOT_STEERING: "engage steering first",
    EngagementInhibit.NO_SPEED_CONTROL: "this kit only steers: you control throttle and brake",
    EngagementInhibit.STOPPING: "a controlled stop is under way",
    EngagementInhibit.BRAKE_PRESSED: "brake is pressed",
    EngagementInhibit.SOURCE_MISSING: "a sensor or the heading is missing",
    EngagementInhibit.TOO_FAST: "too fast to engage",
    EngagementInhibit.HEALTH: "navigation is not good enough",
    EngagementInhibit.NO_PATH: "no route, or no position yet",
    EngagementInhibit.OFF_ROUTE: "more than 10 m from the route",
    EngagementInhibit.WRONG_HEADING: "heading does not fit the route, or is not confirmed yet",
    EngagementInhibit.AMBIGUOUS: "the route passes here more than once",
}

FAULTS = {
    Fault.RAISED: "a fault of the vehicle or computer persists",
    Fault.CHECKS: "a system check has failed",
    Fault.CONTROL: "the control process has died",
    Fault.DRIVE_BY_WIRE: "the drive-by-wire box or its connection has failed",
    Fault.RECORDER: "the recorder has failed three times",
    Fault.DISPLAY: "the display has failed three times",
    Fault.MONITOR: "the monitor has failed three times",
}
"""Faults that hold ERROR, in plain words."""

REASONS = {
    Reason.NON_FINITE: "navigation: estimate not finite",
    Reason.BAD_STEP: "the computer's clock stopped or jumped",
    Reason.GNSS_SILENT: "GNSS is silent",
    Reason.GNSS_STUCK: "GNSS repeats one position while the vehicle moves",
    Reason.GNSS_COARSE: "GNSS states a large error: no fixed solution",
    Reason.GNSS_REJECTED: "GNSS positions do not fit the drive",
    Reason.HEADING_SILENT: "no heading from the INS",
    Reason.HEADING_REJECTED: "headings do not fit the drive",
    Reason.ODOMETER_SILENT: "odometer is silent",
    Reason.ODOMETER_REJECTED: "odometer does not fit the drive: wheels slip?",
    Reason.LGPR_SILENT: "no LGPR fix for 1.5 s",
    Reason.LGPR_REJECTED: "LGPR fixes do not fit the drive",
    Reason.LGPR_FADED: "most scans match the map no better than chance: wet, frozen or changed ground",
    Reason.CONFLICT: "GNSS and LGPR give different places",
    Reason.REACQUIRED: "navigation accepts a rejected source again",
    Reason.FRAME_BEHIND: "the path still moves to a better estimate",
    Reason.UNCERTAIN: "position uncertain across the route",
    Reason.POSITION_LOST: "position lost: neither GNSS nor LGPR",
    Reason.HEADING_LOST: "heading lost: neither INS nor LGPR",
    Reason.SPEED_LOST: "speed unknown",
    Reason.CONFLICT_LASTS: "GNSS and LGPR have given different places for 10 s",
    Reason.FRAME_FAR: "the path is more than 1 m from a better estimate",
    Reason.TOO_UNCERTAIN: "position too uncertain across the route",
    Reason.GNSS_INCONSISTENT: "GNSS positions scatter more than the receiver states",
}
"""Text of each reason of navigation's health."""


def reason_words(reasons: float) -> list[str]:
    """Reasons of navigation's health in plain words; those that stop come first."""
    found = sorted(Reason(whole(reasons)), key=lambda reason: (not reason & STOPPING, reason))
    return [REASONS[reason] for reason in found]


_COMMAND = "command: "


def limited_words(limited: Limited | SkidLimited) -> list[str]:
    """Texts of the limiter's reasons for withholding an unsound command."""
    kind = type(limited)
    bad = limited & (kind.NOT_FINITE | kind.STALE | kind.MANUAL_REQUESTED)
    return [f"{_COMMAND}{_words(bit)}" for bit in bad]


def _words(bit: IntFlag) -> str:
    return str(bit.name).lower().replace("_", " ")


ARRIVED = ("the end of the route is reached", "the plan is complete", "the manoeuvre is complete")
"""Texts of a drive's regular end."""
EVENTS = {
    Event.BOOT_DONE: "the computer has started",
    Event.CHECKS_PASSED: "system checks passed",
    Event.CHECKS_FAILED: "a system check failed",
    Event.STEERING_BUTTON: "steering button pressed",
    Event.CRUISE_PLUS: "plus button pressed",
    Event.CRUISE_MINUS: "minus button pressed",
    Event.OVERRIDE_PRESSED: "override pressed",
    Event.OVERRIDE_RELEASED: "override released",
    Event.OVERRIDE_ASSUMED: "override cannot be read",
    Event.STEERING_TORQUE: "hands on the wheel",
    Event.BRAKE_TAPPED: "brake tapped",
    Event.BRAKE_HELD: "brake held",
    Event.BRAKE_RELEASED: "brake released",
    Event.ESTOP_PRESSED: "emergency stop pressed",
    Event.ESTOP_RELEASED: "emergency stop released",
    Event.ROUTE_NEAR: "on the route",
    Event.ROUTE_OFF: "off the route, or at its end",
    Event.ROUTE_WRONG_HEADING: "heading does not fit the route, or is not confirmed yet",
    Event.ROUTE_AMBIGUOUS: "the route passes here more than once",
    Event.ROUTE_GONE: "no route, or no position yet",
    Event.STANDING: "stationary",
    Event.MOVING: "moving",
    Event.TOO_FAST: "too fast to engage",
    Event.SOURCE_MISSING: "a condition for engaging is missing",
    Event.SOURCES_PRESENT: "all conditions for engaging are met",
    Event.HEALTH_STOP: "navigation or a monitor requests a stop",
    Event.HEALTH_GOOD: "navigation is good enough",
    Event.ERROR_RAISED: "a fault was found",
    Event.ERROR_CLEARED: "the fault is gone",
    Event.CONTROL_DIED: "the control process died",
    Event.CONTROL_RELAUNCHED: "the control process is back",
    Event.DRIVE_BY_WIRE_DIED: "the drive-by-wire box or its connection failed",
    Event.DRIVE_BY_WIRE_RELAUNCHED: "the drive-by-wire box is back",
    Event.REGISTRATION_DIED: "the registration process died",
    Event.REGISTRATION_RELAUNCHED: "the registration process is back",
    Event.RECORDER_DIED: "the recorder died",
    Event.RECORDER_RELAUNCHED: "the recorder is back",
    Event.DISPLAY_DIED: "the display died",
    Event.DISPLAY_RELAUNCHED: "the display is back",
    Event.MONITOR_DIED: "the monitor died",
    Event.MONITOR_RELAUNCHED: "the monitor is back",
    Event.TICK: "time passed",
}
"""Events in plain words."""


_TEXTS_OF = {
    Event.DRIVE_BY_WIRE_DIED: {
        FINDINGS[bit].text
        for bit in (Watch.LINE_SILENT, Watch.BAD_FRAMES, Watch.BUS_OFF, Watch.DEFAULTS_ACT, Watch.SECOND_SENDER)
    },
    Event.ERROR_RAISED: {each.text for each in FINDINGS.values() if each.severity >= Severity.MANUAL},
    Event.HEALTH_STOP: {each.text for each in FINDINGS.values() if each.severity is Severity.STOP}
    | {text for reason, text in REASONS.items() if reason & STOPPING},
}


def causes_of(event: Event, found: Sequence[str]) -> list[str]:
    """Present findings that belong to an event; all of them if none is known to belong to it."""
    own = _TEXTS_OF.get(event, set())
    return [text for text in found if text in own or text.startswith(_COMMAND)] or list(found)


def cause_words(event: Event, check: str, why: Sequence[str]) -> str:
    """Cause of a change of mode: the event and its causes.

    Args:
        event: event that changed the mode.
        check: text of the failed system check; empty for other events.
        why: findings behind the event, the most severe first.
    """
    behind = [text for text in (check, *why) if text]
    return f"{EVENTS[event]}: {'; '.join(behind)}" if behind else EVENTS[event]


def whole(number: float, unknown: int = 0) -> int:
    """A finite number as an integer."""
    return int(number) if math.isfinite(number) else unknown
