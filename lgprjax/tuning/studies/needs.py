"""Requirements of each study: signals and excitation of its logs, precision of its numbers, agreement of held-out logs.

A study that misses one is refused with the reason: a number from the wrong kind of drive is worse than none.
"""

from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from lgprjax.errors import InputError
from lgprjax.tuning import DriveSignals, Estimate
from lgprjax.tuning.steering import LEAST_SPEEDS

SIGNAL_NAMES = {
    "command_rad": "steering_command_rad",
    "front_rad": "wheel_angle_rad",
    "rear_rad": "rear_wheel_angle_rad",
    "potentiometer_v": "steering_potentiometer_v",
    "encoder_counts": "encoder_counts",
    "supply_v": "supply_v",
    "throttle": "throttle",
    "brake": "brake",
}
"""Name in a drive log's /vehicle of each optional signal."""


class Need(NamedTuple):
    """Requirements of a kind of study.

    Attributes:
        drive: description of the drive, for messages and pages.
        signals: required signals of ``/vehicle`` apart from time; a bar separates alternatives.
        way_m: shortest distance driven.
        widest: largest half width of a number's 95 % interval, by its path in the vehicle file.
    """

    drive: str
    signals: tuple[str, ...] = ()
    way_m: float = 0.0
    widest: Mapping[str, float] = MappingProxyType({})


NEEDS: dict[str, Need] = {
    "straight": Need(
        "40 m along a straight line, wheels hardly turned",
        ("potentiometer_v",),
    ),
    "encoder": Need(
        "the wheel turned at standstill from side to side, with pauses",
        ("potentiometer_v", "encoder_counts"),
    ),
    "wheel_angle": Need(
        "a palm tree: arcs at many settings of the steering wheel, to both sides",
        ("potentiometer_v",),
        way_m=20.0,
        widest={"steering.potentiometer_v_per_rad": 0.05},
    ),
    "rear_ratio": Need(
        "turns to both sides, the wheel held in each",
        ("potentiometer_v|front_rad",),
        way_m=20.0,
        widest={"steering.rear_ratio": 0.05},
    ),
    "rear_map": Need("the wheel turned from side to side, standing or driving", ("rear_rad",)),
    "yaw_gain": Need(
        "steady turns to both sides at rising speed, the fastest at least twice the slowest",
        ("potentiometer_v|front_rad",),
        way_m=40.0,
        widest={"steering.characteristic_speed_mps": 0.25},
    ),
    "servo": Need(
        "steps of the steering command, large ones too, and a sweep",
        ("command_rad", "potentiometer_v|front_rad"),
    ),
    "pedals": Need("steps of throttle and brake from standstill"),
    "loop": Need(
        "the autopilot steering through bends, with commands, wheel angles and a gyro",
        ("command_rad", "potentiometer_v|front_rad"),
        way_m=40.0,
    ),
    "tracking": Need("a drive along a path that is known, with the fixes of its scans", way_m=20.0),
    "look_ahead": Need("as for loop, or no logs", ("command_rad", "potentiometer_v|front_rad"), way_m=40.0),
    "fusion": Need("turns at changing speed, with a gyro and the fixes of the scans", way_m=20.0),
    "threshold": Need("the folder of a recorded run of a field"),
}

_RELATIVE = ("steering.potentiometer_v_per_rad", "steering.characteristic_speed_mps")
_SIGMAS = 4.0
_LEAST_SHARE = 0.01
_TIMES = 3.0
_STRAIGHT_SHARE = 0.5
_STRAIGHT_M = 40.0
_SPEED_S = 1.0


def require_excitation(kind: str, path: Path, signals: DriveSignals) -> None:
    """Refuse a log that lacks what a study needs.

    Raises:
        InputError: a signal is missing, or the drive is not of the kind needed.
    """
    need = NEEDS[kind]
    for wanted in need.signals:
        names = wanted.split("|")
        if all(getattr(signals, name) is None for name in names):
            place = " or ".join(f"/vehicle/{SIGNAL_NAMES[name]}" for name in names)
            raise InputError(path, place, "a vehicle signal", "none")
    steps_m = np.diff(signals.travel_m)
    way_m = float(np.sum(np.abs(steps_m)))
    if way_m < need.way_m:
        raise InputError(path, kind, f"{need.way_m:g} m of driving or more: {need.drive}", f"{way_m:.1f} m")
    if kind == "straight" and way_m >= _STRAIGHT_M:  # a shorter drive is refused by the fit
        _require_straight(path, signals)
    if kind == "yaw_gain":
        _require_speeds(path, signals)


