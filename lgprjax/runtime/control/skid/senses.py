"""Inputs of a skid-steer vehicle's control loop from its lines: messages in, the numbers of a tick out."""

import math
from typing import NamedTuple

from lgprjax.frames import LocalFrame
from lgprjax.runtime.config import SensorsTable
from lgprjax.runtime.control.senses import BoxStatus, LineSenses, LocalAttitude, LocalPosition, TurnRate
from lgprjax.runtime.gnss import Quality

# Turns of the vehicle by the INS, ten times per second, from any of its messages.
#
# Only changes of a heading are used: an INS at standstill does not know north. Messages with an attitude are preferred;
# without any, a yaw rate is integrated.

_LEAST_NS = 95_000_000
"""A faster INS is read ten times per second: the noise of a turn is that of its two ends."""
_APART_NS = 500_000_000
"""Rates farther apart than this are not integrated."""


class InsTurn(NamedTuple):
    """A turn, counter-clockwise, and its duration by the INS's own stamps."""

    turn_rad: float
    span_s: float


class InsTurns:
    """Messages in, turns out."""

    def __init__(self) -> None:
        self._from: LocalAttitude | None = None
        self._rate: TurnRate | None = None
        self._summed = InsTurn(0.0, 0.0)

    def take(self, attitude: LocalAttitude | None, rates: list[TurnRate]) -> InsTurn | None:
        """The turn completed by a tick's messages; ``None`` without one."""
        if attitude is not None:
            return self._turned(attitude)
        return self._sum_up(rates) if self._from is None else None

    def _turned(self, attitude: LocalAttitude) -> InsTurn | None:
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


_LONGEST_NS = 500_000_000
"""Odometer readings farther apart than this give no speed."""
_PRESENT_PERIODS = 1.5


class SkidSensed(NamedTuple):
    """Data since the last tick, and the state at its end.

    Attributes:
        step_s: time since the last tick.
        left_mps, right_mps: mean speeds of the tracks since the last skid_status of the previous tick; the last
            measured speeds without one; NaN if unknown.
        place: new position of this tick, or ``None``.
        turn: new INS turn of this tick, or ``None``.
        box: last skid_status; ``None`` before the first.
        box_age_s: time since its arrival; infinite before the first.
        gnss_age_s: time since the measurement of the newest position; infinite before the first.
        ins_age_s: age of the newest turn.
        quality: quality of the newest position while it is younger than 1.5 periods.
    """

    step_s: float
    left_mps: float
    right_mps: float
    place: LocalPosition | None
    turn: InsTurn | None
    box: BoxStatus | None
    box_age_s: float
    gnss_age_s: float
    ins_age_s: float
    quality: Quality


class SkidSenses(LineSenses):
    """Takes the lines' messages one by one.

    Args:
        frame: frame of the plan; ``None``: the first position becomes its anchor.
        sensors: sensor table of the configuration.
    """

    def __init__(self, frame: LocalFrame | None, sensors: SensorsTable) -> None:
        super().__init__(frame, sensors, "skid_status")
        self._turns = InsTurns()
        self._period_s = sensors.gnss_period_s
        self._counted: tuple[int, float, float] | None = None
        self._speeds = (math.nan, math.nan)
        self._turned_ns = 0

    def _take_status(self, box: BoxStatus, *, anew: bool) -> None:
        del box
        if anew:
            self._counted = None

    def end_tick(self, now_ns: int) -> SkidSensed:
        """Everything since the last tick, which is then marked as seen."""
        step_s = self._step_s(now_ns)
        gnss = self._gnss.end_tick()
        turn = self._turns.take(gnss.attitude, gnss.rates)
        if turn is not None:
            self._turned_ns = now_ns
        self._measure_speeds(now_ns)
        newest = self.place
        gnss_age_s = math.inf if newest is None else (now_ns - newest.time_ns) / 1e9
        present = newest is not None and gnss_age_s < _PRESENT_PERIODS * self._period_s
        return SkidSensed(
            step_s,
            *self._speeds,
            gnss.place,
            turn,
            self.box,
            self._box_age_s(now_ns),
            gnss_age_s,
            (now_ns - self._turned_ns) / 1e9,
            newest.quality if newest is not None and present else Quality.NONE,
        )

    def _measure_speeds(self, now_ns: int) -> None:
        """Measure the track speeds from the box's own stamps, which do not jitter like arrivals."""
        box, before = self.box, self._counted
        if box is None:
            return
        self._counted = here = (box.time_ns, box.number("left_m"), box.number("right_m"))
        if now_ns - box.arrival_ns > _LONGEST_NS:
            self._speeds = (math.nan, math.nan)
        elif before is None or here[0] - before[0] > _LONGEST_NS:
            self._speeds = (box.number("left_mps"), box.number("right_mps"))
        elif here[0] > before[0]:
            step_s = (here[0] - before[0]) / 1e9
            self._speeds = ((here[1] - before[1]) / step_s, (here[2] - before[2]) / step_s)
