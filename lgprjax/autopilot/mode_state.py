"""What the mode machine knows, and what of it stands against engaging."""

from typing import NamedTuple

from lgprjax.autopilot.mode_events import ENGAGED, Check, Event, Fault, Mode, Motion, Place, Refusal


class ModeState(NamedTuple):
    """All that the mode machine knows.

    Attributes:
        mode: as driven.
        time_s: latest time heard of.
        booted: the computer has come up.
        checks_passed: the last run of the system checks passed.
        failed_check: which one did not; NONE otherwise.
        faults: what stands in the way of leaving ERROR.
        place: beside the route, as the planner says.
        motion: of the vehicle.
        sources_present: what navigation needs to engage is there.
        health_good: navigation does not ask for a stop.
        brake_pressed, override_pressed, estop_pressed: the operator's hands and feet.
        override_since_s: when the override button went down.
        override_stuck: held for too long, or since before the end of the boot; until let go.
        registration_dead: driven on without it, on GNSS and INS.
        failures: watched processes' deaths of the last minute, each by its event and its time.
        stopping: a controlled stop runs; it ends standing, in MANUAL.
        refusal: why the last press of a button engaged nothing; NONE when it did.
    """

    mode: Mode = Mode.BOOT
    time_s: float = 0.0
    booted: bool = False
    checks_passed: bool = False
    failed_check: Check = Check.NONE
    faults: Fault = Fault(0)
    place: Place = Place.NO_PATH
    motion: Motion = Motion.UNKNOWN
    sources_present: bool = False
    health_good: bool = False
    brake_pressed: bool = False
    override_pressed: bool = False
    estop_pressed: bool = False
    override_since_s: float = 0.0
    override_stuck: bool = False
    registration_dead: bool = False
    failures: tuple[tuple[Event, float], ...] = ()
    stopping: bool = False
    refusal: Refusal = Refusal.NONE


def operator_drives(state: ModeState) -> bool:
    """Whether no actuator is engaged."""
    return state.mode not in ENGAGED


def refusal_of(state: ModeState) -> Refusal:
    """Why nothing may be engaged now, the weightiest reason first; NONE where it may."""
    reasons = (
        (state.estop_pressed or state.mode is Mode.EMERGENCY_STOP, Refusal.ESTOP),
        (not state.checks_passed, Refusal.CHECKS),
        (state.override_stuck, Refusal.OVERRIDE_STUCK),
        (state.override_pressed, Refusal.OVERRIDE_PRESSED),
        (state.mode not in (Mode.READY, *ENGAGED), Refusal.NOT_READY),
        (state.stopping, Refusal.STOPPING),
        (state.brake_pressed, Refusal.BRAKE_PRESSED),
        (state.motion is Motion.UNKNOWN or not state.sources_present, Refusal.SOURCE_MISSING),
        (state.motion is Motion.TOO_FAST, Refusal.TOO_FAST),
        (not state.health_good, Refusal.HEALTH),
        (state.place is Place.NO_PATH, Refusal.NO_PATH),
        (state.place is Place.OFF_ROUTE, Refusal.OFF_ROUTE),
        (state.place is Place.WRONG_HEADING, Refusal.WRONG_HEADING),
        (state.place is Place.AMBIGUOUS, Refusal.AMBIGUOUS),
    )
    return next((reason for applies, reason in reasons if applies), Refusal.NONE)
