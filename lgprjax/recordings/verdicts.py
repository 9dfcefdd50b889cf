"""Verdicts on measured figures: a value, its limits, and where along the drive it falls short."""

from collections.abc import Sequence
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

Verdict = Literal["good", "look", "bad", "not recorded"]
"""The last is no verdict on quality: the underlying quantity was assumed by an importer."""


class Stretch(NamedTuple):
    """Part of a drive that a figure refers to, both ends included.

    Attributes:
        start_s, stop_s: time, seconds since the drive's ``t0_utc``.
        start_m, stop_m: travel by odometry since the first scan.
        channel: concerned; None for all.
    """

    start_s: float
    stop_s: float
    start_m: float
    stop_m: float
    channel: int | None = None


class HealthFigure(NamedTuple):
    """One measured property of a drive.

    Attributes:
        name: name of the figure, stable for programs.
        value: measured value in ``unit``; NaN, like the limits, if the underlying quantity was not recorded.
        look, bad: limits from which the verdict is ``look`` or ``bad``; a falling pair (look above bad) means that
            small values are bad.
        verdict: the value against its limits.
        meaning: description of the measured quantity, in one sentence.
        where: stretches that reach the limit of ``look``.
    """

    name: str
    value: float
    unit: str
    look: float
    bad: float
    verdict: Verdict
    meaning: str
    where: tuple[Stretch, ...]


Findings = tuple[list[HealthFigure], list[tuple[str, str]]]
"""Figures that were measured, and the names of those that could not be, with the reason."""


def verdict_of(value: float, look: float, bad: float) -> Verdict:
    """Compare a value with its limits; NaN is ``bad``."""
    sign = 1.0 if bad >= look else -1.0
    if not np.isfinite(value) or sign * value >= sign * bad:
        return "bad"
    return "look" if sign * value >= sign * look else "good"


def worst(verdicts: Sequence[Verdict]) -> Verdict:
    """The worst of some verdicts, ignoring those not recorded; ``good`` for none."""
    order: tuple[Verdict, ...] = ("good", "look", "bad")
    return max((each for each in verdicts if each in order), key=order.index, default="good")


def figure(
    name: str,
    value: float,
    unit: str,
    limits: tuple[float, float],
    meaning: str,
    where: tuple[Stretch, ...] = (),
) -> HealthFigure:
    """A figure with its verdict; ``limits`` are those of look and bad."""
    verdict = verdict_of(value, *limits)
    return HealthFigure(name, float(value), unit, *limits, verdict, meaning, where if verdict != "good" else ())


def not_recorded(name: str, why: str) -> HealthFigure:
    """A figure whose underlying quantity was not recorded."""
    nan = float("nan")
    return HealthFigure(name=name, value=nan, unit="", look=nan, bad=nan, verdict="not recorded", meaning=why, where=())


def runs(mask: Bool[np.ndarray, " place"]) -> list[tuple[int, int]]:
    """First and last index of every run of True."""
    edges = np.diff(np.concatenate([[False], mask, [False]]).astype(np.int8))
    return [(int(a), int(b) - 1) for a, b in zip(np.flatnonzero(edges > 0), np.flatnonzero(edges < 0), strict=True)]


class BlockStretches:
    """Blocks of scans as stretches of a drive.

    Args:
        first: first scan of each block, and the number of scans.
        time_s: scan times.
        path_m: metres travelled since the first scan.
    """

    def __init__(
        self, first: Int[np.ndarray, " edge"], time_s: Float[np.ndarray, " scan"], path_m: Float[np.ndarray, " scan"]
    ) -> None:
        self._first, self._time_s, self._path_m = first, time_s, path_m
        self.step_m = float(path_m[-1]) / max(len(path_m) - 1, 1)

    def of(self, mask: Bool[np.ndarray, " block"], channel: int | None = None) -> tuple[Stretch, ...]:
        """Stretches of the blocks selected by a mask."""
        out = []
        for low, high in runs(mask):
            a, b = int(self._first[low]), int(self._first[high + 1]) - 1
            times, metres = self._time_s[[a, b]], self._path_m[[a, b]]
            out.append(Stretch(float(times[0]), float(times[1]), float(metres[0]), float(metres[1]), channel))
        return tuple(out)

    def of_channels(self, mask: Bool[np.ndarray, "block channel"]) -> tuple[Stretch, ...]:
        """Stretches of the blocks selected by a mask, per channel."""
        return tuple(stretch for channel in range(mask.shape[1]) for stretch in self.of(mask[:, channel], channel))


def median_of(values: Float[np.ndarray, "block channel"]) -> Float[np.ndarray, " channel"]:
    """Median of the finite values of each column; NaN without any."""
    return np.array([np.median(c[np.isfinite(c)]) if np.isfinite(c).any() else np.nan for c in values.T])
