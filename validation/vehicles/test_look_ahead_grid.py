"""The look-ahead found by gradient beside a search of 100,000 drives, at full and at reduced torque."""

from collections.abc import Callable

import pytest

from lgprjax.tuning import tune_look_ahead
from validation.vehicles.look_ahead_grid import FULL_V, WEAK_V, least_cost, trial_courses, vehicle


@pytest.mark.parametrize("volts", [FULL_V, WEAK_V])
def test_gradient_is_as_good_as_brute_force(volts: float, record_property: Callable[[str, object], None]) -> None:
    """Within 2 % of the least cost of 3,600 schedules, each driven 30 times."""
    trials = trial_courses()
    found, least = tune_look_ahead(vehicle(volts), trials).cost_m, least_cost(trials, volts, (12, 15, 4, 5), 6)
    record_property("cost by gradient, m", found)
    record_property("by brute force, m", least)
    assert found <= 1.02 * least
