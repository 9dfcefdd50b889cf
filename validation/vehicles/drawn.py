"""Vehicles whose numbers and noise laws a seed draws, and their drives along courses, in plain NumPy and float64.

Nothing of the package is used: servo, chassis, pursuit and sensors are written once more, at 100 Hz with the control at
50 Hz, so that what is identified from a log is compared with something else. Noises of the signals are not those that
an estimator may assume: coloured, heavy-tailed, quantised, or on a clock of their own.
"""

from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

STEP_S, EVERY = 0.01, 2
LAWS = ("coloured", "heavy", "quantised", "skewed")
_POINT_M = 0.05


class Hidden(NamedTuple):
    """Vehicles, one value each; names and units as in a vehicle file."""

    wheelbase_m: np.ndarray
    anchor_m: np.ndarray
    ratio: np.ndarray
    v_char_mps: np.ndarray
    largest_rad: np.ndarray
    lag_s: np.ndarray
    delay_s: np.ndarray
    rate_radps: np.ndarray
    dead_band_rad: np.ndarray
    backlash_rad: np.ndarray
    asymmetry: np.ndarray
    front_sigma_rad: np.ndarray
    yaw_rate_sigma: np.ndarray
    colour_s: np.ndarray
    late_s: np.ndarray
    drift: np.ndarray

    def take(self, index: Any) -> "Hidden":
        return Hidden(*(np.asarray(field)[index] for field in self))


class Believed(NamedTuple):
    """What the vehicle's file says and what drives by it: wrong in k, slip and servo."""

    ratio: np.ndarray
    v_char_mps: np.ndarray
    lag_s: np.ndarray
    delay_s: np.ndarray
    rate_radps: np.ndarray

    def take(self, index: Any) -> "Believed":
        return Believed(*(np.asarray(field)[index] for field in self))


def draw_vehicles(count: int, seed: int) -> tuple[Hidden, Believed, list[str]]:
    """Vehicles far apart, what their files say, and the noise law of each."""
    draw = np.random.default_rng(seed)

    def between(low: float, high: float) -> np.ndarray:
        return draw.uniform(low, high, count)

    def factor(most: float) -> np.ndarray:
        return np.exp(draw.uniform(-np.log(most), np.log(most), count))

    base = between(1.8, 5.2)
    true = Hidden(
        base,
        base + between(1.2, 2.8),
        np.where(np.arange(count) % 5 == 4, 0.0, between(0.2, 0.75)),
        between(12.0, 40.0),
        between(0.45, 0.6),
        0.08 * 4.0 ** between(0.0, 1.0),
        between(0.03, 0.12),
        0.22 * 4.0 ** between(0.0, 1.0),
        np.radians(between(0.0, 0.3)),
        np.radians(between(0.0, 0.4)),
        between(-0.06, 0.06),
        np.radians(between(0.08, 0.3)),
        np.radians(between(0.2, 0.6)),
        between(0.3, 1.5),
        between(-0.04, 0.04),
        between(-2e-4, 2e-4),
    )
    told = Believed(
        true.ratio * between(0.88, 1.12),
        true.v_char_mps * factor(1.5),
        true.lag_s * factor(1.5),
        true.delay_s * factor(1.4),
        true.rate_radps * factor(1.15),
    )
    return true, told, [LAWS[number % len(LAWS)] for number in range(count)]


class Course(NamedTuple):
    """Points ``_POINT_M`` apart, one course a lane."""

    x: Float[np.ndarray, "lane point"]
    y: Float[np.ndarray, "lane point"]
    yaw: Float[np.ndarray, "lane point"]


def draw_course(seed: int, *, length_m: float, least_radius_m: float, straight_m: float = 25.0) -> np.ndarray:
    """Curvature at every point: straights and bends with clothoids to both sides."""
    draw = np.random.default_rng(seed)
    parts = [np.zeros(int(straight_m / _POINT_M))]
    while sum(map(len, parts)) * _POINT_M < length_m:
        radius = least_radius_m * 3.0 ** draw.uniform(0.0, 1.0)
        turn = draw.uniform(0.3, 1.6)
        ramp = int(draw.uniform(6.0, 12.0) / _POINT_M)
        hold = max(int(radius * turn / _POINT_M) - ramp, 1)
        rise = np.linspace(0.0, 1.0, ramp)
        bend = np.concatenate([rise, np.ones(hold), rise[::-1]]) / radius * draw.choice([-1.0, 1.0])
        parts += [bend, np.zeros(int(draw.uniform(4.0, 20.0) / _POINT_M))]
    return np.concatenate(parts)[: int(length_m / _POINT_M)]


def lay_courses(curvatures: list[np.ndarray]) -> Course:
    curvature = np.stack(curvatures)
    yaw = np.cumsum(curvature, axis=1) * _POINT_M
    yaw = np.concatenate([np.zeros((len(yaw), 1)), yaw[:, :-1]], axis=1)
    middle = yaw + 0.5 * curvature * _POINT_M
    x = np.cumsum(np.cos(middle) * _POINT_M, axis=1)
    y = np.cumsum(np.sin(middle) * _POINT_M, axis=1)
    zero = np.zeros((len(x), 1))
    return Course(np.concatenate([zero, x[:, :-1]], 1), np.concatenate([zero, y[:, :-1]], 1), yaw)


