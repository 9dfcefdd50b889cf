"""A tractor with a trailer on routes and in fields: a vehicle that the package does not have; docs/own_vehicle.md."""

from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
from jaxtyping import Array, Bool, Float, Int, PRNGKeyArray

from lgprjax.autopilot import bounded, init_limiter, limit_command
from lgprjax.coverage import CarrotSettings, CarrotState, CoverRoute, init_carrot, pursuit_along
from lgprjax.navigation import PlannerState, RoutePath, acquire, find_starts, kalman, planner_settings, step_planner
from lgprjax.simulation.environment import init_env, run_env
from lgprjax.vehicle import Chassis, Turn, VehiclePose, drive_arc, steer_exact

Scalar = Float[Array, ""]
STEP_S, SETTINGS = 0.05, planner_settings(3.0)
NOISES = (0.004, 0.03, 0.004, 1e-5, 1e-5)  # of the filter: front angle, speed, sideways, offset and scale, per tick
GNSS_M, HINGE_RAD, GATE = 0.08, 0.02, 18.4


class TrailerCommand(NamedTuple):  # 1. command and limits
    front_rad: Scalar
    speed_mps: Scalar


class TrailerLimits(NamedTuple):
    front_rad: Scalar
    front_rate_radps: Scalar
    speed_mps: Scalar
    rate_mps2: Scalar
    oldest_s: Scalar

    def within(self, last: TrailerCommand, command: TrailerCommand, step_s: Scalar) -> tuple[TrailerCommand, Any]:
        front, steering = bounded(command.front_rad, last.front_rad, self.front_rad, self.front_rate_radps * step_s)
        speed, driving = bounded(command.speed_mps, last.speed_mps, self.speed_mps, self.rate_mps2 * step_s)
        return TrailerCommand(front, speed), (*steering, *driving)

    def default(self, last: TrailerCommand, step_s: Scalar) -> TrailerCommand:
        return last._replace(speed_mps=jnp.maximum(last.speed_mps - self.rate_mps2 * step_s, 0.0))


class Trailer(NamedTuple):  # 2. motion; states x, y, yaw of the rear axle, hinge angle (tractor minus trailer)
    chassis: Chassis
    hitch_m: Scalar  # behind the rear axle
    drawbar_m: Scalar  # hitch to trailer axle
    antenna_m: Scalar  # ahead of the rear axle
    limits: TrailerLimits


def along(yaw_rad: Scalar) -> Float[Array, "2"]:
    return jnp.stack([jnp.cos(yaw_rad), jnp.sin(yaw_rad)])


def motion(vehicle: Trailer, body: Float[Array, "4"], front_rad: Scalar, speed_mps: Scalar) -> Float[Array, "4"]:
    bend, hinge = jnp.tan(front_rad) / vehicle.chassis.wheelbase_m, body[3]
    pose = drive_arc(VehiclePose(*body[:3]), speed_mps * STEP_S, Turn(bend, jnp.zeros_like(bend)))
    towed = (jnp.sin(hinge) - vehicle.hitch_m * bend * jnp.cos(hinge)) / vehicle.drawbar_m
    return jnp.stack([*pose, hinge + (bend - towed) * speed_mps * STEP_S])


class Readings(NamedTuple):  # 3. filter; states of the motion, steering offset, scale of the wheel speed
    front_rad: Scalar
    speed_mps: Scalar
    hinge_rad: Scalar
    gnss_m: Float[Array, "2"]
    gnss_new: Bool[Array, ""]


def step_filter(vehicle: Trailer, before: kalman.Estimate, seen: Readings) -> kalman.Estimate:
    def move(mean: Float[Array, "6"], noise: Float[Array, "5"]) -> Float[Array, "6"]:
        speed = seen.speed_mps * (1.0 + mean[5]) + noise[1]
        body = motion(vehicle, mean[:4], seen.front_rad - mean[4] + noise[0], speed)
        return jnp.concatenate([body[:2] + noise[2] * along(body[2] + 0.5 * jnp.pi), body[2:], mean[4:] + noise[3:]])

    after = kalman.predict(before.covariance, kalman.linearise(move, before.mean, jnp.asarray(NOISES, jnp.float32)))
    for expect, observed, sigma, new in (
        (lambda mean: mean[:2] + vehicle.antenna_m * along(mean[2]), seen.gnss_m, GNSS_M, seen.gnss_new),
        (lambda mean: mean[3:4], seen.hinge_rad[None], HINGE_RAD, jnp.asarray(True)),
    ):
        noise = sigma**2 * jnp.eye(len(observed), dtype=jnp.float32)
        found = kalman.innovation_of(after.mean, expect, observed, noise, new)
        weighed = kalman.weigh(after, found)
        after = kalman.correct(after, found, weighed, new & (weighed.nis <= GATE))
    return kalman.wrapped(after)


