"""Travel from positions: less noise than theirs, the rest told, and neither motion nor jumps smoothed away."""

from pathlib import Path

import numpy as np
import pytest

from drawn_travel import draw
from formats.mcap_sample import rover_messages
from formats.segy_sample import write_segy
from formats.test_mcap_import import _imported
from lgprjax.formats import DriveLog, SurveyOrigin, assumed_of, import_segy
from lgprjax.formats.travel import mend_travel, smoothed_travel

_SECONDS = 300.0


def _true_m(time_s: np.ndarray, kind: str) -> np.ndarray:
    """A steady drive, or stops and starts at half a metre per second squared with reverse driving between."""
    fine_s = np.arange(0.0, _SECONDS + 1.0, 0.01)
    if kind == "steady":
        speed = 1.5 + 0.3 * np.sin(fine_s / 7.0)
    else:
        speed = np.clip(3.0 * np.sin(2.0 * np.pi * fine_s / 40.0), -1.0 if kind == "reverse" else 0.0, 2.0)
    return np.asarray(np.interp(time_s, fine_s, 0.01 * np.cumsum(speed)))


def _rms(error_m: np.ndarray) -> float:
    return float(np.sqrt(np.mean(error_m**2)))


def _errors(found_m: np.ndarray, true_m: np.ndarray) -> tuple[float, float]:
    """Of a step, and of 10 m, root mean square."""
    error_m = found_m - true_m
    start = np.arange(len(true_m))
    stop = start + np.array([int(np.argmax(np.abs(true_m[i:] - true_m[i]) >= 10.0)) for i in start])
    start, stop = start[stop > start], stop[stop > start]
    return _rms(np.diff(error_m)), _rms(error_m[stop] - error_m[start])


@pytest.mark.parametrize("kind", ["steady", "stops", "reverse"])
@pytest.mark.parametrize("rate_hz", [1.0, 5.0, 10.0])
@pytest.mark.parametrize("noise_m", [0.005, 0.02, 0.05])
def test_errors_are_within_what_is_told(kind: str, rate_hz: float, noise_m: float) -> None:
    time_s = np.arange(0.0, _SECONDS, 1.0 / rate_hz)
    true_m = _true_m(time_s, kind)
    before, after, told = [], [], []
    for seed in range(3):
        raw_m = true_m + noise_m * np.random.default_rng(seed).standard_normal(len(time_s))
        found = smoothed_travel(time_s, raw_m)
        before.append(_errors(raw_m, true_m))
        after.append(_errors(found.distance_m, true_m))
        told.append((found.step_sigma_m, found.span_sigma_m))
    (step_m, span_m), (raw_step_m, raw_span_m), (told_step_m, told_span_m) = (
        np.sqrt(np.mean(np.square(each), axis=0)) for each in (after, before, told)
    )
    assert step_m <= 1.2 * told_step_m
    assert span_m <= 1.2 * told_span_m
    assert step_m <= 1.02 * raw_step_m
    assert span_m <= 1.02 * raw_span_m
    if rate_hz >= 5.0 and noise_m >= 0.02:
        assert step_m < 0.25 * raw_step_m
        assert told_step_m < 2.5 * step_m
        assert told_span_m < 1.5 * span_m


@pytest.mark.parametrize("kind", ["steady", "stops", "reverse"])
@pytest.mark.parametrize("rate_hz", [1.0, 10.0, 100.0])
def test_exact_positions_stay_as_they_are(kind: str, rate_hz: float) -> None:
    time_s = np.arange(0.0, 60.0, 1.0 / rate_hz)
    true_m = _true_m(time_s, kind)
    np.testing.assert_allclose(smoothed_travel(time_s, true_m).distance_m, true_m, atol=1e-4)


def test_steps_of_speed_without_noise_stay_as_they_are() -> None:
    speed = np.repeat([0.0, 0.05, 0.0, -0.05, 0.1], [6, 20, 8, 15, 40])
    travel_m = np.concatenate([[0.0], np.cumsum(speed)])
    smooth_m = smoothed_travel(np.arange(90.0) / 126.0, travel_m).distance_m
    np.testing.assert_allclose(smooth_m, travel_m, atol=1e-7)


def test_jumps_stay_jumps() -> None:
    """What detects them later finds them as in the record: they are not drawn out over the neighbours."""
    found = 0
    for seed in range(12):
        drive = draw(31_000 + seed, jumps=True)
        jumps = mend_travel(drive.time_s, drive.distance_m)
        smooth = mend_travel(drive.time_s, smoothed_travel(drive.time_s, drive.distance_m).distance_m)
        assert len(smooth.bridged) + len(smooth.broken) >= len(jumps.bridged) + len(jumps.broken), seed
        found += len(jumps.bridged) + len(jumps.broken)
    assert found > 4


def test_uneven_times_short_records_and_stands() -> None:
    rng = np.random.default_rng(4)
    time_s = np.sort(rng.uniform(0.0, _SECONDS, 2000))
    true_m = _true_m(time_s, "stops")
    found = smoothed_travel(time_s, true_m + 0.02 * rng.standard_normal(2000))
    assert _rms(np.diff(found.distance_m - true_m)) <= min(1.2 * found.step_sigma_m, 0.012)
    short = smoothed_travel(np.arange(5.0), np.arange(5.0))
    np.testing.assert_array_equal(short.distance_m, np.arange(5.0))
    assert np.isnan(short.step_sigma_m)
    stood = smoothed_travel(np.arange(50.0), 0.02 * rng.standard_normal(50))
    assert np.abs(np.diff(stood.distance_m)).max() < 0.01
    np.testing.assert_array_equal(smoothed_travel(np.arange(50.0), np.zeros(50)).distance_m, 0.0)


def test_a_drive_log_tells_the_noise_of_its_travel(tmp_path: Path) -> None:
    messages = [each for each in rover_messages(600) if each[0] != "/rover/odom"]
    rng = np.random.default_rng(3)
    noisy = [
        (*each[:3], each[3] | {"latitude": each[3]["latitude"] + 0.02 * rng.standard_normal() / 111_000.0})
        if each[0] == "/rover/gps"
        else each
        for each in messages
    ]
    log, _ = _imported(tmp_path, noisy)
    with log:
        odometry, told = log.description.odometry, assumed_of(log.description.provenance)["odometry"]
    assert _rms(np.diff(odometry.distance_m - odometry.time_s)) < 0.004
    assert "cm a step" in told
    assert "over 10 m" in told


def test_noise_of_header_coordinates_adds_no_length(tmp_path: Path) -> None:
    """A centimetre of noise at steps of two: the path of the places is much longer than the line."""
    rng = np.random.default_rng(6)
    count = 400
    along = 0.02 * np.arange(count) + 0.01 * rng.standard_normal(count)
    across = 0.01 * rng.standard_normal(count)
    headers = {71: -1000, 73: np.rint(1000 * (360e3 + along)), 77: np.rint(1000 * (511e3 + across)), 89: 1}
    path = write_segy(tmp_path / "a.sgy", rng.integers(-9000, 9000, (count, 16)), headers=headers)
    import_segy(path, utm_zone="33N", place=SurveyOrigin(0.0, 0.0, 90.0), output=tmp_path / "a.drive.h5")
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        travel_m = log.description.odometry.distance_m
    assert np.hypot(np.diff(along), np.diff(across)).sum() > 10.0
    assert travel_m[-1] == pytest.approx(0.02 * (count - 1), rel=0.02)
    assert np.all(np.diff(travel_m) >= 0.0)
