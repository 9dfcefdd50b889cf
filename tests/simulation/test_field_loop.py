"""Fields in closed loop: lines followed, GNSS gone and back, the threshold's swing and its cure; NEES by NumPy."""

import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.autopilot import pad_fence
from lgprjax.simulation.field_loop import (
    PIDS,
    THRESHOLD_MPS,
    FieldMoment,
    made_up_field_world,
    made_up_tool,
    rectangle_course,
    threshold_world,
)
from lgprjax.tuning import find_limit_cycle, fit_threshold
from simulation.field_drives import FAR, INCH_M, driven, errors, mean_nees, rms, settings


def test_a_fix_that_comes_after_the_next_was_measured_is_refused() -> None:
    world = made_up_field_world()
    world = world._replace(sensors=world.sensors._replace(gnss_ticks=jnp.int32(10), late_ticks=jnp.int32(12)))
    course = rectangle_course(12.0, 6.0, settings(), made_up_tool())
    with pytest.raises(ValueError, match=r"late_ticks.* 10.* 12"):
        driven(world, course, FAR)


@pytest.fixture(scope="module")
def small_field() -> FieldMoment:
    """12 x 6 m with GNSS off 30 s of every 90 s."""
    course = rectangle_course(12.0, 6.0, settings(), made_up_tool())
    return driven(made_up_field_world(off_s=30.0), course, course.fence)


def test_a_field_is_worked_to_its_end_with_gnss_off_a_third_of_the_time(small_field: FieldMoment) -> None:
    assert not small_field.stopping.any()
    assert (small_field.limited & 256 == 0).all()
    worked = small_field.engaged & ~small_field.done
    on_line = worked & (small_field.line >= 0)
    assert set(small_field.line[:, 0]) == set(range(-1, 6))
    assert small_field.done[-1].all()
    assert (worked & ~small_field.heard).sum() > 300
    assert rms(small_field.cross_m[on_line & small_field.heard]) < INCH_M
    assert rms(errors(small_field)[worked & small_field.heard][:, :2].sum(axis=-1) / 2**0.5) < INCH_M
    assert np.degrees(np.abs(errors(small_field)[worked][:, 2])).max() < 1.0
    assert 0.3 < mean_nees(small_field, worked) < 2.0
    # On along lines and nowhere else.
    np.testing.assert_array_equal(small_field.tool[worked] == 1.0, (small_field.line >= 0)[worked])
    assert (small_field.tool[~small_field.engaged] == 0.0).all()


def test_the_threshold_makes_it_swing_and_its_log_tells() -> None:
    # A route of the same ladder as the small field's: nothing compiles anew.
    line = rectangle_course(110.0, 1.2, settings(), made_up_tool())
    assert line.route.rows.shape == rectangle_course(12.0, 6.0, settings(), made_up_tool()).route.rows.shape
    world = threshold_world(PIDS["P 3, D 2"], threshold_mps=THRESHOLD_MPS, believed_mps=0.0)
    swinging = driven(world, line, FAR)
    late = (swinging.line[:, 0] >= 0) & (swinging.to_go_m[:, 0] < 90.0) & ~swinging.done[:, 0]
    time_s = 0.1 * np.arange(len(late))[late]
    found = find_limit_cycle(time_s, np.asarray(swinging.cross_m[late, 0], np.float64))
    assert found.found
    assert 14.0 * INCH_M <= found.peak_to_peak_m <= 22.0 * INCH_M
    told = fit_threshold(
        time_s,
        np.asarray(swinging.believed.yaw_rad[late, 0], np.float64),
        np.asarray(swinging.turn_mps[late, 0], np.float64),
    )
    assert told.found
    assert told.threshold_mps.low <= THRESHOLD_MPS <= told.threshold_mps.high
    assert told.threshold_mps.value == pytest.approx(THRESHOLD_MPS, rel=0.1)


def test_a_fence_on_the_way_stops_the_vehicle_before_it() -> None:
    course = rectangle_course(12.0, 6.0, settings(), made_up_tool())
    wall = pad_fence(np.array([[-20.0, -20.0], [8.0, -20.0], [8.0, 30.0], [-20.0, 30.0]]))
    kept = driven(made_up_field_world(off_s=30.0), course, wall)
    assert kept.edge[-1].all()
    front = kept.x_m + 1.35 * np.cos(kept.yaw_rad) + 0.6 * np.abs(np.sin(kept.yaw_rad))
    assert front.max() < 8.0
    assert front[-1].min() > 7.0
    assert (kept.tool[kept.stopping & kept.engaged] == 0.0)[5:].all()
    assert np.abs(kept.speed_mps[-1]).max() < 1e-3
