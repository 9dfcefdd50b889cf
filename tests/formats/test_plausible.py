"""Places and stamps that are none, in every format: left out, counted and said; what is right is never left out."""

import re
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from formats.mcap_sample import LATITUDE_DEG, LONGITUDE_DEG, METRE_DEG, Message, changed, rover_messages
from formats.samples import write_drive, write_dt1
from formats.segy_sample import write_segy
from formats.side_samples import cor_row, dzg_text, gga_at, gps_text
from formats.test_mcap_import import _imported
from formats.test_signal_tables import SIGNAL_MAP, columns, write_csv
from lgprjax.formats import (
    DriveLog,
    SurveyOrigin,
    VehicleLog,
    assumed_of,
    check_file,
    import_lines,
    import_segy,
    read_side_file,
)
from lgprjax.formats.plausible import ASTRAY, NO_PLACE, ZEROS, date_by_majority, plausible_positions, reach_in_time_m
from lgprjax.formats.signal_tables import import_signals
from refusals import refused

_TRACES = np.random.default_rng(3).integers(-9000, 9000, (60, 40))


# The test itself.


@settings(max_examples=200, deadline=None)
@given(
    seed=st.integers(0, 2**32 - 1),
    step_s=st.sampled_from([0.05, 0.2, 1.0, 10.0]),
    speed_mps=st.floats(0.0, 60.0),
    noise_m=st.sampled_from([0.0, 0.02, 2.0]),
    longitude_deg=st.sampled_from([7.0, 179.9999, -179.9999, 0.0]),
    latitude_deg=st.sampled_from([47.0, 0.0, -33.0, 84.0]),
)
def test_a_drive_passes_whole_and_wrong_places_do_not(
    seed: int, step_s: float, speed_mps: float, noise_m: float, longitude_deg: float, latitude_deg: float
) -> None:
    """Any path at a vehicle's speed, anywhere, also with a receiver that comes to a better fix 8 m beside."""
    rng = np.random.default_rng(seed)
    count = 200
    yaw = np.cumsum(rng.normal(0.0, 0.1, count))
    east = np.cumsum(speed_mps * step_s * np.cos(yaw)) + rng.normal(0.0, noise_m, count)
    north = (
        np.cumsum(speed_mps * step_s * np.sin(yaw)) + rng.normal(0.0, noise_m, count) + 8.0 * (np.arange(count) > 90)
    )
    latitude = latitude_deg + np.degrees(np.clip(north, -1e4, 1e4) / 6.371e6)
    longitude = longitude_deg + np.degrees(np.clip(east, -1e4, 1e4) / (6.371e6 * np.cos(np.radians(latitude_deg))))
    two_ranges = np.where(rng.random(count) < 0.5, longitude % 360.0, longitude)
    reach_m = reach_in_time_m(step_s * np.arange(count))
    judged = plausible_positions(latitude, two_ranges, reach_m)
    assert judged.left_out == {}
    np.testing.assert_allclose(np.cos(np.radians(judged.longitude_deg - longitude)), 1.0, atol=1e-12)
    assert np.abs(judged.longitude_deg).max() <= 180.0
    wrong = rng.choice(np.arange(count), 20, replace=False)
    latitude[wrong[:5]] -= np.copysign(3.0, latitude_deg)
    latitude[wrong[5:10]], longitude[wrong[5:10]] = 0.0, 0.0
    latitude[wrong[10:15]] = [91.0, np.nan, np.inf, -1e9, 1e300]
    longitude[wrong[15:]] = [361.0, np.nan, -np.inf, 4000.0, 1e300]
    judged = plausible_positions(latitude, longitude, reach_m)
    assert set(np.flatnonzero(~judged.kept)) >= {*wrong[10:]}
    assert judged.left_out[NO_PLACE] == 10
    if abs(latitude_deg) > 1.0:
        assert set(np.flatnonzero(~judged.kept)) == {*wrong}
        assert judged.left_out == {NO_PLACE: 10, ZEROS: 5, ASTRAY: 5}


