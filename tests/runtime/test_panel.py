"""What the operator's page shows of the radar: of scans that were judged, and never of old ones."""

import math

import pytest

from lgprjax.registration import Code
from lgprjax.runtime.control.compiled import TickResult
from lgprjax.runtime.control.counter_steer import Panel
from lgprjax.runtime.control.setup import LaidRoute

_RESULT = TickResult(*[math.nan] * len(TickResult._fields))._replace(reasons=0.0)


def made_panel() -> Panel:
    return Panel([LaidRoute("a", None, 10.0, [[0.0, 0.0]], "")])


def test_scans_between_the_stops_of_a_search_say_nothing_new() -> None:
    """Every seventh scan is a stop, and good; the others have no window of their own."""
    panel = made_panel()
    for tick in range(500):
        for scan in range(3 * tick, 3 * tick + 3):
            stop = scan % 7 == 0
            panel.take_fix(tick, Code.OK if stop else Code.NO_WINDOW, 0.93 if stop else math.nan)
        state = panel.state(tick, 0, _RESULT)
        assert (state["code"], state["correlation"], state["ok_share"]) == ("ok", 0.93, 1.0)


def test_a_search_that_finds_no_window_for_half_a_second_is_shown() -> None:
    panel = made_panel()
    panel.take_fix(0, Code.OK, 0.93)
    for tick in range(1, 40):
        panel.take_fix(tick, Code.NO_WINDOW, math.nan)
    assert panel.state(40, 0, _RESULT)["code"] == "no_window"


def test_scans_that_stopped_are_no_correlation() -> None:
    panel = made_panel()
    assert panel.state(0, 0, _RESULT)["code"] is None
    panel.take_fix(1, Code.OK, 0.93)
    assert panel.state(20, 0, _RESULT)["correlation"] == pytest.approx(0.93)
    old = panel.state(30, 0, _RESULT)
    assert old["code"] is None
    assert math.isnan(old["correlation"])
