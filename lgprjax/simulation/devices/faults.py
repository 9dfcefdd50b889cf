"""Faults of the simulated devices: names, and those active at a time."""

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple, TypeVar

from lgprjax.config import between, nearest
from lgprjax.errors import InputError

# When the items of a script, or faults, begin and end.

READY_MODE = 2
"""Mode of the host's command from which times count first."""


class Moment(NamedTuple):
    """Present values of the conditions that start items.

    Attributes:
        now_s: time of the world's clock.
        since_ready_s: time since the host first was ready; ``None`` before.
        way_m: distance driven.
        mode, mode_for_s: mode in the host's last command, and time in this mode.
        arrivals: number of places that the operator of a field has driven to.
    """

    now_s: float
    since_ready_s: float | None
    way_m: float
    mode: int
    mode_for_s: float
    arrivals: int = 0


@dataclass(frozen=True)
class ScriptItem:
    """A line of a script or a fault.

    Attributes:
        name: action or fault.
        numbers: values of the item's own keys.
        for_s: duration.
        at_s, at_way_m, at_arrival, after: start condition, exactly one; ``after`` is (mode, time in it).
        every_s: period of repetition, with ``at_s``.
    """

    name: str
    numbers: Mapping[str, Any]
    for_s: float
    at_s: float | None = None
    at_way_m: float | None = None
    after: tuple[int, float] | None = None
    at_arrival: int | None = None
    every_s: float | None = None

    def begins(self, moment: Moment) -> bool:
        """Whether the start condition holds."""
        if self.at_s is not None:
            return moment.since_ready_s is not None and moment.since_ready_s >= self.at_s
        if self.at_way_m is not None:
            return moment.way_m >= self.at_way_m
        if self.at_arrival is not None:
            return moment.arrivals >= self.at_arrival
        assert self.after is not None
        mode, for_s = self.after
        return moment.since_ready_s is not None and moment.mode == mode and moment.mode_for_s >= for_s

    def again(self) -> "ScriptItem":
        """The item with its next start time."""
        assert self.at_s is not None
        assert self.every_s is not None
        return replace(self, at_s=self.at_s + self.every_s)


class Schedule:
    """Items, each of which begins once, or periodically."""

    def __init__(self, items: Iterable[ScriptItem]) -> None:
        self._waiting = list(items)
        self._running: list[tuple[float, ScriptItem]] = []

    def step(self, moment: Moment) -> list[ScriptItem]:
        """Items that run now, the oldest first."""
        begun = [item for item in self._waiting if item.begins(moment)]
        self._waiting = [item for item in self._waiting if item not in begun]
        self._waiting += [item.again() for item in begun if item.every_s is not None]
        self._running += [(moment.now_s + item.for_s, item) for item in begun]
        self._running = [(ends_s, item) for ends_s, item in self._running if moment.now_s < ends_s]
        return [item for _, item in self._running]


def read_items(
    file: Path,
    place: str,
    rows: list[dict[str, Any]],
    *,
    key: str,
    known: Mapping[str, tuple[str, ...]],
    lasts_s: Mapping[str, float],
) -> list[ScriptItem]:
    """Read items from a list of tables.

    Args:
        file, place: file and place of the list, for messages.
        rows: tables of the items.
        key: key of an item's name.
        known: required keys of each known name.
        lasts_s: default duration of each name; names without one last for ever.

    Raises:
        InputError: a name or key is unknown or missing, an item has not exactly one start condition, or a value is not
            a number or out of range.
    """
    items = []
    for number, row in enumerate(rows, 1):
        where = f"{place}[{number}]"
        name = str(row.get(key))
        if name not in known:
            raise InputError(file, f"{where}.{key}", nearest(name, known, f"a {key}"), name)
        begin = [begins for begins in ("at_s", "at_way_m", "at_arrival", "after") if begins in row]
        if len(begin) != 1:
            raise InputError(file, where, "one of at_s, at_way_m, at_arrival, after", ", ".join(begin) or "none")
        allowed = {key, "for_s", begin[0], *known[name], *(("every_s",) if begin[0] == "at_s" else ())}
        if unknown := sorted(set(row) - allowed):
            raise InputError(file, f"{where}.{unknown[0]}", f"one of {', '.join(sorted(allowed))}", unknown[0])
        if missing := [needed for needed in known[name] if needed not in row]:
            raise InputError(file, f"{where}.{missing[0]}", f"a value (required by {name})", "none")
        times = {
            timed: _number(file, f"{where}.{timed}", row[timed], *limits)
            for timed, limits in _TIMES.items()
            if timed in row
        }
        arrival = row.get("at_arrival")
        items.append(
            ScriptItem(
                name=name,
                numbers={
                    needed: _value(file, f"{where}.{needed}", name, needed, row[needed]) for needed in known[name]
                },
                for_s=times.get("for_s", lasts_s.get(name, math.inf)),
                at_s=times.get("at_s"),
                at_way_m=times.get("at_way_m"),
                after=None if "after" not in row else _after(file, f"{where}.after", row["after"]),
                at_arrival=None
                if arrival is None
                else int(_number(file, f"{where}.at_arrival", arrival, 0, 1e6, whole=True)),
                every_s=times.get("every_s"),
            )
        )
    return items


_TIMES = {"at_s": (-1e6, 1e6), "at_way_m": (-1e6, 1e6), "for_s": (0.0, math.inf), "every_s": (1e-3, 1e6)}
_RANGES = {
    "m": (-1e5, 1e5),
    "x_m": (-1e6, 1e6),
    "y_m": (-1e6, 1e6),
    "speed_mps": (0.0, 100.0),
    "tool_m": (0.0, 10.0),
    "s": (-1e6, 1e6),
    "rad": (-10.0, 10.0),
    "radps": (-100.0, 100.0),
    "share": (-10.0, 10.0),
    "at": (0.0, 1.0),
    "bits": (0, 0xFFFF),
    "counts": (-1e9, 1e9),
    "supply_v": (0.0, 1e3),
    "v": (0.0, 1e3),
    "nm": (-1e3, 1e3),
}
"""Closed range of each number of a script or a fault."""
_PAIRS = ("gnss_jump", "radar_wrong_place")
_TEXTS = ("line", "button")


