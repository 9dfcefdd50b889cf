"""Random fields against sums written out, and the same on both sides of the device."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.scene.ground import constant_field, device_value_at, draw_field, draw_wave_vectors, field_about, value_at

FIELD = draw_field(np.random.default_rng(3), rms=0.2, wavelength_m=(0.3, 10.0), waves=24, mean=1.5)
PLACES = np.random.default_rng(4).uniform(-500.0, 500.0, (20_000, 2))


def test_a_field_is_the_sum_of_its_waves() -> None:
    place = np.array([3.7, -1.2])
    expected = 1.5
    for size, (along, cross), phase in zip(FIELD.amplitude, FIELD.wave_rad_per_m, FIELD.phase_rad, strict=True):
        expected += size * np.sin(along * 3.7 + cross * -1.2 + phase)
    assert value_at(FIELD, place) == pytest.approx(expected, abs=1e-12)
    assert value_at(constant_field(0.7, 5), place) == 0.7


def test_a_field_has_the_mean_rms_and_wavelengths_asked_for() -> None:
    values = value_at(FIELD, PLACES)
    assert values.mean() == pytest.approx(1.5, abs=0.01)
    assert values.std() == pytest.approx(0.2, rel=0.03)
    wavelength_m = 2 * np.pi / np.linalg.norm(FIELD.wave_rad_per_m, axis=1)
    assert 0.3 <= wavelength_m.min() < 1.0
    assert 5.0 < wavelength_m.max() <= 10.0


def test_an_octave_of_longer_waves_is_higher_by_the_root_of_two() -> None:
    wavelength_m = 2 * np.pi / np.linalg.norm(FIELD.wave_rad_per_m, axis=1)
    slope = np.polyfit(np.log(wavelength_m), np.log(FIELD.amplitude), 1)[0]
    assert slope == pytest.approx(0.5, abs=1e-6)


def test_directions_leave_none_out() -> None:
    wave, wavelength_m = draw_wave_vectors(np.random.default_rng(1), 4000, (0.3, 10.0), None)
    angle = np.arctan2(wave[:, 1], wave[:, 0])
    assert np.abs(np.exp(1j * angle).mean()) < 0.05
    assert np.abs(np.exp(2j * angle).mean()) < 0.05
    assert np.median(np.log(wavelength_m)) == pytest.approx(0.5 * np.log(0.3 * 10.0), abs=0.1)


def test_a_repeated_field_is_the_same_a_length_on_and_not_in_between() -> None:
    field = draw_field(np.random.default_rng(5), rms=1.0, wavelength_m=(0.3, 10.0), waves=24, repeat_m=7.0)
    here = value_at(field, PLACES[:500])
    np.testing.assert_allclose(value_at(field, PLACES[:500] + [21.0, 0.0]), here, atol=1e-9)
    assert np.abs(value_at(field, PLACES[:500] + [3.5, 0.0]) - here).max() > 1.0


def test_about_an_origin_far_away_float32_still_resolves_it() -> None:
    origin = np.array([7_000.3, 1.1])
    near = np.random.default_rng(6).uniform(-4.0, 4.0, (64, 2))
    moved = field_about(FIELD, origin)
    assert all(np.asarray(part).dtype == np.float32 for part in moved)
    found = device_value_at(moved, jnp.asarray(near, jnp.float32))
    np.testing.assert_allclose(found, value_at(FIELD, near + origin), atol=2e-5)
