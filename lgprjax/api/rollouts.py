"""Closed-loop rollouts of vehicles along courses: pure functions of arrays, for jit, vmap and grad."""

import math
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jax.typing import ArrayLike
from jaxtyping import Array, Float

from lgprjax.api.inputs import axes_or_new, is_number
from lgprjax.api.vehicles import Vehicle, moving_parts
from lgprjax.errors import InputError
from lgprjax.vehicle import (
    LookAhead,
    Path,
    RolloutLane,
    RolloutMetrics,
    RolloutSpec,
    RolloutState,
    RolloutTrace,
    arc_course,
    clothoid_course,
    constant_look_ahead,
    eight_course,
    line_course,
    path_from_points,
    roll_out,
    roll_out_traced,
    start_rollout,
)

if TYPE_CHECKING:
    from matplotlib.axes import Axes

Kind = Literal["line", "offset", "arc", "curve", "eight"]
_TAKES = {
    "line": ("length_m",),
    "offset": ("metres", "length_m"),
    "arc": ("radius_m", "turn_deg", "hand"),
    "curve": ("radius_m", "turn_deg", "hand"),
    "eight": ("radius_m",),
}
_USUAL: dict[str, float | str] = {
    "metres": 3.0,
    "length_m": 100.0,
    "radius_m": 25.0,
    "turn_deg": 90.0,
    "hand": "left",
}
_SPEED_MPS = 2.235  # 5 mph
_LONGEST_M = 1e5  # of a course: its table has a row every few centimetres
_EIGHT_RADII = 15.73  # length of a lemniscate by its least radius


