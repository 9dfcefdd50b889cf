"""Where the fit of the pedals starts: the best of a grid of pre-tensions and lags, by what the vehicle accelerates.

Given pre-tension, dead zone and lag of both pedals the acceleration is linear in the rest. The way itself is no guide
so far from the answer: a model that stops too early, or never moves off, tells nothing of where to go.
"""

from collections.abc import Iterable

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.tuning.estimate import NotExcitedError
from lgprjax.tuning.pedal_runs import PedalRuns

PRE_TENSIONS = (0.02, 0.06, 0.1, 0.14, 0.18, 0.22, 0.26, 0.3, 0.4)
LAGS_S = (0.1, 0.25, 0.5, 1.0)
DEAD_SHARE = 0.4
FINER = ((0.02, 1.5, 0.3), (0.01, 1.25, 0.15), (0.005, 1.1, 0.08))
SPAN_S = 0.4
LEAST_SPEED_MPS = 0.2


Candidates = Float[np.ndarray, "candidate 3"]
"""Pre-tension, dead zone and lag of a pedal."""

Effects = tuple[Candidates, Float[np.ndarray, "candidate row"]]
"""Candidates with what they make of the commands."""


def pedal_start(runs: PedalRuns, travel_m: Float[np.ndarray, " record"], what: str) -> Float[np.ndarray, " parameter"]:
    """Parameters, in the order of ``PEDAL_NAMES``, to start a fit from.

    Accelerations are second differences of the way over twice ``SPAN_S``; the same differences of the twice summed
    effect stand against them.

    Args:
        runs: commands.
        travel_m: way by odometer, at their records.
        what: is calibrated, for the error.

    Raises:
        NotExcitedError: the vehicle hardly moves in them.
    """
    # The second difference of a spike would be the largest of all: medians of five take it away.
    travel_m = np.median(np.lib.stride_tricks.sliding_window_view(np.pad(travel_m, 2, mode="edge"), 5), axis=1)
    step_s = float(np.median(runs.step_s[runs.step_s > 0.0]))
    span = max(1, round(SPAN_S / step_s))
    span_s = span * step_s
    first = travel_m[span:-span] - travel_m[: -2 * span]
    second = travel_m[2 * span :] - travel_m[span:-span]
    moving = np.minimum(first, second) > LEAST_SPEED_MPS * span_s
    moving &= runs.run[2 * span :] == runs.run[: -2 * span]
    if np.count_nonzero(moving) < 10:
        raise NotExcitedError(
            what, "driving between the standstills", f"{np.count_nonzero(moving) * step_s:.1f} s of it"
        )
    wanted = ((second - first) / span_s**2)[moving]
    plain = np.stack([-np.ones(wanted.size), -((second + first) / (2.0 * span_s))[moving]])

    def effects(throttles: Candidates, brakes: Candidates) -> tuple[Effects, Effects]:
        thrust = _accelerations(runs.throttle, throttles, step_s, span)[:, moving]
        return (throttles, thrust), (brakes, -_accelerations(runs.brake, brakes, step_s, span)[:, moving])

    coarse = _product(PRE_TENSIONS, (DEAD_SHARE,), LAGS_S)
    both = effects(coarse, coarse)
    best = _best(wanted, plain, *both, np.ones(wanted.size, bool))
    if best.size:
        (_, thrust), (_, braked) = effects(best[None, [0, 1, 3]], best[None, [4, 5, 7]])
        left = np.abs(wanted - best[[2, 6, 8, 9]] @ np.vstack([thrust, braked, plain]))
        agreeing = left <= 4.0 / 0.6745 * np.median(left)
        best = _best(wanted, plain, *both, agreeing)
    for change, factor, share in FINER:
        if best.size:
            near = (_around(best[first : first + 4], change, factor, share) for first in (0, 4))
            best = _best(wanted, plain, *effects(*near), agreeing)
    if best.size == 0:
        raise NotExcitedError(
            what, "a vehicle that throttle drives and brake slows", "one that does neither or one only"
        )
    return best


def _product(pre_tensions: Iterable[float], shares: Iterable[float], lags_s: Iterable[float]) -> Candidates:
    pre, share, lag = (np.ravel(grid) for grid in np.meshgrid(*map(list, (pre_tensions, shares, lags_s))))
    return np.stack([pre, share * pre, lag], axis=1)


def _around(pedal: Float[np.ndarray, "4"], change: float, factor: float, share: float) -> Candidates:
    """Neighbours of a candidate: (pre-tension, dead zone, gain, lag), the gain apart."""
    pre, dead, _, lag = pedal
    shares = np.clip(dead / pre + np.array([-share, 0.0, share]), 0.05, 1.0)
    return _product(np.maximum(pre + np.array([-change, 0.0, change]), 0.01), shares, (lag / factor, lag, lag * factor))


def _best(
    wanted: Float[np.ndarray, " row"],
    plain: Float[np.ndarray, "2 row"],
    throttles: Effects,
    brakes: Effects,
    agreeing: Bool[np.ndarray, " row"],
) -> Float[np.ndarray, " parameter"]:
    """The pair that leaves least of the agreeing accelerations, with its gains and resistances; empty for none."""
    features = np.vstack([throttles[1], brakes[1], plain, wanted])[:, agreeing]
    product = features @ features.T
    one, two = (grid.ravel() for grid in np.indices((len(throttles[0]), len(brakes[0]))))
    last = len(features) - 1
    used = np.stack([one, len(throttles[0]) + two, np.full(one.size, last - 2), np.full(one.size, last - 1)], axis=1)
    square = product[used[:, :, None], used[:, None, :]] + 1e-9 * wanted.size * np.eye(4)
    side = product[used, last]
    answer = np.linalg.solve(square, side[..., None])[..., 0]
    left = np.where((answer[:, :2] > 0.0).all(axis=1), -np.sum(answer * side, axis=1), np.inf)
    least = int(np.argmin(left))
    if not np.isfinite(left[least]):
        return np.zeros(0)
    throttle, brake = throttles[0][one[least]], brakes[0][two[least]]
    thrust, braked, *rest = answer[least]
    return np.array([*throttle[:2], thrust, throttle[2], *brake[:2], braked, brake[2], *rest])


def _accelerations(
    command: Float[np.ndarray, " record"], candidates: Candidates, step_s: float, span: int
) -> Float[np.ndarray, "candidate row"]:
    """Mean effect of a gain of 1 over the rows' two spans, weighted as second differences of the way weight it."""
    pre_tension, dead_zone, lag_s = candidates.T
    pressed, effect = np.zeros(pre_tension.size), np.zeros(pre_tension.size)
    course = np.empty((pre_tension.size, command.size))
    keep = np.exp(-step_s / lag_s)
    for record, told in enumerate(command):
        course[:, record] = effect
        taut = told - pre_tension
        pressed = np.maximum(np.clip(pressed, taut, taut + dead_zone), 0.0)
        effect = pressed + keep * (effect - pressed)
    way = _summed(_summed(course))
    return np.asarray((way[:, 2 * span :] - 2.0 * way[:, span:-span] + way[:, : -2 * span]) / span**2)


def _summed(course: Float[np.ndarray, "candidate record"]) -> Float[np.ndarray, "candidate record"]:
    """Sum of trapezoids up to each record, in steps."""
    middle = 0.5 * (course[:, 1:] + course[:, :-1])
    return np.concatenate([np.zeros((len(course), 1)), np.cumsum(middle, axis=1)], axis=1)
