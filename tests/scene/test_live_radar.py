"""A radar that learns the way as it is driven records what a drive planned beforehand records."""

from dataclasses import replace

import numpy as np
import pytest

from lgprjax.radar import ArrayGeometry, uniform_array
from lgprjax.scene import (
    WEATHER,
    Day,
    DrivePlan,
    Ground,
    LiveRadar,
    ReceiverFaults,
    Road,
    RoadConfig,
    SimulatedDrive,
    Springs,
    SweepPlan,
    draw_springs,
    iterate_sweeps,
    make_ground,
    make_road,
    render_drive,
    simulate_drive,
)
from lgprjax.scene.motion import place_on_road, plan_motion, poses_at
from lgprjax.simulation import describe_sweeps
from scene.short_drives import SPARSE

_ROAD = RoadConfig(
    length_m=60.0,
    arcs=((30.0, 0.02), (30.0, -0.03)),
    min_radius_m=30.0,
    transition_m=8.0,
    grade_rms=0.03,
    bank_rms_rad=0.02,
    roughness_rms_m=0.003,
)
_NUMBER = 40
_PLAN = DrivePlan(5.0, 30.0, speed_mps=4.4, scan_rate_hz=42.0, lane_m=0.2)


def test_same_bytes_as_a_planned_drive() -> None:
    """On its way back."""
    ground, road, day, array = _scene()
    plan = replace(_PLAN, direction=-1)
    drive = simulate_drive(ground, plan, day, 5, road=road, array=array)
    motion = plan_motion(plan, 5, road)
    count = round(motion.duration_s * plan.scan_rate_hz - 0.5) + 1
    live = LiveRadar(ground, day, road, array, Springs(motion.height, motion.roll), scans=count, seed=5)
    at, instants = _moment(drive, array)
    along = float(place_on_road(motion, instants)[0].mean()) - 4.0
    found = live.record(_NUMBER, poses_at(motion, instants)[..., [0, 1, 3]], along, -1)
    assert found.received.all()
    difference = np.abs(found.recorded.astype(int) - render_drive(drive)[at : at + 3].astype(int))
    # Another origin of the block rounds otherwise: a count here and there.
    assert difference.max() <= 1
    assert np.mean(difference > 0) < 0.02
    assert found.roll_rad == pytest.approx(drive.pose[at : at + 3, 4], abs=1e-9)


def test_sweeps_are_those_of_a_planned_drive_but_for_rounding() -> None:
    """The calibration channel comes last, in units of the converter's counts."""
    ground, road, day, array = _scene()
    sweeps, faults = SweepPlan(steps=21), ReceiverFaults(gain_drift=0.2, phase_drift_rad=0.5)
    drive = simulate_drive(ground, _PLAN, day, 5, road=road, array=array, faults=faults)
    motion = plan_motion(_PLAN, 5, road)
    count = round(motion.duration_s * _PLAN.scan_rate_hz - 0.5) + 1
    springs = Springs(motion.height, motion.roll)
    live = LiveRadar(ground, day, road, array, springs, scans=count, seed=5, faults=faults, sweeps=sweeps)
    known = describe_sweeps(drive, sweeps)
    assert live.start is not None
    np.testing.assert_array_equal(live.start.empty, known.lookup_sweeps)
    np.testing.assert_array_equal(live.start.empty_calibration, known.lookup_calibration_sweep)
    at, instants = _moment(drive, array)
    planned, calibration = next(iterate_sweeps(drive, sweeps))
    along = float(place_on_road(motion, instants)[0].mean()) + 4.0
    found = live.record(_NUMBER, poses_at(motion, instants)[..., [0, 1, 3]], along).recorded
    wanted = np.concatenate([planned[at : at + 3], calibration[at : at + 3, None]], axis=1)
    off = np.abs(found - wanted) / sweeps.step
    assert off.max() < 1.5
    assert np.mean(off > 0.5) < 0.02


def _scene() -> tuple[Ground, Road, Day, ArrayGeometry]:
    array = uniform_array(3, 0.2, x_m=4.0, height_m=0.3, scan_period_s=1 / 126)
    return make_ground(3, replace(SPARSE, length_m=60.0)), make_road(3, _ROAD), WEATHER["clear"](7), array


def _moment(drive: SimulatedDrive, array: ArrayGeometry) -> tuple[int, np.ndarray]:
    """Scan of the drive that has the number, and the instants of its channels and of those of the next two."""
    at = int(np.flatnonzero(np.isclose(drive.scan_time_s, _NUMBER / 42.0))[0])
    return at, (_NUMBER + np.arange(3))[:, None] / 42.0 + array.time_offset_s


def test_ground_that_ends_is_an_error() -> None:
    ground, road, day, array = _scene()
    live = LiveRadar(ground, day, road, array, draw_springs(_PLAN, 1), scans=10, seed=5)
    place = np.zeros((2, 3, 3))
    place[..., 1] = 6.0  # six metres left of the road's start
    with pytest.raises(ValueError, match=f"{ground.config.half_width_m:.2f}"):
        live.record(0, place, 4.0)
