"""Circles and arcs: against SciPy's geometric fit, with intervals that cover, through outliers, gaps and jumps."""

import numpy as np
import pytest
from jaxtyping import Float
from scipy.optimize import least_squares

from lgprjax.tuning import NotExcitedError
from lgprjax.tuning.arcs import HUBER, Stretches, StretchRules, find_stretches, fit_arcs, fit_circles, serial_memory
from lgprjax.tuning.robust import student_95
from lgprjax.vehicle.sensors import DriveSignals
from refusals import refused
from turning_drives import (
    RATIO,
    WHEELBASE_M,
    Leg,
    Noise,
    arcs_of,
    covered_band,
    drive,
    gauss_markov,
    measured,
    palm_legs,
)

DRAWS = 800
SHAPES = {
    "half circle": (8.0, np.pi, 100),
    "eighth": (-20.0, 0.8, 100),
    "line": (1e9, 1e-8, 60),
    "loop": (6.0, 9.0, 200),
}


def arc_points(radius_m: float, turned_rad: float, count: int) -> Float[np.ndarray, "2 record"]:
    turned = np.linspace(0.0, turned_rad, count)
    return np.stack([abs(radius_m) * np.sin(turned), 2.0 * radius_m * np.sin(turned / 2.0) ** 2])


def rotated(points: Float[np.ndarray, "2 record"], by_rad: float) -> Float[np.ndarray, "2 record"]:
    turn = np.array([[np.cos(by_rad), -np.sin(by_rad)], [np.sin(by_rad), np.cos(by_rad)]])
    return np.asarray(turn @ points)


def held(signals: DriveSignals) -> Stretches:
    assert signals.potentiometer_v is not None
    return find_stretches(signals, signals.potentiometer_v)


def test_circle_is_scipys_huber_fit() -> None:
    rng = np.random.default_rng(1)
    points = rotated(arc_points(12.0, 1.1, 80), 2.0) + rng.normal(size=(2, 80)) * 0.02 + 40.0
    points[:, 7] += 0.15
    circle = fit_circles(points[:1], points[1:], np.ones((1, 80), dtype=bool))

    def distances(numbers: Float[np.ndarray, "3"]) -> Float[np.ndarray, " record"]:
        return np.asarray(np.hypot(points[0] - numbers[0], points[1] - numbers[1]) - numbers[2])

    start = np.array([40.0, 40.0, 10.0])
    limit = HUBER * float(circle.scatter_m[0])
    other = least_squares(distances, start, loss="huber", f_scale=limit, xtol=1e-14, ftol=1e-14, gtol=1e-14)
    assert abs(circle.curvature_radpm[0] - 1.0 / other.x[2]) < 2e-6
    assert circle.used[0].sum() == 80


@pytest.mark.parametrize(("shape", "outliers"), [("half circle", 0.03), ("eighth", 0.0), ("line", 0.03), ("loop", 0.0)])
def test_curvature_interval_covers(shape: str, outliers: float) -> None:
    radius, turned, count = SHAPES[shape]
    rng = np.random.default_rng(2)
    clean = arc_points(radius, turned, count)
    noisy = clean[:, None, :] + rng.normal(size=(2, DRAWS, count)) * 0.02
    noisy += (rng.random((DRAWS, count)) < outliers) * rng.normal(size=(2, DRAWS, count)) * 3.0
    circles = fit_circles(noisy[0], noisy[1], np.ones((DRAWS, count), dtype=bool))
    half = student_95(count - 3.0) * np.sqrt(circles.covariance[:, 2, 2])
    covered = np.mean(np.abs(circles.curvature_radpm - 1.0 / radius) <= half)
    low, high = covered_band(DRAWS)
    assert low <= covered <= high


def test_memory_of_residuals_is_that_of_the_process() -> None:
    rng, keep = np.random.default_rng(3), 0.8
    series = np.stack([gauss_markov(rng, 400, keep) for _ in range(30)])
    every = np.ones(series.shape, dtype=bool)
    assert serial_memory(series, every, 0) == pytest.approx((1 + keep) / (1 - keep), rel=0.12)
    assert serial_memory(rng.normal(size=(30, 400)), every, 0) == 1.0


