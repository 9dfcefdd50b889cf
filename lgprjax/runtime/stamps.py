"""Conversion of a device's time stamps to monotonic times of this computer."""

import math
from enum import IntEnum
from typing import NamedTuple

from lgprjax.wire import LeastDelay

_NEAR_NS = 50_000_000
"""Differences between arrival and stamp within this belong to one clock. A difference below the least by more than
this is a stamp from the future.
"""
_ENOUGH = 5
_ENOUGH_NS = 100_000_000
"""Consecutive samples, and their duration, that establish a clock that was set."""


class _Run(NamedTuple):
    """Rejected stamps in a row that agree with each other: of a clock that may have been set."""

    difference_ns: int
    least_ns: int
    since_ns: int
    last_stamp_ns: int
    samples: int


class StampClock:
    """Times of one kind of sample, from the device's stamps and never later than their arrival.

    A stamp is rejected when it does not grow, when it is from the future, or when it came more than ``late_s`` late. A
    clock that was set, forward or back, is accepted once enough consecutive samples agree. A delayed line looks
    different, as its stamps keep growing, and is never mistaken for a clock that was set.

    Args:
        delay_s: least delay from the measurement of a sample to its arrival.
        late_s: largest additional delay of a sample.

    Attributes:
        rejected: samples so far.
        settings: number of times the clock was set.
    """

    def __init__(self, delay_s: float = 0.0, late_s: float = 0.2) -> None:
        self._delay_ns = round(delay_s * 1e9)
        self._late_ns = round(late_s * 1e9)
        self._least: LeastDelay | None = None
        self._run: _Run | None = None
        self._last_stamp_ns = 0
        self._last_time_ns: int | None = None
        self.rejected = 0
        self.settings = 0

    def feed(self, stamp_us: int, arrival_ns: int) -> int | None:
        """Monotonic time, ns, of the sample stamped ``stamp_us``; ``None`` where it is rejected.

        Times grow from sample to sample and are never later than ``arrival_ns``, which must not fall.
        """
        time_ns = self._time_of(stamp_us * 1000, arrival_ns)
        if time_ns is None or (self._last_time_ns is not None and time_ns <= self._last_time_ns):
            self.rejected += 1
            return None
        self._last_time_ns = time_ns
        return time_ns

    def expected_us(self, arrival_ns: int) -> int | None:
        """Stamp, us, of a sample that arrives now without delay; ``None`` before the first."""
        return None if self._least is None else (arrival_ns - self._least.at(arrival_ns)) // 1000

    def _time_of(self, stamp_ns: int, arrival_ns: int) -> int | None:
        difference = arrival_ns - stamp_ns
        if self._least is None:
            self._least = LeastDelay(difference, arrival_ns)
        elif not self._believed(stamp_ns, difference, self._least.at(arrival_ns)):
            run = self._run
            if run is None or run.samples < _ENOUGH or arrival_ns - run.since_ns < _ENOUGH_NS:
                return None
            self._least = LeastDelay(run.least_ns, arrival_ns)
            self.settings += 1
        self._run = None
        self._last_stamp_ns = stamp_ns
        return stamp_ns + self._least.feed(difference, arrival_ns) - self._delay_ns

    def _believed(self, stamp_ns: int, difference_ns: int, least_ns: int) -> bool:
        """Whether the sample fits the present clock; else it is noted, in case the clock was set."""
        late = difference_ns - least_ns
        grows = stamp_ns > self._last_stamp_ns
        run = self._run
        goes_on = (
            run is not None
            and stamp_ns > run.last_stamp_ns
            and abs(difference_ns - run.difference_ns) <= _NEAR_NS  # of the run's first
        )
        # Stamps that grow again after going back look late, and belong to the set clock.
        if grows and -_NEAR_NS <= late <= self._late_ns and (late <= _NEAR_NS or not goes_on):
            return True
        if run is not None and goes_on:
            self._run = run._replace(
                least_ns=min(run.least_ns, difference_ns), last_stamp_ns=stamp_ns, samples=run.samples + 1
            )
        elif not grows or late < -_NEAR_NS:
            self._run = _Run(difference_ns, difference_ns, stamp_ns + difference_ns, stamp_ns, 1)
        else:
            self._run = None
        return False


class GnssTimeScale(IntEnum):
    """Seconds after which a GNSS time restarts; ``NONE`` if a message has no time."""

    NONE = 0
    UTC_DAY = 86_400
    GPS_WEEK = 604_800


class WeekClock:
    """A ``StampClock`` for times of week or day, which restart, and which leap seconds set back.

    Args:
        scale: time scale; not ``NONE``.
        delay_s, late_s: arguments of the ``StampClock``.

    Attributes:
        clock: underlying ``StampClock``.
    """

    def __init__(self, scale: GnssTimeScale, delay_s: float = 0.0, late_s: float = 0.2) -> None:
        self.clock = StampClock(delay_s, late_s)
        self._period_us = scale * 1_000_000
        # The last minute of a day may have 61 seconds.
        self._end_s = scale + (scale is GnssTimeScale.UTC_DAY)

    def feed(self, time_s: float, arrival_ns: int) -> int | None:
        """Monotonic time, ns, of the sample of ``time_s`` seconds of the week or day; ``None`` if it is rejected."""
        if not (math.isfinite(time_s) and 0.0 <= time_s < self._end_s):
            self.clock.rejected += 1
            return None
        stamp_us = round(time_s * 1e6)
        expected_us = self.clock.expected_us(arrival_ns)
        if expected_us is not None:
            stamp_us += (expected_us - stamp_us + self._period_us // 2) // self._period_us * self._period_us
        return self.clock.feed(stamp_us, arrival_ns)
