"""Why nothing is engaged, in plain words."""

from lgprjax.autopilot import Refusal

REFUSALS = {
    Refusal.NONE: "",
    Refusal.ESTOP: "emergency stop is pressed: release it, then press override",
    Refusal.CHECKS: "system checks have not passed",
    Refusal.OVERRIDE_STUCK: "override button is stuck",
    Refusal.OVERRIDE_PRESSED: "override button is pressed",
    Refusal.NOT_READY: "not ready: press and release override",
    Refusal.NOT_STEERING: "engage steering first",
    Refusal.STOPPING: "a controlled stop is under way",
    Refusal.BRAKE_PRESSED: "brake is pressed",
    Refusal.SOURCE_MISSING: "a sensor or the heading is missing",
    Refusal.TOO_FAST: "too fast to engage",
    Refusal.HEALTH: "navigation is not good enough",
    Refusal.NO_PATH: "no route, or no position yet",
    Refusal.OFF_ROUTE: "more than 10 m from the route",
    Refusal.WRONG_HEADING: "heading does not fit the route, or is not confirmed yet",
    Refusal.AMBIGUOUS: "the route passes here more than once",
}

OF_NAVIGATION = (
    Refusal.SOURCE_MISSING,
    Refusal.HEALTH,
    Refusal.NO_PATH,
    Refusal.OFF_ROUTE,
    Refusal.WRONG_HEADING,
)
"""Refusals that a vehicle may know better words for."""
