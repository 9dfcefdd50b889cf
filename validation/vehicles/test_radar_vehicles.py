"""Ten hidden vehicles in clear weather, snow and rain, on maps displaced by 5 cm; positions are radar fixes.

The studies begin with vehicle files that are wrong.
"""

from collections.abc import Callable

import pytest

from validation.vehicles.radar_vehicles import COUNT, NAMES, result_of

RecordProperty = Callable[[str, object], None]


@pytest.mark.parametrize("number", range(COUNT))
def test_a_vehicle_by_radar_fixes(number: int, record_property: RecordProperty) -> None:
    found = result_of(number)
    for name, figure in found._asdict().items():
        record_property(name, figure)
    print(number, found)
    assert found.ok > 0.8
    assert found.tracking_m < 0.02
    assert found.tuned_m < found.driven_m


def test_intervals_hold_the_truth(record_property: RecordProperty) -> None:
    found = [result_of(number) for number in range(COUNT)]
    inside = sum(each.inside[name] for each in found for name in NAMES)
    record_property("inside", f"{inside} of {COUNT * len(NAMES)}")
    assert inside >= 0.875 * COUNT * len(NAMES)
    assert sum(each.predicted <= 0.2 for each in found) >= 0.8 * COUNT
