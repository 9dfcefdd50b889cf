"""Setup of a skid-steer vehicle's control loop, read from files at start."""

import json
import math
from collections.abc import Sequence
from pathlib import Path
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.autopilot.fence import fence_of_ground, pad_fence
from lgprjax.autopilot.skid_step import SkidSetup, skid_setup
from lgprjax.coverage.ground import SafeGround, check_drivable, ground_of_plan
from lgprjax.coverage.guidance import LEAST_ROWS, CoverRoute, lay_pattern
from lgprjax.coverage.pattern import Pattern
from lgprjax.coverage.resume import Resumption, RoutePlace, resume_place, route_from
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import VehicleFile, read_vehicle
from lgprjax.formats.coverage_files import TakenUp, read_cover_plan, read_taken_up
from lgprjax.frames import LocalFrame
from lgprjax.recordings.vehicles import carrot_of, machine_of, skid_setup_of
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.skid.compiled import SkidResult
from lgprjax.runtime.control.skid.watches import ToolBelief
from lgprjax.runtime.gnss import Quality

_DEEPER = 2.0
"""Limit of the depth, as a multiple of the commanded one."""
_SAME_RADIUS_M = 1e-3
_ANYWHERE_M = 5000.0


class SkidLoaded(NamedTuple):
    """Contents of the files of a run.

    Attributes:
        setup: setup of the compiled step.
        belief: commanded state of the tool.
        frame: frame of the plan; without a plan that of a dead control loop, else ``None``.
        name: name of the field; ``None`` without a plan, when nothing can be driven.
        perimeter_m: corners of the field; none without a plan.
        lines: number of lines of the plan.
        route, fence: inputs of the step; empty without a plan.
        ground: ground inside the fence; ``None`` without a plan.
        pattern: whole pattern of the plan; ``None`` without a plan.
        taken_up: resumed work of earlier runs; ``None`` if the plan begins anew.
        machine: name and serial number of the machine.
        gnss_period_s: period of positions.
        hashes: hash of every file read, by its name in the configuration.
    """

    setup: SkidSetup
    belief: ToolBelief
    frame: LocalFrame | None
    name: str | None
    perimeter_m: Float[np.ndarray, "corner 2"]
    lines: int
    route: CoverRoute
    fence: Float[Array, "side 2 2"]
    gnss_period_s: float
    hashes: dict[str, str]
    ground: SafeGround | None = None
    pattern: Pattern | None = None
    taken_up: TakenUp | None = None
    machine: str = ""


def load_skid(
    config: RuntimeConfig, place: RoutePlace | None = None, anchor: Sequence[float] | None = None
) -> SkidLoaded:
    """Read vehicle, plan, and resumed work of earlier runs.

    Args:
        config: configuration of the run.
        place: place to begin at after a relaunch of the control loop; ``None``: the run's start.
        anchor: without a plan, latitude, longitude and height of the frame of a relaunched control loop.

    Raises:
        InputError: the vehicle file or the plan cannot be used, the plan is for another tool, or the resumed work is of
            another plan.
    """
    assert config.coverage is not None
    path = config.path(config.vehicle)
    vehicle = read_vehicle(path)
    setup, belief = _setup(config, vehicle)
    hashes = {config.vehicle: file_hash(path)}
    period_s = config.sensors.gnss_period_s
    if config.coverage.plan is None:
        corners = _ANYWHERE_M * np.array([[-1.0, -1.0], [1.0, -1.0], [1.0, 1.0], [-1.0, 1.0]])
        none = np.zeros((0, 2))
        return SkidLoaded(
            setup=setup,
            belief=belief,
            frame=None if anchor is None else LocalFrame(*anchor),
            name=None,
            perimeter_m=none,
            lines=0,
            route=_no_route(),
            fence=pad_fence(corners),
            gnss_period_s=period_s,
            hashes=hashes,
            machine=machine_of(vehicle),
        )
    file = config.path(config.coverage.plan)
    plan = read_cover_plan(file)
    hashes[config.coverage.plan] = file_hash(file)
    if plan.tool != setup.tool:
        raise InputError(file, "tool", f"the tool of {path.name}, {setup.tool}", f"{plan.tool}: plan again")
    least_m = float(setup.vehicle.smallest_radius_m)
    tightest_m = min((turn.tightest_radius_m for turn in plan.pattern.turns), default=math.inf)
    if tightest_m < least_m - _SAME_RADIUS_M:
        expected = f"radii of at least {least_m:g} m, the smallest radius of {path.name}"
        raise InputError(file, "turns", expected, f"{tightest_m:.3g} m: plan again")
    route = lay_pattern(plan.pattern)
    taken_up = None if config.coverage.resume is None else _taken_up(config, hashes)
    resumption = None if taken_up is None else taken_up.resumption
    if place is not None:
        resumption = Resumption(place, () if resumption is None else resumption.worked)
    if resumption is not None:
        route = route_from(route, plan.pattern, resumption)
    perimeter_m = plan.pattern.field.perimeter_m
    ground = ground_of_plan(plan.pattern, plan.ground, setup.outline, spare_m=config.coverage.spare_m)
    # The same check as when it was planned: a body that has grown since is found here.
    check_drivable(plan.pattern, ground, setup.outline, name=str(file))
    try:
        fence = fence_of_ground(ground)
    except InputError as error:
        raise InputError(file, error.place, error.expected, error.found) from None
    lines = len(plan.pattern.lines)
    return SkidLoaded(
        setup=setup,
        belief=belief,
        frame=plan.frame,
        name=plan.name,
        perimeter_m=perimeter_m,
        lines=lines,
        route=route,
        fence=fence,
        gnss_period_s=period_s,
        hashes=hashes,
        ground=ground,
        pattern=plan.pattern,
        taken_up=taken_up,
        machine=machine_of(vehicle),
    )


