"""The whole step in closed loop on a winding route: vehicles with servo and pedals, each lane with its own trouble."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Float, Int

from lgprjax.autopilot import (
    AutopilotConfig,
    AutopilotInfo,
    AutopilotInputs,
    AutopilotState,
    Command,
    Limited,
    LimiterRules,
    default_velocity,
    init_autopilot,
    step_autopilot,
)
from lgprjax.navigation import (
    PlanCode,
    PlannerState,
    Reaction,
    RoutePath,
    RouteSpeeds,
    lost_planner,
    make_route_path,
    planner_settings,
)
from lgprjax.vehicle import (
    LookAhead,
    Servo,
    ServoState,
    VehiclePose,
    drive_arc,
    ideal_servo,
    init_drive,
    init_servo,
    path_from_curvature,
    step_drive,
    step_servo,
    turn_of,
    yaw_gain,
)
from made_up_pedals import pedals_with
from rollout_lanes import ANCHOR_M, chassis

STEP_S, STEPS = 0.05, 1300
SPEED_MPS = 4.47
FRONT_RATE_RADPS = 0.5
CHASSIS = chassis(v_char_mps=20.0)
RULES = LimiterRules(*(jnp.float32(value) for value in (0.6, FRONT_RATE_RADPS, 1.0, 2.0, 0.2, 0.4, 0.05)))
PEDALS = pedals_with()
CONFIG = AutopilotConfig(
    CHASSIS,
    PEDALS,
    LookAhead(*(jnp.float32(value) for value in (3.0, 5.0, 1.0, 6.0))),
    planner_settings(5.0),
    default_velocity(),
    RULES,
)


def winding_route() -> RoutePath:
    """40 m straight, left and right with radii of 30 and 40 m, and straight again: 230 m."""
    parts = [(0.0, 40.0), (1.0 / 30.0, 40.0), (0.0, 20.0), (-1.0 / 40.0, 50.0), (0.0, 80.0)]
    # Curvature does not jump: it changes over 12 m, as where a driver turned the wheel in some two seconds.
    bend = np.concatenate([np.full(round(length / 0.25), curvature) for curvature, length in parts])
    bend = np.convolve(np.pad(bend, 24, mode="edge"), np.full(48, 1.0 / 48.0), mode="same")[24:-24]
    return make_route_path([path_from_curvature(bend)], [1], CHASSIS, RouteSpeeds(cruise_mps=6.0))


class Told(NamedTuple):
    """What a lane is told at each step beside its true pose and speed."""

    bad_pose: Float[np.ndarray, "step lane"]
    bad_speed: Float[np.ndarray, "step lane"]
    reaction: Float[np.ndarray, "step lane"]
    speed_cap_mps: Float[np.ndarray, "step lane"]
    age_s: Float[np.ndarray, "step lane"]
    steering: Float[np.ndarray, "step lane"]
    speed: Float[np.ndarray, "step lane"]


class Driven(NamedTuple):
    """What came of it."""

    front_rad: Float[np.ndarray, "step lane"]
    throttle: Float[np.ndarray, "step lane"]
    brake: Float[np.ndarray, "step lane"]
    limited: Int[np.ndarray, "step lane"]
    offset_m: Float[np.ndarray, "step lane"]
    speed_mps: Float[np.ndarray, "step lane"]
    way_m: Float[np.ndarray, "step lane"]
    code: Int[np.ndarray, "step lane"]
    wheel_rad: Float[np.ndarray, "step lane"]
    wanted_mps: Float[np.ndarray, "step lane"]


class Vehicle(NamedTuple):
    """The plant of one lane."""

    pose: VehiclePose
    servo: ServoState
    drive: object
    way_m: Float[Array, ""]


LANES = ("usual", "stop", "bad pose", "stop without speed", "late", "capped", "stale")
ENGAGES_S, TROUBLE_S = 6.0, 20.0


def at(time_s: float) -> int:
    return round(time_s / STEP_S)


def tell() -> Told:
    count = (STEPS, len(LANES))
    zero, one = np.zeros(count), np.ones(count)
    told = Told(zero.copy(), zero.copy(), zero.copy(), np.full(count, np.inf), 0.05 * one, one.copy(), one.copy())
    lane = {name: number for number, name in enumerate(LANES)}
    told.reaction[at(TROUBLE_S) :, [lane["stop"], lane["stop without speed"]]] = Reaction.STOP
    told.bad_pose[at(TROUBLE_S) :, lane["bad pose"]] = np.nan
    told.bad_speed[at(TROUBLE_S) :, lane["stop without speed"]] = np.nan
    told.steering[: at(ENGAGES_S), lane["late"]] = 0.0
    told.reaction[at(TROUBLE_S) :, lane["capped"]] = Reaction.DEGRADE
    told.speed_cap_mps[at(TROUBLE_S) :, lane["capped"]] = 2.0
    told.age_s[at(TROUBLE_S) :, lane["stale"]] = 0.21
    return told


@jax.jit
def drive(route: RoutePath, servo: Servo, told: Float[Array, "step 7 lane"], wheel_rad: Float[Array, " lane"]):  # type: ignore[no-untyped-def]
    """All lanes from 2 m beside the route's start."""

    def one(wheel, signals):  # type: ignore[no-untyped-def]
        zero = jnp.float32(0.0)
        pose = VehiclePose(zero - ANCHOR_M, zero + 2.0, zero)
        planner = lost_planner()._replace(pose=pose, code=jnp.int32(PlanCode.FOLLOWING))
        start = init_autopilot(planner, jnp.float32(SPEED_MPS), wheel)
        vehicle = Vehicle(pose, init_servo(wheel), init_drive(jnp.float32(SPEED_MPS)), zero)

        def step(carry, now):  # type: ignore[no-untyped-def]
            vehicle, state = carry
            seen = vehicle.pose._replace(x_m=vehicle.pose.x_m + now[0])
            inputs = AutopilotInputs(
                seen,
                vehicle.drive.speed_mps + now[1],
                now[2].astype(jnp.int32),
                now[3],
                now[4],
                now[5] > 0.0,
                now[6] > 0.0,
                jnp.float32(SPEED_MPS),
                vehicle.servo.wheel_rad,
            )
            state, sent, info = step_autopilot(CONFIG, route, state, inputs, jnp.float32(STEP_S))
            wheels = step_servo(vehicle.servo, servo, sent.front_rad, 1.0, STEP_S)
            drive, way = step_drive(vehicle.drive, PEDALS, sent.throttle, sent.brake, STEP_S)
            gain = yaw_gain(CHASSIS.characteristic_speed_mps, drive.speed_mps)
            pose = drive_arc(vehicle.pose, way, turn_of(CHASSIS, wheels.wheel_rad), gain)
            kept = (*sent, info.limited, info.plan.offset_m, drive.speed_mps, vehicle.way_m + way, info.plan.code)
            return (Vehicle(pose, wheels, drive, vehicle.way_m + way), state), (
                *kept,
                vehicle.servo.wheel_rad,
                info.wanted_mps,
            )

        return jax.lax.scan(step, (vehicle, start), signals)[1]

    return jax.vmap(one, in_axes=(0, 2), out_axes=1)(wheel_rad, told)  # type: ignore[no-untyped-call]


