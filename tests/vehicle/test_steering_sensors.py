"""Potentiometer and encoder: their readings of an angle."""

import numpy as np

from lgprjax.vehicle import (
    Encoder,
    Potentiometer,
    read_encoder,
    read_potentiometer,
)

BENT = Potentiometer(2.4, (2.0, 0.1, -0.3), 0.6)
ANGLES = np.linspace(-0.55, 0.55, 23)


def test_a_voltage_is_the_polynomial_of_the_angle() -> None:
    expected = [2.4 + 2.0 * angle + 0.1 * angle**2 - 0.3 * angle**3 for angle in ANGLES]
    np.testing.assert_allclose(read_potentiometer(BENT, ANGLES), expected, rtol=1e-14)


def test_counts_are_whole_and_the_nearest() -> None:
    encoder = Encoder(12000.0, 731.4)
    counts = read_encoder(encoder, ANGLES)
    assert (counts == np.floor(counts)).all()
    away = np.abs(counts - (731.4 + 12000.0 * ANGLES))
    assert away.max() <= 0.5
    assert away.max() > 0.1  # the rounding is there
