"""Faults in the closed loop of the runtime, each at several moments: what is found, how fast, and what is done.

Numbers are those of the fault list in docs/onboard.md. A drive is brought to moments of its own (straight and slow, in
a bend, faster); from copies of these each fault takes its course.
"""

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest

from lgprjax.autopilot import Mode
from lgprjax.autopilot.watch_findings import Watch
from lgprjax.navigation import Reason
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.setup import Loaded
from lgprjax.simulation.devices.course_world import CourseWorld
from lgprjax.simulation.devices.faults import FAULT_LASTS_S, FAULTS
from lgprjax.simulation.devices.schedule import Schedule, read_items
from onboard_loop import DRIVE, OnboardLoop

MOMENTS = ("straight", "bend", "fast")
ENGAGED = (Mode.STEERING, Mode.SPEED)


class Moment(NamedTuple):
    """A drive, engaged, somewhere on its way."""

    loop: OnboardLoop
    shared: tuple[Any, ...]

    def copy(self) -> OnboardLoop:
        """The same drive, to go on by itself."""
        memo: dict[int, Any] = {id(each): each for each in self.shared}
        # Locks are of no use to a copy in one thread, and cannot be copied.
        lock = self.loop.stage._lock
        memo[id(lock)] = lock
        return copy.deepcopy(self.loop, memo)


def beyond(way_m: float) -> Callable[[OnboardLoop], bool]:
    """A way driven."""
    return lambda loop: loop.stage._known.last.travel_m > way_m


@pytest.fixture(scope="module")
def moments(world: CourseWorld, config: RuntimeConfig, loaded: Loaded) -> dict[str, Moment]:
    faster = [
        {"after": {"mode": 4, "for_s": 14.0 + 0.6 * number}, "do": "press", "button": "plus", "for_s": 0.25}
        for number in range(8)
    ]
    loop = OnboardLoop(world, config, loaded, [*DRIVE, *faster], [])
    found = {}
    for name, way_m in zip(MOMENTS, (12.0, 22.0, 70.0), strict=True):
        reached = loop.run(60.0, until=beyond(way_m))
        assert reached, name
        assert loop.mode is Mode.SPEED, [event for _, event in loop.events]
        found[name] = Moment(loop, (world, config, loaded))
        loop = found[name].copy()
    return found


class After(NamedTuple):
    """What came of a fault: times in seconds after it."""

    loop: OnboardLoop
    first: int

    def when(self, holds: Callable[[np.void], bool]) -> float:
        """First tick's time with something; infinite where there is none."""
        for number, row in enumerate(self.loop.rows[self.first :]):
            if holds(row):
                return (self.loop.times_ns[self.first + number] - self.loop.times_ns[self.first - 1]) / 1e9
        return math.inf

    def mode(self, *modes: Mode) -> float:
        """Until one of these modes."""
        return self.when(lambda row: Mode(int(row["mode"])) in modes)

    def watch(self, bit: Watch) -> float:
        """Until a finding."""
        return self.when(lambda row: bool(int(row["watch"]) & bit))

    def reason(self, reason: Reason) -> float:
        """Until a reason of navigation's health."""
        return self.when(lambda row: bool(int(row["reasons"]) & reason))

    @property
    def standing(self) -> bool:
        """At the end, by the truth."""
        return abs(self.loop.stage._known.last.speed_mps) < 0.15

    @property
    def largest_off_m(self) -> float:
        """Of the true anchor from the path, while engaged."""
        cross = np.abs(self.loop.stage.truth.arrays()["cross_m"])
        return float(cross[-200:].max())


def follow(moment: Moment, faults: list[dict[str, Any]], seconds: float, **how: Any) -> After:
    """What comes of faults that begin now."""
    loop = moment.copy()
    now_m = loop.stage._known.last.travel_m
    items = [{"at_way_m": now_m, **fault} for fault in faults]
    loop.stage._wrong = Schedule(
        read_items(Path("faults"), "faults", items, key="kind", known=FAULTS, lasts_s=FAULT_LASTS_S)
    )
    for name, value in how.items():
        setattr(loop, name, value)
    first = len(loop.rows)
    loop.run(seconds)
    within_limits(loop, first)
    return After(loop, first)


