"""What the watches find: one bit a finding, what each asks for, and what the operator reads of it."""

from enum import IntEnum, IntFlag


class Severity(IntEnum):
    """What a finding asks for; the largest one wins."""

    CONTINUE = 0
    """Shown and recorded."""
    DEGRADE = 1
    """Drive on slowly."""
    STOP = 2
    """Controlled stop: throttle idle, ramped brake, steer on along the path."""
    MANUAL = 3
    """Actuators to their defaults, warn, the operator drives."""
    EMERGENCY = 4
    """The box cuts the actuators' power and brakes."""


class Watch(IntFlag):
    """One bit a finding; times from onset to bit stand with the watches."""

    POTENTIOMETER_RANGE = 1 << 0
    POTENTIOMETER_STUCK = 1 << 1
    WHEEL_SENSORS_APART = 1 << 2
    SERVO_WEAK = 1 << 3
    SERVO_DEAD = 1 << 4
    SUPPLY_LOW = 1 << 5
    STEERING_RUNAWAY = 1 << 6
    REAR_STUCK = 1 << 7
    YAW_RATE_LOST = 1 << 8
    ODOMETER_DEAD = 1 << 9
    ODOMETER_REVERSED = 1 << 10
    ODOMETER_SLIPS = 1 << 11
    SPEED_UNKNOWN = 1 << 12
    THROTTLE_STUCK = 1 << 13
    SPEED_RISES = 1 << 14
    BRAKE_DEAD = 1 << 15
    BRAKE_UNTESTED = 1 << 16
    PEDAL_UNREAD = 1 << 17
    LINE_SILENT = 1 << 18
    BAD_FRAMES = 1 << 19
    DEFAULTS_ACT = 1 << 20
    BUS_OFF = 1 << 21
    SECOND_SENDER = 1 << 22
    ACTUATOR_FAULT = 1 << 23
    OFF_PATH = 1 << 24
    FAR_OFF_PATH = 1 << 25
    OVERRIDE_CONTACTS = 1 << 26
    CONTROLLER_SILENT = 1 << 27
    TORQUE_UNREAD = 1 << 28
    HEADING_UNCONFIRMED = 1 << 29
    HEADING_CONTRADICTED = 1 << 30


SEVERITY = {
    Watch.POTENTIOMETER_RANGE: Severity.MANUAL,
    Watch.POTENTIOMETER_STUCK: Severity.MANUAL,
    Watch.WHEEL_SENSORS_APART: Severity.MANUAL,
    Watch.SERVO_WEAK: Severity.DEGRADE,
    Watch.SERVO_DEAD: Severity.MANUAL,
    Watch.SUPPLY_LOW: Severity.DEGRADE,
    Watch.STEERING_RUNAWAY: Severity.MANUAL,
    Watch.REAR_STUCK: Severity.STOP,
    Watch.YAW_RATE_LOST: Severity.DEGRADE,
    Watch.ODOMETER_DEAD: Severity.DEGRADE,
    Watch.ODOMETER_REVERSED: Severity.DEGRADE,
    Watch.ODOMETER_SLIPS: Severity.DEGRADE,
    Watch.SPEED_UNKNOWN: Severity.STOP,
    # Throttle idle and brake is what a controlled stop does; the box's cut is for a speed that rises all the same.
    Watch.THROTTLE_STUCK: Severity.STOP,
    Watch.SPEED_RISES: Severity.EMERGENCY,
    Watch.BRAKE_DEAD: Severity.EMERGENCY,
    Watch.BRAKE_UNTESTED: Severity.CONTINUE,
    Watch.PEDAL_UNREAD: Severity.STOP,
    Watch.LINE_SILENT: Severity.MANUAL,
    Watch.BAD_FRAMES: Severity.MANUAL,
    Watch.DEFAULTS_ACT: Severity.MANUAL,
    Watch.BUS_OFF: Severity.MANUAL,
    Watch.SECOND_SENDER: Severity.MANUAL,
    Watch.ACTUATOR_FAULT: Severity.MANUAL,
    Watch.OFF_PATH: Severity.DEGRADE,
    Watch.FAR_OFF_PATH: Severity.STOP,
    Watch.OVERRIDE_CONTACTS: Severity.MANUAL,
    Watch.CONTROLLER_SILENT: Severity.MANUAL,
    Watch.TORQUE_UNREAD: Severity.MANUAL,
    Watch.HEADING_UNCONFIRMED: Severity.CONTINUE,
    Watch.HEADING_CONTRADICTED: Severity.MANUAL,
}
"""What each finding asks for while the autopilot drives."""

