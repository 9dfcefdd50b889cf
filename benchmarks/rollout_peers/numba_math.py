"""A rollout's step in Numba, lane by lane: the arithmetic of ``lgprjax.vehicle``, written again as scalars of float32.

Every function is forced into its caller. ``fastmath`` and NumPy's division (no test for zero) are on, indices are
unsigned and choices are selections, so that nothing keeps LLVM from putting lanes in vectors.
"""

# Numba finds the types of the kernels itself.
# mypy: allow-untyped-defs, allow-untyped-calls, disable-error-code=var-annotated

from typing import Any

import numpy as np
from numba import njit, types
from numba.extending import intrinsic

f4 = np.float32
ZERO, ONE, TWO = f4(0.0), f4(1.0), f4(2.0)
HALF, THIRD, FIFTH, SIXTH, TENTH = f4(1.0 / 2.0), f4(1.0 / 3.0), f4(1.0 / 5.0), f4(1.0 / 6.0), f4(1.0 / 10.0)
TWELFTH, TWENTIETH, TWENTY_FOURTH = f4(1.0 / 12.0), f4(1.0 / 20.0), f4(1.0 / 24.0)
THIRTIETH, FORTY_SECOND = f4(1.0 / 30.0), f4(1.0 / 42.0)
C945, C420, C105, C15, C9, C4, C1_5 = f4(945.0), f4(420.0), f4(105.0), f4(15.0), f4(9.0), f4(4.0), f4(1.5)


def inlined(function: Any) -> Any:
    """Compiled into its caller."""
    return njit(forceinline=True, fastmath=True, error_model="numpy")(function)


def _truncate(_context: Any, _value: Any) -> Any:
    """To int32 by one instruction; Numba's own ``int`` and ``floor`` go by way of 64 bits, which vectors lack."""

    def generate(context: Any, builder: Any, _signature: Any, arguments: Any) -> Any:
        return builder.fptosi(arguments[0], context.get_value_type(types.int32))

    return types.int32(types.float32), generate


_whole: Any = intrinsic(_truncate)


@inlined
def clip(value, low, high):
    value = value if value > low else low
    return value if value < high else high


@inlined
def place(arc, per_spacing, spacing, last):
    """Row of an arc length and the way beyond its start."""
    # Truncation is floor where it matters: the shift keeps the argument positive down to one arc before the start.
    row = _whole(clip(arc * per_spacing + ONE, ZERO, f4(last) + HALF))
    begin = row - np.int32(1)
    begin = begin if begin > np.int32(0) else np.int32(0)
    return row, arc - f4(begin) * spacing


@inlined
def tangent(angle):
    square = angle * angle
    return angle * (C945 - square * (C105 - square)) / (C945 - square * (C420 - C15 * square))


@inlined
def path_position(beyond, x, y, cos, sin, curvature):
    turn = curvature * beyond
    square = turn * turn
    along = beyond * (ONE - square * SIXTH * (ONE - square * TWENTIETH))
    aside = beyond * turn * (HALF - square * TWENTY_FOURTH * (ONE - square * THIRTIETH))
    return x + cos * along - sin * aside, y + sin * along + cos * aside


@inlined
def project(near, beyond, x, y, cos, sin, curvature, anchor_x, anchor_y):
    """Arc length of the foot and distance from it, on the row's circle."""
    east, north = anchor_x - x, anchor_y - y
    along, aside = east * cos + north * sin, north * cos - east * sin
    share = ONE - curvature * aside
    share = share if share > TENTH else TENTH
    way = along / share
    angle = curvature * way
    square = angle * angle
    turned = curvature * along
    bent = aside - HALF * curvature * (along * along + aside * aside)
    offset = TWO * bent / (ONE + np.sqrt(turned * turned + share * share))
    return near - beyond + way * (ONE - square * (THIRD - square * FIFTH)), offset


@inlined
def newton(ratio, front_arm, rear_arm, wanted, largest, front):
    """One step; both tangents and the quotient of value and slope with one division each."""
    behind = ratio * front
    square, square_behind = front * front, behind * behind
    low = C945 - square * (C420 - C15 * square)
    low_behind = C945 - square_behind * (C420 - C15 * square_behind)
    both = ONE / (low * low_behind)
    front_tangent = front * (C945 - square * (C105 - square)) * low_behind * both
    rear_tangent = behind * (C945 - square_behind * (C105 - square_behind)) * low * both
    value = front_arm * front_tangent + rear_arm * rear_tangent - wanted
    rise = front_arm * (ONE + front_tangent * front_tangent)
    rise += rear_arm * (ONE + rear_tangent * rear_tangent) * ratio
    step = value / (rise if rise > ZERO else ONE)
    return clip(front - (step if rise > ZERO else ZERO), -largest, largest)


@inlined
def steer(ahead, left, ratio, lead, loss, largest, lock_front, lock_rear):
    """Front angle and 1 where the goal cannot be reached; ratio, lead, loss and tangents at the lock as prepared."""
    half_square = HALF * (ahead * ahead + left * left)
    front_arm = half_square + lead * ahead
    rear_arm = half_square + (lead - ONE) * ahead
    wanted = left * loss
    lock = largest if left > ZERO else (-largest if left < ZERO else ZERO)
    rise = front_arm + ratio * rear_arm
    guess = wanted / (rise if rise > ZERO else ONE)
    square = guess * guess
    guess = guess * (C15 + C4 * square) / (C15 + C9 * square)
    front = clip(guess if rise > ZERO else lock, -largest, largest)
    front = newton(ratio, front_arm, rear_arm, wanted, largest, front)
    front = newton(ratio, front_arm, rear_arm, wanted, largest, front)
    front = newton(ratio, front_arm, rear_arm, wanted, largest, front)
    front = newton(ratio, front_arm, rear_arm, wanted, largest, front)
    most = front_arm * lock_front + rear_arm * lock_rear
    slope = front_arm * (ONE + lock_front * lock_front) + rear_arm * (ONE + lock_rear * lock_rear) * ratio
    size = wanted if wanted > ZERO else -wanted
    able = (rise > ZERO) & (slope > ZERO) & (size <= most)
    return front if able else lock, ZERO if able else ONE


@inlined
def turn_wheels(command, motor, wheel, dead_band, gone, least, most, play):
    wrong = command - motor
    wrong = wrong - clip(wrong, -dead_band, dead_band)
    motor = motor + clip(wrong * gone, least, most)
    return motor, clip(wheel, motor - play, motor + play)


@inlined
def drive(x, y, cos, sin, wheel, ratio, way, gain, per_base):
    rear_tangent = tangent(ratio * wheel)
    change = gain * (tangent(wheel) + rear_tangent) * per_base * way
    square = change * change
    along = ONE - square * SIXTH * (ONE - square * TWENTIETH * (ONE - square * FORTY_SECOND))
    aside = HALF * change * (ONE - square * TWELFTH * (ONE - square * THIRTIETH))
    drift = -gain * way * rear_tangent
    forward, left = along * way - aside * drift, aside * way + along * drift
    turned_cos, turned_sin = ONE - aside * change, along * change
    new_cos, new_sin = cos * turned_cos - sin * turned_sin, sin * turned_cos + cos * turned_sin
    unit = C1_5 - HALF * (new_cos * new_cos + new_sin * new_sin)
    return x + cos * forward - sin * left, y + sin * forward + cos * left, new_cos * unit, new_sin * unit
