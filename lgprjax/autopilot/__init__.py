"""Autopilot: operating modes, velocity control, the command limiter, and the one step in which a command is born."""

from lgprjax.autopilot.limiter import Command, Limited, LimiterRules, LimiterState, init_limiter, limit_command
from lgprjax.autopilot.mode_diagram import describe_modes
from lgprjax.autopilot.mode_events import Action, Check, Event, Fault, Happening, Mode, Motion, Place, Refusal
from lgprjax.autopilot.mode_state import ModeState, operator_drives, refusal_of
from lgprjax.autopilot.modes import step_modes
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

__all__ = [
    "Action",
    "AutopilotConfig",
    "AutopilotInfo",
    "AutopilotInputs",
    "AutopilotState",
    "Check",
    "Command",
    "Event",
    "Fault",
    "Happening",
    "Limited",
    "LimiterRules",
    "LimiterState",
    "Mode",
    "ModeState",
    "Motion",
    "Place",
    "Pressed",
    "Refusal",
    "VelocitySettings",
    "VelocityState",
    "default_velocity",
    "describe_modes",
    "init_autopilot",
    "init_limiter",
    "init_velocity",
    "limit_command",
    "operator_drives",
    "refusal_of",
    "step_autopilot",
    "step_modes",
    "step_stop",
    "step_velocity",
]