TEXT = {
    Watch.POTENTIOMETER_RANGE: "wheel potentiometer: open, shorted or out of range",
    Watch.POTENTIOMETER_STUCK: "wheel potentiometer: stuck, the encoder turns without it",
    Watch.WHEEL_SENSORS_APART: "wheel potentiometer and encoder disagree: wheel refitted or a sensor slipped",
    Watch.SERVO_WEAK: "steering servo is slow: the wheels lag behind their command",
    Watch.SERVO_DEAD: "steering servo does not follow its command",
    Watch.SUPPLY_LOW: "supply of the steering servo is low",
    Watch.STEERING_RUNAWAY: "steering runs away from its command: servo cut",
    Watch.REAR_STUCK: "the vehicle turns otherwise than its wheels say: rear steering stuck?",
    Watch.YAW_RATE_LOST: "no yaw rate: the rear steering cannot be watched",
    Watch.ODOMETER_DEAD: "odometer stands while the vehicle moves",
    Watch.ODOMETER_REVERSED: "odometer counts the wrong way",
    Watch.ODOMETER_SLIPS: "odometer and GNSS disagree: wheels slip?",
    Watch.SPEED_UNKNOWN: "speed unknown: odometer bad and no GNSS",
    Watch.THROTTLE_STUCK: "throttle stuck open: braking",
    Watch.SPEED_RISES: "throttle stuck open and the speed rises: power cut",
    Watch.BRAKE_DEAD: "brake has no effect: power cut",
    Watch.BRAKE_UNTESTED: "braking test not passed",
    Watch.PEDAL_UNREAD: "throttle or brake position is no number",
    Watch.LINE_SILENT: "drive-by-wire box is silent",
    Watch.BAD_FRAMES: "drive-by-wire box: three bad frames in a row",
    Watch.DEFAULTS_ACT: "drive-by-wire box acts by its defaults",
    Watch.BUS_OFF: "drive-by-wire box: bus off",
    Watch.SECOND_SENDER: "somebody else commands the drive-by-wire box",
    Watch.ACTUATOR_FAULT: "drive-by-wire box reports a servo, throttle, brake or power fault",
    Watch.OFF_PATH: "more than 1 ft off the path",
    Watch.FAR_OFF_PATH: "more than 3 ft off the path: stopping",
    Watch.OVERRIDE_CONTACTS: "override button: wire cut or contact stuck",
    Watch.CONTROLLER_SILENT: "operator controller is silent",
    Watch.TORQUE_UNREAD: "torque of the operator's hands is no number",
    Watch.HEADING_UNCONFIRMED: "heading not confirmed yet: drive two metres",
    Watch.HEADING_CONTRADICTED: "heading contradicts the way driven: reversed?",
}
"""Each finding in plain words."""

_NOTHING = Watch(0)

REFUSING = Watch.BRAKE_UNTESTED | Watch.HEADING_UNCONFIRMED
for _bit, _severity in SEVERITY.items():
    if _severity >= Severity.STOP and _bit is not Watch.FAR_OFF_PATH:
        REFUSING |= _bit
"""Findings with which nothing may be engaged."""


def as_watch(bits: int) -> Watch:
    """Bits as findings. Most ticks have none, and making a flag takes longer than the rest of a watch."""
    return Watch(bits) if bits else _NOTHING


def severity_of(bits: Watch) -> Severity:
    """The largest that findings ask for; CONTINUE for none."""
    return max((SEVERITY[bit] for bit in bits), default=Severity.CONTINUE)


def describe(bits: Watch) -> list[str]:
    """Findings in plain words, the weightiest first."""
    return [TEXT[bit] for bit in sorted(bits, key=lambda bit: (-SEVERITY[bit], bit))]
