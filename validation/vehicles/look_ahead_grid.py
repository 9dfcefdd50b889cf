"""The look-ahead by brute force: every schedule of a grid, each driven on line and arc, at every speed and offset."""

import jax.numpy as jnp
import numpy as np

from lgprjax.tuning import TrialCourses, TunedVehicle, judge
from lgprjax.vehicle import Chassis, LookAhead, ProportionalRear, Servo, arc_course, line_course

SPEEDS = (1.5, 2.235, 4.47, 6.5, 8.0)
FULL_V, WEAK_V = 24.0, 16.0
"""At full torque, and where 43 % of it are left."""


def vehicle(supply_v: float = FULL_V, delay_s: float = 0.06) -> TunedVehicle:
    length, anchor, k, largest, characteristic = (jnp.float32(v) for v in (3.8, 6.5, 0.63, 0.52, 20.0))
    servo = Servo(*(jnp.float32(v) for v in (0.2, 0.5, delay_s, np.radians(0.2), np.radians(0.3), 0.0, 24.0, 10.0)))
    return TunedVehicle(
        Chassis(length, anchor, ProportionalRear(k), largest, characteristic), servo, jnp.float32(supply_v)
    )


def trial_courses(speeds_mps: tuple[float, ...] = SPEEDS, duration_s: float = 25.0) -> TrialCourses:
    """Line and arc, offsets 0 and ±3 m."""
    return TrialCourses((line_course(300.0), arc_course(25.0, 2 * np.pi)), speeds_mps, duration_s=duration_s)


def least_cost(trials: TrialCourses, supply_v: float, counts: tuple[int, int, int, int], parts: int) -> float:
    """Least mean cost over the speeds of schedules that leave the margin at all of them.

    Args:
        trials: courses.
        supply_v: of the servo.
        counts: of short and long look-aheads, slow and fast speeds.
        parts: calls of equal size.
    """
    ranges = (np.geomspace(0.8, 8, counts[0]), np.geomspace(1.5, 18, counts[1]))
    speeds = (np.linspace(0.5, 3.5, counts[2]), np.linspace(5.0, 10, counts[3]))
    grid = np.stack(np.meshgrid(*ranges, *speeds, indexing="ij"), axis=-1).reshape(-1, 4)
    costs = []
    for part in np.split(grid, parts):
        judged = judge(vehicle(supply_v), trials, LookAhead(*(jnp.asarray(column, jnp.float32) for column in part.T)))
        enough = jnp.all(judged.margin_rad >= trials.least_margin_rad, axis=-1)
        costs.append(np.asarray(jnp.where(enough, jnp.mean(judged.cost_m, axis=-1), jnp.inf)))
    return float(np.min(np.concatenate(costs)))