def _value(file: Path, place: str, name: str, key: str, value: Any) -> Any:
    """An item's own value; texts are left to ``check_choice``."""
    if key in _TEXTS:
        return value
    limits = _RANGES[key]
    if name not in _PAIRS:
        return _number(file, place, value, *limits, whole=key == "bits")
    if not isinstance(value, list | tuple) or len(value) != 2:
        raise InputError(file, place, "a list of 2 numbers", repr(value)[:60])
    return tuple(_number(file, f"{place}[{at}]", number, *limits) for at, number in enumerate(value, 1))


def _after(file: Path, place: str, value: Any) -> tuple[int, float]:
    if not isinstance(value, dict) or set(value) != {"mode", "for_s"}:
        raise InputError(file, place, "a table of mode and for_s", repr(value)[:60])
    mode = _number(file, f"{place}.mode", value["mode"], 0, 0xFF, whole=True)
    return int(mode), _number(file, f"{place}.for_s", value["for_s"], 0.0, 1e6)


def _number(file: Path, place: str, value: Any, low: float, high: float, *, whole: bool = False) -> float:
    is_number = isinstance(value, int | float) and not isinstance(value, bool)
    if not is_number or not low <= value <= high or (whole and value != int(value)):
        expected = f"a {'whole ' if whole else ''}number, {between(low, high)}"
        raise InputError(file, place, expected, repr(value)[:60])
    return float(value)


def check_choice(file: Path, place: str, items: list[ScriptItem], key: str, known: tuple[str, ...]) -> None:
    """Hold the items' texts under a key against those that there are.

    Raises:
        InputError: one is not among them.
    """
    for number, item in enumerate(items, 1):
        told = item.numbers.get(key, known[0])
        if told not in known:
            where = f"{place}[{number}].{key}"
            raise InputError(file, where, f"one of {', '.join(known)}, for {item.name}", repr(told))


FAULTS: dict[str, tuple[str, ...]] = {
    "gnss_off": (),
    "gnss_stuck": (),
    "gnss_jump": ("m",),
    "gnss_float": (),
    "gnss_single": (),
    "time_step": ("s",),
    "week_rollover": (),
    "ins_off": (),
    "ins_stuck": (),
    "ins_bias": ("rad", "radps"),
    "ins_nan": (),
    "heading_reversed": (),
    "radar_missing": (),
    "radar_slow": ("s",),
    "radar_garbage": (),
    "radar_wrong_place": ("m",),
    "radar_faded": ("share",),
    "radar_errors": ("bits",),
    "odometer_dead": (),
    "odometer_slip": ("share",),
    "odometer_reversed": (),
    "potentiometer_open": (),
    "potentiometer_short": (),
    "potentiometer_stuck": (),
    "encoder_offset": ("counts",),
    "servo_stalled": (),
    "servo_weak": ("supply_v",),
    "servo_runaway": ("radps",),
    "rear_stuck": ("rad",),
    "throttle_stuck": ("at",),
    "brake_dead": (),
    "line_corrupt": ("line",),
    "line_repeat": ("line",),
    "line_silent": ("line",),
    "bus_off": (),
    "override_stuck": (),
    "override_wire_cut": (),
    "estop_held": (),
    "supply_sag": ("v",),
    "second_master": (),
}
"""Faults by name, with their required keys.

``m`` of ``gnss_jump`` is [east, north], of ``radar_wrong_place`` [along, left]; ``line`` is drive_by_wire, controller,
gnss or radar. A fault of a line acts on both of its ways; ``gnss`` and the other way of a repeating counter have none.
``week_rollover`` counts its moment from the world's start: GNSS time runs towards it from there. ``servo_runaway``
turns while the servo has torque. What ``at_s`` counts from, else, is the first command of mode READY.
"""

FAULT_LASTS_S = {"supply_sag": 0.05}

_Value = TypeVar("_Value")


class RunningFaults:
    """Faults that run."""

    def __init__(self) -> None:
        self._running: dict[str, list[Mapping[str, Any]]] = {}
        self._held: dict[str, Any] = {}

    def run(self, items: Iterable[ScriptItem]) -> None:
        """These run now, no others."""
        running: dict[str, list[Mapping[str, Any]]] = {}
        for item in items:
            running.setdefault(item.name, []).append(item.numbers)
        # Another thread looks: it sees the old ones or the new ones.
        self._running = running

    def has(self, name: str) -> bool:
        """Whether a fault runs."""
        return name in self._running

    def number(self, name: str, key: str, sound: float) -> float:
        """A running fault's number, else the sound one."""
        rows = self._running.get(name)
        return float(rows[-1][key]) if rows else sound

    def pair(self, name: str, key: str) -> tuple[float, float]:
        """A running fault's two numbers, else zeros."""
        rows = self._running.get(name)
        return (float(rows[-1][key][0]), float(rows[-1][key][1])) if rows else (0.0, 0.0)

    def on_line(self, name: str, line: str) -> bool:
        """Whether a fault of lines runs on this one."""
        return any(row["line"] == line for row in self._running.get(name, ()))

    def hold(self, name: str, value: _Value) -> _Value:
        """The value, or its value when the fault began."""
        if not self.has(name):
            self._held.pop(name, None)
            return value
        held: _Value = self._held.setdefault(name, value)
        return held
