"""Numba as it is usually written: ``prange`` over lanes, one lane's numbers in registers through all of its steps."""

# Numba finds the types of the kernels itself.
# mypy: allow-untyped-defs, allow-untyped-calls

import numpy as np
from numba import njit, prange

from benchmarks.rollout_peers.numba_math import ONE, ZERO, drive, f4, path_position, place, project, steer, turn_wheels
from benchmarks.rollout_peers.work import arguments, finish, seconds
from benchmarks.rollout_problem import TAIL_M, TOLERANCE_M, as_flat, load_problem


@njit(parallel=True, fastmath=True, error_model="numpy")
def roll_lanes(rows, spacing, state, inputs, steps, tolerance, tail):
    """Advance all lanes; ``state`` is changed in place.

    Args:
        rows: [row, 5] of the path, flat.
    """
    last = np.int32(len(rows) // 5 - 1)
    per_spacing = ONE / spacing
    for j in prange(state.shape[1]):
        x, y, cos, sin, arc, advance, motor, wheel = (
            state[0, j], state[1, j], state[2, j], state[3, j], state[4, j], state[5, j], state[6, j], state[7, j],
        )  # fmt: skip
        square, largest, settled, low, high, steered, missed = (
            state[8, j], state[9, j], state[10, j], state[11, j], state[12, j], state[13, j], state[14, j],
        )  # fmt: skip
        ratio, lead, per_base, way = inputs[0, j], inputs[1, j], inputs[14, j], inputs[12, j]
        lead_m = lead / per_base
        size = way if way > ZERO else -way
        for number in range(1, steps + 1):
            anchor_x, anchor_y = x + lead_m * cos, y + lead_m * sin
            near = arc + advance
            row, beyond = place(near, per_spacing, spacing, last)
            at = np.uint64(row) * np.uint64(5)
            found, offset = project(
                near, beyond, rows[at], rows[at + np.uint64(1)], rows[at + np.uint64(2)], rows[at + np.uint64(3)],
                rows[at + np.uint64(4)], anchor_x, anchor_y,
            )  # fmt: skip
            advance = found - arc
            arc = found
            row, beyond = place(arc + inputs[11, j], per_spacing, spacing, last)
            at = np.uint64(row) * np.uint64(5)
            goal_x, goal_y = path_position(
                beyond, rows[at], rows[at + np.uint64(1)], rows[at + np.uint64(2)], rows[at + np.uint64(3)],
                rows[at + np.uint64(4)],
            )  # fmt: skip
            east, north = goal_x - anchor_x, goal_y - anchor_y
            command, unreachable = steer(
                (east * cos + north * sin) * per_base, (north * cos - east * sin) * per_base, ratio, lead,
                inputs[2, j], inputs[3, j], inputs[4, j], inputs[5, j],
            )  # fmt: skip
            before = wheel
            motor, wheel = turn_wheels(
                command, motor, wheel, inputs[6, j], inputs[7, j], inputs[8, j], inputs[9, j], inputs[10, j]
            )
            x, y, cos, sin = drive(x, y, cos, sin, wheel, ratio, way, inputs[13, j], per_base)
            error = offset if offset > ZERO else -offset
            settled = settled if error <= tolerance else f4(number) * size
            late = f4(steps - number) * size < tail
            low = offset if late & (offset < low) else low
            high = offset if late & (offset > high) else high
            square += offset * offset
            largest = error if error > largest else largest
            steered += abs(wheel - before)
            missed += unreachable
        final = (x, y, cos, sin, arc, advance, motor, wheel, square, largest, settled, low, high, steered, missed)
        for field in range(15):
            state[field, j] = final[field]


def main() -> None:
    """The program."""
    chosen = arguments("numba_lanes")
    problem = load_problem(chosen.problem)
    begin, inputs = as_flat(problem, chosen.steps)
    rows = problem.rows.ravel().copy()
    state = begin.copy()

    def run() -> None:
        state[:] = begin
        roll_lanes(rows, f4(problem.spacing_m), state, inputs, chosen.steps, f4(TOLERANCE_M), f4(TAIL_M))

    taken_s = seconds(run, chosen.repeats)
    finish(chosen, taken_s, state.shape[1], state[:4], np.sqrt(state[8] / chosen.steps))


if __name__ == "__main__":
    main()
