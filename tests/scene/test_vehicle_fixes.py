"""Fixes drawn from an error model: where the array is, wrong by what the model says, and none where it has none."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.scene.motion import drive_turns
from lgprjax.scene.sensors import FixErrors
from lgprjax.scene.vehicle_drive import DriveTruth, TrueVehicle, VehicleFixes, draw_vehicle_fixes, drive_manoeuvre

ARRAY_X_M, EVERY = 6.2, 10


@pytest.fixture(scope="module")
def truth() -> DriveTruth:
    return drive_manoeuvre(TrueVehicle(), drive_turns([2.0, 4.0], [0.2, -0.15], hold_s=60.0))


def _errors(sigma: float, lost_m: float) -> FixErrors:
    def row(*values: float) -> jnp.ndarray:
        return jnp.asarray(values, jnp.float32) * sigma

    return FixErrors(
        slow_sigma=row(0.02, 0.03, 0.003),
        slow_m=jnp.float32(2.0),
        white_sigma=row(0.03, 0.01, 0.004),
        bias=row(0.05, -0.02, 0.01),
        reported_sigma=jnp.asarray([0.04, 0.02, 0.005], jnp.float32),
        found_m=jnp.float32(6.0),
        lost_m=jnp.float32(lost_m),
        strength=jnp.float32(0.8),
        p_false=jnp.float32(1e-9),
    )


def _draw(truth: DriveTruth, errors: FixErrors, seed: int = 3) -> VehicleFixes:
    return draw_vehicle_fixes(truth, errors, array_x_m=ARRAY_X_M, rate_hz=10.0, seed=seed)


def _array_centre(truth: DriveTruth) -> np.ndarray:
    yaw = truth.yaw_rad[::EVERY]
    east = truth.east_m[::EVERY] + ARRAY_X_M * np.cos(yaw)
    return np.stack([east, truth.north_m[::EVERY] + ARRAY_X_M * np.sin(yaw), yaw], axis=1)


@pytest.mark.parametrize("rate_hz", [60.0, 200.0])
def test_a_rate_that_the_simulation_has_not_is_refused(truth: DriveTruth, rate_hz: float) -> None:
    with pytest.raises(ValueError, match=f"rate_hz.*{rate_hz:g}"):
        draw_vehicle_fixes(truth, _errors(0.0, 1e-9), array_x_m=ARRAY_X_M, rate_hz=rate_hz, seed=3)


def test_without_errors_a_fix_is_the_array_centre(truth: DriveTruth) -> None:
    fixes = _draw(truth, _errors(0.0, 1e-9)._replace(found_m=jnp.float32(1e9)))
    np.testing.assert_allclose(fixes.time_s, truth.time_s[::EVERY])
    assert fixes.found.all()
    np.testing.assert_allclose(fixes.pose[:, [0, 1, 3]], _array_centre(truth), atol=1e-9)


def test_errors_are_along_and_across_and_so_is_their_covariance(truth: DriveTruth) -> None:
    fixes = _draw(truth, _errors(1.0, 2.0))
    assert fixes.found.mean() == pytest.approx(0.75, abs=0.1)
    assert np.isnan(fixes.pose[~fixes.found]).all()
    assert np.isnan(fixes.covariance[~fixes.found]).all()
    at = _array_centre(truth)[fixes.found]
    pose = fixes.pose[fixes.found]
    away = pose[:, :2] - at[:, :2]
    cos, sin = np.cos(at[:, 2]), np.sin(at[:, 2])
    along, across = cos * away[:, 0] + sin * away[:, 1], cos * away[:, 1] - sin * away[:, 0]
    turned = pose[:, 3] - at[:, 2]
    for error, bias, sigma in (
        (along, 0.05, np.hypot(0.02, 0.03)),
        (across, -0.02, np.hypot(0.03, 0.01)),
        (turned, 0.01, 0.005),
    ):
        assert error.mean() == pytest.approx(bias, abs=0.25 * sigma)
        assert error.std() == pytest.approx(sigma, rel=0.1)
    # A fix's own sigmas are those along its heading and across it.
    here = np.stack([np.cos(pose[:, 3]), np.sin(pose[:, 3])], axis=1)
    level = fixes.covariance[fixes.found][:, :2, :2]
    np.testing.assert_allclose(np.einsum("ni,nij,nj->n", here, level, here), 0.04**2, rtol=1e-5)
    np.testing.assert_allclose(np.linalg.det(level), (0.04 * 0.02) ** 2, rtol=1e-5)
    assert fixes.sigma_m == pytest.approx((0.04, 0.02))


def test_another_seed_is_another_draw(truth: DriveTruth) -> None:
    errors = _errors(1.0, 2.0)
    one, same, other = (_draw(truth, errors, seed) for seed in (1, 1, 2))
    np.testing.assert_array_equal(one.pose, same.pose)
    assert (one.found != other.found).any()
