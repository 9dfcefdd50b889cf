"""Drawn drives with odometers' records, some of which jump: plain kinematics, nothing of the package."""

from typing import NamedTuple

import numpy as np

_FINE_S = 0.001
_LASTS_S = 40.0
_EDGE_S = 3.0


class Drawn(NamedTuple):
    """A record and what is true of it.

    Attributes:
        time_s, distance_m: the record.
        true_m: of the vehicle at the record's times, as the record counts (chords count backwards too).
        jump_s, jump_m: middle and length of the jump of the positions; 0 where there is none.
        smoothed: over half a second.
        added_m: what the jump adds to the record.
        noise_m: a sigma of the positions.
        speed_mps: largest of the drive.
    """

    time_s: np.ndarray
    distance_m: np.ndarray
    true_m: np.ndarray
    jump_s: float
    jump_m: float
    smoothed: bool
    added_m: float
    noise_m: float
    rate_hz: float
    speed_mps: float
    kind: str


def draw(seed: int, *, jumps: bool) -> Drawn:
    """A drive of 40 s: speeds of 0.3 to 15 m/s, stands, stops and starts at up to 6 m/s², reversals; records of 1 to
    100 Hz, uneven and with gaps, exact or noisy, of wheels or of positions (along the heading, or chords)."""
    rng = np.random.default_rng([seed, int(jumps)])
    fastest = float(np.exp(rng.uniform(np.log(0.3), np.log(15.0))))
    kind = str(rng.choice(["wheels", "along", "chords"]))
    fine_s = np.arange(0.0, _LASTS_S, _FINE_S)
    speed = _speeds(rng, fastest, fine_s)
    way = np.cumsum(speed) * _FINE_S
    rate_hz = float(np.exp(rng.uniform(np.log(1.0), np.log(100.0))))
    time_s = _record_times(rng, rate_hz)
    noise_m = 0.0 if kind == "wheels" and rng.random() < 0.5 else float(rng.uniform(0.01, 0.03))
    bend = rng.uniform(-0.1, 0.1)
    yaw = bend * way
    east, north = np.cumsum(np.cos(yaw) * speed) * _FINE_S, np.cumsum(np.sin(yaw) * speed) * _FINE_S
    jump_m = float(np.exp(rng.uniform(np.log(0.3), np.log(30.0)))) if jumps else 0.0
    jump_s = float(rng.uniform(_EDGE_S, _LASTS_S - _EDGE_S))
    smoothed = bool(rng.random() < 0.5)
    shape = np.clip((fine_s - jump_s) / 0.5 + 0.5, 0.0, 1.0) if smoothed else (fine_s >= jump_s).astype(float)
    direction = rng.uniform(-np.pi, np.pi)
    middle = np.interp(jump_s, fine_s, yaw)

    def recorded(jump: float) -> np.ndarray:
        aside = jump * shape
        x = np.interp(time_s, fine_s, east + aside * np.cos(middle + direction))
        y = np.interp(time_s, fine_s, north + aside * np.sin(middle + direction))
        own = np.random.default_rng([seed, 7])
        x, y = x + noise_m * own.standard_normal(len(x)), y + noise_m * own.standard_normal(len(y))
        if kind == "chords":
            return np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(x), np.diff(y)))])
        at = np.interp(time_s, fine_s, yaw)
        half = 0.5 * (at[1:] + at[:-1])
        return np.concatenate([[0.0], np.cumsum(np.diff(x) * np.cos(half) + np.diff(y) * np.sin(half))])

    without, having = recorded(0.0), recorded(jump_m)
    if kind == "wheels":
        # Somebody else's record: what the positions stepped by stands in it as it is, forward or back.
        sign = 1.0 if np.cos(direction) > 0.0 else -1.0
        own = np.random.default_rng([seed, 7])
        without = np.interp(time_s, fine_s, way) + noise_m * own.standard_normal(len(time_s))
        having = without + sign * jump_m * np.interp(time_s, fine_s, shape)
    added = float((having - without)[-1])
    return Drawn(time_s, having, without, jump_s, jump_m, smoothed, added, noise_m, rate_hz, fastest, kind)


def _speeds(rng: np.random.Generator, fastest: float, fine_s: np.ndarray) -> np.ndarray:
    at, speeds = [0.0], [float(rng.uniform(0.0, fastest))]
    while at[-1] < _LASTS_S:
        held = float(rng.exponential(3.0)) + 0.05
        wanted = float(rng.choice([0.0, fastest, rng.uniform(0.0, fastest), -rng.uniform(0.0, min(fastest, 3.0))]))
        # Who turns round does it gently; who only brakes or starts may do it as hard as tyres allow.
        hardest = 3.0 if wanted * speeds[-1] < 0.0 or wanted < 0.0 or speeds[-1] < 0.0 else 6.0
        at += [at[-1] + held, at[-1] + held + abs(wanted - speeds[-1]) / float(rng.uniform(0.5, hardest)) + 1e-6]
        speeds += [speeds[-1], wanted]
    return np.asarray(np.interp(fine_s, at, speeds))


def _record_times(rng: np.random.Generator, rate_hz: float) -> np.ndarray:
    steps = np.full(int(_LASTS_S * rate_hz * 1.5) + 4, 1.0 / rate_hz)
    if rng.random() < 0.5:
        steps *= rng.uniform(0.6, 1.4, len(steps))
    time_s = np.cumsum(steps)
    time_s = time_s[time_s < _LASTS_S - 0.01]
    if rng.random() < 0.3:
        time_s = time_s[rng.random(len(time_s)) > 0.05]
    return time_s
