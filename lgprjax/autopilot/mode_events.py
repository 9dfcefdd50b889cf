"""What happens to the mode machine, what it answers, and which events of a kind belong together."""

from enum import Enum, IntEnum, IntFlag, auto
from typing import NamedTuple


class Mode(IntEnum):
    """What is driven by whom. Only in STEERING and SPEED is an actuator engaged."""

    BOOT = 0
    CHECKS = 1
    READY = 2
    STEERING = 3
    SPEED = 4
    MANUAL = 5
    ERROR = 6
    EMERGENCY_STOP = 7


ENGAGED = (Mode.STEERING, Mode.SPEED)


class Event(Enum):
    """What happens. Buttons and pedals tell both edges; everything else tells a change.

    ``BRAKE_TAPPED`` is the brake going down, ``BRAKE_HELD`` its staying there, ``ERROR_CLEARED`` the going of the last
    error raised. ``ROUTE_NEAR`` is within 10 m of the chosen path, on one place and along it.
    """

    BOOT_DONE = auto()
    CHECKS_PASSED = auto()
    CHECKS_FAILED = auto()
    STEERING_BUTTON = auto()
    CRUISE_PLUS = auto()
    CRUISE_MINUS = auto()
    OVERRIDE_PRESSED = auto()
    OVERRIDE_RELEASED = auto()
    STEERING_TORQUE = auto()
    BRAKE_TAPPED = auto()
    BRAKE_HELD = auto()
    BRAKE_RELEASED = auto()
    ESTOP_PRESSED = auto()
    ESTOP_RELEASED = auto()
    ROUTE_NEAR = auto()
    ROUTE_OFF = auto()
    ROUTE_WRONG_HEADING = auto()
    ROUTE_AMBIGUOUS = auto()
    ROUTE_GONE = auto()
    STANDING = auto()
    MOVING = auto()
    TOO_FAST = auto()
    SOURCE_MISSING = auto()
    SOURCES_PRESENT = auto()
    HEALTH_STOP = auto()
    HEALTH_GOOD = auto()
    ERROR_RAISED = auto()
    ERROR_CLEARED = auto()
    CONTROL_DIED = auto()
    CONTROL_RELAUNCHED = auto()
    DRIVE_BY_WIRE_DIED = auto()
    DRIVE_BY_WIRE_RELAUNCHED = auto()
    REGISTRATION_DIED = auto()
    REGISTRATION_RELAUNCHED = auto()
    RECORDER_DIED = auto()
    RECORDER_RELAUNCHED = auto()
    DISPLAY_DIED = auto()
    DISPLAY_RELAUNCHED = auto()
    MONITOR_DIED = auto()
    MONITOR_RELAUNCHED = auto()
    TICK = auto()


class Check(Enum):
    """A system check that failed."""

    NONE = auto()
    DRIVE_BY_WIRE = auto()
    STEERING_SENSORS = auto()
    BRAKE = auto()
    GNSS_INS = auto()
    LGPR = auto()
    ROUTE = auto()
    PARAMETERS = auto()
    STORAGE = auto()
    SECOND_MASTER = auto()


class Happening(NamedTuple):
    """An event with its monotonic time, and the check that failed where one did."""

    event: Event
    time_s: float
    check: Check = Check.NONE


class Action(Enum):
    """What the host does.

    ``WARN`` shows the state's faults or its refusal. ``STOP_CONTROLLED`` hands the brake to the autopilot in STEERING
    too, until ``RELEASE_ACTUATORS``.
    """

    RUN_CHECKS = auto()
    RELEASE_ACTUATORS = auto()
    RELEASE_PEDALS = auto()
    ENGAGE_STEERING = auto()
    ENGAGE_SPEED = auto()
    LOCK_SPEED = auto()
    RAISE_SPEED = auto()
    LOWER_SPEED = auto()
    STOP_CONTROLLED = auto()
    CUT_POWER = auto()
    RESTORE_POWER = auto()
    LIGHT_BUTTON = auto()
    DARKEN_BUTTON = auto()
    WARN = auto()
    RELAUNCH_CONTROL = auto()
    RELAUNCH_DRIVE_BY_WIRE = auto()
    RELAUNCH_REGISTRATION = auto()
    RELAUNCH_RECORDER = auto()
    RELAUNCH_DISPLAY = auto()
    RELAUNCH_MONITOR = auto()