class Driven(NamedTuple):
    """Logs at 50 Hz, [record, lane], and the truth behind them."""

    time_s: np.ndarray
    command_rad: np.ndarray
    front_rad: np.ndarray
    yaw_rate_radps: np.ndarray
    speed_mps: np.ndarray
    x_m: np.ndarray
    y_m: np.ndarray
    yaw_rad: np.ndarray
    offset_m: np.ndarray
    true_front_rad: np.ndarray
    true_x_m: np.ndarray
    true_y_m: np.ndarray
    true_yaw_rad: np.ndarray


def drive(
    true: Hidden,
    told: Believed,
    course: Course,
    laws: list[str],
    *,
    ahead_m: Any,
    speed_mps: np.ndarray,
    offset_m: np.ndarray,
    seconds: float,
    seed: int,
    torque: np.ndarray | float = 1.0,
    quiet: bool = False,
) -> Driven:
    """Drive every lane along its course.

    Args:
        ahead_m: function of speed [lane] to look-ahead [lane].
        speed_mps: [lane], or [step, lane] at 100 Hz.
        offset_m: of the anchor at the start.
        torque: share that is left.
        quiet: neither noise of the pose nor disturbance.
    """
    lanes, steps = len(true.ratio), round(seconds / STEP_S)
    draw = np.random.default_rng(seed)
    speed = np.broadcast_to(speed_mps, (steps, lanes))
    slots = int(np.ceil(np.max(true.delay_s) / STEP_S)) + 2
    waiting = np.zeros((slots, lanes))
    late = true.delay_s / STEP_S
    below = np.floor(late).astype(int)
    blend, lane = late - below, np.arange(lanes)
    loud = 0.0 if quiet else 1.0
    wander = _coloured(draw, steps, lanes, 0.8) * loud
    askew = _coloured(draw, steps, lanes, 0.5) * loud * np.radians(0.12)
    seen = _coloured(draw, steps, lanes, 0.7) * loud * 0.02
    seen_yaw = _coloured(draw, steps, lanes, 0.7) * loud * np.radians(0.1)
    yaw, motor, wheel, command, arc = (np.zeros(lanes) for _ in range(5))
    x, y = -true.anchor_m + 0.0 * yaw, offset_m + 0.0 * yaw
    share = np.broadcast_to(torque, (lanes,))
    rows: list[tuple[np.ndarray, ...]] = []
    gain = 1.0 / (1.0 + (speed / true.v_char_mps) ** 2)
    for step in range(steps):
        v = speed[step]
        if step % EVERY == 0:
            arc, offset = _foot(course, arc, x + true.anchor_m * np.cos(yaw), y + true.anchor_m * np.sin(yaw))
            felt = yaw + seen_yaw[step]
            px, py = x - np.sin(yaw) * seen[step], y + np.cos(yaw) * seen[step]
            command = _pursue(true, told, course, (px, py, felt), arc, ahead_m(v), v)
            rows.append((command, wheel, offset, x, y, yaw, v))
        waiting = np.concatenate([command[None], waiting[:-1]])
        # A command begins to act within a step. One blended with its follower would begin with the step: at its rate's
        # limit the servo turns as fast for a part of a command.
        for slot, lasting in ((below + 1, blend * STEP_S), (below, (1.0 - blend) * STEP_S)):
            wrong = waiting[slot, lane] - motor
            wrong = np.sign(wrong) * np.maximum(np.abs(wrong) - true.dead_band_rad, 0.0)
            most = true.rate_radps * share * lasting
            nearer = -np.expm1(-lasting * share / true.lag_s) * wrong
            motor = motor + np.clip(nearer, -most * (1.0 - true.asymmetry), most * (1.0 + true.asymmetry))
        wheel = np.clip(wheel, motor - 0.5 * true.backlash_rad, motor + 0.5 * true.backlash_rad)
        front, rear = np.tan(wheel), np.tan(true.ratio * wheel)
        way = v * STEP_S
        turn = gain[step] * (front + rear) / true.wheelbase_m * way + (askew[step] * STEP_S)
        side = -gain[step] * rear * way
        ahead, aside = np.sinc(turn / np.pi), np.sin(0.5 * turn) * np.sinc(0.5 * turn / np.pi)
        forward, left = ahead * way - aside * side, aside * way + ahead * side + 0.002 * wander[step] * STEP_S * v
        x, y = x + np.cos(yaw) * forward - np.sin(yaw) * left, y + np.sin(yaw) * forward + np.cos(yaw) * left
        yaw = yaw + turn
    stacked = [np.stack(column) for column in zip(*rows, strict=True)]
    return _logged(true, laws, draw, stacked, quiet=quiet)


