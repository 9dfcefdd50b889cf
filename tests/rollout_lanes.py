"""Lanes that the tests of rollouts drive, and a tracker in float64 that shares no line with the package."""

from dataclasses import dataclass, field

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from scipy.optimize import brentq

from lgprjax.vehicle import (
    Chassis,
    Path,
    ProportionalRear,
    RolloutLane,
    RolloutState,
    Servo,
    constant_look_ahead,
    ideal_servo,
    start_rollout,
)

WHEELBASE_M, ANCHOR_M, RATIO, LARGEST_RAD = 3.8, 6.5, 0.63, 0.6


def chassis(
    ratio: float = RATIO, anchor_m: float = ANCHOR_M, v_char_mps: float = np.inf, largest_rad: float = LARGEST_RAD
) -> Chassis:
    rear = ProportionalRear(jnp.float32(ratio))
    numbers = (jnp.float32(value) for value in (WHEELBASE_M, anchor_m, largest_rad, v_char_mps))
    wheelbase, anchor, largest, v_char = numbers
    return Chassis(wheelbase, anchor, rear, largest, v_char)


def one_lane(
    look_ahead_m: float = 5.0,
    speed_mps: float = 4.47,
    *,
    true: Chassis | None = None,
    believed: Chassis | None = None,
    servo: Servo | None = None,
    supply_v: float = 1.0,
) -> RolloutLane:
    true = chassis() if true is None else true
    return RolloutLane(
        true,
        true if believed is None else believed,
        ideal_servo() if servo is None else servo,
        jnp.float32(supply_v),
        jnp.float32(speed_mps),
        constant_look_ahead(jnp.float32(look_ahead_m)),
    )


def begin(
    path: Path, lane: RolloutLane, offset_m: float = 0.0, arc_m: float = 0.0, *, delay_slots: int = 0
) -> RolloutState:
    numbers = (jnp.float32(arc_m), jnp.float32(offset_m), jnp.float32(0.0))
    return start_rollout(path, lane, *numbers, delay_slots=delay_slots)


@dataclass
class Plain:
    """One vehicle in float64: nearest of dense points, atan2 and brentq for the law, exact arcs by trigonometry.

    The servo is a lag, a rate and a dead band. ``curve`` is [point, 2], its points 1 mm apart.
    """

    curve: Float[np.ndarray, "point 2"]
    look_ahead_m: float
    speed_mps: float
    pose: tuple[float, float, float]
    v_char_mps: float = np.inf
    lag_s: float = 0.0
    rate_radps: float = np.inf
    dead_band_rad: float = 0.0
    anchor_m: float = ANCHOR_M
    ratio: float = RATIO
    step_s: float = 0.05
    wheel_rad: float = 0.0
    near: int = 0
    offsets: list[float] = field(default_factory=list)
    wheels: list[float] = field(default_factory=list)

    def run(self, steps: int) -> tuple[float, float, float]:
        for _ in range(steps):
            self.step()
        return self.pose

    def step(self) -> None:
        x, y, yaw = self.pose
        anchor = np.array([x + self.anchor_m * np.cos(yaw), y + self.anchor_m * np.sin(yaw)])
        low = max(self.near - 2000, 0)
        window = self.curve[low : self.near + 2000]
        self.near = low + int(np.argmin(np.hypot(*(window - anchor).T)))
        foot = self.curve[self.near]
        ahead = self.curve[min(self.near + 1, len(self.curve) - 1)] - self.curve[max(self.near - 1, 0)]
        ahead /= np.hypot(*ahead)
        # The foot's along-track rounding to a millimetre does not touch the distance across.
        self.offsets.append(float(ahead[0] * (anchor - foot)[1] - ahead[1] * (anchor - foot)[0]))
        goal = self.curve[self.near + round(1e3 * np.sign(self.speed_mps) * self.look_ahead_m)] - anchor
        gain = 1.0 / (1.0 + (self.speed_mps / self.v_char_mps) ** 2)
        wanted = self.law(float(np.hypot(*goal)), float(np.arctan2(goal[1], goal[0]) - yaw), gain)
        wrong = wanted - self.wheel_rad
        wrong = np.sign(wrong) * max(abs(wrong) - self.dead_band_rad, 0.0)
        moved = wrong * (1.0 - np.exp(-self.step_s / self.lag_s)) if self.lag_s else wrong
        most = self.rate_radps * self.step_s
        self.wheel_rad += min(max(moved, -most), most)
        self.wheels.append(self.wheel_rad)
        self.pose = self.arc(gain)

    def law(self, distance: float, bearing: float, gain: float) -> float:
        front = 0.5 * distance + self.anchor_m * np.cos(bearing)
        rear = 0.5 * distance + (self.anchor_m - WHEELBASE_M) * np.cos(bearing)

        def left_side(angle: float) -> float:
            value = front * np.tan(angle) + rear * np.tan(self.ratio * angle)
            return float(value - WHEELBASE_M * np.sin(bearing) / gain)

        if left_side(LARGEST_RAD) < 0.0:
            return LARGEST_RAD
        if left_side(-LARGEST_RAD) > 0.0:
            return -LARGEST_RAD
        return float(brentq(left_side, -LARGEST_RAD, LARGEST_RAD, xtol=1e-14))

    def arc(self, gain: float) -> tuple[float, float, float]:
        x, y, yaw = self.pose
        way = self.speed_mps * self.step_s
        behind = np.tan(self.ratio * self.wheel_rad)
        turn = gain * way * (np.tan(self.wheel_rad) + behind) / WHEELBASE_M
        # The integral of the body's velocity turned by the heading, by Gauss's rule of twenty points.
        node, weight = np.polynomial.legendre.leggauss(20)
        heading = yaw + turn * 0.5 * (1.0 + node)
        side = -gain * behind
        x += way * np.sum(0.5 * weight * (np.cos(heading) - side * np.sin(heading)))
        y += way * np.sum(0.5 * weight * (np.sin(heading) + side * np.cos(heading)))
        return float(x), float(y), float(yaw + turn)