@pytest.fixture(scope="module")
def driven() -> dict[str, Driven]:
    told = jnp.asarray(np.stack(tell(), axis=1), jnp.float32)
    wheels = jnp.asarray([0.1 * (name == "late") for name in LANES], jnp.float32)
    found = drive(winding_route(), ideal_servo(lag_s=0.15, rate_radps=0.6), told, wheels)
    parts = [np.asarray(part) for part in found]
    return {name: Driven(*(part[:, number] for part in parts)) for number, name in enumerate(LANES)}


def test_two_metres_aside_converge_below_ten_centimetres_and_stay_there_round_bends(driven: dict[str, Driven]) -> None:
    usual = driven["usual"]
    following = usual.code == PlanCode.FOLLOWING
    late = following & (usual.way_m > 35.0)
    assert usual.way_m[following].max() > 220.0
    assert np.abs(usual.offset_m[late]).max() < 0.10
    # Half way over within two look-aheads and a half.
    assert np.abs(usual.offset_m[usual.way_m < 14.0]).min() < 1.0
    assert np.abs(usual.speed_mps[late & (usual.way_m < 190.0)] - SPEED_MPS).max() < 0.1


def test_at_the_end_it_stands_and_holds(driven: dict[str, Driven]) -> None:
    usual = driven["usual"]
    assert usual.code[-1] == PlanCode.DONE
    assert usual.speed_mps[-1] == 0.0
    assert (usual.throttle[-1], usual.brake[-1]) == (0.0, np.float32(0.4))


def test_no_command_ever_steps_further_than_the_rates(driven: dict[str, Driven]) -> None:
    for name, lane in driven.items():
        engaged = np.arange(STEPS) >= (at(ENGAGES_S) if name == "late" else 0)
        before = np.concatenate([lane.wheel_rad[:1], lane.front_rad[:-1]])
        assert np.abs(lane.front_rad - before)[engaged].max() <= FRONT_RATE_RADPS * STEP_S * (1.0 + 1e-5), name
        assert np.diff(lane.throttle).max() <= 1.0 * STEP_S * (1.0 + 1e-5), name
        assert np.diff(lane.brake).max() <= 2.0 * STEP_S * (1.0 + 1e-5), name


