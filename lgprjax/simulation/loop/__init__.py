"""Closed loops: scene, registration, fusion, planner, law, limiter, actuators, vehicle, and round again."""

from lgprjax.simulation.loop.closed_loop import decide, move
from lgprjax.simulation.loop.driven_course import DrivenCourse, drive_course, route_of_map
from lgprjax.simulation.loop.lane_starts import route_of_road, start_lanes
from lgprjax.simulation.loop.loop_setup import LoopVehicle, loop_setup
from lgprjax.simulation.loop.loop_state import (
    TICK_S,
    Decision,
    LoopSetup,
    LoopSpec,
    LoopState,
    ReportedNoise,
    start_loop,
)
from lgprjax.simulation.loop.loop_tick import LoopSums, LoopTick, blank_sums
from lgprjax.simulation.loop.many_drives import draw_fix, run_lane, run_lanes
from lgprjax.simulation.loop.off_road import (
    MILE_M,
    Course,
    OffRoad,
    SceneFrame,
    draw_course,
    make_course,
    scene_frame_of,
)
from lgprjax.simulation.loop.radar_loop import RadarLoop, TickFix
from lgprjax.simulation.loop.tracking_error import (
    FOOT_M,
    TrackingError,
    cross_track_m,
    tracking_error,
)

__all__ = [
    "FOOT_M",
    "MILE_M",
    "TICK_S",
    "Course",
    "Decision",
    "DrivenCourse",
    "LoopSetup",
    "LoopSpec",
    "LoopState",
    "LoopSums",
    "LoopTick",
    "LoopVehicle",
    "OffRoad",
    "RadarLoop",
    "ReportedNoise",
    "SceneFrame",
    "TickFix",
    "TrackingError",
    "blank_sums",
    "cross_track_m",
    "decide",
    "draw_course",
    "draw_fix",
    "drive_course",
    "loop_setup",
    "make_course",
    "move",
    "route_of_map",
    "route_of_road",
    "run_lane",
    "run_lanes",
    "scene_frame_of",
    "start_lanes",
    "start_loop",
    "tracking_error",
]
