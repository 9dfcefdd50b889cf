"""Courses to drive a vehicle along: line, arc, curve with clothoids, figure of eight.

A logged route is a course too: ``path_from_points``.
"""

import math
from typing import Literal

import numpy as np

from lgprjax.errors import InputError
from lgprjax.vehicle.path import SPACING_M, Path, path_from_curvature, path_from_points

Hand = Literal["left", "right"]
_EIGHT_POINTS = 800


def line_course(length_m: float, *, heading_rad: float = 0.0) -> Path:
    """A straight line from the origin.

    Raises:
        InputError: a length that is not positive.
    """
    _check_positive("length_m", length_m)
    count = max(round(length_m / SPACING_M), 1)
    return path_from_curvature(np.zeros(count), spacing_m=length_m / count, start=(0.0, 0.0, heading_rad))


def arc_course(radius_m: float, turn_rad: float, hand: Hand = "left") -> Path:
    """An arc of one radius from the origin, eastward at its start. A whole turn is closed and goes on for ever.

    Raises:
        InputError: radius or turn not positive, or a radius below half a metre.
    """
    _check_radius(radius_m)
    _check_positive("turn_rad", turn_rad)
    whole = math.isclose(turn_rad, 2.0 * math.pi)
    length_m = radius_m * turn_rad
    count = max(math.ceil(length_m / SPACING_M), 1)
    curvature = np.full(count, _sign(hand) / radius_m)
    return path_from_curvature(curvature, spacing_m=length_m / count, closed=whole)


def clothoid_course(
    radius_m: float, turn_rad: float, clothoid_m: float, hand: Hand = "left", *, straight_m: float = 20.0
) -> Path:
    """Straight, clothoid into an arc, clothoid out of it, straight: a curve as roads have.

    Args:
        radius_m: of the arc.
        turn_rad: of the whole curve, clothoids included.
        clothoid_m: length of each; curvature grows in proportion to the way.
        hand: to which side.
        straight_m: before and after.

    Raises:
        InputError: a length not positive, or clothoids that turn by more than the whole curve.
    """
    _check_radius(radius_m)
    for name, value in (("turn_rad", turn_rad), ("clothoid_m", clothoid_m), ("straight_m", straight_m)):
        _check_positive(name, value)
    arc_m = radius_m * turn_rad - clothoid_m
    if arc_m < 0.0:
        found = f"{clothoid_m:g} m, which turn by {clothoid_m / radius_m:.3f} rad"
        raise InputError("course", "clothoid_m", f"clothoids that turn by at most {turn_rad:.3f} rad", found)
    ends_m = np.cumsum([straight_m, clothoid_m, arc_m, clothoid_m, straight_m])
    count = math.ceil(ends_m[-1] / SPACING_M)
    step_m = float(ends_m[-1]) / count
    knots_m = np.linspace(0.0, ends_m[-1], count + 1)
    # The mean curvature of each arc of the table, so that the whole turn is kept: differences of its integral.
    profile_m = np.unique(np.concatenate([[0.0], ends_m, knots_m]))
    shape = np.interp(profile_m, np.concatenate([[0.0], ends_m]), [0.0, 0.0, 1.0, 1.0, 0.0, 0.0])
    turned = np.concatenate([[0.0], np.cumsum(np.diff(profile_m) * 0.5 * (shape[1:] + shape[:-1]))]) / radius_m
    curvature = _sign(hand) * np.diff(np.interp(knots_m, profile_m, turned)) / step_m
    return path_from_curvature(curvature, spacing_m=step_m)


def eight_course(least_radius_m: float) -> Path:
    """A closed lemniscate that crosses itself at the origin; its curvature runs through zero there.

    Raises:
        InputError: a radius below half a metre.
    """
    _check_radius(least_radius_m)
    angle = np.linspace(0.0, 2.0 * np.pi, _EIGHT_POINTS, endpoint=False)
    # Bernoulli's: the least radius is a third of the half width.
    scale = 3.0 * least_radius_m / (1.0 + np.sin(angle) ** 2)
    points = np.stack([scale * np.cos(angle), scale * np.sin(angle) * np.cos(angle)], axis=-1)
    return path_from_points(points, closed=True)


def _sign(hand: Hand) -> float:
    return 1.0 if hand == "left" else -1.0


def _check_positive(name: str, value: float) -> None:
    if not (math.isfinite(value) and value > 0.0):
        raise InputError("course", name, "a positive number", f"{value:g}")


def _check_radius(radius_m: float) -> None:
    if not (math.isfinite(radius_m) and radius_m >= 2.0 * SPACING_M):
        raise InputError("course", "radius", f"at least {2.0 * SPACING_M:g} m", f"{radius_m:g} m")
