"""How far the INS says that the vehicle has turned, ten times a second, of whatever messages it speaks.

A heading is used for its changes alone: an INS of a machine that has stood does not know north. Messages that tell an
attitude come first; where there are none, a yaw rate is summed up.
"""

import math
from typing import NamedTuple

from lgprjax.runtime.control.gnss_senses import Attitude, TurnRate

_LEAST_NS = 95_000_000
"""An INS that speaks more often is heard ten times a second: the noise of a turn is that of its two ends."""
_APART_NS = 500_000_000
"""Rates farther apart than this do not say what was between."""


class InsTurn(NamedTuple):
    """A turn, counter-clockwise, and how long it took by the INS's own stamps."""

    turn_rad: float
    span_s: float


class InsTurns:
    """Messages in, turns out."""

    def __init__(self) -> None:
        self._from: Attitude | None = None
        self._rate: TurnRate | None = None
        self._summed = InsTurn(0.0, 0.0)

    def take(self, attitude: Attitude | None, rates: list[TurnRate]) -> InsTurn | None:
        """The turn that a tick's messages complete; ``None`` where they complete none."""
        if attitude is not None:
            return self._turned(attitude)
        return self._sum_up(rates) if self._from is None else None

    def _turned(self, attitude: Attitude) -> InsTurn | None:
        before = self._from
        if before is None:
            self._from = attitude
            return None
        span_ns = attitude.time_ns - before.time_ns
        if span_ns < _LEAST_NS:
            return None
        self._from = attitude
        return InsTurn(math.remainder(attitude.yaw_rad - before.yaw_rad, math.tau), span_ns / 1e9)

    def _sum_up(self, rates: list[TurnRate]) -> InsTurn | None:
        for rate in rates:
            before, self._rate = self._rate, rate
            span_ns = 0 if before is None else rate.arrival_ns - before.arrival_ns
            if before is None or span_ns > _APART_NS or not math.isfinite(before.radps + rate.radps):
                self._summed = InsTurn(0.0, 0.0)
                continue
            turn = 0.5 * (before.radps + rate.radps) * span_ns / 1e9
            self._summed = InsTurn(self._summed.turn_rad + turn, self._summed.span_s + span_ns / 1e9)
        if self._summed.span_s < _LEAST_NS / 1e9:
            return None
        summed, self._summed = self._summed, InsTurn(0.0, 0.0)
        return summed
