"""Drives of a hand cart, drawn in float64 and apart from the filter's code: GNSS alone is heard of them.

People pull it along lines at 0.11 to 0.45 m/s (MF), weave, walk in surges, stop now and then, and turn at a line's end:
along an arc, or on the spot. The ground lets it crab. Runs go their own ways; all have the same length.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.navigation import GnssObservation

ANTENNA_X_M, ANTENNA_Y_M = 0.3, 0.1
FIX_SIGMA_M, SLOW_SHARE, SLOW_S = 0.02, 0.4, 60.0
SLOWEST_MPS, FASTEST_MPS = 0.11, 0.45
STEP_S = 0.1


class CartDrives(NamedTuple):
    """Drives of equal length; leading axes run and tick.

    Attributes:
        truth: x, y and yaw of the axle's middle after each tick.
        on_line: on a line, not in a turn, and moving.
        start_m: about where each began.
        step_s, fixes: as the filter takes them.
    """

    truth: Float[np.ndarray, "run tick 3"]
    on_line: Bool[np.ndarray, "run tick"]
    start_m: Float[np.ndarray, "run 2"]
    step_s: Float[np.ndarray, "run tick"]
    fixes: GnssObservation


def draw_cart_drives(
    *,
    runs: int,
    seconds: float,
    seed: int,
    on_the_spot: bool,
    off_s: float = 0.0,
    every_s: float = 90.0,
    fix_sigma_m: float = FIX_SIGMA_M,
) -> CartDrives:
    """Drives of lines of 20 m, with GNSS off for the last ``off_s`` of every ``every_s``."""
    rng = np.random.default_rng(seed)
    drawn = [_drive(rng, round(seconds / STEP_S), on_the_spot) for _ in range(runs)]
    truth, line = np.stack([each[0] for each in drawn]), np.stack([each[1] for each in drawn])
    ticks = truth.shape[1]
    time = (np.arange(ticks) + 1) * STEP_S
    heard = time % every_s < every_s - off_s
    fix, age, comes = np.full((runs, ticks, 2), np.nan), np.full((runs, ticks), np.nan), np.zeros((runs, ticks), bool)
    keep = np.exp(-1.0 / SLOW_S)
    for run in range(runs):
        slow = np.sqrt(SLOW_SHARE) * fix_sigma_m * rng.standard_normal(2)
        for tick in range(int(rng.integers(1, 10)), ticks, 10):
            slow = keep * slow + np.sqrt(SLOW_SHARE * (1.0 - keep**2)) * fix_sigma_m * rng.standard_normal(2)
            if not heard[tick] or rng.uniform() < 0.03:
                continue
            # Taken within the tick, or in the one before.
            late = rng.uniform(0.0, 1.0)
            pose = late * truth[run, tick - 1] + (1.0 - late) * truth[run, tick]
            cos, sin = np.cos(pose[2]), np.sin(pose[2])
            lever = [cos * ANTENNA_X_M - sin * ANTENNA_Y_M, sin * ANTENNA_X_M + cos * ANTENNA_Y_M]
            white = np.sqrt(1.0 - SLOW_SHARE) * fix_sigma_m * rng.standard_normal(2)
            fix[run, tick] = pose[:2] + lever + slow + white
            age[run, tick], comes[run, tick] = late * STEP_S, True
    single = jnp.float32
    covariance = np.broadcast_to(fix_sigma_m**2 * np.eye(2), (runs, ticks, 2, 2))
    fixes = GnssObservation(
        single(fix[..., 0]), single(fix[..., 1]), single(covariance), single(age), jnp.asarray(comes)
    )
    start = truth[:, 0, :2] + rng.normal(0.0, 0.5, (runs, 2))
    return CartDrives(truth, line, start, np.full((runs, ticks), STEP_S, np.float32), fixes)


def _drive(
    rng: np.random.Generator, ticks: int, on_the_spot: bool
) -> tuple[Float[np.ndarray, "tick 3"], Bool[np.ndarray, " tick"]]:
    """One drive: pose after each tick, and whether it was on a line."""
    pace = rng.uniform(SLOWEST_MPS, FASTEST_MPS)
    crab, surge_hz = rng.uniform(-0.01, 0.01), rng.uniform(1.0, 1.8)
    x, y, base = rng.uniform(-20.0, 20.0), rng.uniform(-20.0, 20.0), rng.uniform(-np.pi, np.pi)
    weave = lean = 0.0
    speed, line_m, turned, rest_s, side = 0.0, 0.0, 0.0, 3.0, 1.0
    truth, line = np.zeros((ticks, 3)), np.zeros(ticks, bool)
    for tick in range(ticks):
        turning = line_m >= 20.0
        if rest_s <= 0.0 and rng.uniform() < STEP_S / 120.0:
            rest_s = rng.uniform(4.0, 20.0)
        stands = rest_s > 0.0 or (turning and on_the_spot)
        rest_s -= STEP_S
        wanted = 0.0 if stands else pace * (1.0 + 0.15 * np.sin(2.0 * np.pi * surge_hz * tick * STEP_S))
        speed += np.clip(wanted - speed, -0.8 * STEP_S, 0.5 * STEP_S)
        way = speed * STEP_S
        # A person does not walk straight: some 2° over some 3 m.
        keep = np.exp(-way / 3.0)
        lean = keep * lean + 0.06 * np.sqrt(1.0 - keep**2) * rng.standard_normal()
        weave += (lean - weave) * (1.0 - np.exp(-way / 1.0))
        if turning and rest_s <= 0.0:
            bend = 0.8 * STEP_S if on_the_spot else way / 1.5
            bend = min(bend, np.pi - turned)
            base, turned = base + side * bend, turned + bend
            if turned >= np.pi - 1e-9:
                line_m, turned, side = 0.0, 0.0, -side
        elif not turning:
            line_m += way
        yaw = base + weave
        x += way * np.cos(yaw) - crab * way * np.sin(yaw) + 0.003 * np.sqrt(way) * rng.standard_normal()
        y += way * np.sin(yaw) + crab * way * np.cos(yaw) + 0.003 * np.sqrt(way) * rng.standard_normal()
        truth[tick] = x, y, yaw
        line[tick] = not turning and speed > 0.05
    return truth, line
