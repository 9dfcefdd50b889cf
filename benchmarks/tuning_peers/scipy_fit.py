"""The loop of the same drives by ``scipy.optimize.least_squares``: NumPy over all drives at once, a step at a time.

The model, the clipped (Huber) residuals and the prior are those of the study, written again in float64. All columns of
the Jacobian are one pass over the steps: drives that differ in one number each, or in where the servo begins. It finds
the likeliest numbers and no more: neither the posterior along the servo's rate nor the memory of the errors, which the
study's intervals rest on.

``python -m benchmarks.tuning_peers.scipy_fit OUT PROBLEM --repeats N --threads N``.
"""

import argparse
import json
import time
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from scipy.optimize import least_squares

from benchmarks.process import hold_to
from benchmarks.rollout_peers.work import peak_rss_mb
from benchmarks.tuning_problem import TuningProblem, load_tuning

STEP_S = 0.02
_BY_FACTOR = np.array([True, False, True, False, False, False, False, False, False])
_HUBER = 1.345
_AROUND_S = 1.0
_START_RAD = 0.02
_DIFFERENCE = 1e-4
_ROUNDS, _AT_REST = 12, 1e-2


def values_of(problem: TuningProblem, place: Float[np.ndarray, "*n number"]) -> Float[np.ndarray, "*n number"]:
    """Numbers at places in units of the prior's width."""
    moved = place * problem.width.astype(np.float64)
    value = problem.value.astype(np.float64)
    return np.where(_BY_FACTOR, value * np.exp(np.where(_BY_FACTOR, moved, 0.0)), value + moved)


def model(
    problem: TuningProblem, sought: Float[np.ndarray, "case sought"]
) -> Float[np.ndarray, "output case drive step"]:
    """Front angle and yaw rate of every drive in several cases at once."""
    place, start = np.split(sought, [len(problem.value)], axis=1)
    lag, delay, rate, dead, asymmetry, ratio, slip, zero, late = values_of(problem, place).T[..., None]
    command, share = problem.command_rad.astype(np.float64).T, problem.share.astype(np.float64).T
    play = 0.5 * float(problem.backlash_rad)
    dead = np.maximum(dead, 0.0)
    measured = problem.front_rad.astype(np.float64).T
    wheel = measured[0] - zero
    motor = wheel + _START_RAD * start
    seen = np.empty((len(command), *wheel.shape))
    for step, (wanted, torque, placed) in enumerate(zip(command, share, problem.placed.T, strict=True)):
        if placed.any():
            stands = measured[step] - zero
            motor, wheel = np.where(placed, stands + _START_RAD * start, motor), np.where(placed, stands, wheel)
        seen[step] = wheel
        wrong = wanted - motor
        wrong = wrong - np.clip(wrong, -dead, dead)
        most = rate * torque * STEP_S
        turned = wrong * -np.expm1(-STEP_S * torque / lag)
        motor = motor + np.clip(turned, -most * (1.0 - asymmetry), most * (1.0 + asymmetry))
        wheel = np.clip(wheel, motor - play, motor + play)
    wheel = _later(np.moveaxis(seen, 0, -1), delay[:, 0])
    speed = problem.speed_mps.astype(np.float64)[None]
    around = 0.5 * (_later(speed, np.array([_AROUND_S])) + _later(speed, np.array([-_AROUND_S])))
    gain = 1.0 / (1.0 + slip[..., None] * around**2)
    turning = np.tan(wheel) + np.tan(ratio[..., None] * wheel)
    yaw_rate = gain * speed * turning / float(problem.wheelbase_m)
    return np.stack([wheel + zero[..., None], _later(yaw_rate, late[:, 0])])


def _later(
    values: Float[np.ndarray, "case drive step"], late_s: Float[np.ndarray, " case"]
) -> Float[np.ndarray, "case drive step"]:
    steps = values.shape[-1]
    rows = []
    for one, late in zip(values, late_s, strict=True):
        at = np.clip(np.arange(steps) - late / STEP_S, 0.0, steps - 1.0)
        low = np.minimum(at.astype(int), steps - 2)
        rows.append(one[:, low] + (at - low) * (one[:, low + 1] - one[:, low]))
    return np.stack(rows)


