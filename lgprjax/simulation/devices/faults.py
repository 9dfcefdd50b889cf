"""What goes wrong with the simulated devices: names, and what runs at a moment."""

from collections.abc import Iterable, Mapping
from typing import Any, TypeVar

from lgprjax.simulation.devices.schedule import Item

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
"""Faults by name, and what each must say of itself.

``m`` of ``gnss_jump`` is [east, north], of ``radar_wrong_place`` [along, left]; ``line`` is drive_by_wire, controller,
gnss or radar. A fault of a line acts on both of its ways; ``gnss`` and the other way of a repeating counter have none.
``week_rollover`` counts its moment from the world's start: GNSS time runs towards it from there. ``servo_runaway``
turns while the servo has torque. What ``at_s`` counts from, else, is the first command of mode READY.
"""

FAULT_LASTS_S = {"supply_sag": 0.05}

_Value = TypeVar("_Value")


class Faults:
    """Faults that run."""

    def __init__(self) -> None:
        self._running: dict[str, list[Mapping[str, Any]]] = {}
        self._held: dict[str, Any] = {}

    def run(self, items: Iterable[Item]) -> None:
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
        """The value, or the one that it had when the fault began."""
        if not self.has(name):
            self._held.pop(name, None)
            return value
        held: _Value = self._held.setdefault(name, value)
        return held
