"""The vehicle of ``vehicles/tractor_trailer.py`` on drawn routes and fields: tracking, estimates, and its hinge.

Limits follow from the vehicle: a lag in metres of way, the look-ahead, the position error, the hinge of a steady turn.
"""

import re
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Bool, Float

from lgprjax.coverage import CarrotSettings, CoverRoute, PatternSettings, field_of_polygon, lay_pattern, plan_pattern
from lgprjax.navigation import RoutePath, RouteSpeeds, RouteTrack, legs_of_track, make_route_path
from lgprjax.simulation.loop import cross_track_m
from lgprjax.vehicle import Chassis, ProportionalRear
from vehicles.tractor_trailer import InField, OnRoute, Trailer, TrailerLimits, World, drive

_DRIVES, _TICKS = 4, {"route": 900, "field": 5600}
_RUN = {kind: jax.jit(jax.vmap(partial(drive, ticks=ticks))) for kind, ticks in _TICKS.items()}
_MPS, _RADPS, _RADIUS_M = 3.0, 0.5, 6.0
_POSITION_M = 0.1
"""Position error at the largest: four sigmas of the slow GNSS error of 2 cm, and 2 cm of noise."""
_RECIPE = Path(__file__).parents[2] / "vehicles" / "tractor_trailer.py"


class Driven(NamedTuple):
    """One drive: its world, true bodies, errors of the estimated pose, offset from the path, and metres of the path."""

    world: World
    body: Float[np.ndarray, "tick 4"]
    error: Float[np.ndarray, "tick 3"]
    nees: float
    cross_m: Float[np.ndarray, " tick"]
    to_go_m: Float[np.ndarray, " tick"]
    line_m: Float[np.ndarray, "point 2"]

    def steady_hinge_rad(self, curvature_radpm: float) -> float:
        """Hinge angle of a steady turn of the tractor's rear axle: hitch and trailer axle on circles of one centre."""
        hitch, drawbar = float(self.world.vehicle.hitch_m), float(self.world.vehicle.drawbar_m)
        reach = np.hypot(1.0 / curvature_radpm, hitch)
        return float(np.arctan(hitch * curvature_radpm) + np.arcsin(drawbar / reach))


def _world(rng: np.random.Generator, guidance: OnRoute | InField) -> World:
    one, zero, largest = jnp.float32, jnp.float32(0.0), jnp.float32(0.65)
    wheelbase, hitch, drawbar = rng.uniform([2.2, 0.6, 2.8], [3.0, 1.1, 4.0])
    chassis = Chassis(one(wheelbase), zero, ProportionalRear(zero), largest, one(np.inf))
    limits = TrailerLimits(largest, one(_RADPS), one(_MPS), one(0.6), one(0.2))
    lag, offset, scale = rng.uniform([0.2, -0.02, -0.03], [0.4, 0.02, 0.03])
    vehicle = Trailer(chassis, one(hitch), one(drawbar), one(1.5), limits)
    return World(vehicle, guidance, one(lag), one(offset), one(scale))


def _route(rng: np.random.Generator) -> tuple[RoutePath, Float[np.ndarray, "point 2"]]:
    """A hundred metres of bends to both sides, of no less than 20 m."""
    along = np.arange(0.0, 100.0, 0.5)
    curvature = 0.05 * np.sin(2.0 * np.pi * along / rng.uniform(50.0, 80.0) + rng.uniform(0.0, 6.0))
    yaw = rng.uniform(-3.0, 3.0) + 0.5 * np.cumsum(curvature)
    points = 0.5 * np.cumsum(np.stack([np.cos(yaw), np.sin(yaw)], axis=1), axis=0)
    return make_route_path(*legs_of_track(RouteTrack("drawn", points, yaw)), None, RouteSpeeds(_MPS, 1.5)), points


