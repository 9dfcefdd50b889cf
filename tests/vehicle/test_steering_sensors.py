"""Potentiometer and encoder: readings and their inverses, on arrays and at the ends of the range."""

import numpy as np
import pytest

from lgprjax.vehicle import (
    Encoder,
    Potentiometer,
    encoder_angle,
    encoder_zero,
    potentiometer_angle,
    read_encoder,
    read_potentiometer,
)

BENT = Potentiometer(2.4, (2.0, 0.1, -0.3), 0.6)
ANGLES = np.linspace(-0.55, 0.55, 23)


def test_a_voltage_is_the_polynomial_of_the_angle() -> None:
    expected = [2.4 + 2.0 * angle + 0.1 * angle**2 - 0.3 * angle**3 for angle in ANGLES]
    np.testing.assert_allclose(read_potentiometer(BENT, ANGLES), expected, rtol=1e-14)


@pytest.mark.parametrize("sensor", [BENT, Potentiometer(2.4, (2.0,), 0.6), Potentiometer(2.4, (-1.5, 0.2), 0.6)])
def test_the_angle_of_a_voltage_is_the_one_that_was_read(sensor: Potentiometer) -> None:
    np.testing.assert_allclose(potentiometer_angle(sensor, read_potentiometer(sensor, ANGLES)), ANGLES, atol=1e-9)


def test_a_voltage_that_no_angle_has_is_none() -> None:
    found = potentiometer_angle(BENT, np.array([0.0, 2.4, 5.0]))
    assert np.isnan(found[[0, 2]]).all()
    assert found[1] == pytest.approx(0.0, abs=1e-12)


def test_a_voltage_that_turns_back_is_refused() -> None:
    with pytest.raises(ValueError, match="does not run one way"):
        potentiometer_angle(Potentiometer(2.4, (0.1, 2.0), 0.6), np.array([2.4]))


def test_counts_are_whole_and_come_back_within_half_of_one() -> None:
    encoder = Encoder(12000.0, 731.4)
    counts = read_encoder(encoder, ANGLES)
    assert (counts == np.floor(counts)).all()
    back = encoder_angle(encoder, counts)
    assert np.abs(back - ANGLES).max() <= 0.5 / 12000.0
    assert np.abs(back - ANGLES).max() > 0.1 / 12000.0  # the rounding is there


def test_an_encoder_is_set_by_one_known_angle() -> None:
    fresh = encoder_zero(Encoder(-8000.0, 0.0), 1234.0, 0.25)
    assert encoder_angle(fresh, np.array([1234.0]))[0] == pytest.approx(0.25, abs=1e-12)
    assert encoder_angle(fresh, np.array([1234.0 - 800.0]))[0] == pytest.approx(0.35, abs=1e-12)
