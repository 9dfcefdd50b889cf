"""Travel by a box that falls silent or starts anew, and what the search makes of it."""

import math
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest

from lgprjax.frames import LocalFrame
from lgprjax.registration import DriveFixes
from lgprjax.run_records import FIX, PRIOR, Record, RecordKind, Source
from lgprjax.runtime.config import SensorsTable
from lgprjax.runtime.control.senses import Sensed, Senses
from lgprjax.runtime.registration.program import ScanQueue, _Scan
from lgprjax.runtime.registration.search import Search
from lgprjax.runtime.stamps import StampClock
from lgprjax.wire import Frame, encode

_T0 = 10_000_000_000
_SPEED_MPS = 3.0
_STATUS = {
    **{"command_sequence": 0, "engaged": 0, "state": 0, "refused": 0, "encoder_counts": 0, "pedals": 0},
    **{"potentiometer_v": 1.0, "supply_v": 24.0, "torque_nm": 0.0, "throttle": 0.0, "brake": 0.0},
}


def _senses() -> Senses:
    return Senses(LocalFrame(42.0, -71.0, 0.0), SensorsTable())


def _driven(silent_s: tuple[float, float] = (9.0, 9.0), restart: bool = False) -> tuple[Senses, list[Sensed]]:
    """Three seconds at 3 m/s, a status each 10 ms but in a silence, after which the box may count from zero."""
    senses, ticks = _senses(), []
    for number in range(300):
        at_s, now_ns = 0.01 * number, _T0 + 10_000_000 * number
        anew = restart and at_s >= silent_s[1]
        since_s = at_s - silent_s[0] if anew else at_s + 5.0
        if not silent_s[0] <= at_s < silent_s[1]:
            fields = {**_STATUS, "speed_mps": _SPEED_MPS, "odometer_m": _SPEED_MPS * since_s + 500.0 * (not anew)}
            stamp_us = round(1e6 * since_s)
            data = encode(
                "drive_status", fields, mode=0, session=1 + anew, sequence=number, stamp_us=stamp_us, ttl_ms=0
            )
            senses.take(Record(RecordKind.PORT_IN, Source.DRIVE_BY_WIRE, 0, now_ns, data))
        if number % 2:
            ticks.append(senses.end_tick(now_ns))
    return senses, ticks


@pytest.mark.parametrize("silent_s", [(1.0, 1.3), (1.0, 2.2)])
def test_a_silence_loses_no_travel(silent_s: tuple[float, float]) -> None:
    senses, ticks = _driven(silent_s)
    assert senses.travel_m == pytest.approx(9.0, abs=0.1)
    assert not any(tick.travel_lost for tick in ticks)
    speeds = [tick.odometer_mps for tick in ticks if math.isfinite(tick.odometer_mps)]
    np.testing.assert_allclose(speeds, _SPEED_MPS, rtol=1e-3)


def test_a_box_that_starts_anew_tells_that_travel_is_lost() -> None:
    senses, ticks = _driven((1.0, 1.2), restart=True)
    assert sum(tick.travel_lost for tick in ticks) == 1
    assert 7.8 < senses.travel_m < 8.4
    assert all(not abs(tick.odometer_mps) > 1.1 * _SPEED_MPS for tick in ticks)


def test_an_odometer_that_leaps_is_lost_travel() -> None:
    senses = _senses()
    lost = []
    for number, odometer_m in enumerate((0.0, 0.03, 700.0, 700.03, 700.06, 700.09)):
        fields = {**_STATUS, "speed_mps": _SPEED_MPS, "odometer_m": odometer_m}
        data = encode(
            "drive_status", fields, mode=0, session=1, sequence=number, stamp_us=10_000 * number + 1, ttl_ms=0
        )
        senses.take(Record(RecordKind.PORT_IN, Source.DRIVE_BY_WIRE, 0, _T0 + 10_000_000 * number, data))
        lost.append(senses.end_tick(_T0 + 10_000_000 * number).travel_lost)
    assert lost == [False, False, True, False, False, False]
    assert senses.travel_m == pytest.approx(0.12)


def test_a_fix_keeps_its_own_probability() -> None:
    """Of two scans of a tick the first gave the fix; the other was declined."""

    def fix(scan: int, code: int, p_false: float) -> Record:
        row = np.zeros((), FIX)
        row["scan_ns"], row["scan"], row["code"], row["correlation"], row["p_false"] = _T0, scan, code, 0.8, p_false
        return Record(RecordKind.FIX, Source.REGISTRATION, 0, _T0, row.tobytes())

    senses = _senses()
    senses.end_tick(_T0)
    senses.take(fix(1, 0, 9e-5))
    senses.take(fix(2, 2, 1e-30))
    tick = senses.end_tick(_T0 + 20_000_000)
    assert tick.fix is not None
    assert int(tick.fix["scan"]) == 1
    assert tick.p_false == pytest.approx(9e-5)
    senses.take(fix(3, 2, 0.3))
    assert senses.end_tick(_T0 + 40_000_000).p_false == pytest.approx(0.3)


class _Searches:
    """Counts how often a search began anew."""

    def __init__(self) -> None:
        self.begun = 0

    def begin_anew(self) -> None:
        self.begun += 1


def test_lost_travel_begins_the_search_anew() -> None:
    searches = _Searches()
    queue = ScanQueue(cast(Search, cast(Any, searches)), StampClock(), 3.0, 0.3)

    def prior(valid: bool) -> bytes:
        row = np.zeros((), PRIOR)
        row["time_ns"], row["valid"] = _T0, valid
        return row.tobytes()

    # Nothing was searched yet: there is nothing to forget.
    queue.priors.take(prior(False))
    assert queue.step() is None
    assert searches.begun == 0
    queue._begins = False
    queue.priors.take(prior(True))
    assert queue.step() is None
    assert searches.begun == 0
    queue.priors.take(prior(False))
    queue.priors.take(prior(False))
    assert queue.step() is None
    assert queue.step() is None
    assert searches.begun == 1
    assert queue._begins


def test_a_match_that_is_told_again_at_standstill_says_hardly_more() -> None:
    """One scan is searched, then the vehicle stands; the filter is told each tenth of a second."""
    queue = ScanQueue(cast(Search, cast(Any, _Searches())), StampClock(), 3.0, 0.3)
    shape = {"pose": (1, 5), "covariance": (1, 5, 5), "overlap_channels": (1,)}
    scalars = ("code", "window_m", "correlation", "margin", "overlap", "overlap_channels", "p_false")
    names = (*scalars, "pose", "covariance")
    fix = SimpleNamespace(**{name: np.zeros(shape.get(name, (1,)), np.float32) for name in names})
    fix.covariance = 0.01 * np.eye(5, dtype=np.float32)[None]
    variances = []
    for number in range(40):
        found = cast(DriveFixes, cast(Any, SimpleNamespace(fix=fix, searched=np.array([number == 0]))))
        scan = _Scan(_T0 + 100_000_000 * number, cast(Frame, SimpleNamespace(number=lambda _: 0)))
        (row,) = queue._rows([scan], found)
        assert int(row["code"]) == 0
        variances.append(float(row["covariance"][0, 0]))
    assert variances[0] == pytest.approx(0.01)
    assert np.sum(1.0 / np.array(variances)) < 1.4 / 0.01
    # The next match is one of its own.
    found = cast(DriveFixes, cast(Any, SimpleNamespace(fix=fix, searched=np.array([True]))))
    (row,) = queue._rows([scan], found)
    assert float(row["covariance"][0, 0]) == pytest.approx(0.01)
