"""A hidden vehicle that a plain plant drove: found and predicted. ``make validation NAME=vehicles`` takes twenty."""

from validation.vehicles.hidden import check_loops


def test_a_hidden_vehicle_is_found_and_predicted() -> None:
    # Two drives: as many as the studies fit, so that one compiled program serves all.
    check_loops((7,), drives=(0, 2))