def within_limits(loop: OnboardLoop, first: int) -> None:
    """No command beyond the limiter while something is engaged, and the rows of the log can be read."""
    rate = 0.5013072490692139
    rows, times = loop.rows[first - 1 :], loop.times_ns[first - 1 :]
    for before, row, began, now in zip(rows, rows[1:], times, times[1:], strict=False):
        if not (int(before["engage"]) & 3 and int(row["engage"]) & 3):
            continue
        step_s = (now - began) / 1e9
        turned = abs(float(row["command"][0]) - float(before["command"][0]))
        assert turned <= rate * step_s + 1e-5
        assert np.isfinite(row["command"]).all()
        assert not (row["command"][1] > 0.0 and row["command"][2] > 0.0)
        assert row["command"][1] - before["command"][1] <= 2.0 * step_s + 1e-5
        assert row["command"][2] - before["command"][2] <= 4.0 * step_s + 1e-5
    for _, event in loop.events:
        json.loads(event)


class Case(NamedTuple):
    """A fault: its number in the list, what is injected, for how long it is followed, and what must hold."""

    number: int
    name: str
    faults: list[dict[str, Any]]
    seconds: float
    holds: Callable[[After], bool]


def goes_on(after: After) -> bool:
    """Engaged throughout, within a foot of the path."""
    return after.mode(*(mode for mode in Mode if mode not in ENGAGED)) == math.inf and after.largest_off_m < 0.3048


def hands_over(within_s: float) -> Callable[[After], bool]:
    """Error mode, released, within a time."""
    return lambda after: after.mode(Mode.ERROR) <= within_s and not int(after.loop.rows[-1]["engage"]) & 3


def stops(after: After) -> bool:
    """A controlled stop: engaged until it stands, then manual."""
    return after.standing and after.loop.mode in (Mode.MANUAL, Mode.ERROR)