def _field(rng: np.random.Generator, tool_ahead_m: float) -> tuple[CoverRoute, Float[np.ndarray, "point 2"]]:
    """A field of slanting sides, its tool on the trailer's axle."""
    length, width, slant = rng.uniform([30.0, 10.0, -4.0], [40.0, 13.0, 4.0])
    corners = np.array([[0.0, 0.0], [length, 0.0], [length + slant, width], [slant, width]])
    settings = PatternSettings(3.0, 0.1, "boustrophedon", _RADIUS_M, 30.0, tool_ahead_m)
    route = lay_pattern(plan_pattern(field_of_polygon(corners, name="drawn"), settings, name="drawn"), spacing_m=0.25)
    x, y, yaw = np.asarray(route.rows, np.float64)[0, :3]
    run_up = np.stack([x + np.arange(-20.0, 0.0) * np.cos(yaw), y + np.arange(-20.0, 0.0) * np.sin(yaw)], axis=1)
    return route, np.concatenate([run_up, np.asarray(route.rows, np.float64)[: int(route.count), :2]])


def _drive(kind: str, seed: int) -> list[Driven]:
    rng = np.random.default_rng(seed)
    worlds: list[World] = []
    lines, starts = [], []
    for _ in range(_DRIVES):
        if kind == "route":
            path, line = _route(rng)
            world = _world(rng, OnRoute(path))
            at = np.asarray(path.legs.rows, np.float64)[0, 20]
            start = np.array([at[0], at[1], np.arctan2(at[3], at[2]), 0.0])
        else:
            world = _world(rng, OnRoute(_route(rng)[0]))
            route, line = _field(rng, -float(world.vehicle.hitch_m + world.vehicle.drawbar_m))
            # Pursuit has no gains; nine tenths of the lock are left for corrections.
            carrot = (3.0, 0.0, 0.0, 0.0, 0.2, 0.0, 0.3, 0.3)
            world = world._replace(guidance=InField(route, CarrotSettings(*map(jnp.float32, carrot))))
            x, y, yaw = np.asarray(route.rows, np.float64)[0, :3]
            start = np.array([x - 8.0 * np.cos(yaw), y - 8.0 * np.sin(yaw), yaw, 0.0])
        worlds.append(world)
        lines.append(line)
        starts.append(start + [*rng.normal(0.0, 0.2, 2), 0.0, 0.0])
    many = jax.tree.map(lambda *leaves: jnp.stack(leaves), *worlds)
    keys = jax.random.split(jax.random.key(seed), _DRIVES)
    found = _RUN[kind](many, jnp.asarray(starts, jnp.float32), keys)
    bodies, estimates, _, to_go = jax.tree.map(np.asarray, found)
    each = zip(worlds, lines, bodies, estimates.mean, estimates.covariance, to_go, strict=True)
    return [_driven(*parts) for parts in each]


def _driven(world: World, line: Any, body: Any, mean: Any, covariance: Any, to_go_m: Any) -> Driven:
    """Up to arrival, without the first five seconds, in which the estimate settles."""
    arrived = to_go_m < 0.5
    assert arrived.any()
    kept = slice(100, int(np.argmax(arrived)))
    body, wrong = body[kept].astype(np.float64), mean[kept, :3].astype(np.float64) - body[kept, :3]
    wrong[:, 2] = np.angle(np.exp(1j * wrong[:, 2]))
    spread = np.linalg.inv(covariance[kept, :3, :3].astype(np.float64))
    nees = float(np.mean(np.einsum("ti,tij,tj->t", wrong, spread, wrong)) / 3.0)
    return Driven(world, body, wrong, nees, cross_track_m(body[:, :2], line), to_go_m[kept], line)


def _estimates_hold(each: Driven) -> None:
    assert np.sqrt(np.mean(each.error[:, :2] ** 2)) < 0.04
    assert np.degrees(np.abs(each.error[:, 2])).max() < 3.0
    # The slow GNSS error is no state of the filter, which states up to half of it as noise.
    assert 0.3 < each.nees < 3.0


