"""Stations by their stretches against a look at every station; the reach of tracks about frames against the same."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.subsurface import StationPlaces, StationPositions, stretches_of
from lgprjax.subsurface.stations import track_extents

RNG = np.random.default_rng(3)


def track(stations: int, step_m: float = 0.04, bend_m: float = 15.0, aside_m: float = 0.0) -> np.ndarray:
    """East and north along a bend."""
    angle = np.arange(stations) * step_m / bend_m
    return np.stack([(bend_m + aside_m) * np.sin(angle), (bend_m + aside_m) * (1.0 - np.cos(angle))], axis=1)


def places_of(*tracks: np.ndarray) -> StationPositions:
    place = np.concatenate(tracks)
    pose = np.zeros((len(place), 5))
    pose[:, :2] = place
    drive = np.repeat(np.arange(len(tracks)), [len(each) for each in tracks])
    return StationPositions(pose, np.arange(len(place), dtype=np.float64), drive)


# Two lanes, one with a gap of metres, and a lone station far away.
LANE = track(400)
GAPPED = np.delete(track(500, aside_m=1.0), np.arange(150, 300), axis=0)
PLACES = places_of(LANE, GAPPED, np.array([[200.0, 200.0]]))
HELD = StationPlaces.held(PLACES)


def test_stretches_hold_every_station_once_and_no_gap() -> None:
    stretches = HELD.stretches
    count = np.diff(np.append(stretches.first, len(PLACES.pose)))
    assert count.min() >= 1
    assert count.max() == 16
    assert len(stretches.first) < len(PLACES.pose) / 12
    own = np.repeat(np.arange(len(count)), count)
    for number in range(len(count)):
        assert len(set(PLACES.drive[own == number])) == 1
        assert np.all(np.hypot(*np.diff(PLACES.pose[own == number, :2], axis=0).T) < 0.05)
    apart = np.hypot(*(PLACES.pose[:, :2] - stretches.chord_m.mean(axis=1)[own]).T)
    assert np.all(apart <= stretches.reach_m[own])
    assert stretches.reach_m.max() < 0.4


@settings(max_examples=40, deadline=None)
@given(
    centre=st.tuples(st.floats(-5.0, 25.0), st.floats(-5.0, 20.0)),
    radius_m=st.floats(0.0, 30.0),
)
def test_near_and_nearest_are_what_a_look_at_every_station_finds(centre: tuple[float, float], radius_m: float) -> None:
    point = np.array(centre)
    square = np.sum((PLACES.pose[:, :2] - point) ** 2, axis=1)
    expected = np.flatnonzero(square <= radius_m**2)
    np.testing.assert_array_equal(HELD.near(point, radius_m), expected)
    best = int(expected[np.argmin(square[expected])]) if len(expected) else -1
    assert HELD.nearest(np.stack([point, point + 1e4]), radius_m).tolist() == [best, -1]


def test_only_stations_that_may_be_near_are_read() -> None:
    read: list[int] = []

    def reading(stations: np.ndarray) -> StationPositions:
        read.append(len(stations))
        return StationPositions(*(field[stations] for field in PLACES))

    places = StationPlaces(stretches_of(PLACES.pose[:, :2], PLACES.drive), len(PLACES.pose), reading)
    found = places.near(LANE[200], 0.5)
    assert len(found) <= sum(read) <= len(found) + 32
    assert len(read) == 1


def test_extents_are_those_of_the_stations() -> None:
    """In every frame, of the stations within the box; between stations a chord may reach up to a step farther."""
    yaw = np.arange(0, 400, 37) * 0.04 / 15.0
    frames = np.concatenate([np.stack([*LANE[::37].T, yaw], axis=1), [[200.0, 200.0, 1.0], [100.0, 100.0, 0.0]]])
    half_m = np.array([3.0, 2.0])
    low, high = track_extents(frames, HELD, half_m)
    for (east, north, turn), lowest, highest in zip(frames, low, high, strict=True):
        apart = PLACES.pose[:, :2] - [east, north]
        place = apart @ np.array([[np.cos(turn), -np.sin(turn)], [np.sin(turn), np.cos(turn)]])
        place = place[np.all(np.abs(place) <= half_m, axis=1)]
        expected = (place.min(axis=0), place.max(axis=0)) if len(place) else (np.zeros(2), np.zeros(2))
        assert np.all(lowest <= expected[0] + 0.006)
        assert np.all(highest >= expected[1] - 0.006)
        assert np.all(np.abs(lowest - expected[0]) < 0.045)
        assert np.all(np.abs(highest - expected[1]) < 0.045)
        assert np.all(np.abs([lowest, highest]) <= half_m + 1e-9)
