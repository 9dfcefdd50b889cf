"""Plans of fields, records of the ground worked, and their figures."""

from lgprjax.worked.layers import CoverFigures, LayerFigures, cover_figures, cover_layers
from lgprjax.worked.plans import (
    FieldPlan,
    OrderCost,
    PlanFile,
    PlanOptions,
    check_plan_options,
    make_cover_plan,
    open_cover_plan,
    plan_field,
    save_cover_plan,
)
from lgprjax.worked.record import CoverRun, read_cover_run, record_cover

__all__ = [
    "CoverFigures",
    "CoverRun",
    "FieldPlan",
    "LayerFigures",
    "OrderCost",
    "PlanFile",
    "PlanOptions",
    "check_plan_options",
    "cover_figures",
    "cover_layers",
    "make_cover_plan",
    "open_cover_plan",
    "plan_field",
    "read_cover_run",
    "record_cover",
    "save_cover_plan",
]
