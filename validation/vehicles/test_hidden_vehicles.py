"""Twenty hidden vehicles: loops, look-aheads, and intervals over two thousand draws."""

from collections.abc import Callable

import pytest

from validation.vehicles.drawn import LAWS
from validation.vehicles.hidden import COUNT, check_look_ahead, check_loops, coverage

RecordProperty = Callable[[str, object], None]


def test_twenty_hidden_vehicles(record_property: RecordProperty) -> None:
    for name, figure in check_loops(tuple(range(COUNT))).items():
        record_property(name, figure)


def test_twenty_look_aheads(record_property: RecordProperty) -> None:
    for name, figure in check_look_ahead(tuple(range(COUNT)), 512, 60).items():
        record_property(name, figure)


@pytest.mark.parametrize(
    ("law", "draws", "low", "high"), [("white", 2000, 0.93, 0.97), *((law, 400, 0.9, 1.0) for law in LAWS)]
)
def test_intervals_cover(law: str, draws: int, low: float, high: float, record_property: RecordProperty) -> None:
    shares = coverage(law, draws, 17)
    for name in ("lag_s", "delay_s", "rate_radps", "rear_ratio", "slip_s2pm2"):
        record_property(name, shares[name])
        assert low <= shares[name] <= high, name