def stop_way_m(speed_mps: float) -> float:
    """Way of a stop whose deceleration rises at 1.5 m/s³ to 1.5 m/s² behind a brake's lag of 0.25 s."""
    speed, way, brake, asked, step = speed_mps, 0.0, 0.0, 0.0, 1e-3
    while speed > 0.0:
        resisted = 0.15 + 0.03 * speed
        asked = min(asked + 1.5 * step, 1.5 - resisted)
        brake += (asked - brake) * step / 0.25
        way += speed * step
        speed -= (brake + resisted) * step
    return way


def test_a_stop_in_a_bend_stands_in_time_and_on_the_path(driven: dict[str, Driven]) -> None:
    lane, begin = driven["stop"], at(TROUBLE_S)
    assert (lane.throttle[begin:] == 0.0).all()
    expected = stop_way_m(float(lane.speed_mps[begin - 1]))
    # The throttle's last effect fades with its lag, and the brake's slack is taken up at the limiter's rate.
    assert lane.way_m[-1] - lane.way_m[begin - 1] == pytest.approx(expected, rel=0.08)
    assert lane.speed_mps[-1] == 0.0
    assert np.abs(lane.offset_m[begin:]).max() < 0.10
    assert (lane.wanted_mps[begin:] == 0.0).all()
    assert (np.diff(lane.brake[begin:]) > -1e-6).all()
    assert (lane.limited[begin:] & Limited.MANUAL_REQUESTED == 0).all()


def test_a_stop_needs_no_speed(driven: dict[str, Driven]) -> None:
    lane, begin = driven["stop without speed"], at(TROUBLE_S)
    assert lane.speed_mps[-1] == 0.0
    assert lane.way_m[-1] - lane.way_m[begin - 1] < stop_way_m(float(lane.speed_mps[begin - 1])) * 1.08
    assert np.abs(lane.offset_m[begin:]).max() < 0.10
    assert (lane.limited[begin:] & Limited.MANUAL_REQUESTED == 0).all()


@pytest.mark.parametrize(("name", "why"), [("bad pose", Limited.NOT_FINITE), ("stale", Limited.STALE)])
def test_a_pose_that_is_none_or_old_is_bridged_once_and_then_fails_safe(
    driven: dict[str, Driven], name: str, why: Limited
) -> None:
    lane, begin = driven[name], at(TROUBLE_S)
    sent = np.stack([lane.front_rad, lane.throttle, lane.brake])
    np.testing.assert_array_equal(sent[:, begin], sent[:, begin - 1])
    assert lane.limited[begin] == why
    assert (lane.limited[begin + 1 :] == why | Limited.MANUAL_REQUESTED).all()
    assert (lane.throttle[begin + 1 :] == 0.0).all()
    assert lane.brake[begin + 1] == pytest.approx(2.0 * STEP_S, abs=1e-6)
    assert lane.brake[begin + 5] == np.float32(0.4)
    turned = np.diff(np.abs(lane.front_rad[begin:]))
    assert turned.max() <= 0.0
    assert turned.min() >= -0.05 * STEP_S * (1.0 + 1e-4)
    assert lane.speed_mps[-1] == 0.0


def test_engaging_starts_from_where_the_wheels_are(driven: dict[str, Driven]) -> None:
    lane, begin = driven["late"], at(ENGAGES_S)
    np.testing.assert_array_equal(lane.front_rad[:begin], lane.wheel_rad[:begin])
    assert (lane.throttle[:begin] == 0.0).all()
    assert (lane.brake[:begin] == 0.0).all()
    assert (lane.limited[:begin] == 0).all()
    assert abs(lane.front_rad[begin] - lane.wheel_rad[begin]) <= FRONT_RATE_RADPS * STEP_S * (1.0 + 1e-5)


def test_a_cap_is_kept(driven: dict[str, Driven]) -> None:
    lane = driven["capped"]
    assert np.abs(lane.speed_mps[at(TROUBLE_S + 8.0) : at(TROUBLE_S + 20.0)] - 2.0).max() < 0.1
    assert (lane.wanted_mps[at(TROUBLE_S) :] <= 2.0).all()


@jax.jit
def one_step(
    config: AutopilotConfig, route: RoutePath, state: AutopilotState, inputs: AutopilotInputs
) -> tuple[Command, AutopilotInfo]:
    return step_autopilot(config, route, state, inputs, jnp.float32(STEP_S))[1:]


