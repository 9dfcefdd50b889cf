"""Intervals of calibrations hold what they are of in 93 to 97 % of two thousand draws."""

import numpy as np
import pytest

from turning_drives import Noise, covered_band
from validation.vehicles.intervals import (
    LINE_CASES,
    WANDERING,
    band_shares,
    encoder_shares,
    line_shares,
    noise_shares,
    pedal_shares,
    ratio_shares,
    yaw_gain_shares,
)

DRAWS = 2000
LOW, HIGH = covered_band(DRAWS)


def test_encoder() -> None:
    shares, lines = encoder_shares(DRAWS, spike_share=0.0)
    assert all(LOW <= share <= HIGH for share in shares.values()), shares
    assert lines > 0.99


@pytest.mark.parametrize("outliers", [0.0, 0.03])
def test_pedals(outliers: float) -> None:
    shares = pedal_shares(DRAWS, outliers)
    assert ((shares >= LOW) & (shares <= HIGH)).all(), shares


def test_band_of_the_steering_map() -> None:
    shares, worst = band_shares(DRAWS)
    assert np.all((shares >= LOW) & (shares <= HIGH))
    assert worst <= 0.2


@pytest.mark.parametrize("noise", [Noise(), WANDERING], ids=["white", "wandering"])
def test_rear_ratio_by_heading(noise: Noise) -> None:
    share, _ = ratio_shares(DRAWS, noise)
    assert LOW <= share <= HIGH


def test_characteristic_speed() -> None:
    share, worst = yaw_gain_shares(DRAWS, Noise(front_rad=np.radians(0.1)))
    assert LOW <= share <= HIGH
    assert worst < 0.05


@pytest.mark.parametrize("name", LINE_CASES)
def test_robust_lines(name: str) -> None:
    shares = line_shares(name, DRAWS)
    assert ((shares >= LOW) & (shares <= HIGH)).all(), shares


def test_noises_of_the_filter() -> None:
    shares, told = noise_shares(200)
    assert told > 0.9
    assert np.all(shares > 0.88)
    assert 0.92 < shares.mean() < 0.98