@partial(jax.tree_util.register_dataclass, data_fields=["path", "offset_m"], meta_fields=["kind"])
@dataclass(frozen=True, eq=False)
class Course:
    """A path to follow, and the vehicle's initial offset; a pytree.

    Attributes:
        path: table over arc length.
        offset_m: initial offset of the anchor from the path, positive to the left, m.
        kind: kind of the course.
    """

    path: Path
    offset_m: Float[Array, "..."]
    kind: str

    def __repr__(self) -> str:
        if isinstance(self.path.length_m, jax.core.Tracer):
            return f"Course {self.kind!r}"
        several = jnp.broadcast_shapes(jnp.shape(self.path.length_m), jnp.shape(self.offset_m))
        if several:
            return f"Course {self.kind!r}: a batch of {math.prod(several)}"
        beside = f", begun {float(self.offset_m):g} m to the left" if np.any(np.asarray(self.offset_m)) else ""
        return f"Course {self.kind!r}: {float(self.path.length_m):.1f} m{beside}"

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Draw the path, or every path of a batch, from above. Returns the axes."""
        axes = axes_or_new(ax)
        rows = np.asarray(self.path.rows)
        for path in rows.reshape(-1, *rows.shape[-2:]):
            axes.plot(path[1:, 0], path[1:, 1])
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("x (m)")
        axes.set_ylabel("y (m)")
        axes.set_title(repr(self))
        return axes


def course(
    kind: Kind | Float[np.ndarray, "point 2"],
    *,
    metres: float | None = None,
    length_m: float | None = None,
    radius_m: float | None = None,
    turn_deg: float | None = None,
    hand: Literal["left", "right"] | None = None,
) -> Course:
    """A course for a vehicle to follow.

    Args:
        kind: ``line`` (straight), ``offset`` (straight, with an initial offset of the vehicle), ``arc`` (constant
            radius; 360° gives a circle), ``curve`` (straight, clothoid, arc, clothoid, straight) or ``eight`` (closed
            lemniscate); or points [point, 2] of the path, m.
        metres: ``offset``: initial offset of the vehicle to the left of the line, m; default: 3.
        length_m: ``line`` and ``offset``: length, m; default: 100.
        radius_m: ``arc``, ``curve``: radius, ``eight``: minimum radius, m; default: 25.
        turn_deg: ``arc`` and ``curve``: total turn; default: 90.
        hand: ``arc`` and ``curve``: direction of the turn; default: left.

    Raises:
        InputError: unknown kind, an argument of another kind, or an invalid length.

    Example:
        print(lx.course("offset", metres=3.0))   # Course 'offset': 100.0 m, begun 3 m to the left
        bend = lx.course("curve", radius_m=20.0, turn_deg=60.0, hand="right")
        logged = lx.course([[0.0, 0.0], [10.0, 0.0], [20.0, 2.0], [30.0, 6.0]])
    """
    given = {"metres": metres, "length_m": length_m, "radius_m": radius_m, "turn_deg": turn_deg, "hand": hand}
    named = kind if isinstance(kind, str) else "points"
    takes = _TAKES.get(named, ())
    if isinstance(kind, str) and kind not in _TAKES:
        raise InputError("course", "kind", f"{', '.join(_TAKES)}, or points", repr(kind))
    for name, value in given.items():
        if value is not None and name not in takes:
            raise InputError(
                "course", name, f"an argument of the course {named!r}: {', '.join(takes) or 'none'}", repr(value)
            )
    told = {name: _USUAL[name] if given[name] is None else given[name] for name in takes}
    for name in takes:
        one = told[name]
        if name != "hand" and not (is_number(one) and math.isfinite(one)):
            raise InputError("course", name, "a finite number", repr(told[name])[:60])
        if name == "length_m" and not 0.0 < told[name] <= _LONGEST_M:  # type: ignore[operator]
            raise InputError("course", name, f"more than 0 and at most {_LONGEST_M:g} m", f"{told[name]:g}")
    if not isinstance(told.get("hand", "left"), str) or told.get("hand", "left") not in ("left", "right"):
        raise InputError("course", "hand", "left or right", repr(told["hand"])[:60])
    return Course(_path(kind, told), jnp.float32(told.get("metres", 0.0)), named)  # type: ignore[arg-type]


def _path(kind: Kind | Float[np.ndarray, "point 2"], told: dict[str, object]) -> Path:
    number = {name: float(value) for name, value in told.items() if name != "hand"}  # type: ignore[arg-type]
    if not isinstance(kind, str):
        try:
            points = np.asarray(kind, np.float64)
        except (TypeError, ValueError):
            raise InputError("course", "points", "an array [point, 2] of numbers", repr(kind)[:60]) from None
        if points.ndim != 2 or points.shape[1] != 2 or not len(points):
            raise InputError("course", "points", "an array [point, 2]", f"shape {points.shape}")
        _require_length("points", float(np.sum(np.hypot(*np.diff(points, axis=0).T))))
        return path_from_points(points)
    if kind == "eight":
        _require_length("radius_m", _EIGHT_RADII * number["radius_m"])
        return eight_course(number["radius_m"])
    if kind in ("line", "offset"):
        return line_course(number["length_m"])
    hand: Literal["left", "right"] = "right" if told["hand"] == "right" else "left"
    turn_rad = math.radians(number["turn_deg"])
    _require_length("radius_m, turn_deg", number["radius_m"] * turn_rad)
    if kind == "arc":
        return arc_course(number["radius_m"], turn_rad, hand)
    # Clothoids over half of the turn: a quarter at each end.
    return clothoid_course(number["radius_m"], turn_rad, 0.5 * number["radius_m"] * turn_rad, hand)


def _require_length(name: str, length_m: float) -> None:
    if length_m > _LONGEST_M:
        raise InputError("course", name, f"a course of at most {_LONGEST_M:g} m", f"{length_m:g} m")


class Rollout(NamedTuple):
    """A simulated drive; a pytree.

    Attributes:
        trace: pose, wheel angles and cross-track error per step.
        metrics: RMS and max cross-track error, settling, effort.
    """

    trace: RolloutTrace
    metrics: RolloutMetrics

    def __repr__(self) -> str:
        if isinstance(self.metrics.rms_m, jax.core.Tracer) or jnp.ndim(self.metrics.rms_m):
            steps, vehicles = jnp.shape(self.trace.x_m)[self._steps_axis()], math.prod(jnp.shape(self.metrics.rms_m))
            return f"Rollout: {steps} steps of {vehicles} vehicles"
        rms_m, most_m = float(self.metrics.rms_m), float(self.metrics.largest_m)
        return f"Rollout: {len(self.trace.x_m)} steps, off the path by {rms_m:.3f} m RMS, {most_m:.3f} m at most"

    def plot(self, *, ax: "Axes | None" = None) -> "Axes":
        """Draw the cross-track error over the arc length, a line per vehicle. Returns the axes."""
        axes = axes_or_new(ax)
        axes.axhline(0.0, linewidth=0.8, color="0.6")
        ways = (
            np.moveaxis(np.asarray(each), self._steps_axis(), 0) for each in (self.trace.arc_m, self.trace.offset_m)
        )
        axes.plot(*(way.reshape(len(way), -1) for way in ways))
        axes.set_xlabel("distance along the path (m)")
        axes.set_ylabel("offset (m), left positive")
        return axes

    def _steps_axis(self) -> int:
        """Axis of the trace's steps: the first for arrays of vehicles, behind those that ``vmap`` puts in front."""
        shape, vehicles = jnp.shape(self.trace.x_m), jnp.shape(self.metrics.rms_m)
        # With as many steps as vehicles both would do.
        return next(axis for axis in range(len(shape)) if shape[:axis] + shape[axis + 1 :] == vehicles)