def _foot(course: Course, arc: np.ndarray, x: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Way along the course and offset to the left of the point nearest to each place, walked to from the last one."""
    for _ in range(3):
        px, py, heading = _at(course, arc)
        arc = arc + np.clip((x - px) * np.cos(heading) + (y - py) * np.sin(heading), -1.0, 1.0)
    px, py, heading = _at(course, arc)
    return arc, (y - py) * np.cos(heading) - (x - px) * np.sin(heading)


def _at(course: Course, arc: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    lane = np.arange(len(course.x))
    place = np.clip(arc / _POINT_M, 0.0, course.x.shape[1] - 2.0)
    below = place.astype(int)
    share = place - below
    yaw = course.yaw[lane, below]
    beyond = arc - (below + share) * _POINT_M
    x = (1.0 - share) * course.x[lane, below] + share * course.x[lane, below + 1] + beyond * np.cos(yaw)
    y = (1.0 - share) * course.y[lane, below] + share * course.y[lane, below + 1] + beyond * np.sin(yaw)
    return x, y, (1.0 - share) * yaw + share * course.yaw[lane, below + 1]


def _pursue(
    true: Hidden,
    told: Believed,
    course: Course,
    pose: tuple[np.ndarray, ...],
    arc: np.ndarray,
    ahead: Any,
    v: np.ndarray,
) -> np.ndarray:
    """The exact pursuit equation (LL eq. 2) with the believed k, by bisection."""
    x, y, yaw = pose
    ax, ay = x + true.anchor_m * np.cos(yaw), y + true.anchor_m * np.sin(yaw)
    gx, gy, _ = _at(course, arc + ahead)
    distance, bearing = np.hypot(gx - ax, gy - ay), np.arctan2(gy - ay, gx - ax) - yaw
    bearing = np.arctan2(np.sin(bearing), np.cos(bearing))
    front = 0.5 * distance + true.anchor_m * np.cos(bearing)
    rear = 0.5 * distance + (true.anchor_m - true.wheelbase_m) * np.cos(bearing)
    wanted = true.wheelbase_m * np.sin(bearing) * (1.0 + (v / told.v_char_mps) ** 2)
    low, high = -true.largest_rad, true.largest_rad.copy()
    for _ in range(26):
        middle = 0.5 * (low + high)
        over = front * np.tan(middle) + rear * np.tan(told.ratio * middle) > wanted
        low, high = np.where(over, low, middle), np.where(over, middle, high)
    return np.asarray(0.5 * (low + high))


def _coloured(draw: np.random.Generator, steps: int, lanes: int, seconds: float | np.ndarray) -> np.ndarray:
    """Gauss-Markov noise of unit size."""
    keep = np.exp(-STEP_S / seconds)
    white = draw.normal(size=(steps, lanes)) * np.sqrt(1.0 - keep**2)
    value, rows = draw.normal(size=lanes), np.empty((steps, lanes))
    for step in range(steps):
        value = keep * value + white[step]
        rows[step] = value
    return rows


def _logged(true: Hidden, laws: list[str], draw: np.random.Generator, rows: list[np.ndarray], *, quiet: bool) -> Driven:
    """What the sensors make of it, each lane by its law."""
    command, wheel, offset, x, y, yaw, speed = rows
    count, lanes = wheel.shape
    time_s = STEP_S * EVERY * np.arange(count)
    rate = np.gradient(yaw, time_s, axis=0)
    front = wheel + 0.0
    gyro = rate + np.radians(draw.normal(size=lanes)) * 0.3
    for number, law in enumerate(laws):
        if law == "skewed":
            # The gyro's clock: late, and faster or slower.
            own = time_s * (1.0 + true.drift[number]) - true.late_s[number]
            gyro[:, number] = np.interp(own, time_s, gyro[:, number])
        gyro[:, number] += true.yaw_rate_sigma[number] * noise_of(law, draw, count, true.colour_s[number])
        front[:, number] += true.front_sigma_rad[number] * noise_of(law, draw, count, true.colour_s[number])
        if law == "quantised":
            for column, step in ((front, np.radians(0.35)), (gyro, np.radians(0.5))):
                column[:, number] = step * np.round(column[:, number] / step)
    if quiet:
        gyro, front = rate, wheel
    seen = 0.0 if quiet else 0.02
    return Driven(
        time_s,
        command,
        front,
        gyro,
        speed * (1.0 + (0.0 if quiet else 0.003)),
        x + seen * draw.normal(size=x.shape),
        y + seen * draw.normal(size=x.shape),
        yaw + (0.0 if quiet else np.radians(0.1)) * draw.normal(size=x.shape),
        offset,
        wheel,
        x,
        y,
        yaw,
    )


def noise_of(law: str, draw: np.random.Generator, count: int, colour_s: float) -> np.ndarray:
    """Noise of some unit size at 50 Hz."""
    white = draw.normal(size=count)
    if law == "coloured":
        keep = np.exp(-STEP_S * EVERY / colour_s)
        slow, value = np.empty(count), draw.normal()
        for record in range(count):
            value = keep * value + np.sqrt(1.0 - keep**2) * draw.normal()
            slow[record] = value
        return 0.8 * slow + 0.6 * white
    if law == "heavy":
        return draw.standard_t(2.5, size=count) * 0.7 + (draw.random(count) < 0.005) * 15.0 * draw.normal(size=count)
    return white
