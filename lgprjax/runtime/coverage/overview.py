"""Overview of a plan for the operator: order of the swaths, ways in reverse, keep-outs, time."""

import math
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.coverage import Pattern
from lgprjax.coverage.pattern import driving_time_s
from lgprjax.coverage.turns import poses_along
from lgprjax.formats import CoverPlan

_PAGE_STEP_M = 0.4


class TurnWays(NamedTuple):
    """Points along the ways between swaths, of the reference point: each is driven in one direction."""

    forward_m: tuple[Float[np.ndarray, "_ 2"], ...]
    reverse_m: tuple[Float[np.ndarray, "_ 2"], ...]


def turn_ways(pattern: Pattern, spacing_m: float = 0.2) -> TurnWays:
    """The ways between the swaths of a pattern, for pictures.

    Args:
        pattern: planned pattern.
        spacing_m: largest spacing of the points.
    """
    ways: dict[bool, list[Float[np.ndarray, "_ 2"]]] = {True: [], False: []}
    for turn in pattern.turns:
        begins = np.concatenate([[0.0], np.cumsum(np.abs(turn.pieces[:, 0]))])
        for number, (length_m, _) in enumerate(turn.pieces):
            inner = np.linspace(begins[number], begins[number + 1], max(math.ceil(abs(length_m) / spacing_m), 1) + 1)
            # A hair before the border, where the next piece may go the other way.
            inner[-1] -= 1e-9
            ways[bool(length_m > 0.0)].append(poses_along(turn.start, turn.pieces, inner)[:, :2])
    return TurnWays(tuple(ways[True]), tuple(ways[False]))


def plan_overview(plan: CoverPlan, speed_mps: float) -> dict[str, Any]:
    """Data of a plan for the operator's page, in metres about its anchor, to the centimetre.

    Args:
        plan: plan of the field.
        speed_mps: set speed on straight ways, for the time.
    """
    pattern, computed = plan.pattern, plan.computed_corner
    return {
        "swaths": [_rounded(np.concatenate([line.start_m, line.end_m])) for line in pattern.lines],
        "reverse": [_rounded(way) for way in turn_ways(pattern, _PAGE_STEP_M).reverse_m],
        "keep_outs": [_rounded(ring) for ring in plan.keep_outs_m],
        "computed_corner": None if computed is None else _rounded(pattern.field.perimeter_m[computed]),
        "length_m": round(pattern.length_m, 1),
        "time_s": round(driving_time_s(pattern, speed_mps)),
    }


def _rounded(places_m: Float[np.ndarray, "..."]) -> Any:
    return np.round(places_m, 2).tolist()