class Fault(IntFlag):
    """What keeps ERROR standing, each until its own event clears it."""

    RAISED = 1
    CHECKS = 2
    CONTROL = 4
    DRIVE_BY_WIRE = 8
    RECORDER = 16
    DISPLAY = 32
    MONITOR = 64


class Place(Enum):
    """Where the vehicle is beside the chosen path."""

    NO_PATH = auto()
    NEAR = auto()
    OFF_ROUTE = auto()
    WRONG_HEADING = auto()
    AMBIGUOUS = auto()


class Motion(Enum):
    """How fast the vehicle is; too fast to engage is for the host to say."""

    UNKNOWN = auto()
    STANDING = auto()
    MOVING = auto()
    TOO_FAST = auto()


class Refusal(Enum):
    """Why a button engaged nothing."""

    NONE = auto()
    ESTOP = auto()
    CHECKS = auto()
    OVERRIDE_STUCK = auto()
    OVERRIDE_PRESSED = auto()
    NOT_READY = auto()
    NOT_STEERING = auto()
    STOPPING = auto()
    BRAKE_PRESSED = auto()
    SOURCE_MISSING = auto()
    TOO_FAST = auto()
    HEALTH = auto()
    NO_PATH = auto()
    OFF_ROUTE = auto()
    WRONG_HEADING = auto()
    AMBIGUOUS = auto()


class Process(NamedTuple):
    """A process that may die: the fault it then is, what says that it is back, and how it is brought back."""

    fault: Fault
    relaunched: Event
    relaunch: Action


FATAL = {
    Event.CONTROL_DIED: Process(Fault.CONTROL, Event.CONTROL_RELAUNCHED, Action.RELAUNCH_CONTROL),
    Event.DRIVE_BY_WIRE_DIED: Process(
        Fault.DRIVE_BY_WIRE, Event.DRIVE_BY_WIRE_RELAUNCHED, Action.RELAUNCH_DRIVE_BY_WIRE
    ),
}
"""An error at once."""
WATCHED = {
    Event.RECORDER_DIED: Process(Fault.RECORDER, Event.RECORDER_RELAUNCHED, Action.RELAUNCH_RECORDER),
    Event.DISPLAY_DIED: Process(Fault.DISPLAY, Event.DISPLAY_RELAUNCHED, Action.RELAUNCH_DISPLAY),
    Event.MONITOR_DIED: Process(Fault.MONITOR, Event.MONITOR_RELAUNCHED, Action.RELAUNCH_MONITOR),
}
"""Relaunched while driving on, until they fail too often."""
CLEARS = {process.relaunched: process.fault for process in (*FATAL.values(), *WATCHED.values())} | {
    Event.ERROR_CLEARED: Fault.RAISED,
    Event.CHECKS_PASSED: Fault.CHECKS,
}
"""The fault that an event ends."""
PLACES = {
    Event.ROUTE_NEAR: Place.NEAR,
    Event.ROUTE_OFF: Place.OFF_ROUTE,
    Event.ROUTE_WRONG_HEADING: Place.WRONG_HEADING,
    Event.ROUTE_AMBIGUOUS: Place.AMBIGUOUS,
    Event.ROUTE_GONE: Place.NO_PATH,
}
MOTIONS = {Event.STANDING: Motion.STANDING, Event.MOVING: Motion.MOVING, Event.TOO_FAST: Motion.TOO_FAST}
