"""In which order lines are driven, and which lines of a concave field belong together."""

import math
from collections.abc import Sequence
from itertools import pairwise
from typing import Literal, NamedTuple

Order = Literal["zamboni", "boustrophedon"]
Span = tuple[float, float]


class Piece(NamedTuple):
    """One piece of one strip.

    Attributes:
        strip: number of the strip, from 0.
        span_m: from where to where along it.
    """

    strip: int
    span_m: Span


def middle_line(count: int) -> int:
    """Number, from 1, of the line that the first is joined to in Zamboni order: the first of the second half.

    Of an odd number of lines the first half has one more, so that the order ends in it and no two neighbours follow
    each other.
    """
    return (count + 1) // 2 + 1


def line_order(count: int, order: Order) -> tuple[int, ...]:
    """Numbers of lines, from 0, in driving order.

    Zamboni is 1, m, 2, m + 1, ... with m the middle line (MF section 2), boustrophedon 1, 2, 3, ...
    """
    if order == "boustrophedon":
        return tuple(range(count))
    half = middle_line(count) - 1
    return tuple(number // 2 + (number % 2) * half for number in range(count))


def smallest_step(count: int, order: Order) -> int:
    """Fewest line spacings between two lines driven one after the other; n/2 − 1 for n > 2 even and Zamboni order."""
    return min((abs(after - before) for before, after in pairwise(line_order(count, order))), default=0)


def lines_for_zamboni(radius_m: float, spacing_m: float) -> int:
    """Fewest lines that one-handed turns of a radius can join: (n/2 − 1) w ≥ 2R for n even (MF section 2)."""
    steps = math.ceil(2.0 * radius_m / spacing_m - 1e-9)
    return 2 if steps <= 1 else 2 * steps + 1


def chains(strips: Sequence[Sequence[Span]]) -> tuple[tuple[Piece, ...], ...]:
    """Pieces of neighbouring strips that follow each other one by one: a concave field falls into several chains.

    A chain ends where the field parts or comes together. A convex field is one chain.

    Args:
        strips: of each strip the pieces, ascending.
    """
    done: list[list[Piece]] = []
    open_chains: dict[Span, list[Piece]] = {}
    for number, pieces in enumerate(strips):
        following: dict[Span, list[Piece]] = {}
        for span in pieces:
            below = [each for each in open_chains if _overlap(each, span)]
            if len(below) == 1 and sum(_overlap(below[0], each) for each in pieces) == 1:
                chain = open_chains[below[0]]
            else:
                chain = []
                done.append(chain)
            chain.append(Piece(number, span))
            following[span] = chain
        open_chains = following
    return tuple(tuple(chain) for chain in done)


def _overlap(one: Span, other: Span) -> bool:
    return one[0] < other[1] and other[0] < one[1]
