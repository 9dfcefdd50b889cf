"""Stamps of devices as this computer's time: jitter, drift, rollover, leaps, and what is rejected."""

import math
import random
from itertools import pairwise

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.runtime.stamps import GnssTimeScale, StampClock, WeekClock

_S = 1_000_000_000


class _Device:
    """Samples of a device whose clock may be set; told is what the clock under test made of each."""

    def __init__(self, period_s: float, *, offset_s: float = 1234.5, drift: float = 0.0, late_s: float = 0.2) -> None:
        self.clock = StampClock(late_s=late_s)
        self.period_s, self.offset_s, self.drift = period_s, offset_s, drift
        self.random = random.Random(1)
        self.true_s = 100.0
        self.errors_s: list[float | None] = []
        self.told: list[int] = []

    def sample(self, *, late_s: float = 0.0, jitter_s: float = 0.003) -> float | None:
        """Error of the time told for the next sample, less the transport of 2 ms that nobody can know."""
        self.true_s += self.period_s
        stamp_us = round((self.true_s * (1 + self.drift) + self.offset_s) * 1e6)
        arrival_ns = round((self.true_s + 0.002 + late_s + self.random.expovariate(1 / jitter_s)) * _S)
        told = self.clock.feed(stamp_us, arrival_ns)
        if told is None:
            error = None
        else:
            assert told <= arrival_ns
            error = told / _S - self.true_s - 0.002
            self.told.append(told)
        self.errors_s.append(error)
        return error

    def run(self, count: int) -> list[float | None]:
        return [self.sample() for _ in range(count)]


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_jitter_and_drift_for_an_hour(drift: float) -> None:
    device = _Device(0.5, drift=drift)
    errors = device.run(3600 * 2)
    taken = [error for error in errors if error is not None]
    assert len(taken) >= 0.999 * len(errors)
    # The least of the last few dozen arrivals is within a millisecond of nothing; drift adds 200 ppm of its age.
    assert max(abs(error) for error in taken[10:]) < 0.004
    assert all(left < right for left, right in pairwise(device.told))


def test_constant_delay_is_taken_off() -> None:
    clock = StampClock(delay_s=0.030)
    assert clock.feed(5_000_000, 7 * _S) == 7 * _S - 30_000_000
    assert clock.feed(5_020_000, 7 * _S + 25_000_000) == pytest.approx(7 * _S - 10_000_000, abs=5_000)  # drift


def test_duplicates_and_stamps_that_go_back() -> None:
    clock = StampClock()
    told = [
        clock.feed(stamp * 1000, round((0.5 + arrival / 1000) * _S))
        for stamp, arrival in [(20, 20), (40, 40), (40, 41), (40, 60), (30, 61), (60, 62), (80, 80)]
    ]
    rounded = [None if time is None else round((time / _S - 0.5) * 1000) for time in told]
    assert rounded == [20, 40, None, None, None, 60, 80]
    assert (clock.rejected, clock.settings) == (3, 0)


def test_late_samples_keep_their_own_time() -> None:
    device = _Device(0.2)
    device.run(50)
    error = device.sample(late_s=0.15)
    assert error is not None
    assert abs(error) < 0.004
    assert device.sample(late_s=0.3) is None
    assert device.sample() is not None


def test_a_line_that_grows_late_is_no_new_clock() -> None:
    device = _Device(0.02)
    device.run(100)
    assert [device.sample(late_s=0.5) for _ in range(2000)] == [None] * 2000
    assert device.clock.settings == 0
    assert device.sample() is not None


@pytest.mark.parametrize(("leap_s", "period_s"), [(0.06, 0.02), (1.0, 0.143), (1e6, 0.02)])
def test_one_leap_is_rejected_alone(leap_s: float, period_s: float) -> None:
    device = _Device(period_s)
    device.run(50)
    device.offset_s += leap_s
    assert device.sample() is None
    device.offset_s -= leap_s
    assert None not in device.run(50)


def test_stamps_that_do_not_agree_are_no_new_clock() -> None:
    device = _Device(0.02)
    device.run(50)
    for leap in range(1, 41):
        # From the future, growing, and each by another difference.
        device.offset_s += 0.3 * leap
        assert device.sample() is None
        device.offset_s -= 0.3 * leap
    assert device.clock.settings == 0
    assert None not in device.run(50)