def test_the_recipe_is_short_and_uses_public_names_only() -> None:
    text = _RECIPE.read_text(encoding="utf-8")
    assert len(text.splitlines()) <= 150
    imports = [line for line in text.splitlines() if line.startswith(("from lgprjax", "import lgprjax"))]
    assert len(imports) >= 5
    assert not re.search(r"[\s.]_\w", " ".join(imports))


@pytest.mark.parametrize("seed", [1, 2])
def test_drawn_vehicles_follow_drawn_routes(seed: int) -> None:
    for each in _drive("route", seed):
        _estimates_hold(each)
        # Pursuit steers by the route's curvature a third of the look-ahead on, which bends by 0.05 sin(2 pi s / 50).
        ahead_m, change = 2.0 + 1.2 * _MPS, 0.05 * 2.0 * np.pi / 50.0
        assert np.abs(each.cross_m).max() < change * ahead_m**3 / 6.0 + _POSITION_M
        assert np.abs(each.body[:, 3]).max() < each.steady_hinge_rad(1.2 * 0.05)


@pytest.fixture(scope="module", params=[3, 4])
def fields(request: pytest.FixtureRequest) -> list[Driven]:
    return _drive("field", request.param)


def test_drawn_vehicles_work_drawn_fields(fields: list[Driven]) -> None:
    for each in fields:
        _estimates_hold(each)
        route = each.world.guidance.path
        assert isinstance(route, CoverRoute)
        on_line = _line_of(each, route) >= 0
        assert np.sqrt(np.mean(each.cross_m[on_line] ** 2)) < 0.05
        # In a turn the wheels come late by their lag and by the time to the turn's angle: so far the vehicle goes on.
        angle = float(np.arctan(each.world.vehicle.chassis.wheelbase_m / _RADIUS_M))
        late_m = 0.3 * _RADIUS_M * (float(each.world.lag_s) + angle / _RADPS)
        assert np.abs(each.cross_m).max() < 0.5 * late_m**2 / _RADIUS_M + _POSITION_M


def test_the_trailer_stays_off_jackknife_and_follows_on_the_lines(fields: list[Driven]) -> None:
    for each in fields:
        hinge = np.abs(each.body[:, 3])
        assert hinge.max() < each.steady_hinge_rad(1.15 / _RADIUS_M) < np.radians(75.0)
        assert hinge.max() > 0.8 * each.steady_hinge_rad(1.0 / _RADIUS_M)
        hitch, drawbar = float(each.world.vehicle.hitch_m), float(each.world.vehicle.drawbar_m)
        yaw = each.body[:, 2]
        tail = yaw - each.body[:, 3]
        axle = each.body[:, :2] - hitch * np.stack([np.cos(yaw), np.sin(yaw)], axis=1)
        axle = axle - drawbar * np.stack([np.cos(tail), np.sin(tail)], axis=1)
        route = each.world.guidance.path
        assert isinstance(route, CoverRoute)
        straight = _straight_for(_line_of(each, route) >= 0, each, 4.0 * drawbar)
        assert straight.sum() > 100
        # A hinge of a radian at most fades to a fiftieth over four drawbars.
        assert np.abs(cross_track_m(axle, each.line_m))[straight].max() < drawbar * 0.02 + _POSITION_M


def _line_of(each: Driven, route: CoverRoute) -> Any:
    arc_m = float(route.length_m) - each.to_go_m
    row = np.clip((arc_m / float(route.spacing_m)).astype(int), 0, int(route.count) - 1)
    return np.where(arc_m < 0.0, -1, np.asarray(route.line)[row])


def _straight_for(on_line: Bool[np.ndarray, " tick"], each: Driven, way_m: float) -> Bool[np.ndarray, " tick"]:
    """Ticks whose last metres were all on a line."""
    off = np.where(on_line, np.inf, each.to_go_m)
    straight: Bool[np.ndarray, " tick"] = np.minimum.accumulate(off) - each.to_go_m > way_m
    return straight