def test_interval_of_positions_that_repeat() -> None:
    """Each fix held over four records: as many records say as much as a quarter of them."""
    legs = palm_legs()
    clean = drive(legs)
    wrong = []
    for seed in range(30):
        rng = np.random.default_rng(seed)
        noise = np.repeat(rng.normal(size=(2, len(clean.time_s) // 4 + 1)), 4, axis=1)[:, : len(clean.time_s)] * 0.02
        arcs = fit_arcs(
            clean._replace(east_m=clean.east_m + noise[0], north_m=clean.north_m + noise[1]),
            held(clean),
        )
        assert arcs.memory > 2.5
        bend = np.array([np.tan(leg.front_rad) + np.tan(RATIO * leg.front_rad) for leg in legs]) / WHEELBASE_M
        truth = bend * np.cos([RATIO * leg.front_rad for leg in legs])
        wrong.append((arcs.curvature_radpm - truth) / arcs.sigma_radpm)
    assert 0.85 < np.std(wrong) < 1.15


def test_arcs_of_a_palm_tree_are_those_of_the_geometry() -> None:
    legs = palm_legs()
    clean = drive(legs)
    arcs = arcs_of(clean)
    front = np.array([leg.front_rad for leg in legs])
    bend = (np.tan(front) + np.tan(RATIO * front)) / WHEELBASE_M
    np.testing.assert_allclose(arcs.curvature_radpm, bend * np.cos(RATIO * front), atol=2e-7)
    np.testing.assert_allclose(arcs.slip_rad, -RATIO * front, atol=2e-6)
    np.testing.assert_array_equal(arcs.stretches.sense, [1.0, -1.0] * 11)
    np.testing.assert_array_equal(arcs.stretches.setting, np.repeat(np.arange(11), 2))
    axle_mps = 1.5 / np.cos(RATIO * front)
    np.testing.assert_allclose(arcs.speed_mps, axle_mps, rtol=1e-3)


def test_gap_jump_and_short_way_are_dropped_and_counted() -> None:
    clean = measured(drive([*palm_legs(), Leg(0.3, 1.5, 1.0)]), Noise(), np.random.default_rng(4))
    stretches = held(clean)
    assert stretches.dropped == {"short": 1}
    assert len(stretches.start) == 22
    # The positions jump by a metre in the middle of the fifth stretch; the sixth loses a second, the seventh four.
    middle = (stretches.start + stretches.stop) // 2
    after = np.arange(len(clean.time_s))
    jumped = (after >= middle[4]) & (after < stretches.stop[4])
    east = clean.east_m + 1.0 * jumped
    east[middle[5] : middle[5] + 10] = np.nan
    east[middle[6] - 20 : middle[6] + 20] = np.nan
    broken = clean._replace(east_m=east)
    arcs = fit_arcs(broken, held(broken))
    assert arcs.stretches.dropped == {"short": 1, "positions not on one arc": 1}
    assert len(arcs.curvature_radpm) == 22  # one less for the jump, one more for the gap


def test_spikes_of_the_steering_signal_end_no_stretch() -> None:
    clean = measured(drive(palm_legs()), Noise(), np.random.default_rng(5))
    rng = np.random.default_rng(6)
    assert clean.potentiometer_v is not None
    spiked = clean.potentiometer_v + (rng.random(len(clean.time_s)) < 0.02) * rng.normal(size=len(clean.time_s))
    whole, through = held(clean), find_stretches(clean, spiked)
    assert len(through.start) == len(whole.start)
    np.testing.assert_allclose(through.steering, whole.steering, atol=0.003)


def test_a_drive_without_held_steering_is_refused() -> None:
    clean = drive([Leg(0.0, 40.0, 2.0)])
    weave = 0.3 * np.sin(clean.time_s)
    with refused("steering", 3, 12, error=NotExcitedError):
        find_stretches(clean, weave)
    with refused("steering", 50, error=NotExcitedError, found=1):
        find_stretches(clean, np.zeros(len(clean.time_s)), StretchRules(least_length_m=50.0))
    with refused("drive", 12, error=NotExcitedError, found=0):
        find_stretches(clean, np.full(len(clean.time_s), np.nan))
