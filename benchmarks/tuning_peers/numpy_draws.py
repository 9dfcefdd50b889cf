"""The cost of the schedule found, over the same draws, by NumPy: draw by draw, and many at once.

The rollout is that of ``lgprjax.vehicle``, written again in float64 with NumPy's functions: a loop over steps, all
lanes of a call at once. Draw by draw, the lanes are a draw's speeds, torques and offsets, and time is taken over few
draws; many at once, they are as many as a core's caches hold.

``python -m benchmarks.tuning_peers.numpy_draws OUT PROBLEM --single N --threads N``.
"""

import argparse
import json
import time
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from benchmarks.process import hold_to
from benchmarks.rollout_peers.work import peak_rss_mb
from benchmarks.tuning_problem import TuningProblem, load_tuning

_LANES = 2304
"""At once: the some forty arrays of a step, 18 kB each, stay in a core's caches."""
_NEWTON_STEPS = 4


class Lanes(NamedTuple):
    """Vehicles of a call; one value each."""

    lag_s: Float[np.ndarray, " lane"]
    delay_s: Float[np.ndarray, " lane"]
    rate_radps: Float[np.ndarray, " lane"]
    dead_band_rad: Float[np.ndarray, " lane"]
    asymmetry: Float[np.ndarray, " lane"]
    ratio: Float[np.ndarray, " lane"]
    slip_s2pm2: Float[np.ndarray, " lane"]
    speed_mps: Float[np.ndarray, " lane"]
    share: Float[np.ndarray, " lane"]
    ahead_m: Float[np.ndarray, " lane"]
    offset_m: Float[np.ndarray, " lane"]


