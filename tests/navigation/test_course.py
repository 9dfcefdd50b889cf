"""A course over ground is the heading only at the point without slip, and is turned into it anywhere else."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation import FilterModel, course_observation, default_model
from lgprjax.vehicle import Chassis, ProportionalRear, VehiclePose, body_point, drive_arc, turn_of, zero_slip_point

STEP_S = 1.0 / 21.0
f32 = jnp.float32


@pytest.fixture(scope="module")
def model() -> FilterModel:
    return default_model(zero_slip_m=1.4, gnss_x_m=0.8, gnss_y_m=0.3, array_x_m=6.0, array_y_m=-0.1)


@pytest.mark.parametrize("speed", [4.47, -2.0])
def test_a_course_is_the_heading_only_where_nothing_slips(speed: float) -> None:
    """Courses of points of the body on the exact circle of a counter-steered vehicle."""
    chassis = Chassis(f32(3.8), f32(6.5), ProportionalRear(f32(0.63)), f32(0.5), f32(jnp.inf))
    front = f32(0.1)
    turn = turn_of(chassis, front)
    zero_slip = float(zero_slip_point(chassis, front))
    curvature = float(turn.curvature_radpm)
    model = default_model(zero_slip_m=zero_slip, gnss_x_m=0.0, gnss_y_m=0.0, array_x_m=6.0, array_y_m=0.0)
    at = VehiclePose(f32(0.0), f32(0.0), f32(0.4))
    for ahead in (zero_slip, 0.0, 5.0):
        # A short way to either side of the pose: the chord runs along the course there.
        before, after = (body_point(drive_arc(at, f32(way), turn), f32(ahead)) for way in (-speed * 0.1, speed * 0.1))
        course = float(jnp.arctan2(after[1] - before[1], after[0] - before[0]))
        backwards = np.pi if speed < 0.0 else 0.0
        off = np.angle(np.exp(1j * (course - backwards - 0.4)))
        assert off == pytest.approx(np.arctan((ahead - zero_slip) * curvature), abs=2e-5)
        if ahead == 0.0:
            assert abs(off) > 0.06  # 3.6 degrees wrong if it were taken for the heading
        heading = course_observation(model, f32(course), f32(ahead), f32(speed), f32(curvature * speed), f32(1e-4))
        assert np.angle(np.exp(1j * (float(heading.yaw_rad) - 0.4))) == pytest.approx(0.0, abs=2e-5)
        assert bool(heading.valid)


@pytest.mark.parametrize(("speed", "rate", "valid"), [(0.9, 0.0, False), (1.1, 0.0, True), (4.0, 0.21, False)])
def test_a_slow_or_tight_course_is_no_heading(model: FilterModel, speed: float, rate: float, valid: bool) -> None:
    heading = course_observation(model, f32(0.1), f32(0.0), f32(speed), f32(rate), f32(1e-4))
    assert bool(heading.valid) is valid
