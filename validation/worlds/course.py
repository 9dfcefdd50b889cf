"""Routes and drives of a world as geometry: where the body, and every antenna, truly is at every moment.

East and north in metres about the world's anchor; headings as yaw, counter-clockwise from east.
"""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from validation.worlds.parameters import World

_STEP_M = 0.02
_BEYOND_M = 8.0
_CLOCK_HZ = 200.0

Array1 = Float[np.ndarray, " any"]


class Centreline(NamedTuple):
    """A route's middle, densely: along it, place, direction and curvature (left positive)."""

    at_m: Array1
    east_m: Array1
    north_m: Array1
    yaw: Array1
    curvature: Array1

    def place(self, at_m: np.ndarray, left_m: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """East, north and the route's direction at points ``left_m`` beside it."""
        yaw = np.interp(at_m, self.at_m, self.yaw)
        east = np.interp(at_m, self.at_m, self.east_m) - left_m * np.sin(yaw)
        north = np.interp(at_m, self.at_m, self.north_m) + left_m * np.cos(yaw)
        return east, north, yaw

    def foot(self, east_m: np.ndarray, north_m: np.ndarray, guess_m: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """How far along the route points lie, and how far to its left: Newton from a guess within the bend."""
        at = np.array(guess_m, dtype=float)
        left = np.zeros_like(at)
        for _ in range(6):
            foot_east, foot_north, yaw = self.place(at, np.zeros_like(at))
            away_east, away_north = east_m - foot_east, north_m - foot_north
            left = away_north * np.cos(yaw) - away_east * np.sin(yaw)
            ahead = away_east * np.cos(yaw) + away_north * np.sin(yaw)
            at += ahead / np.maximum(1.0 - np.interp(at, self.at_m, self.curvature) * left, 0.3)
        return at, left


class Motion(NamedTuple):
    """The body origin's true motion on a fast clock, and the antennas' at every scan.

    Attributes:
        time_s, at_m, east_m, north_m, yaw, roll, height_m, travel_m: of the body; ``height_m`` is the array's.
        scan_time_s: of the recorded scans.
        antenna_m: east, north and height above the ground of every antenna at its own moment.
        antenna_at_m, antenna_left_m: along the route and to its left.
    """

    time_s: Array1
    at_m: Array1
    east_m: Array1
    north_m: Array1
    yaw: Array1
    roll: Array1
    height_m: Array1
    travel_m: Array1
    scan_time_s: Array1
    antenna_m: Float[np.ndarray, "scan channel 3"]
    antenna_at_m: Float[np.ndarray, "scan channel"]
    antenna_left_m: Float[np.ndarray, "scan channel"]


def centreline_of(world: World) -> Centreline:
    """Straight, one arc, or an S whose curvature swings between both signs of the least radius."""
    at = np.arange(-_BEYOND_M, world.route_m + _BEYOND_M + _STEP_M, _STEP_M)
    rng = np.random.default_rng([world.seed, 1])
    start, side = rng.uniform(-np.pi, np.pi), rng.choice([-1.0, 1.0])
    tightest = 0.0 if world.bend == "straight" else side / world.radius_m
    curvature = tightest * (np.sin(2.0 * np.pi * at / world.route_m) if world.bend == "s" else np.ones_like(at))
    yaw = start + _integral(curvature)
    return Centreline(at, _integral(np.cos(yaw)), _integral(np.sin(yaw)), yaw, curvature)


def wander(rng: np.random.Generator, count: int, steps: float) -> Array1:
    """Smooth Gaussian noise of unit variance, its correlation falling to exp(-1/4) within ``steps`` samples."""
    pad = int(4 * steps) + 1
    noise = gaussian_filter1d(rng.standard_normal(count + 2 * pad), max(steps, 1e-3))[pad : pad + count]
    return np.asarray(noise * np.sqrt(2.0 * np.sqrt(np.pi) * max(steps, 0.3)))


def antenna_offsets(world: World) -> tuple[Array1, Array1, Array1]:
    """Forward and left place of each antenna in the body frame, and its delay within a scan."""
    index = np.arange(world.channels)
    left = (0.5 * (world.channels - 1) - index) * world.pitch_m
    period_s = world.scan_spacing_m / world.speed_mps
    delay = 0.8 * period_s * index / world.channels if world.channels >= 6 else np.zeros(world.channels)
    return np.full(world.channels, world.antenna_x_m), left, delay


def drive_along(
    world: World, line: Centreline, rng: np.random.Generator, left_m: float, weave_m: float, from_m: float, to_m: float
) -> Motion:
    """One drive beside the route's middle: speed within a tenth, weaving, bouncing and rolling; some scans dropped."""
    seconds = (to_m - from_m) / world.speed_mps * 1.3
    time = np.arange(0.0, seconds, 1.0 / _CLOCK_HZ)
    smooth = 4.0 * _CLOCK_HZ / world.speed_mps
    speed = world.speed_mps * np.clip(1.0 + 0.04 * wander(rng, len(time), smooth), 0.85, 1.15)
    at = from_m + np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]) / _CLOCK_HZ)])
    length, phase = rng.uniform(18.0, 30.0), rng.uniform(0.0, 2.0 * np.pi)
    wave = 2.0 * np.pi / length
    beside = left_m + weave_m * np.sin(wave * at + phase)
    slope = weave_m * wave * np.cos(wave * at + phase)
    east, north, direction = line.place(at, beside)
    bend = np.interp(at, line.at_m, line.curvature)
    yaw = direction + np.arctan2(slope, 1.0 - bend * beside)
    bounce = _CLOCK_HZ / world.speed_mps
    lift = world.bounce_m * wander(rng, len(time), 0.5 * bounce)
    height = world.height_m + np.maximum(lift, -0.8 * world.height_m)
    roll = np.radians(world.roll_deg) * wander(rng, len(time), 0.8 * bounce)
    travel = np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(east), np.diff(north)))])
    scan_time = _scan_times(world, rng, time[0] + 0.2, np.interp(to_m, at, time))
    x, y, delay = antenna_offsets(world)
    moment = scan_time[:, None] + delay
    now = [np.interp(moment, time, value) for value in (east, north, yaw, height, roll, at)]
    antenna_east = now[0] + x * np.cos(now[2]) - y * np.sin(now[2])
    antenna_north = now[1] + x * np.sin(now[2]) + y * np.cos(now[2])
    antenna_height = np.maximum(now[3] + y * np.sin(now[4]), 0.005)
    foot, left = line.foot(antenna_east, antenna_north, now[5] + x)
    antenna = np.stack([antenna_east, antenna_north, antenna_height], axis=-1)
    return Motion(time, at, east, north, yaw, roll, height, travel, scan_time, antenna, foot, left)


def _scan_times(world: World, rng: np.random.Generator, start_s: float, stop_s: float) -> Array1:
    """Evenly in time, a hundredth of them missing, a few at once."""
    times = np.arange(start_s, stop_s, world.scan_spacing_m / world.speed_mps)
    lost = np.zeros(len(times), dtype=bool)
    for first in rng.integers(20, max(len(times) - 20, 21), size=max(len(times) // 300, 1)):
        lost[first : first + rng.integers(1, 6)] = True
    return times[~lost]


def _integral(rate: Array1) -> Array1:
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1]) * _STEP_M)])