def _require_speeds(path: Path, signals: DriveSignals) -> None:
    """Refuse turning tests at one speed before their arcs are fitted."""
    edges_s = np.arange(signals.time_s[0], signals.time_s[-1], _SPEED_S)
    way_m = np.abs(np.diff(np.interp(edges_s, signals.time_s, signals.travel_m)))
    order = np.argsort(way_m)
    # Speeds are weighted by distance, so that starting and stopping hardly count.
    share = np.cumsum(way_m[order]) / max(float(np.sum(way_m)), 1e-9)
    slow, fast = (float(np.interp(part, share, way_m[order])) / _SPEED_S for part in (0.02, 0.98))
    if fast < LEAST_SPEEDS * slow:
        raise InputError(
            path, "yaw_gain", NEEDS["yaw_gain"].drive, f"{slow:.1f} to {fast:.1f} m/s for nearly all of the drive"
        )


def _require_straight(path: Path, signals: DriveSignals) -> None:
    """Refuse a drive in which the wheel is turned to and fro: its mean potentiometer value is not that of straight
    driving.
    """
    volts = signals.potentiometer_v
    assert volts is not None
    # A driver holds the wheel still most of the time, so half of the readings must be close together.
    level = volts[np.isfinite(volts)]
    noise = 1.4826 * float(np.median(np.abs(np.diff(level, 2)))) / 6.0**0.5
    low, quarter, three, high = np.percentile(level, [2.5, 25.0, 75.0, 97.5])
    if three - quarter > _STRAIGHT_SHARE * (high - low) and high - low > 30.0 * max(noise, 1e-4):
        found = (
            f"half of the potentiometer's values within {three - quarter:.2g} V, nearly all within {high - low:.2g} V"
        )
        raise InputError(path, "straight", NEEDS["straight"].drive, found)


def require_precision(kind: str, path: Path, found: dict[str, Estimate | list[Estimate]]) -> None:
    """Refuse numbers that the logs determine too poorly.

    Raises:
        InputError: an interval is wider than the study allows.
    """
    for name, widest in NEEDS[kind].widest.items():
        one = found.get(name)
        if not isinstance(one, Estimate):
            continue
        half = 0.5 * (one.high - one.low)
        relative = name in _RELATIVE
        wide = half / abs(one.value) if relative else half
        if not wide <= widest:
            unit = " %" if relative else ""
            times = 100.0 if relative else 1.0
            expected = f"{name} to within {times * widest:g}{unit}: {NEEDS[kind].drive}"
            raise InputError(path, kind, expected, f"{one.value:.4g}, to within {times * wide:.2g}{unit}")


class Contradiction(NamedTuple):
    """A held-out log that disagrees with the fit; the vehicle file is not written then."""

    path: Path
    what: str
    expected: str
    found: str


def compared(what: str, path: Path, fitted: Estimate, held: Estimate) -> tuple[Contradiction, ...]:
    """Compare a number of the fit with that of a held-out log."""
    away = abs(held.value - fitted.value)
    most = max(_SIGMAS * float(np.hypot(fitted.sigma, held.sigma)), _LEAST_SHARE * abs(fitted.value))
    if away <= most:
        return ()
    return (Contradiction(path, what, f"{fitted.value:.4g} to within {most:.2g}, as fitted", f"{held.value:.4g}"),)


def judged_residual(what: str, path: Path, fitted: float, held: float, unit: str) -> tuple[Contradiction, ...]:
    """Compare the residuals of a held-out log with those of the fit."""
    if held <= _TIMES * fitted:
        return ()
    expected = f"residuals of {_TIMES * fitted:.3g} {unit} or less, {_TIMES:g} times those of the fit"
    return (Contradiction(path, what, expected, f"{held:.3g} {unit}"),)