CASES = [
    Case(1, "antenna pulled", [{"kind": "gnss_off"}], 4.0,
         lambda a: a.reason(Reason.GNSS_SILENT) <= 0.25 and goes_on(a)),
    Case(2, "GNSS stuck", [{"kind": "gnss_stuck"}], 4.0,
         lambda a: a.reason(Reason.GNSS_STUCK) <= 1.0 and goes_on(a)),
    Case(3, "GNSS jumps 0.3 m", [{"kind": "gnss_jump", "m": [0.3, 0.0]}], 5.0, goes_on),
    Case(3, "GNSS jumps 3 m", [{"kind": "gnss_jump", "m": [0.0, 3.0]}], 5.0,
         lambda a: a.reason(Reason.GNSS_REJECTED) <= 0.25 and goes_on(a)),
    Case(3, "GNSS jumps 30 m", [{"kind": "gnss_jump", "m": [30.0, 0.0]}], 5.0,
         lambda a: a.reason(Reason.GNSS_REJECTED) <= 0.25 and goes_on(a)),
    Case(7, "GNSS time steps forward", [{"kind": "time_step", "s": 5.0}], 4.0, goes_on),
    Case(7, "GNSS time steps back", [{"kind": "time_step", "s": -1.0}], 4.0, goes_on),
    Case(8, "INS off", [{"kind": "ins_off"}], 4.0,
         lambda a: a.reason(Reason.HEADING_SILENT) <= 0.3 and (goes_on(a) or stops(a))),
    Case(8, "INS without numbers", [{"kind": "ins_nan"}], 4.0,
         lambda a: a.reason(Reason.HEADING_SILENT) <= 0.3 and (goes_on(a) or stops(a))),
    Case(8, "INS stuck", [{"kind": "ins_stuck"}], 6.0, lambda a: goes_on(a) or stops(a)),
    Case(8, "INS biased", [{"kind": "ins_bias", "rad": 0.1, "radps": 0.02}], 6.0, lambda a: goes_on(a) or stops(a)),
    Case(14, "odometer dead", [{"kind": "odometer_dead"}], 5.0,
         lambda a: a.watch(Watch.ODOMETER_DEAD) <= 0.6 and (goes_on(a) or stops(a))),
    Case(14, "odometer reversed", [{"kind": "odometer_reversed"}], 5.0,
         lambda a: a.watch(Watch.ODOMETER_REVERSED | Watch.ODOMETER_DEAD) <= 0.6),
    Case(14, "odometer slips", [{"kind": "odometer_slip", "share": 0.5}], 5.0,
         lambda a: a.watch(Watch.ODOMETER_SLIPS | Watch.ODOMETER_DEAD) <= 1.0),
    Case(15, "potentiometer open", [{"kind": "potentiometer_open"}], 2.0, hands_over(0.15)),
    Case(15, "potentiometer short", [{"kind": "potentiometer_short"}], 2.0, hands_over(0.15)),
    Case(15, "potentiometer stuck", [{"kind": "potentiometer_stuck"}], 8.0,
         lambda a: a.mode(Mode.ERROR) < 8.0),
    Case(16, "encoder slips by a tooth", [{"kind": "encoder_offset", "counts": 1500}], 2.0, hands_over(0.3)),
    Case(17, "servo stalled", [{"kind": "servo_stalled"}], 10.0, lambda a: a.mode(Mode.ERROR) < 10.0),
    Case(17, "servo weak", [{"kind": "servo_weak", "supply_v": 12.5}], 3.0,
         lambda a: a.watch(Watch.SUPPLY_LOW | Watch.SERVO_WEAK) <= 0.5),
    Case(18, "steering runs away", [{"kind": "servo_runaway", "radps": 0.5}], 2.0, hands_over(0.35)),
    Case(19, "rear steering stuck", [{"kind": "rear_stuck", "rad": -0.15}], 8.0,
         lambda a: a.watch(Watch.REAR_STUCK) < 3.0 and a.standing),
    Case(21, "throttle stuck open", [{"kind": "throttle_stuck", "at": 0.5}], 8.0,
         lambda a: a.watch(Watch.THROTTLE_STUCK) <= 0.7),
    Case(23, "frames corrupt", [{"kind": "line_corrupt", "line": "drive_by_wire"}], 2.0, hands_over(0.3)),
    Case(23, "counter repeats", [{"kind": "line_repeat", "line": "drive_by_wire"}], 2.0, hands_over(0.3)),
    Case(23, "bus off", [{"kind": "bus_off"}], 2.0, hands_over(0.3)),
    Case(24, "drive-by-wire silent", [{"kind": "line_silent", "line": "drive_by_wire"}], 2.0, hands_over(0.3)),
    Case(34, "override stuck", [{"kind": "override_stuck"}], 2.0, lambda a: a.mode(Mode.MANUAL) <= 0.1),
    Case(34, "override wire cut", [{"kind": "override_wire_cut"}], 2.0, lambda a: a.mode(Mode.MANUAL) <= 0.25),
    Case(34, "controller silent", [{"kind": "line_silent", "line": "controller"}], 2.0,
         lambda a: a.mode(Mode.MANUAL) <= 0.25),
    Case(38, "supply sags for 50 ms", [{"kind": "supply_sag", "v": 9.0, "for_s": 0.05}], 3.0, goes_on),
    Case(41, "second master", [{"kind": "second_master"}], 2.0, hands_over(0.3)),
]  # fmt: skip


@pytest.mark.parametrize("case", CASES, ids=lambda case: f"{case.number}-{case.name}")
@pytest.mark.parametrize("moment", MOMENTS)
def test_a_fault_is_answered_as_listed(moments: dict[str, Moment], moment: str, case: Case) -> None:
    after = follow(moments[moment], case.faults, case.seconds)
    assert case.holds(after), told(after)


def told(after: After) -> str:
    """The fault's course, for a person."""
    begin = after.loop.times_ns[after.first - 1]
    events = [event for event in after.loop.events if event[0] * 1e9 > begin - 7_000_000_000_000]
    last = after.loop.rows[-1]
    bits = [int(row["watch"]) for row in after.loop.rows[after.first :]]
    reasons = [int(row["reasons"]) for row in after.loop.rows[after.first :]]
    seen = Watch(int(np.bitwise_or.reduce(bits)))
    why = Reason(int(np.bitwise_or.reduce(reasons)))
    return f"{events}\n{seen!r}\n{why!r}\n{last}\noff {after.largest_off_m:.2f} m"
