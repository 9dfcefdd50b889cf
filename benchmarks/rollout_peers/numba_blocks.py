"""Numba with lanes in blocks that stay in the first cache: vectors of lanes wherever there is no table to look into.

All numbers of a block lie in one flat array with constant offsets. LLVM then knows that no two of them are the same
memory, which it cannot know of arrays that are handed in, and vectorises the arithmetic; only fetching rows stays
scalar, as the machine's own gather is no faster.
"""

# Numba finds the types of the kernels itself.
# mypy: allow-untyped-defs, allow-untyped-calls

import numpy as np
from numba import njit, prange

from benchmarks.rollout_peers.numba_math import ZERO, drive, f4, path_position, place, project, steer, turn_wheels
from benchmarks.rollout_peers.work import arguments, finish, seconds
from benchmarks.rollout_problem import TAIL_M, TOLERANCE_M, as_flat, load_problem

BLOCK = 128
(X, Y, COS, SIN, ARC, ADVANCE, MOTOR, WHEEL, SQUARE, LARGEST, SETTLED, LOW, HIGH, STEERED, UNREACHABLE) = range(15)
STATE = 15
(RATIO, LEAD, LOSS, LIMIT, LOCK_FRONT, LOCK_REAR, DEAD_BAND, GONE) = range(15, 23)
(LEAST, MOST, PLAY, AHEAD, WAY, GAIN, PER_BASE) = range(23, 30)
INPUT = 15
(LEAD_M, BEYOND, NEAR, ANCHOR_X, ANCHOR_Y, ROW) = range(30, 36)
NUMBERS = 40


