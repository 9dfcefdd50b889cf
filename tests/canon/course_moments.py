"""Moments of a drive on board, and what comes of a fault or a button that begins there."""

import copy
import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from canon.course_loop import OnboardLoop
from lgprjax.autopilot import Mode
from lgprjax.autopilot.monitors import Watch
from lgprjax.navigation import Reason
from lgprjax.simulation.devices.faults import FAULT_LASTS_S, FAULTS, Schedule, read_items
from lgprjax.simulation.devices.vehicle import SCRIPT, SCRIPT_LASTS_S

ENGAGED = (Mode.STEERING, Mode.SPEED)
_RATE_RADPS, _THROTTLE_PER_S, _BRAKE_PER_S = 0.5013072490692139, 2.0, 4.0


class Moment(NamedTuple):
    """A drive, engaged, somewhere on its way; ``shared`` is not copied with it."""

    loop: OnboardLoop
    shared: tuple[Any, ...]

    def copy(self) -> OnboardLoop:
        """The same drive, to go on by itself."""
        memo: dict[int, Any] = {id(each): each for each in self.shared}
        # A lock is of no use to a copy in one thread, and cannot be copied.
        lock = self.loop.stage._lock
        memo[id(lock)] = lock
        return copy.deepcopy(self.loop, memo)


class After(NamedTuple):
    """What came of it: times in seconds after it began."""

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

    def engaged(self, bits: int) -> float:
        """Until the command has exactly these bits."""
        return self.when(lambda row: int(row["engage"]) == bits)

    @property
    def last(self) -> np.void:
        """The last tick."""
        return self.loop.rows[-1]

    @property
    def largest_off_m(self) -> float:
        """Of the true anchor from the path since it began."""
        truth = self.loop.stage.truth.arrays()
        since = truth["mono_ns"] >= self.loop.times_ns[self.first - 1]
        return float(np.abs(truth["cross_m"][since]).max())

    def speed_at(self, after_s: float) -> float:
        """True speed at a time."""
        truth = self.loop.stage.truth.arrays()
        at = np.searchsorted(truth["mono_ns"], self.loop.times_ns[self.first - 1] + after_s * 1e9)
        return float(truth["speed_mps"][min(int(at), len(truth["mono_ns"]) - 1)])

    @property
    def told(self) -> str:
        """Its course, for a person."""
        begin_s = (self.loop.times_ns[self.first - 1] - self.loop.times_ns[0]) / 1e9
        events = [(round(time_s - begin_s, 2), event) for time_s, event in self.loop.events if time_s >= begin_s]
        rows = self.loop.rows[self.first :]
        seen = Watch(int(np.bitwise_or.reduce([int(row["watch"]) for row in rows])))
        why = Reason(int(np.bitwise_or.reduce([int(row["reasons"]) for row in rows])))
        return f"{events}\n{seen!r}\n{why!r}\n{rows[-1]}\noff {self.largest_off_m:.2f} m"


def follow(
    moment: Moment,
    seconds: float,
    *,
    faults: list[dict[str, Any]] | None = None,
    script: list[dict[str, Any]] | None = None,
    change: Callable[[OnboardLoop], None] = lambda _: None,
) -> After:
    """What comes of faults, of what the operator does, or of a change, that begin now."""
    loop = moment.copy()
    here = {"at_way_m": loop.stage._known.last.travel_m}
    if faults is not None:
        items = [{**here, **fault} for fault in faults]
        known = read_items(Path("faults"), "", items, key="kind", known=FAULTS, lasts_s=FAULT_LASTS_S)
        loop.stage._wrong = Schedule(known)
    if script is not None:
        items = [{**here, **line} for line in script]
        known = read_items(Path("script"), "", items, key="do", known=SCRIPT, lasts_s=SCRIPT_LASTS_S)
        loop.stage._script = Schedule(known)
    first = len(loop.rows)
    change(loop)
    loop.run(seconds)
    within_limits(loop, first)
    return After(loop, first)


def within_limits(loop: OnboardLoop, first: int) -> None:
    """No command beyond the limiter while something is engaged; every event of the log can be read."""
    rows, times = loop.rows[first - 1 :], loop.times_ns[first - 1 :]
    for before, row, began, now in zip(rows, rows[1:], times, times[1:], strict=False):
        assert np.isfinite(row["command"]).all()
        if not (int(before["engage"]) & 3 and int(row["engage"]) & 3):
            continue
        step_s = (now - began) / 1e9
        front, throttle, brake = (np.asarray(row["command"], float) - np.asarray(before["command"], float)).tolist()
        assert abs(front) <= _RATE_RADPS * step_s + 1e-5
        assert throttle <= _THROTTLE_PER_S * step_s + 1e-5
        assert brake <= _BRAKE_PER_S * step_s + 1e-5
        assert not (row["command"][1] > 0.0 and row["command"][2] > 0.0)
    for _, event in loop.events:
        json.loads(event)


def goes_on(after: After) -> bool:
    """Engaged throughout, within a foot of the path."""
    return after.mode(*(mode for mode in Mode if mode not in ENGAGED)) == math.inf and after.largest_off_m < 0.3048


def hands_over(within_s: float) -> Callable[[After], bool]:
    """Error mode, released, within a time."""
    return lambda after: after.mode(Mode.ERROR) <= within_s and not int(after.last["engage"]) & 3


def stops(after: After) -> bool:
    """A controlled stop: engaged until it stands, then the operator's."""
    over_s = after.mode(Mode.MANUAL, Mode.ERROR)
    return over_s < math.inf and abs(after.speed_at(over_s)) < 0.3
