"""When the items of scripts and faults begin and end, and which are refused."""

import math
from pathlib import Path
from typing import Any

import pytest

from lgprjax.simulation.devices.faults import (
    FAULT_LASTS_S,
    FAULTS,
    Moment,
    RunningFaults,
    Schedule,
    ScriptItem,
    read_items,
)
from lgprjax.simulation.devices.vehicle import SCRIPT, SCRIPT_LASTS_S
from refusals import refused


def _script(*rows: dict[str, Any]) -> list[ScriptItem]:
    return read_items(Path("s.json"), "script", list(rows), key="do", known=SCRIPT, lasts_s=SCRIPT_LASTS_S)


def _faults(*rows: dict[str, Any]) -> list[ScriptItem]:
    return read_items(Path("s.json"), "faults", list(rows), key="kind", known=FAULTS, lasts_s=FAULT_LASTS_S)


def _at(now_s: float, ready_s: float | None = 10.0, way_m: float = 0.0, mode: int = 2, mode_s: float = 0.0) -> Moment:
    since = None if ready_s is None or now_s < ready_s else now_s - ready_s
    return Moment(now_s, since, way_m, mode, mode_s)


def _names(items: list[ScriptItem]) -> list[str]:
    return [item.name for item in items]


def test_moments_count_from_ready() -> None:
    schedule = Schedule(_script({"at_s": 2.0, "do": "press", "button": "plus"}))
    assert schedule.step(_at(30.0, ready_s=None)) == []
    assert schedule.step(_at(31.9, ready_s=30.0)) == []
    assert _names(schedule.step(_at(32.0, ready_s=30.0))) == ["press"]
    assert _names(schedule.step(_at(32.29, ready_s=30.0))) == ["press"]
    assert schedule.step(_at(32.31, ready_s=30.0)) == []
    # It does not begin again.
    assert schedule.step(_at(40.0, ready_s=30.0)) == []


def test_a_mode_must_have_lasted() -> None:
    schedule = Schedule(_script({"after": {"mode": 3, "for_s": 1.0}, "do": "torque", "nm": 8}))
    assert schedule.step(_at(20.0, mode=3, mode_s=0.9)) == []
    assert schedule.step(_at(21.0, mode=2, mode_s=1.5)) == []
    assert _names(schedule.step(_at(22.0, mode=3, mode_s=1.0))) == ["torque"]


def test_a_way_may_begin_it_and_faults_last() -> None:
    schedule = Schedule(
        _faults({"at_way_m": 20.0, "kind": "gnss_jump", "m": [3, -1]}, {"at_s": 1, "kind": "supply_sag", "v": 9})
    )
    assert _names(schedule.step(_at(12.0, way_m=19.0))) == ["supply_sag"]
    assert schedule.step(_at(12.06, way_m=19.0)) == []
    running = schedule.step(_at(900.0, way_m=20.5))
    faults = RunningFaults()
    faults.run(running)
    assert faults.pair("gnss_jump", "m") == (3.0, -1.0)
    assert not faults.has("supply_sag")


def test_a_stuck_value_is_held_until_the_fault_ends() -> None:
    faults = RunningFaults()
    assert faults.hold("potentiometer_stuck", 1.0) == 1.0
    faults.run(_faults({"at_s": 0, "kind": "potentiometer_stuck"}))
    assert [faults.hold("potentiometer_stuck", value) for value in (2.0, 3.0)] == [2.0, 2.0]
    faults.run([])
    assert faults.hold("potentiometer_stuck", 4.0) == 4.0


@pytest.mark.parametrize(
    ("row", "place"),
    [
        ({"at_s": 1, "kind": "gnss_of"}, "faults[1].kind"),
        ({"at_s": 1, "kind": "gnss_jump"}, "faults[1].m"),
        ({"kind": "gnss_off"}, "faults[1]"),
        ({"at_s": 1, "at_way_m": 2, "kind": "gnss_off"}, "faults[1]"),
        ({"at_s": 1, "kind": "gnss_off", "colour": 2}, "faults[1].colour"),
        ({"at_s": "x", "kind": "gnss_off"}, "faults[1].at_s"),
        ({"at_s": 0, "kind": "gnss_off", "every_s": 0}, "faults[1].every_s"),
        ({"at_way_m": math.inf, "kind": "gnss_off"}, "faults[1].at_way_m"),
        ({"at_arrival": 1.5, "kind": "gnss_off"}, "faults[1].at_arrival"),
        ({"after": {"for_s": 1}, "kind": "gnss_off"}, "faults[1].after"),
        ({"after": {"mode": "SPEED", "for_s": 1}, "kind": "gnss_off"}, "faults[1].after.mode"),
        ({"at_s": 1, "kind": "gnss_jump", "m": 3.0}, "faults[1].m"),
        ({"at_s": 1, "kind": "gnss_jump", "m": [3.0, "x"]}, "faults[1].m[2]"),
        ({"at_s": 1, "kind": "supply_sag", "v": "low"}, "faults[1].v"),
        ({"at_s": 1, "kind": "radar_errors", "bits": 70_000}, "faults[1].bits"),
        ({"at_s": 1, "kind": "time_step", "s": True}, "faults[1].s"),
    ],
)
def test_what_is_not_as_expected_is_refused(row: dict[str, Any], place: str) -> None:
    with refused(place, file="s.json"):
        _faults(row)
