"""A number found from a log, with the interval that it can be defended by."""

from typing import NamedTuple


class Estimate(NamedTuple):
    """A fitted number.

    Attributes:
        value: in the unit of its name.
        sigma: standard error.
        low, high: 95 % interval.
    """

    value: float
    sigma: float
    low: float
    high: float


class NotExcitedError(ValueError):
    """A log does not hold what a fit needs; the message says what was expected and what was found."""

    def __init__(self, what: str, expected: str, found: str) -> None:
        super().__init__(f"{what}: expected {expected}, found {found}")
        self.what, self.expected, self.found = what, expected, found
