"""Drives of a skid-steer vehicle over a field, drawn in float64 and apart from the filter's code.

Both sides are told what to do; the ground slips away under each, the body slides about a point that is not its
midpoint, the wheels read too much, the INS drifts, and fixes come late, out of step with everything, with an error that
partly stays. Runs go through the same motions with their own errors.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.navigation import DeltaHeading, GnssObservation, SkidMotion, SkidObservations

TRACK_M, ANTENNA_X_M, ANTENNA_Y_M = 1.2, 0.35, -0.2
FIX_SIGMA_M, SLOW_SHARE, SLOW_S = 0.02, 0.4, 60.0
INS_NOISE_RAD, INS_DRIFT_RADPS = 3e-5, 1.8e-5
SLIP_SIGMA, SLIP_M, SCALE_SIGMA, TURN_SIGMA, SLIDE_SIGMA_M = 0.015, 10.0, 0.02, 0.12, 0.08
WANDER, ASIDE, ALONG, WHEEL_NOISE_MPS = 0.004, 0.005, 0.003, 0.003
Runs = Float[np.ndarray, " run"]


class FieldDrives(NamedTuple):
    """Drives of equal length.

    Attributes:
        truth: x, y and yaw of the midpoint after each tick; the yaw as driven.
        start_m: about where each began.
        fixes: whether GNSS is heard at all at a tick.
        motions, observations: leading axes tick and run.
    """

    truth: Float[np.ndarray, "tick run 3"]
    start_m: Float[np.ndarray, "run 2"]
    fixes: Bool[np.ndarray, " tick"]
    motions: SkidMotion
    observations: SkidObservations


def field_wheels(seconds: float, step_s: float) -> Float[np.ndarray, "tick 2"]:
    """Speeds of both sides: standing, straight, then lines of 20 m at 0.5 m/s and half turns of 2 m radius."""
    legs = [(3.0, 0.0, 0.0), (22.0, 0.4, 0.0)]
    turns = 0
    while sum(leg[0] for leg in legs) < seconds:
        legs += [(40.0, 0.5, 0.0), (2.0 * np.pi / 0.45, 0.45, 0.5 if turns % 5 else -0.5)]
        turns += 1
    ticks = round(seconds / step_s)
    time = np.arange(ticks) * step_s
    ends = np.cumsum([leg[0] for leg in legs])
    leg = np.minimum(np.searchsorted(ends, time, side="right"), len(legs) - 1)
    speed, curvature = (np.array([each[part] for each in legs])[leg] for part in (1, 2))
    # A line is never quite straight: the operator weaves a little.
    weave = 0.01 * np.sin(0.4 * time) * (curvature == 0.0)
    wheels = np.stack([1.0 - (curvature + weave) * TRACK_M / 2, 1.0 + (curvature + weave) * TRACK_M / 2], axis=1)
    wheels = wheels * speed[:, None]
    # Wheels take a second to follow.
    width = max(round(1.0 / step_s), 1)
    padded = np.concatenate([np.zeros((width - 1, 2)), wheels])
    return np.stack([np.convolve(padded[:, side], np.full(width, 1.0 / width), "valid") for side in (0, 1)], axis=1)


def draw_field_drives(
    *, runs: int, seconds: float, seed: int, step_s: float = 0.05, off_s: float = 30.0, every_s: float = 90.0
) -> FieldDrives:
    """Drives over a field with GNSS off for the last ``off_s`` of every ``every_s``."""
    rng = np.random.default_rng(seed)
    wheels = field_wheels(seconds, step_s)
    ticks = len(wheels)
    pose = np.stack([rng.uniform(-20, 20, runs), rng.uniform(-20, 20, runs), rng.uniform(-np.pi, np.pi, runs)], axis=1)
    start = pose[:, :2] + rng.normal(0.0, 0.5, (runs, 2))
    slip = SLIP_SIGMA * rng.standard_normal((runs, 2))
    scale, turn_scale = SCALE_SIGMA * rng.standard_normal(runs), TURN_SIGMA * rng.standard_normal(runs)
    slide = SLIDE_SIGMA_M * rng.standard_normal(runs)
    drift = INS_DRIFT_RADPS * rng.choice([-1.0, 1.0], runs)
    slow = np.sqrt(SLOW_SHARE) * FIX_SIGMA_M * rng.standard_normal((runs, 2))
    fix_phase, ins_phase_s = rng.integers(0, round(1.0 / step_s), runs), rng.uniform(0.0, 0.003, runs)
    heard_yaw = pose[:, 2].copy()
    ins_every = round(0.1 / step_s)
    keep_slow = np.exp(-step_s / SLOW_S)
    time = (np.arange(ticks) + 1) * step_s
    on = (time % every_s) < every_s - off_s
    truth, read, fixes, deltas = [], [], [], []
    for tick in range(ticks):
        moved = np.abs(wheels[tick]) * step_s
        keep = np.exp(-moved / SLIP_M)
        slip = keep * slip + SLIP_SIGMA * np.sqrt(1.0 - keep**2) * rng.standard_normal((runs, 2))
        ground = wheels[tick] * (1.0 - slip)
        speed, way = ground.mean(axis=1), moved.mean()
        rate = (ground[:, 1] - ground[:, 0]) / TRACK_M * (1.0 + turn_scale)
        noise = np.sqrt(way) * rng.standard_normal((runs, 3))
        before = pose
        pose = _driven(pose, speed * step_s, rate * step_s + WANDER * noise[:, 0], slide)
        rate = (pose[:, 2] - before[:, 2]) / step_s
        cos, sin = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        pose[:, 0] += ALONG * noise[:, 1] * cos - ASIDE * noise[:, 2] * sin
        pose[:, 1] += ALONG * noise[:, 1] * sin + ASIDE * noise[:, 2] * cos
        slow = keep_slow * slow + np.sqrt(SLOW_SHARE * (1.0 - keep_slow**2)) * FIX_SIGMA_M * rng.standard_normal(
            (runs, 2)
        )
        truth.append(pose.copy())
        read.append(wheels[tick] * (1.0 + scale[:, None]) + WHEEL_NOISE_MPS * rng.standard_normal((runs, 2)))
        # A fix is a tenth of a second old, give or take; it comes once a second, not at the same tick in every run.
        age = rng.uniform(0.05, 0.15, runs)
        then = _driven(pose, -age * speed, -age * rate, slide)
        cos, sin = np.cos(then[:, 2]), np.sin(then[:, 2])
        fix = then[:, :2] + np.stack(
            [cos * ANTENNA_X_M - sin * ANTENNA_Y_M, sin * ANTENNA_X_M + cos * ANTENNA_Y_M], axis=1
        )
        fix = fix + slow + np.sqrt(1.0 - SLOW_SHARE) * FIX_SIGMA_M * rng.standard_normal((runs, 2))
        comes = on[tick] & ((tick + fix_phase) % round(1.0 / step_s) == 0) & (rng.uniform(size=runs) < 0.97)
        fix[~comes] = np.nan
        fixes.append((fix, age, comes))
        speaks = (tick + 1) % ins_every == 0
        ends = pose[:, 2] - ins_phase_s * rate
        turn = ends - heard_yaw + drift * ins_every * step_s + INS_NOISE_RAD * rng.standard_normal(runs)
        # What gets lost on the line is lost: the next one does not make up for it.
        deltas.append((np.where(speaks, turn, np.nan), np.full(runs, speaks) & (rng.uniform(size=runs) < 0.995)))
        heard_yaw = ends if speaks else heard_yaw
    return FieldDrives(np.stack(truth), start, on, *_given(np.stack(read), fixes, deltas, step_s, ins_every))


def _driven(pose: Float[np.ndarray, "run 3"], way: Runs, turn: Runs, slide: Runs) -> Float[np.ndarray, "run 3"]:
    """Along an arc on which the point ``slide`` ahead of the midpoint does not move aside."""
    yaw, after = pose[:, 2], pose[:, 2] + turn
    chord = way * np.sinc(turn / (2.0 * np.pi))
    x = pose[:, 0] + slide * (np.cos(yaw) - np.cos(after)) + chord * np.cos(yaw + turn / 2.0)
    y = pose[:, 1] + slide * (np.sin(yaw) - np.sin(after)) + chord * np.sin(yaw + turn / 2.0)
    return np.stack([x, y, after], axis=1)


def _given(
    read: Float[np.ndarray, "tick run 2"],
    fixes: list[tuple[np.ndarray, np.ndarray, np.ndarray]],
    deltas: list[tuple[np.ndarray, np.ndarray]],
    step_s: float,
    ins_every: int,
) -> tuple[SkidMotion, SkidObservations]:
    shape = read.shape[:2]
    place, age, comes = (np.stack(part) for part in zip(*fixes, strict=True))
    turn, speaks = (np.stack(part) for part in zip(*deltas, strict=True))
    single = jnp.float32
    motion = SkidMotion(single(read[..., 0]), single(read[..., 1]), jnp.full(shape, step_s, single))
    covariance = np.broadcast_to(FIX_SIGMA_M**2 * np.eye(2), (*shape, 2, 2))
    gnss = GnssObservation(
        single(place[..., 0]), single(place[..., 1]), single(covariance), single(age), jnp.asarray(comes)
    )
    delta = DeltaHeading(single(turn), jnp.full(shape, ins_every * step_s, single), jnp.asarray(speaks))
    return motion, SkidObservations(gnss, delta)
