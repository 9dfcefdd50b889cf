"""Fields worked in closed loop: world, filter, guidance, fence and limiter, a whole field in one program."""

from lgprjax.simulation.field.field_loop import FieldMoment, FieldState, run_fields
from lgprjax.simulation.field.field_world import (
    MOMENT_TICKS,
    TICK_S,
    FieldCourse,
    FieldSpec,
    FieldWorld,
    made_up_field_world,
    made_up_tool,
    rectangle_course,
)
from lgprjax.simulation.field.threshold_world import PIDS, THRESHOLD_MPS, threshold_world

__all__ = [
    "MOMENT_TICKS",
    "PIDS",
    "THRESHOLD_MPS",
    "TICK_S",
    "FieldCourse",
    "FieldMoment",
    "FieldSpec",
    "FieldState",
    "FieldWorld",
    "made_up_field_world",
    "made_up_tool",
    "rectangle_course",
    "run_fields",
    "threshold_world",
]