class Sent(NamedTuple):
    """A command as plain numbers."""

    front_rad: float
    throttle: float
    brake: float


WHEELS = Sent(0.0, 0.0, 0.0)


def command(
    planner: PlannerState | None = None, wheel_rad: float = 0.1, config: AutopilotConfig = CONFIG, **told: float | bool
) -> tuple[Sent, int]:
    """One step on the route's straight start, all engaged, at speed; ``told`` replaces inputs."""
    zero = jnp.float32(0.0)
    pose = VehiclePose(zero - ANCHOR_M + 10.0, zero, zero)
    usual = lost_planner()._replace(pose=pose, arc_m=jnp.float32(10.0), code=jnp.int32(PlanCode.FOLLOWING))
    state = init_autopilot(planner or usual, jnp.float32(SPEED_MPS), jnp.float32(wheel_rad))
    numbers = {"speed_mps": SPEED_MPS, "speed_cap_mps": np.inf, "age_s": 0.0, "set_speed_mps": SPEED_MPS} | {
        name: value for name, value in told.items() if name.endswith("_mps")
    }
    inputs = AutopilotInputs(
        pose_route=pose,
        reaction=jnp.int32(told.get("reaction", Reaction.CONTINUE)),
        steering_engaged=jnp.asarray(told.get("steering_engaged", True)),
        speed_engaged=jnp.asarray(told.get("speed_engaged", True)),
        front_rad=jnp.float32(told.get("front_rad", wheel_rad)),
        **{name: jnp.float32(value) for name, value in numbers.items()},
    )
    sent, info = one_step(config, winding_route(), state, inputs)
    return Sent(*(float(part) for part in sent)), int(info.limited)


def test_rolling_against_the_gear_brakes() -> None:
    sent, _ = command(speed_mps=-0.5)
    assert sent.throttle == 0.0
    assert sent.brake > 0.0
    sent, _ = command(speed_mps=0.5)
    assert (sent.throttle > 0.0, sent.brake) == (True, 0.0)


def test_with_no_place_on_the_route_the_wheels_stay_and_the_vehicle_slows() -> None:
    sent, _ = command(planner=lost_planner(), wheel_rad=0.1)
    assert sent.front_rad == np.float32(0.1)
    assert sent.throttle == 0.0
    assert command(wheel_rad=0.1)[0].front_rad < 0.1


def test_the_command_makes_up_for_dead_band_and_play_where_it_steers() -> None:
    """On the path and straight, with wheels to the left: the law wants them back, and the command leads that way."""
    loose = CONFIG._replace(slack_rad=jnp.float32(0.005))
    plain, leading = (command(wheel_rad=0.01, config=config)[0].front_rad for config in (CONFIG, loose))
    # As fast as the limiter lets it: 0.01 rad in a step.
    assert plain == pytest.approx(0.0, abs=1e-6)
    assert leading == pytest.approx(-0.005, abs=1e-6)
    kept, _ = command(planner=lost_planner(), wheel_rad=0.1, config=loose)
    assert kept.front_rad == np.float32(0.1)
    free, _ = command(wheel_rad=0.1, config=loose, steering_engaged=False, front_rad=0.07)
    assert free.front_rad == np.float32(0.07)


def test_a_speed_that_is_no_number_is_a_bad_command_but_in_a_stop() -> None:
    for sent, limited in (command(speed_mps=np.nan), command(set_speed_mps=np.nan)):
        assert limited == Limited.NOT_FINITE
        assert sent == WHEELS._replace(front_rad=float(np.float32(0.1)))
    assert command(speed_mps=np.nan, reaction=Reaction.STOP)[1] & Limited.NOT_FINITE == 0


def test_with_steering_alone_the_pedals_are_the_operators() -> None:
    sent, limited = command(speed_engaged=False)
    assert (sent.throttle, sent.brake) == (0.0, 0.0)
    assert sent.front_rad < 0.1
    assert limited == Limited.FRONT_RATE
    # A controlled stop takes the brake there too.
    assert command(speed_engaged=False, reaction=Reaction.STOP)[0].brake > 0.0


def test_not_engaged_nothing_is_told_and_wheels_that_are_not_known_are_not_believed() -> None:
    sent, limited = command(steering_engaged=False, front_rad=-0.2, reaction=Reaction.STOP)
    assert sent == WHEELS._replace(front_rad=float(np.float32(-0.2)))
    assert limited == 0
    assert command(steering_engaged=False, front_rad=np.nan)[0].front_rad == np.float32(0.1)
