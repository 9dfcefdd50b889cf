"""A drive along a line in plain NumPy: a controller with gains on offset and heading, a late vehicle, a threshold."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

STEP_S, SPEED_MPS, TRACK_M = 0.1, 0.45, 1.1


class Drive(NamedTuple):
    """Ten records a second."""

    time_s: Float[np.ndarray, " record"]
    cross_m: Float[np.ndarray, " record"]
    yaw_rad: Float[np.ndarray, " record"]
    turn_mps: Float[np.ndarray, " record"]


def swinging_drive(
    seed: int,
    *,
    threshold_mps: float,
    records: int = 2400,
    bend_radpm: Float[np.ndarray, " record"] | None = None,
    veer_radps: float = 0.0,
) -> Drive:
    """A drive of a vehicle 0.4 s late with 0.4 s of lag.

    Args:
        seed: of the noises: slip, estimate and heading.
        threshold_mps: of the wheels' difference.
        records: how many.
        bend_radpm: curvature of the path, fed forward; None for a straight one.
        veer_radps: sigma of a turn that nobody commanded and that changes over 20 s, as of sides that slip unequally.
    """
    rng = np.random.default_rng(seed)
    bends = np.zeros(records) if bend_radpm is None else bend_radpm
    cross, yaw, path, rate, slip, wander = 0.1, 0.05, 0.0, 0.0, 0.0, 0.0
    veer = veer_radps * rng.normal() if veer_radps else 0.0
    waiting = [0.0] * 4
    kept = np.zeros((records, 3))
    for number in range(records):
        slip += 0.05 * (-slip + 0.02 * rng.normal())
        if veer_radps:
            veer += -veer * STEP_S / 20.0 + veer_radps * np.sqrt(2.0 * STEP_S / 20.0) * rng.normal()
        wander += 0.02 * (-wander + 0.05 * rng.normal())
        seen, heading = cross + wander, yaw - path
        wanted = SPEED_MPS * (bends[number] - 2.0 * seen - 1.67 * heading)
        turn = TRACK_M * float(np.clip(wanted, -0.6, 0.6))
        kept[number] = seen, yaw + 5e-4 * rng.normal(), turn
        waiting = [turn, *waiting[:-1]]
        told = waiting[-1] if abs(waiting[-1]) >= threshold_mps else 0.0
        rate += (1.0 - np.exp(-STEP_S / 0.4)) * (told / TRACK_M - rate)
        yaw += STEP_S * (rate + 0.5 * slip + veer)
        path += STEP_S * SPEED_MPS * bends[number]
        cross += STEP_S * SPEED_MPS * np.sin(yaw - path)
    return Drive(STEP_S * np.arange(records), *kept.T)
