"""A run's time line from its records: what is told, once and with its cause, and why a run ended short."""

import json

import numpy as np
import pytest

from lgprjax.autopilot import Mode
from lgprjax.run_records import SKID_PLAN, Record, RecordKind, Source
from lgprjax.runtime.timeline import timeline_of


def told(at_s: float, **what: object) -> Record:
    """An event of the control loop."""
    return Record(RecordKind.EVENT, Source.CONTROL, 1, int(1e9 * at_s), json.dumps(what).encode())


def drives(at_s: float, mode: Mode, to_go_m: float) -> Record:
    row = np.zeros((), SKID_PLAN)
    row["mode"], row["to_go_m"] = int(mode), to_go_m
    return Record(RecordKind.SKID_PLAN, Source.CONTROL, 1, int(1e9 * at_s), row.tobytes())


ENGAGES = [
    told(1.0, event="CHECKS_PASSED", mode="READY", actions=[], why=[]),
    told(2.0, event="STEERING_BUTTON", mode="STEERING", actions=[], why=[]),
    drives(3.0, Mode.STEERING, 40.0),
]


def test_what_slowed_a_run_last_is_told_though_it_is_over() -> None:
    found = timeline_of(
        [*ENGAGES, told(4.0, slow=["GNSS is silent"]), told(5.0, slow=[]), drives(6.0, Mode.STEERING, 12.4)]
    )
    slow = [each.text for each in found.entries if each.kind == "slow"]
    assert ["GNSS is silent" in each for each in slow] == [True, False]
    assert "12 m" in found.shortfall
    assert "GNSS is silent" in found.shortfall
    assert "40 m" in timeline_of(ENGAGES).shortfall


@pytest.mark.parametrize("mode", ["READY", "STEERING"])
def test_what_engaging_needs_is_told_to_those_who_are_not_engaged(mode: str) -> None:
    missing = told(4.0, event="SOURCE_MISSING", mode=mode, actions=[], why=["no position from GNSS"])
    found = timeline_of([*(ENGAGES if mode == "STEERING" else ENGAGES[:1]), missing])
    texts = [each.text for each in found.entries if each.kind == "note"]
    assert ["no position from GNSS" in each for each in texts] == [True] * (mode == "READY")


def test_who_never_engaged_is_told_why_it_was_refused() -> None:
    refused = told(3.0, event="STEERING_BUTTON", mode="READY", actions=["WARN"], why=["heading not known"])
    found = timeline_of([ENGAGES[0], refused])
    assert not found.engaged
    assert "heading not known" in found.shortfall