@pytest.mark.parametrize(
    ("step_s", "period_s"), [(-3600.0, 0.143), (-0.5, 0.02), (-0.18, 0.143), (0.2, 0.02), (3600.0, 0.02)]
)
def test_a_clock_that_is_set_is_found(step_s: float, period_s: float) -> None:
    device = _Device(period_s)
    device.run(50)
    device.offset_s += step_s
    errors = device.run(100)
    # No sample between is told a wrong time; half a dozen later, a tenth of a second at least, it goes on.
    lost = errors.index(next(error for error in errors if error is not None))
    assert lost <= max(6, 0.1 / period_s + 2)
    assert all(error is not None and abs(error) < 0.012 for error in errors[lost + 1 :])
    assert device.clock.settings == 1
    assert all(left < right for left, right in pairwise(device.told))


def test_old_samples_in_a_burst_are_no_new_clock() -> None:
    device = _Device(0.02)
    device.run(100)
    now_ns = round((device.true_s + 0.01) * _S)
    for back in range(60, 0, -1):  # every 4 ms: a dozen that agree
        stamp_us = round((device.true_s - 0.004 * back + device.offset_s) * 1e6)
        assert device.clock.feed(stamp_us, now_ns) is None
    assert device.clock.settings == 0
    assert None not in device.run(20)


def test_a_first_sample_that_was_held_up_is_got_over() -> None:
    device = _Device(0.02)
    device.sample(late_s=1.0)
    errors = device.run(80)
    assert None not in errors[60:]
    assert max(abs(error) for error in errors[60:] if error is not None) < 0.004


@pytest.mark.parametrize(("scale", "length_s"), [(GnssTimeScale.GPS_WEEK, 604800.0), (GnssTimeScale.UTC_DAY, 86400.0)])
def test_time_begins_anew(scale: GnssTimeScale, length_s: float) -> None:
    clock = WeekClock(scale)
    told = []
    for tick in range(400):
        true_s = length_s - 20.0 + 0.1 * tick
        told.append(clock.feed(round(true_s % length_s, 3), round((true_s + 50.0) * _S)))
    assert all(time is not None for time in told)
    assert told == [pytest.approx((length_s - 20.0 + 0.1 * tick + 50.0) * _S, abs=1000) for tick in range(400)]
    assert clock.clock.settings == 0


@pytest.mark.parametrize("period_s", [0.02, 0.2])
def test_a_leap_second_is_got_over(period_s: float) -> None:
    clock = WeekClock(GnssTimeScale.UTC_DAY)
    lost = []
    for tick in range(round(20 / period_s)):
        true_s = 86390.0 + period_s * tick
        # 23:59:60 is told as such; then the day begins a second later than clocks that count on think.
        day_s = true_s if true_s < 86401.0 - 1e-6 else true_s - 86401.0
        arrival_ns = round((true_s + 7.0) * _S)
        told = clock.feed(max(0.0, round(day_s, 3)), arrival_ns)
        if told is None:
            lost.append(true_s)
        else:
            assert told == pytest.approx(arrival_ns, abs=2_000_000)
    assert clock.clock.settings == 1
    assert len(lost) <= max(6, 0.1 / period_s + 2)
    assert min(lost) >= 86401.0 - 1e-6


def test_no_times_of_week() -> None:
    clock = WeekClock(GnssTimeScale.GPS_WEEK)
    assert clock.feed(1.0, _S) == _S
    for tow_s in (math.nan, math.inf, -0.001, 604800.0, 1e300):
        assert clock.feed(tow_s, 2 * _S) is None
    assert clock.feed(2.0, 2 * _S) == 2 * _S


@given(st.lists(st.tuples(st.integers(0, 3_000_000), st.integers(0, 400_000_000)), max_size=80))
@settings(max_examples=50, deadline=None)
def test_told_times_grow_and_never_lie_ahead(samples: list[tuple[int, int]]) -> None:
    clock, arrival_ns, told_before = StampClock(), 0, -(10**18)
    for stamp_us, waited_ns in samples:
        arrival_ns += waited_ns
        told = clock.feed(stamp_us, arrival_ns)
        if told is not None:
            assert told_before < told <= arrival_ns
            told_before = told