class LoopResiduals:
    """Residuals of the drives and of the prior, at scales that are held until they are taken anew.

    Sought are places of the numbers, and where each drive's servo begins, in its standard deviations.
    """

    def __init__(self, problem: TuningProblem) -> None:
        # What no drive reaches was only padded.
        last = int(np.flatnonzero(np.any(problem.front_used | problem.yaw_used, axis=0))[-1]) + 1
        names = ("command_rad", "share", "speed_mps", "front_rad", "yaw_rate_radps", "front_used", "yaw_used", "placed")
        cut = {name: getattr(problem, name)[:, :last] for name in names}
        self.problem = problem._replace(**cut)
        self.measured = np.stack([cut["front_rad"], cut["yaw_rate_radps"]]).astype(np.float64)
        self.used: Bool[np.ndarray, "output drive step"] = np.stack([cut["front_used"], cut["yaw_used"]])
        self.scale = np.ones(self.used.shape[:2])

    def left(self, sought: Float[np.ndarray, "case sought"]) -> Float[np.ndarray, "case output drive step"]:
        """Measured less model, the gyro's bias taken out."""
        left = np.moveaxis(self.measured[:, None] - model(self.problem, sought), 0, 1)
        for case in left:
            for drive, used in enumerate(self.used[1]):
                if used.any():
                    own = case[1, drive, used]
                    middle = np.median(own)
                    wide = 2.0 * _spread(own)
                    case[1, drive] -= middle + np.mean(np.clip(own - middle, -wide, wide))
        return np.asarray(np.where(self.used, left, 0.0))

    def take_scales(self, sought: Float[np.ndarray, " sought"]) -> None:
        """Robust scales about a place."""
        left = self.left(sought[None])[0]
        for output, drive in np.ndindex(self.scale.shape):
            used = self.used[output, drive]
            self.scale[output, drive] = _spread(left[output, drive, used]) if used.any() else 1.0

    def __call__(self, sought: Float[np.ndarray, " sought"]) -> Float[np.ndarray, " residual"]:
        """For ``least_squares``."""
        return np.append((self.left(sought[None])[0] / self.scale[..., None])[self.used], sought)

    def jacobian(self, sought: Float[np.ndarray, " sought"]) -> Float[np.ndarray, "residual sought"]:
        """Forward differences, all in one pass: the starts together, each drive having only its own."""
        numbers = len(self.problem.value)
        each = np.eye(len(sought))
        moved = np.concatenate([np.zeros_like(each[:1]), each[:numbers], each[numbers:].sum(axis=0, keepdims=True)])
        left = self.left(sought + _DIFFERENCE * moved) / self.scale[..., None]
        slopes = (left[1:] - left[0]) / _DIFFERENCE
        own = np.eye(len(each) - numbers)[:, None, :, None] * slopes[-1]
        return np.concatenate([np.concatenate([slopes[:-1], own])[:, self.used].T, each])


def _spread(values: Float[np.ndarray, " step"]) -> float:
    return max(1.4826 * float(np.median(np.abs(values - np.median(values)))), 1e-5)


def fit(problem: TuningProblem) -> Float[np.ndarray, " number"]:
    """The likeliest numbers: least squares in turn with the scales, from the vehicle file's values."""
    residuals = LoopResiduals(problem)
    sought = np.zeros(len(problem.value) + len(problem.placed))
    for _ in range(_ROUNDS):
        residuals.take_scales(sought)
        before = sought
        sought = least_squares(
            residuals, sought, jac=residuals.jacobian, loss="huber", f_scale=_HUBER, xtol=1e-5, ftol=1e-7, max_nfev=30
        ).x
        if np.max(np.abs(sought - before)) < _AT_REST:
            break
    return values_of(problem, sought[: len(problem.value)])


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.tuning_peers.scipy_fit")
    parser.add_argument("out", type=Path)
    parser.add_argument("problem", type=Path)
    for name in ("--repeats", "--threads"):
        parser.add_argument(name, type=int, required=True)
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    problem = load_tuning(chosen.problem)
    taken_s = []
    for _ in range(chosen.repeats):
        begin = time.perf_counter()
        found = fit(problem)
        taken_s.append(time.perf_counter() - begin)
    apart = np.abs(found - problem.found) / problem.sigma
    figures = {
        "fit_s": min(taken_s),
        "found": found.tolist(),
        "apart": float(np.max(apart)),
        "threads": chosen.threads,
        "peak_rss_mb": peak_rss_mb(),
    }
    chosen.out.write_text(json.dumps(figures), encoding="utf-8")


if __name__ == "__main__":
    main()
