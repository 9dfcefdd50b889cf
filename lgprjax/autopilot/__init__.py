"""Autopilot: operating modes, velocity control, the command limiter, the one step in which a command is born, and
the watches on what the vehicle does with it.
"""

from lgprjax.autopilot.edge_ahead import StopRules, edge_ahead
from lgprjax.autopilot.fence import FENCE_SLOTS, fence_around, fence_of_route, pad_fence, room_of_route
from lgprjax.autopilot.limiter import Command, Limited, LimiterRules, LimiterState, init_limiter, limit_command
from lgprjax.autopilot.mode_diagram import describe_modes
from lgprjax.autopilot.mode_events import Action, Check, Event, Fault, Happening, Mode, Motion, Place, Refusal
from lgprjax.autopilot.mode_state import ModeState, operator_drives, refusal_of
from lgprjax.autopilot.modes import step_modes
from lgprjax.autopilot.onboard import OnboardInfo, OnboardSetup, OnboardState, Orders, step_onboard
from lgprjax.autopilot.skid_health import SkidHealth, SkidHealthRules, default_skid_health
from lgprjax.autopilot.skid_limiter import (
    SkidCommand,
    SkidLimited,
    SkidLimiterRules,
    SkidLimiterState,
    init_skid_limiter,
    limit_skid_command,
)
from lgprjax.autopilot.skid_setup import SkidSetup, skid_setup
from lgprjax.autopilot.skid_step import Guidance, SkidInfo, SkidOrders, SkidState, init_skid, step_skid
from lgprjax.autopilot.step import (
    AutopilotConfig,
    AutopilotInfo,
    AutopilotInputs,
    AutopilotState,
    init_autopilot,
    step_autopilot,
)
from lgprjax.autopilot.velocity import (
    Pressed,
    VelocitySettings,
    VelocityState,
    default_velocity,
    init_velocity,
    step_stop,
    step_velocity,
)
from lgprjax.autopilot.watch_belief import (
    ChassisBelief,
    Knots,
    PedalBelief,
    PedalsBelief,
    WheelBelief,
    front_angle,
    linear_wheel_map,
    proportional_rear,
)
from lgprjax.autopilot.watch_buttons import ButtonState, Hands, step_buttons
from lgprjax.autopilot.watch_chassis import ChassisWatchState, step_chassis_watch
from lgprjax.autopilot.watch_findings import REFUSING, SEVERITY, Severity, Watch, as_watch, describe, severity_of
from lgprjax.autopilot.watch_ground import Position
from lgprjax.autopilot.watch_heading import HeadingCheck, HeadingWatchState, step_heading_watch
from lgprjax.autopilot.watch_line import LineWatchState, step_line_watch
from lgprjax.autopilot.watch_motion import MotionState, step_motion
from lgprjax.autopilot.watch_odometer import OdometerWatchState, step_odometer_watch
from lgprjax.autopilot.watch_path import PathWatchState, step_path_watch
from lgprjax.autopilot.watch_pedals import PedalReading, PedalWatchState, step_pedal_watch
from lgprjax.autopilot.watch_servo import ServoWatchState, step_servo_watch
from lgprjax.autopilot.watch_wheel_sensors import WheelAngles, WheelSensorState, init_wheel_sensors, step_wheel_sensors

__all__ = [
    "FENCE_SLOTS",
    "REFUSING",
    "SEVERITY",
    "Action",
    "AutopilotConfig",
    "AutopilotInfo",
    "AutopilotInputs",
    "AutopilotState",
    "ButtonState",
    "ChassisBelief",
    "ChassisWatchState",
    "Check",
    "Command",
    "Event",
    "Fault",
    "Guidance",
    "Hands",
    "Happening",
    "HeadingCheck",
    "HeadingWatchState",
    "Knots",
    "Limited",
    "LimiterRules",
    "LimiterState",
    "LineWatchState",
    "Mode",
    "ModeState",
    "Motion",
    "MotionState",
    "OdometerWatchState",
    "OnboardInfo",
    "OnboardSetup",
    "OnboardState",
    "Orders",
    "PathWatchState",
    "PedalBelief",
    "PedalReading",
    "PedalWatchState",
    "PedalsBelief",
    "Place",
    "Position",
    "Pressed",
    "Refusal",
    "ServoWatchState",
    "Severity",
    "SkidCommand",
    "SkidHealth",
    "SkidHealthRules",
    "SkidInfo",
    "SkidLimited",
    "SkidLimiterRules",
    "SkidLimiterState",
    "SkidOrders",
    "SkidSetup",
    "SkidState",
    "StopRules",
    "VelocitySettings",
    "VelocityState",
    "Watch",
    "WheelAngles",
    "WheelBelief",
    "WheelSensorState",
    "as_watch",
    "default_skid_health",
    "default_velocity",
    "describe",
    "describe_modes",
    "edge_ahead",
    "fence_around",
    "fence_of_route",
    "front_angle",
    "init_autopilot",
    "init_limiter",
    "init_skid",
    "init_skid_limiter",
    "init_velocity",
    "init_wheel_sensors",
    "limit_command",
    "limit_skid_command",
    "linear_wheel_map",
    "operator_drives",
    "pad_fence",
    "proportional_rear",
    "refusal_of",
    "room_of_route",
    "severity_of",
    "skid_setup",
    "step_autopilot",
    "step_buttons",
    "step_chassis_watch",
    "step_heading_watch",
    "step_line_watch",
    "step_modes",
    "step_motion",
    "step_odometer_watch",
    "step_onboard",
    "step_path_watch",
    "step_pedal_watch",
    "step_servo_watch",
    "step_skid",
    "step_stop",
    "step_velocity",
    "step_wheel_sensors",
]