def test_a_site_without_a_place_keeps_its_origin() -> None:
    """Drives without a place on the earth begin at latitude 0, longitude 0."""
    metres = np.arange(50.0)
    judged = plausible_positions(0.0 * metres, np.degrees(metres / 6.378e6), reach_in_time_m(metres))
    assert judged.left_out == {}


def test_the_greater_part_of_a_drive_is_kept() -> None:
    """A receiver that begins at its last known place, in another town."""
    latitude = np.where(np.arange(100) < 30, 48.5, 47.0) + 1e-6 * np.arange(100.0)
    judged = plausible_positions(latitude, np.full(100, 8.0), reach_in_time_m(0.1 * np.arange(100)))
    np.testing.assert_array_equal(judged.kept, np.arange(100) >= 30)


def test_a_place_that_is_repeated_counts_once() -> None:
    """Ten minutes of the last known place, another town, before the first fix."""
    latitude = np.concatenate([np.full(600, 48.5), 47.0 + 1e-5 * np.arange(60.0)])
    judged = plausible_positions(latitude, np.full(660, 8.0), reach_in_time_m(np.arange(660.0)))
    np.testing.assert_array_equal(judged.kept, np.arange(660) >= 600)


@settings(max_examples=100, deadline=None)
@given(seed=st.integers(0, 2**32 - 1), share=st.floats(0.0, 0.45), begin_s=st.floats(0.0, 86_400.0))
def test_dates_of_most_records_are_right(seed: int, share: float, begin_s: float) -> None:
    """Whatever the other dates are, and wherever the silences: times are those that made the times of day."""
    rng = np.random.default_rng(seed)
    true_s = 86_400.0 * 19_000 + begin_s + np.cumsum(rng.choice([0.2, 1.0, 20.0, 400.0], 300, p=[0.6, 0.3, 0.09, 0.01]))
    day: list[int | None] = [int(each // 86_400.0) for each in true_s]
    wrong = rng.permutation(300)[: int(300 * share)]
    for i in wrong:
        day[i] = [None, 3_657, 24_000, 11_832][int(rng.integers(0, 4))]
    # A run between silences has more right dates than wrong ones of any kind, or it follows its neighbours.
    found = date_by_majority(true_s % 86_400.0, day)
    np.testing.assert_allclose(found.time_s, true_s, atol=1e-4)
    assert sum(found.other_dates.values()) == sum(day[i] is not None for i in wrong)


# Recordings of messages.


def _moved(change: Callable[[int, dict[str, Any]], dict[str, Any]]) -> list[Message]:
    return changed(rover_messages(600), "/rover/gps", lambda n, values: values | change(n, values))


_SIGMA = {"position_covariance": [0.0] * 9}


@pytest.mark.parametrize(
    ("change", "left", "reason"),
    [
        (lambda n, _: {"latitude": 0.0, "longitude": 0.0} if n < 6 else {}, 6, ZEROS),
        (lambda n, _: {"latitude": 0.0} if n == 40 else {}, 1, ASTRAY),
        (lambda n, v: {"latitude": v["longitude"], "longitude": v["latitude"]} if n in (3, 50) else {}, 2, ASTRAY),
        (lambda n, _: {"latitude": 214.7} if n == 99 else {}, 1, NO_PLACE),
        # Faster than a vehicle this is not, but the odometer has no such travel.
        (lambda n, v: {"latitude": v["latitude"] + 42.0 * METRE_DEG} if 20 < n < 25 else {}, 4, ASTRAY),
        (lambda n, v: {"longitude": v["longitude"] - 360.0 * (n % 2)}, 0, ""),
    ],
)
def test_places_of_messages(change: Callable[..., dict[str, Any]], left: int, reason: str, tmp_path: Path) -> None:
    log, notes = _imported(tmp_path, _moved(change))
    with log:
        track = log.description.navigation
    count = sum(each[0] == "/rover/gps" for each in rover_messages(600))
    assert len(track.time_s) == count - left
    assert np.abs(track.longitude_deg - LONGITUDE_DEG).max() < 1e-3
    assert np.abs(track.latitude_deg - LATITUDE_DEG).max() < 1e-3
    assert sum(f"left out {left} of {count} positions ({left} {reason})" in note for note in notes) == bool(left)


def test_messages_of_zeros_are_refused(tmp_path: Path) -> None:
    with refused("/rover/gps", ZEROS):
        _imported(tmp_path, _moved(lambda *_: {"latitude": 0.0, "longitude": 0.0}))


def test_a_sigma_of_zero_is_unknown(tmp_path: Path) -> None:
    log, _ = _imported(tmp_path, _moved(lambda *_: {"position_covariance_type": 2, **_SIGMA}))
    with log:
        assert log.description.navigation.sigma_east_m is None
        assert assumed_of(log.description.provenance)["position sigma"] == "not recorded"
    flat = [0.04, 0.0, 0.0, 0.0, 0.04, 0.0, 0.0, 0.0, 0.0]
    log, _ = _imported(tmp_path, _moved(lambda *_: {"position_covariance_type": 2, "position_covariance": flat}))
    with log:
        assert log.description.navigation.sigma_height_m is None
        assert log.description.navigation.sigma_east_m is not None
    some = _moved(lambda n, _: {"position_covariance_type": 2, **_SIGMA} if n == 30 else {})
    with refused("/rover/gps", "--gnss-sigma-m", "1 of"):
        _imported(tmp_path, some)


@pytest.mark.parametrize(("factor", "said"), [(1.0, False), (0.8, False), (3.6, True), (0.02, True)])
def test_travel_and_positions_of_messages_are_compared(factor: float, said: bool, tmp_path: Path) -> None:
    """An odometer in kilometres per hour, or one whose wheel slips on its shaft."""

    def scaled(_: int, values: dict[str, Any]) -> dict[str, Any]:
        inner = values["pose"]["pose"]
        position = inner["position"] | {"x": factor * inner["position"]["x"]}
        return values | {"pose": values["pose"] | {"pose": inner | {"position": position}}}

    log, notes = _imported(tmp_path, changed(rover_messages(600), "/rover/odom", scaled))
    with log:
        travel_m = float(np.ptp(log.description.odometry.distance_m))
    assert travel_m == pytest.approx(30.0 * factor, rel=0.01)
    lengths = [[float(each) for each in re.findall(r"(\d+\.\d) m", note)] for note in notes]
    assert lengths == ([[pytest.approx(30.0, rel=0.01), pytest.approx(30.0 * factor, rel=0.01)]] if said else [])


def test_stamps_of_another_day_are_left_out(tmp_path: Path) -> None:
    """A computer without a battery counts from 1970 until it hears the time."""
    true = rover_messages(600)
    first = {topic: next(i for i, each in enumerate(true) if each[0] == topic) for topic in {each[0] for each in true}}

    def early(n: int, values: dict[str, Any]) -> dict[str, Any]:
        return (
            values | {"header": values["header"] | {"stamp": {"sec": 12, "nanosec": 40_000_000 * n}}}
            if n < 8
            else values
        )

    messages = true
    for topic in first:
        messages = changed(messages, topic, early)
    log, notes = _imported(tmp_path, messages)
    with log:
        # Positions begin 1.6 s late, and scans a second before them.
        assert 600 - log.scans in (12, 13)
        assert log.description.navigation.time_s[-1] < 31.0
    assert sum("8 messages of another day than the rest" in note for note in notes) == len(first)


# Drive logs.


def test_check_sees_places_that_no_vehicle_reaches(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    for name in ("latitude_deg", "longitude_deg"):
        with h5py.File(path, "r+") as store:
            store[f"/gnss_ins/{name}"][1] = 0.0
    (finding,) = check_file(path)
    assert (finding.place, finding.severity) == ("/gnss_ins", "error")
    assert ZEROS in finding.found
    assert "index 1" in finding.found


# Files beside lines, coordinates of headers, tables.


def _place(n: int) -> tuple[float, float]:
    return 46.0 + 1e-6 * n, 7.0 + 2e-6 * n


@pytest.mark.parametrize(
    ("wrong", "reason"),
    [({0: (0.0, 0.0), 7: (0.0, 0.0)}, ZEROS), ({7: (46.0, 8.0)}, ASTRAY), ({29: (44.0, 7.0)}, ASTRAY)],
)
@pytest.mark.parametrize("suffix", [".GPS", ".DZG", ".cor"])
def test_receivers_beside_a_line(
    wrong: dict[int, tuple[float, float]], reason: str, suffix: str, tmp_path: Path
) -> None:
    places = [wrong.get(n, _place(n)) for n in range(30)]
    sentences = [[gga_at(n, *place)] for n, place in enumerate(places)]
    rows = [
        cor_row(2 * n + 1, latitude=f"{abs(a)}\t{'S' if a < 0 else 'N'}", longitude=f"{b}\tE")
        for n, (a, b) in enumerate(places)
    ]
    text = {
        ".GPS": gps_text([each for pair in sentences for each in (pair, [])]),
        ".DZG": dzg_text({2 * n: each for n, each in enumerate(sentences)}),
        ".cor": "".join(rows),
    }[suffix]
    (tmp_path / f"a{suffix}").write_text(text, newline="")
    side = read_side_file(tmp_path / f"a{suffix}")
    np.testing.assert_array_equal(side.trace, [2 * n for n in range(30) if n not in wrong])
    assert side.counts[reason] == len(wrong)
    line = write_dt1(tmp_path / "a.DT1", _TRACES, step=0.1)
    survey = import_lines([line], output=tmp_path / "a.drive.h5")
    assert any(f"left out {len(wrong)} of 30 positions" in note for note in survey.notes)
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        latitude = log.description.navigation.latitude_deg
    np.testing.assert_allclose(latitude, 46.0 + 0.5e-6 * np.arange(60), atol=3e-7)


@pytest.mark.parametrize("wrong", [{20: (0.0, 0.0), 21: (0.0, 0.0)}, {5: (7.0, 46.0)}, {59: (46.0, 30.0)}])
def test_coordinates_of_headers(wrong: dict[int, tuple[float, float]], tmp_path: Path) -> None:
    places = np.array([wrong.get(n, _place(n)) for n in range(60)])
    headers = {71: -10000, 73: np.rint(places[:, 1] * 3.6e7), 77: np.rint(places[:, 0] * 3.6e7), 89: 2}
    path = write_segy(tmp_path / "a.sgy", _TRACES, headers=headers)
    notes = import_segy(path, place=SurveyOrigin(0.0, 0.0, 90.0), output=tmp_path / "a.drive.h5")
    assert any(f"left out {len(wrong)} of 60 positions" in note for note in notes)
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        track = log.description.navigation
    np.testing.assert_allclose(track.longitude_deg, 7.0 + 2e-6 * np.arange(60), atol=3e-6)


@pytest.mark.parametrize(
    ("edit", "name"),
    [
        (lambda t: t["lat"].__setitem__([3, 4], 0.0) or t["lon"].__setitem__([3, 4], 0.0), "latitude, longitude"),
        (lambda t: t["lat"].__setitem__(200, 47.0), "latitude, longitude"),
        (lambda t: t.update(lon=t["lon"] + 360.0 * (np.arange(len(t["lon"])) > 100) - 360.0), ""),
    ],
)
def test_places_of_tables(edit: Callable[[dict[str, np.ndarray]], None], name: str, tmp_path: Path) -> None:
    table = columns()
    edit(table)
    found = import_signals(write_csv(tmp_path / "a.csv", table), SIGNAL_MAP, tmp_path / "a.drive.h5")
    assert list(found.left_out) == [name] * bool(name)
    log = VehicleLog.open(tmp_path / "a.drive.h5")
    assert np.abs(log.navigation.latitude_deg - 46.0).max() < 0.01
    assert np.abs(log.navigation.longitude_deg - 11.0).max() < 0.01
