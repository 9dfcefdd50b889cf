"""Coverage of a field: its lines and turns, the route along them, guidance on it, and the area truly worked."""

from lgprjax.coverage.carrot import CarrotPlan, CarrotSettings, CarrotState, default_carrot, init_carrot, step_carrot
from lgprjax.coverage.cells import CellGrid, cell_centres, grid_of_field, inside_cells
from lgprjax.coverage.cover_route import CoverRoute, RoutePoint, lay_pattern, route_point
from lgprjax.coverage.end_arcs import Pose, Turn, turn_points
from lgprjax.coverage.field import Field, field_of_corners, field_of_polygon
from lgprjax.coverage.gaps import plan_gaps
from lgprjax.coverage.layers import LEVELS, CellState, cell_states, processed_area_m2
from lgprjax.coverage.line_order import line_order, middle_line
from lgprjax.coverage.lines import Line, line_count, lines_heading_rad
from lgprjax.coverage.pattern import Pattern, plan_pattern
from lgprjax.coverage.pattern_settings import PatternSettings
from lgprjax.coverage.route_foot import RouteFoot, route_foot
from lgprjax.coverage.route_pursuit import pursuit_along
from lgprjax.coverage.tool import Tool, ToolMoment, tool_centre
from lgprjax.coverage.worked import WorkedState, init_worked, run_worked, step_worked

__all__ = [
    "LEVELS",
    "CarrotPlan",
    "CarrotSettings",
    "CarrotState",
    "CellGrid",
    "CellState",
    "CoverRoute",
    "Field",
    "Line",
    "Pattern",
    "PatternSettings",
    "Pose",
    "RouteFoot",
    "RoutePoint",
    "Tool",
    "ToolMoment",
    "Turn",
    "WorkedState",
    "cell_centres",
    "cell_states",
    "default_carrot",
    "field_of_corners",
    "field_of_polygon",
    "grid_of_field",
    "init_carrot",
    "init_worked",
    "inside_cells",
    "lay_pattern",
    "line_count",
    "line_order",
    "lines_heading_rad",
    "middle_line",
    "plan_gaps",
    "plan_pattern",
    "processed_area_m2",
    "pursuit_along",
    "route_foot",
    "route_point",
    "run_worked",
    "step_carrot",
    "step_worked",
    "tool_centre",
    "turn_points",
]
