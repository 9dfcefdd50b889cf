"""Records between the processes: what is known of fixes of this layout, and of older runs."""

import math
import struct

import numpy as np
import pytest

from lgprjax.frames import LocalFrame
from lgprjax.registration import Code
from lgprjax.run_records import FIX, Record, RecordKind, Source, fix_row
from lgprjax.runtime.config import SensorsTable
from lgprjax.runtime.control.senses import Senses

_NOW_NS = 5_000_000_000


def _fields(code: Code, correlation: float) -> bytes:
    """A fix of layout 1.1, field by field as data_schema/run_log.toml has them."""
    head = struct.pack("<qIBbH4f", _NOW_NS, 7, int(code), 2, 3, correlation, 0.2, 0.7, 11.0)
    return head + struct.pack("<5d", *range(5)) + struct.pack("<25d", *np.diag(np.full(5, 1e-4)).ravel())


def _taken(payload: bytes) -> Senses:
    senses = Senses(LocalFrame(45.0, 7.0, 300.0), SensorsTable())
    senses.take(Record(RecordKind.FIX, Source.REGISTRATION, 0, _NOW_NS, payload))
    return senses


def test_a_fix_of_this_layout_is_read_back() -> None:
    row = fix_row(_fields(Code.OK, 0.8) + struct.pack("<f", 3e-7))
    assert (int(row["scan"]), int(row["code"]), int(row["window_dm"]), int(row["waiting"])) == (7, Code.OK, 2, 3)
    assert float(row["correlation"]) == pytest.approx(0.8)
    assert row["pose"].tolist() == [0.0, 1.0, 2.0, 3.0, 4.0]
    assert float(row["p_false"]) == pytest.approx(3e-7)


def test_of_a_fix_of_an_older_run_everything_is_known_but_its_chance() -> None:
    old = fix_row(_fields(Code.OK, 0.8))
    new = fix_row(_fields(Code.OK, 0.8) + struct.pack("<f", 0.5))
    assert math.isnan(float(old["p_false"]))
    for name in FIX.names or ():
        if name != "p_false":
            np.testing.assert_array_equal(old[name], new[name])


@pytest.mark.parametrize("bytes_off", [-4, 1])
def test_what_is_no_fix_of_either_layout_is_refused(bytes_off: int) -> None:
    whole = _fields(Code.OK, 0.8)
    with pytest.raises(ValueError, match="buffer"):
        fix_row(whole[:bytes_off] if bytes_off < 0 else whole + bytes(4 + bytes_off))


def test_a_matched_scan_says_what_its_match_is_worth() -> None:
    for code in (Code.OK, Code.LOW_CORRELATION, Code.AMBIGUOUS):
        sensed = _taken(_fields(code, 0.3) + struct.pack("<f", 2e-6)).end_tick(_NOW_NS)
        assert sensed.p_false == pytest.approx(2e-6)
        assert (sensed.fix is not None) == (code is Code.OK)


def test_a_tick_without_a_match_says_nothing_of_the_ground() -> None:
    for code in (Code.NO_WINDOW, Code.OFF_MAP):
        senses = _taken(_fields(code, math.nan) + struct.pack("<f", 1.0))
        assert math.isnan(senses.end_tick(_NOW_NS).p_false)
    senses = _taken(_fields(Code.OK, 0.3) + struct.pack("<f", 2e-6))
    senses.end_tick(_NOW_NS)
    assert math.isnan(senses.end_tick(_NOW_NS + 20_000_000).p_false)


def test_the_match_of_an_older_run_is_not_taken_for_a_good_one() -> None:
    sensed = _taken(_fields(Code.OK, 0.9)).end_tick(_NOW_NS)
    assert sensed.fix is not None
    assert math.isnan(sensed.p_false)
