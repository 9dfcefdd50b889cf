"""Metrics: those summed on the way are NumPy's of the trajectory."""

import jax.numpy as jnp
import numpy as np

from lgprjax.vehicle import RolloutSpec, ideal_servo, path_from_curvature, roll_out_traced
from lgprjax.vehicle.metrics import finish_metrics, init_metrics, step_metrics
from rollout_lanes import begin, chassis, one_lane


def test_metrics_are_those_of_the_trace() -> None:
    path = path_from_curvature(0.06 * np.sin(np.arange(600) / 30.0))
    servo = ideal_servo(0.4, 0.3)._replace(dead_band_rad=jnp.float32(0.01))
    lane = one_lane(5.0, 4.0, servo=servo, true=chassis(largest_rad=0.15))
    spec = RolloutSpec(500, tolerance_m=0.2, tail_m=25.0)
    _, found, trace = roll_out_traced(spec, path, lane, begin(path, lane, 1.5))
    offset, wheel = np.asarray(trace.offset_m, np.float64), np.asarray(trace.front_rad, np.float64)
    way = 0.2 * np.arange(1, 501)
    np.testing.assert_allclose(found.rms_m, np.sqrt(np.mean(offset**2)), rtol=1e-5)
    np.testing.assert_allclose(found.largest_m, np.abs(offset).max(), rtol=1e-6)
    np.testing.assert_allclose(found.settling_m, way[np.abs(offset) > 0.2].max(), rtol=1e-5)
    tail = offset[500 - 125 :]
    np.testing.assert_allclose(found.cycle_m, 0.5 * np.ptp(tail), rtol=1e-4)
    np.testing.assert_allclose(found.effort_radpm, np.abs(np.diff(wheel, prepend=0.0)).sum() / 100.0, rtol=1e-4)
    np.testing.assert_allclose(found.unreachable_share, np.mean(~np.asarray(trace.reachable)), rtol=1e-5)
    assert 0.0 < float(found.unreachable_share) < 1.0


def test_error_that_is_no_number_never_settles() -> None:
    one = jnp.float32(1.0)
    sums = step_metrics(
        init_metrics(one), jnp.float32(jnp.nan), 7.0 * one, jnp.bool_(True), one, jnp.bool_(True), tolerance_m=0.1
    )
    metrics = finish_metrics(sums, 1, 7.0 * one)
    assert float(metrics.settling_m) == 7.0
    assert np.isnan(float(metrics.rms_m))
