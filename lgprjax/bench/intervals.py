"""How much a share of successes may be wrong by."""

import math
from typing import NamedTuple

_TWO_SIDED_95 = 1.959963984540054


class Interval(NamedTuple):
    """A range of shares."""

    low: float
    high: float


def wilson(successes: int, trials: int) -> Interval:
    """Wilson's 95 % score interval of a share; all of 0 to 1 where nothing was tried.

    Unlike the normal one it stays within 0 to 1 and is of use where all trials succeeded.
    """
    if trials == 0:
        return Interval(0.0, 1.0)
    z2 = _TWO_SIDED_95**2
    share = successes / trials
    middle = (share + z2 / (2 * trials)) / (1 + z2 / trials)
    half = _TWO_SIDED_95 / (1 + z2 / trials) * math.sqrt(share * (1 - share) / trials + z2 / (4 * trials**2))
    # Rounding must not push the ends of "none" and "all" past them.
    low = 0.0 if successes == 0 else middle - half
    high = 1.0 if successes == trials else middle + half
    return Interval(low, high)