class OnRoute(NamedTuple):  # 4. guidance on a route: wheels, largest speed, way to go
    path: RoutePath

    def steer(self, vehicle: Trailer, state: PlannerState, pose: VehiclePose, speed_mps: Scalar) -> tuple[Any, ...]:
        settings = SETTINGS._replace(look_ahead_m=2.0 + 1.2 * speed_mps)
        state, plan = step_planner(self.path, settings, vehicle.chassis, state, pose, speed_mps)
        front = steer_exact(vehicle.chassis, plan.ahead_m, plan.left_m, jnp.ones_like(speed_mps)).front_rad
        return state, TrailerCommand(front, plan.speed_limit_mps), plan.to_go_m


class InField(NamedTuple):  # 5. guidance in a field
    path: CoverRoute
    settings: CarrotSettings

    def steer(self, vehicle: Trailer, state: CarrotState, pose: VehiclePose, speed_mps: Scalar) -> tuple[Any, ...]:
        # At 1 m/s a yaw rate is a curvature.
        state, plan = pursuit_along(self.settings, self.path, state, pose, jnp.ones_like(speed_mps), STEP_S * speed_mps)
        front = jnp.arctan(vehicle.chassis.wheelbase_m * plan.yaw_rate_radps)
        return state, TrailerCommand(front, plan.speed_limit_mps), plan.to_go_m


class World(NamedTuple):  # 6. world: what the filter is not told: lags, slip, slow errors, offsets
    vehicle: Trailer
    guidance: OnRoute | InField
    lag_s: Scalar
    offset_rad: Scalar
    scale: Scalar

    def move(self, at: Any, command: TrailerCommand, tick: Int[Array, ""], key: PRNGKeyArray) -> tuple[Any, Readings]:
        (body, acting, slow_m), white = at, jax.random.normal(key, (8,))
        acting = jax.tree.map(lambda now, told: now + (told - now) * STEP_S / self.lag_s, acting, command)
        body = motion(self.vehicle, body, acting.front_rad * (1.0 - 0.002 * acting.speed_mps**2), acting.speed_mps)
        slip_m = 0.003 * jnp.sqrt(STEP_S * acting.speed_mps) * white[0]
        body = body.at[:2].add(slip_m * along(body[2] + 0.5 * jnp.pi))
        slow_m = slow_m * (1.0 - STEP_S / 60.0) + 0.02 * (2.0 * STEP_S / 60.0) ** 0.5 * white[1:3]
        gnss_m = body[:2] + self.vehicle.antenna_m * along(body[2]) + slow_m + 0.015 * white[3:5]
        front, speed = acting.front_rad + self.offset_rad, acting.speed_mps / (1.0 + self.scale)
        front, speed, hinge = jnp.stack([front, speed, body[3]]) + jnp.asarray([0.003, 0.02, 0.02]) * white[5:]
        return (body, acting, slow_m), Readings(front, speed, hinge, gnss_m, tick % 4 == 0)

    def decide(self, at: Any, onboard: tuple[Any, ...], seen: Readings) -> tuple[Any, ...]:
        estimate, state, limiter = onboard
        estimate = step_filter(self.vehicle, estimate, seen)
        pose, speed = VehiclePose(*estimate.mean[:3]), jnp.maximum(seen.speed_mps, 0.0)
        state, wanted, to_go_m = self.guidance.steer(self.vehicle, state, pose, speed)
        age_s, step_s = jnp.float32(0.0), jnp.float32(STEP_S)
        limiter, command, _ = limit_command(self.vehicle.limits, limiter, wanted, age_s, step_s)
        return (estimate, state, limiter), command, (at[0], estimate, command, to_go_m)


def drive(world: World, body: Float[Array, "4"], key: PRNGKeyArray, ticks: int) -> tuple[Any, ...]:
    """7. Drive from a true pose; true body, estimate, command and way to go of every tick."""
    begin, noise = jax.random.split(key)
    sigmas = jnp.asarray([0.3, 0.3, 0.1, 0.1, 0.02, 0.02], jnp.float32)
    mean = jnp.concatenate([body, jnp.zeros(2)]) + (sigmas * jax.random.normal(begin, (6,))).at[4:].set(0.0)
    still = TrailerCommand(jnp.float32(0.0), jnp.float32(0.0))
    state: PlannerState | CarrotState = init_carrot()
    if isinstance(world.guidance, OnRoute):
        starts = find_starts(world.guidance.path, SETTINGS, world.vehicle.chassis, VehiclePose(*mean[:3]))
        state = acquire(starts)[0]
    onboard = kalman.Estimate(mean, jnp.diag(sigmas**2)), state, init_limiter(still)
    return run_env(world, init_env((body, still, jnp.zeros(2)), onboard, still), noise, ticks)[1]