def _taken_up(config: RuntimeConfig, hashes: dict[str, str]) -> TakenUp:
    """Work of earlier runs; the hash of its file is added."""
    assert config.coverage is not None
    assert config.coverage.plan is not None
    assert config.coverage.resume is not None
    path = config.path(config.coverage.resume)
    held = read_taken_up(path)
    digest = hashes[config.coverage.plan]
    if held.plan_sha256 != digest:
        raise InputError(path, "plan", f"the plan of this run, {digest[:12]}...", f"{held.plan_sha256[:12]}...")
    hashes[config.coverage.resume] = file_hash(path)
    return held


PROGRESS_FILE = "progress.json"
"""File in the run's folder with the place of the newest counting moment, for a relaunched control loop."""


def place_after_death(folder: Path, pattern: Pattern) -> RoutePlace | None:
    """Place at which a relaunched control loop continues; ``None`` if no moment had counted."""
    try:
        told = json.loads((folder / PROGRESS_FILE).read_text(encoding="utf-8"))
        last = RoutePlace(int(told["line"]), float(told["along_m"]))
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return resume_place(pattern, last) if 0 <= last.line < len(pattern.lines) else None


def _setup(config: RuntimeConfig, vehicle: VehicleFile) -> tuple[SkidSetup, ToolBelief]:
    path = config.path(config.vehicle)
    parts = skid_setup_of(vehicle, path)
    depth_m = _needed(config, "tool.depth_m", vehicle.tool.depth_m)
    tolerance_m = _needed(config, "tool.depth_tolerance_m", vehicle.tool.depth_tolerance_m)
    setup = skid_setup(
        parts.vehicle,
        parts.tool,
        parts.model,
        depth_m=depth_m,
        deepest_m=_DEEPER * depth_m,
        threshold_mps=vehicle.skid_steer.threshold_mps or 0.0,
        carrot=carrot_of(vehicle, path),
        outline=parts.outline,
    )
    return setup, ToolBelief(depth_m, tolerance_m)


def _no_route() -> CoverRoute:
    rows, line = jnp.zeros((LEAST_ROWS, 5), jnp.float32), jnp.full(LEAST_ROWS, -1, jnp.int32)
    return CoverRoute(rows, line, jnp.float32(1.0), jnp.float32(1.0), jnp.int32(2))


def _needed(config: RuntimeConfig, place: str, value: float | None) -> float:
    if value is None:
        raise InputError(config.path(config.vehicle), place, "a number", "none")
    return value


# Corners of a field, marked by the operator: place and accuracy of the reference point.


def corner_obstacle(result: SkidResult, quality: Quality, *, engaged: bool) -> str:
    """Why no corner can be marked now; empty if it can."""
    if engaged:
        return "corners are marked only while the operator drives"
    if not result.heading_known > 0.5:
        # The lever between antenna and reference point rotates with the heading.
        return "heading not known: drive straight by remote control"
    return "" if quality is Quality.FIXED else "no fixed position now"


def corner_row(number: int, result: SkidResult, frame: LocalFrame, up_m: float) -> bytes:
    """The ``CORNER`` record, JSON.

    Args:
        number: number of the corner in this run, from 1.
        result: result of the tick.
        frame: frame of the pose.
        up_m: height of the last position in the frame.
    """
    latitude, longitude, height = frame.to_geodetic(np.array([result.x_m]), np.array([result.y_m]), np.array([up_m]))
    corner = {
        "corner": number,
        "latitude_deg": float(latitude[0]),
        "longitude_deg": float(longitude[0]),
        "height_m": float(height[0]),
        "sigma_m": result.sigma_m,
        "yaw_rad": result.yaw_rad,
        "sigma_yaw_rad": math.sqrt(max(result.yawyaw, 0.0)),
        "covariance_m2": [[result.xx, result.xy], [result.xy, result.yy]],
    }
    return json.dumps(corner).encode()