def rollout(
    vehicle: Vehicle,
    course: Course,
    look_ahead_m: ArrayLike | None = None,
    *,
    speed_mps: ArrayLike = _SPEED_MPS,
    duration_s: float = 25.0,
    step_s: float = 0.05,
    law: Literal["exact", "closed", "stanley"] = "exact",
) -> Rollout:
    """Drive a course in closed loop: pursuit law, steering servo, kinematics. A pure function, for jit, vmap and grad.

    Args:
        vehicle: counter-steer vehicle.
        course: course from ``course``.
        look_ahead_m: look-ahead distance along the path, m; default: that of the vehicle file, over speed.
        speed_mps: constant speed above 0, m/s. Speed and look-ahead are scalars, or arrays with a value per vehicle.
        duration_s, step_s: duration of the drive and of a step, s; static Python numbers.
        law: pure pursuit, ``exact`` (LL eq. 2) or ``closed`` (LL eq. 3), or ``stanley`` for comparison.

    Returns:
        Rollout: ``trace`` [step, ...] and ``metrics``; ``vmap`` adds a leading axis.

    Raises:
        InputError: a skid-steer vehicle, a value missing in its file, a duration that is not positive, or arrays of
            different shapes.

    Example:
        import jax
        import jax.numpy as jnp

        vehicle, bend = lx.open_vehicle("made_up.vehicle.toml"), lx.course("curve", turn_deg=45.0)
        drive = jax.jit(lx.rollout)(vehicle, bend, 3.0)
        print(drive)                       # Rollout: 500 steps, off the path by ... m RMS
        drive.plot()
        many = jax.vmap(lambda metres: lx.rollout(vehicle, bend, metres).metrics.rms_m)(jnp.linspace(2.0, 6.0, 5))
        slope = jax.grad(lambda metres: lx.rollout(vehicle, bend, metres).metrics.rms_m)(3.0)
    """
    spec, lane, start = _prepared(vehicle, course, look_ahead_m, speed_mps, duration_s, step_s, law)
    _, metrics, trace = roll_out_traced(spec, course.path, lane, start)
    return Rollout(trace, metrics)


def tracking_cost(
    look_ahead_m: ArrayLike,
    vehicle: Vehicle,
    course: Course,
    *,
    speed_mps: ArrayLike = _SPEED_MPS,
    duration_s: float = 25.0,
    effort_m2: ArrayLike = 2.0,
) -> Float[Array, "..."]:
    """Cost of a look-ahead in metres: RMS cross-track error plus weighted movement of the wheels.

    Cost function of the look-ahead study (docs/vehicle.md), for one course and speed, without the phase-margin
    constraint.

    Args:
        look_ahead_m: look-ahead distance along the path, m.
        vehicle: counter-steer vehicle.
        course: course from ``course``.
        speed_mps: constant speed, m/s.
        duration_s: duration of the drive, s; a static Python number.
        effort_m2: weight of the wheel movement, metres of cost per rad/m; 0 or more.

    Raises:
        InputError: as ``rollout``.

    Example:
        import jax
        import jax.numpy as jnp

        vehicle, beside = lx.open_vehicle("made_up.vehicle.toml"), lx.course("offset", metres=3.0)
        cost, slope = jax.value_and_grad(lx.tracking_cost)(3.0, vehicle, beside)
        costs = jax.vmap(lx.tracking_cost, in_axes=(0, None, None))(jnp.linspace(2.0, 6.0, 5), vehicle, beside)
    """
    _require_numbers("effort_m2", effort_m2, zero=True)
    spec, lane, start = _prepared(vehicle, course, look_ahead_m, speed_mps, duration_s, 0.05, "exact")
    _, metrics = roll_out(spec, course.path, lane, start)
    cost: Array = metrics.rms_m + jnp.asarray(effort_m2, jnp.float32) * metrics.effort_radpm
    return cost