@njit(parallel=True, fastmath=True, error_model="numpy")
def roll_blocks(rows, spacing, state, inputs, steps, tolerance, tail):
    """Advance all lanes; ``state`` is changed in place, its lanes a multiple of the block.

    Args:
        rows: [row, 5] of the path, flat.
    """
    last = np.int32(len(rows) // 5 - 1)
    per_spacing = f4(1.0) / spacing
    for block in prange(state.shape[1] // BLOCK):
        n = np.empty(NUMBERS * BLOCK, np.float32)
        at = np.empty(BLOCK, np.int32)
        first = block * BLOCK
        for field in range(STATE):
            for j in range(BLOCK):
                n[field * BLOCK + j] = state[field, first + j]
        for field in range(INPUT):
            for j in range(BLOCK):
                n[(STATE + field) * BLOCK + j] = inputs[field, first + j]
        for j in range(BLOCK):
            n[LEAD_M * BLOCK + j] = n[LEAD * BLOCK + j] / n[PER_BASE * BLOCK + j]
        for number in range(1, steps + 1):
            for j in range(BLOCK):
                lead = n[LEAD_M * BLOCK + j]
                n[ANCHOR_X * BLOCK + j] = n[X * BLOCK + j] + lead * n[COS * BLOCK + j]
                n[ANCHOR_Y * BLOCK + j] = n[Y * BLOCK + j] + lead * n[SIN * BLOCK + j]
                near = n[ARC * BLOCK + j] + n[ADVANCE * BLOCK + j]
                n[NEAR * BLOCK + j] = near
                row, beyond = place(near, per_spacing, spacing, last)
                at[j] = row
                n[BEYOND * BLOCK + j] = beyond
            fetch(rows, at, n)
            for j in range(BLOCK):
                near = n[NEAR * BLOCK + j]
                arc, offset = project(
                    near,
                    n[BEYOND * BLOCK + j],
                    n[ROW * BLOCK + j],
                    n[(ROW + 1) * BLOCK + j],
                    n[(ROW + 2) * BLOCK + j],
                    n[(ROW + 3) * BLOCK + j],
                    n[(ROW + 4) * BLOCK + j],
                    n[ANCHOR_X * BLOCK + j],
                    n[ANCHOR_Y * BLOCK + j],
                )
                n[ADVANCE * BLOCK + j] = arc - n[ARC * BLOCK + j]
                n[ARC * BLOCK + j] = arc
                error = offset if offset > ZERO else -offset
                way = n[WAY * BLOCK + j]
                way = way if way > ZERO else -way
                settled = n[SETTLED * BLOCK + j]
                n[SETTLED * BLOCK + j] = settled if error <= tolerance else f4(number) * way
                late = f4(steps - number) * way < tail
                low, high = n[LOW * BLOCK + j], n[HIGH * BLOCK + j]
                n[LOW * BLOCK + j] = offset if late & (offset < low) else low
                n[HIGH * BLOCK + j] = offset if late & (offset > high) else high
                n[SQUARE * BLOCK + j] += offset * offset
                largest = n[LARGEST * BLOCK + j]
                n[LARGEST * BLOCK + j] = error if error > largest else largest
                row, beyond = place(arc + n[AHEAD * BLOCK + j], per_spacing, spacing, last)
                at[j] = row
                n[BEYOND * BLOCK + j] = beyond
            fetch(rows, at, n)
            for j in range(BLOCK):
                x, y = path_position(
                    n[BEYOND * BLOCK + j],
                    n[ROW * BLOCK + j],
                    n[(ROW + 1) * BLOCK + j],
                    n[(ROW + 2) * BLOCK + j],
                    n[(ROW + 3) * BLOCK + j],
                    n[(ROW + 4) * BLOCK + j],
                )
                east, north = x - n[ANCHOR_X * BLOCK + j], y - n[ANCHOR_Y * BLOCK + j]
                cos, sin = n[COS * BLOCK + j], n[SIN * BLOCK + j]
                per_base = n[PER_BASE * BLOCK + j]
                ratio = n[RATIO * BLOCK + j]
                command, missed = steer(
                    (east * cos + north * sin) * per_base,
                    (north * cos - east * sin) * per_base,
                    ratio,
                    n[LEAD * BLOCK + j],
                    n[LOSS * BLOCK + j],
                    n[LIMIT * BLOCK + j],
                    n[LOCK_FRONT * BLOCK + j],
                    n[LOCK_REAR * BLOCK + j],
                )
                n[UNREACHABLE * BLOCK + j] += missed
                before = n[WHEEL * BLOCK + j]
                motor, wheel = turn_wheels(
                    command,
                    n[MOTOR * BLOCK + j],
                    before,
                    n[DEAD_BAND * BLOCK + j],
                    n[GONE * BLOCK + j],
                    n[LEAST * BLOCK + j],
                    n[MOST * BLOCK + j],
                    n[PLAY * BLOCK + j],
                )
                n[MOTOR * BLOCK + j] = motor
                n[WHEEL * BLOCK + j] = wheel
                n[STEERED * BLOCK + j] += abs(wheel - before)
                x, y, cos, sin = drive(
                    n[X * BLOCK + j],
                    n[Y * BLOCK + j],
                    cos,
                    sin,
                    wheel,
                    ratio,
                    n[WAY * BLOCK + j],
                    n[GAIN * BLOCK + j],
                    per_base,
                )
                n[X * BLOCK + j] = x
                n[Y * BLOCK + j] = y
                n[COS * BLOCK + j] = cos
                n[SIN * BLOCK + j] = sin
        for field in range(STATE):
            for j in range(BLOCK):
                state[field, first + j] = n[field * BLOCK + j]


@njit(fastmath=True, error_model="numpy")
def fetch(rows, at, n):
    for j in range(BLOCK):
        row = np.uint64(at[j]) * np.uint64(5)
        n[ROW * BLOCK + j] = rows[row]
        n[(ROW + 1) * BLOCK + j] = rows[row + np.uint64(1)]
        n[(ROW + 2) * BLOCK + j] = rows[row + np.uint64(2)]
        n[(ROW + 3) * BLOCK + j] = rows[row + np.uint64(3)]
        n[(ROW + 4) * BLOCK + j] = rows[row + np.uint64(4)]


def main() -> None:
    """The program: whole blocks, the last lane repeated to fill them."""
    chosen = arguments("numba_blocks")
    problem = load_problem(chosen.problem)
    flat = as_flat(problem, chosen.steps)
    lanes = flat.state.shape[1]
    fill = ((0, 0), (0, -lanes % BLOCK))
    begin, inputs = np.pad(flat.state, fill, mode="edge"), np.pad(flat.inputs, fill, mode="edge")
    rows = problem.rows.ravel().copy()
    state = begin.copy()

    def run() -> None:
        state[:] = begin
        roll_blocks(rows, f4(problem.spacing_m), state, inputs, chosen.steps, f4(TOLERANCE_M), f4(TAIL_M))

    taken_s = seconds(run, chosen.repeats)
    finish(chosen, taken_s, lanes, state[:4, :lanes], np.sqrt(state[SQUARE, :lanes] / chosen.steps))


if __name__ == "__main__":
    main()