class Table:
    """A path as arcs of one length, straight beyond its ends unless it is closed."""

    def __init__(self, rows: Float[np.ndarray, "row 5"], numbers: Float[np.ndarray, " 3"]) -> None:
        self.columns = np.ascontiguousarray(rows.T, dtype=np.float64)
        self.spacing_m, self.length_m, self.laps_per_m = (float(v) for v in numbers)

    def fetch(self, arc_m: Float[np.ndarray, " lane"]) -> tuple[np.ndarray, ...]:
        """Way beyond the start of the arc, then the arc's x, y, cosine, sine and curvature."""
        lap = arc_m - np.floor(arc_m * self.laps_per_m) * self.length_m
        row = np.clip(np.floor(lap / self.spacing_m).astype(int) + 1, 0, self.columns.shape[1] - 1)
        return (lap - np.maximum(row - 1, 0) * self.spacing_m, *self.columns[:, row])

    def place(self, arc_m: Float[np.ndarray, " lane"]) -> tuple[np.ndarray, np.ndarray]:
        """Position at an arc length."""
        beyond, x, y, cos, sin, curvature = self.fetch(arc_m)
        half = 0.5 * curvature * beyond
        chord = beyond * np.sinc(half / np.pi)
        along, aside = chord * np.cos(half), chord * np.sin(half)
        return x + cos * along - sin * aside, y + sin * along + cos * aside

    def foot(
        self, near_m: Float[np.ndarray, " lane"], x_m: Float[np.ndarray, " lane"], y_m: Float[np.ndarray, " lane"]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Arc length of the foot on the arc near by, and offset to the left of it."""
        beyond, x, y, cos, sin, curvature = self.fetch(near_m)
        along, aside = (x_m - x) * cos + (y_m - y) * sin, (y_m - y) * cos - (x_m - x) * sin
        share = np.maximum(1.0 - curvature * aside, 0.1)
        angle = curvature * along / share
        way = along / share * (1.0 - angle**2 * (1.0 / 3.0 - angle**2 / 5.0))
        bent = aside - 0.5 * curvature * (along**2 + aside**2)
        return near_m - beyond + way, 2.0 * bent / (1.0 + np.hypot(curvature * along, share))


def lanes_of(problem: TuningProblem, low: int, high: int) -> Lanes:
    """Lanes of some draws: draw, speed, share, offset."""
    draws = problem.draws[low:high].astype(np.float64)
    shape = (len(draws), len(problem.speeds_mps), len(problem.shares), len(problem.offsets_m))

    def over(values: np.ndarray, *axes: int) -> np.ndarray:
        wanted = [values.shape[axes.index(axis)] if axis in axes else 1 for axis in range(len(shape))]
        return np.broadcast_to(values.reshape(wanted), shape).reshape(-1)

    drawn = [over(draws[:, number], 0) for number in range(7)]
    speed, share = over(problem.speeds_mps.astype(np.float64), 1), over(problem.shares.astype(np.float64), 2)
    ahead, offset = over(problem.ahead_m.astype(np.float64), 1, 2), over(problem.offsets_m.astype(np.float64), 3)
    return Lanes._make([*drawn, speed, share, ahead, offset])


def roll_out(problem: TuningProblem, table: Table, lanes: Lanes) -> Float[np.ndarray, " lane"]:
    """RMS distance from the path and weighted movement of the wheels, m."""
    base, lead, ratio, largest, v_char = (float(v) for v in problem.believed)
    steps, step_s, effort_m2, slots = int(problem.settings[0]), *(float(v) for v in problem.settings[1:])
    v, count, every = lanes.speed_mps, len(lanes.speed_mps), np.arange(len(lanes.speed_mps))
    way = v * step_s
    gain, loss = 1.0 / (1.0 + v**2 * lanes.slip_s2pm2), 1.0 + (v / v_char) ** 2
    approach = -np.expm1(-step_s * lanes.share / lanes.lag_s)
    most = lanes.rate_radps * lanes.share * step_s
    right, left = most * (1.0 - lanes.asymmetry), most * (1.0 + lanes.asymmetry)
    play = 0.5 * float(problem.backlash_rad)
    age = np.clip(lanes.delay_s / step_s, 0.0, slots)
    newer = np.minimum(np.floor(age), slots - 1).astype(int)
    part = age - newer
    sent = np.zeros((steps + int(slots) + 1, count))
    (_, x0, y0, cos0, sin0, _) = table.fetch(np.zeros(count))
    yaw = np.arctan2(sin0, cos0)
    x, y = x0 - sin0 * lanes.offset_m - lead * cos0, y0 + cos0 * lanes.offset_m - lead * sin0
    arc, advance, motor, wheel = (np.zeros(count) for _ in range(4))
    square, steered = np.zeros(count), np.zeros(count)
    locked = np.tan(largest), np.tan(ratio * largest)
    for step in range(steps):
        cos, sin = np.cos(yaw), np.sin(yaw)
        ax, ay = x + lead * cos, y + lead * sin
        foot, offset = table.foot(arc + advance, ax, ay)
        gx, gy = table.place(foot + lanes.ahead_m)
        ahead, aside = (gx - ax) * cos + (gy - ay) * sin, (gy - ay) * cos - (gx - ax) * sin
        half = 0.5 * (ahead**2 + aside**2)
        front_arm, rear_arm, wanted = half + lead * ahead, half + (lead - base) * ahead, base * aside * loss
        rise = front_arm + ratio * rear_arm
        front = np.clip(np.arctan2(wanted, rise), -largest, largest)
        for _ in range(_NEWTON_STEPS):
            ahead_tan, rear_tan = np.tan(front), np.tan(ratio * front)
            slope = front_arm * (1.0 + ahead_tan**2) + ratio * rear_arm * (1.0 + rear_tan**2)
            value = front_arm * ahead_tan + rear_arm * rear_tan - wanted
            front = np.clip(front - np.where(slope > 0.0, value / slope, 0.0), -largest, largest)
        at_lock = front_arm * locked[0] + rear_arm * locked[1]
        lock_slope = front_arm * (1.0 + locked[0] ** 2) + ratio * rear_arm * (1.0 + locked[1] ** 2)
        reachable = (rise > 0.0) & (lock_slope > 0.0) & (np.abs(wanted) <= at_lock)
        row = step + int(slots)
        sent[row] = np.where(reachable, front, np.sign(aside) * largest)
        after, before = sent[row - newer, every], sent[row - newer - 1, every]
        wrong = after + part * (before - after) - motor
        wrong = wrong - np.clip(wrong, -lanes.dead_band_rad, lanes.dead_band_rad)
        motor = motor + np.clip(wrong * approach, -right, left)
        turned = np.clip(wheel, motor - play, motor + play)
        square += offset**2
        steered += np.abs(turned - wheel)
        wheel = turned
        rear = np.tan(lanes.ratio * wheel)
        turn = gain * (np.tan(wheel) + rear) / base * way
        drift = -gain * way * rear
        along, bow = np.sinc(turn / np.pi), np.sin(0.5 * turn) * np.sinc(0.5 * turn / np.pi)
        forward, sideways = along * way - bow * drift, bow * way + along * drift
        x, y, yaw = x + cos * forward - sin * sideways, y + sin * forward + cos * sideways, yaw + turn
        arc, advance = foot, foot - arc
    return np.asarray(np.sqrt(square / steps) + effort_m2 * steered / (steps * way))


def costs(problem: TuningProblem, tables: list[Table], low: int, high: int) -> Float[np.ndarray, "draw speed share"]:
    """Means over paths and offsets."""
    lanes = lanes_of(problem, low, high)
    shape = (high - low, len(problem.speeds_mps), len(problem.shares), len(problem.offsets_m))
    found = np.stack([roll_out(problem, table, lanes) for table in tables]).reshape(len(tables), *shape)
    return np.asarray(found.mean(axis=(0, -1)))


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.tuning_peers.numpy_draws")
    parser.add_argument("out", type=Path)
    parser.add_argument("problem", type=Path)
    for name in ("--single", "--threads"):
        parser.add_argument(name, type=int, required=True)
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    problem = load_tuning(chosen.problem)
    tables = [
        Table(rows, numbers) for rows, numbers in zip((problem.rows_0, problem.rows_1), problem.paths, strict=True)
    ]
    draws = len(problem.draws)
    single = min(chosen.single, draws)
    costs(problem, tables, 0, 1)
    begin = time.perf_counter()
    for draw in range(single):
        costs(problem, tables, draw, draw + 1)
    single_s = (time.perf_counter() - begin) * draws / single
    size = max(_LANES // (len(problem.speeds_mps) * len(problem.shares) * len(problem.offsets_m)), 1)
    begin = time.perf_counter()
    found = np.concatenate([costs(problem, tables, low, min(low + size, draws)) for low in range(0, draws, size)])
    figures = {
        "all_s": time.perf_counter() - begin,
        "single_s": single_s,
        "single_draws": single,
        "mean_m": float(found.mean()),
        "mean_apart_m": float(abs(found.mean() - problem.cost_m.mean())),
        "apart_m": float(np.max(np.abs(found - problem.cost_m))),
        "threads": chosen.threads,
        "peak_rss_mb": peak_rss_mb(),
    }
    chosen.out.write_text(json.dumps(figures), encoding="utf-8")


if __name__ == "__main__":
    main()