def _prepared(
    vehicle: Vehicle,
    course: Course,
    look_ahead_m: ArrayLike | None,
    speed_mps: ArrayLike,
    duration_s: float,
    step_s: float,
    law: Literal["exact", "closed", "stanley"],
) -> tuple[RolloutSpec, RolloutLane, RolloutState]:
    for given, type_, maker in ((vehicle, Vehicle, "open_vehicle"), (course, Course, "course")):
        if not isinstance(given, type_):
            raise InputError("call", type_.__name__.lower(), f"the result of {maker}()", repr(given)[:60])
    for name, numbers in (("look_ahead_m", look_ahead_m), ("speed_mps", speed_mps)):
        if numbers is not None:
            _require_numbers(name, numbers)
    for name, value in (("duration_s", duration_s), ("step_s", step_s)):
        if not (is_number(value) and math.isfinite(value) and value > 0.0):
            raise InputError("call", name, "a positive Python number, not an array", repr(value)[:60])
    duration_s, step_s = float(duration_s), float(step_s)
    if law not in ("exact", "closed", "stanley"):
        raise InputError("call", "law", "exact, closed or stanley", repr(law)[:60])
    if vehicle.chassis is None or vehicle.servo is None:
        moving_parts(vehicle.file, vehicle.path)  # says which number is missing
    assert vehicle.chassis is not None
    assert vehicle.servo is not None
    ahead = vehicle.look_ahead if look_ahead_m is None else constant_look_ahead(jnp.asarray(look_ahead_m, jnp.float32))
    if ahead is None:
        where = "vehicle file" if vehicle.path is None else vehicle.path
        raise InputError(
            where, "pursuit.short_m", "a look-ahead in the vehicle file, or the argument look_ahead_m", "none"
        )
    speed = jnp.asarray(speed_mps, jnp.float32)
    shapes = jnp.shape(ahead.short_m), jnp.shape(speed), jnp.shape(course.offset_m)
    try:
        shape = jnp.broadcast_shapes(*shapes)
    except ValueError:
        places, found = "look_ahead_m, speed_mps, course", ", ".join(map(str, shapes))
        raise InputError("call", places, "shapes that broadcast together", found) from None
    lane = RolloutLane(
        vehicle.chassis,
        vehicle.chassis,
        vehicle.servo,
        vehicle.servo.nominal_v,
        jnp.broadcast_to(speed, shape),
        LookAhead(*(jnp.broadcast_to(field, shape) for field in ahead)),
    )
    slots = math.ceil(vehicle.delay_s / step_s - 1e-9)
    spec = RolloutSpec(steps=max(1, round(duration_s / step_s)), step_s=step_s, law=law, delay_slots=slots)
    zero = jnp.zeros(shape, jnp.float32)
    start = start_rollout(course.path, lane, zero, jnp.broadcast_to(course.offset_m, shape), zero, delay_slots=slots)
    return spec, lane, start


def _require_numbers(name: str, given: ArrayLike, *, zero: bool = False) -> None:
    """Refuse values that are not numbers, or arrays of numbers, above 0 or from 0 on; traced values are not checked."""
    try:
        values = np.asarray(given)
    except jax.errors.TracerArrayConversionError:
        return
    except ValueError:  # lists of unequal lengths
        values = np.asarray(None)
    real = np.issubdtype(values.dtype, np.integer) or np.issubdtype(values.dtype, np.floating)
    if not (real and np.all(np.isfinite(values)) and np.all((values >= 0.0) if zero else (values > 0.0))):
        least = "of at least 0" if zero else "above 0"
        raise InputError("call", name, f"a number {least}, or an array of them", repr(given)[:60])
