"""The spatial index against a look at every point; tile frames along drives."""

import numpy as np
from hypothesis import given, settings
from hypothesis import strategies as st

from lgprjax.subsurface import SpatialIndex, TilePlacer

COORDINATE = st.floats(-40.0, 40.0, width=32)
POINT = st.tuples(COORDINATE, COORDINATE)


@settings(max_examples=40, deadline=None)
@given(
    points=st.lists(POINT, min_size=1, max_size=40),
    centre=POINT,
    radius_m=st.floats(0.0, 60.0),
    cell_m=st.sampled_from([0.7, 2.0, 8.0, 100.0]),
)
def test_near_and_nearest_are_what_a_look_at_every_point_finds(
    points: list[tuple[float, float]], centre: tuple[float, float], radius_m: float, cell_m: float
) -> None:
    place = np.array(points, dtype=np.float64)
    index = SpatialIndex(place, cell_m)
    middle = np.array(centre, dtype=np.float64)
    square = np.sum((place - middle) ** 2, axis=1)
    expected = [n for n in range(len(points)) if square[n] <= radius_m**2]
    assert index.near(middle, radius_m).tolist() == expected
    best = min(expected, key=lambda n: (square[n], n)) if expected else None
    assert index.nearest(middle, radius_m) == best
    query, found = index.near_each(np.stack([middle, middle + 1e5, middle]), radius_m)
    assert query.tolist() == [0] * len(expected) + [2] * len(expected)
    assert [sorted(found[query == n]) for n in (0, 2)] == [expected, expected]


def test_far_from_the_anchor_the_cells_do_not_mix() -> None:
    """Both signs, 50 km out, on the borders of cells."""
    corners = np.array([[sx * 50_000.0, sy * 50_000.0] for sx in (-1, 1) for sy in (-1, 1)])
    place = np.concatenate([corners, corners + 0.5, [[0.0, 0.0], [-1e-9, -1e-9], [8.0, -8.0]]])
    index = SpatialIndex(place, 8.0)
    for n, point in enumerate(place):
        found = [m for m in range(len(place)) if np.hypot(*(place[m] - point)) <= 1.0]
        assert index.near(point, 1.0).tolist() == found
        assert n in found


def drive(east: np.ndarray, north: np.ndarray, yaw_rad: float) -> np.ndarray:
    pose = np.zeros((len(east), 5))
    pose[:, 0], pose[:, 1], pose[:, 3] = east, north, yaw_rad
    return pose


SPACING_M = 4.0
ROAD = drive(np.arange(-30.0, 30.0, 0.05), np.full(1200, -5.0), 0.0)


def placed(*poses: np.ndarray) -> np.ndarray:
    """Frames after drives in this order."""
    placer = TilePlacer(SPACING_M)
    for pose in poses:
        placer.place(pose)
    return placer.frames


def reached(frames: np.ndarray, pose: np.ndarray) -> float:
    """Largest distance from a station to its nearest frame."""
    apart = np.hypot(pose[:, None, 0] - frames[None, :, 0], pose[:, None, 1] - frames[None, :, 1])
    return float(apart.min(axis=1).max())


def test_frames_stand_within_half_the_spacing_of_a_drive_and_look_along_it() -> None:
    frames = placed(ROAD)
    assert reached(frames, ROAD) <= 0.5 * SPACING_M
    gaps_m = np.diff(frames[:, 0])
    assert np.all(gaps_m > 0.5 * SPACING_M)
    assert np.all(gaps_m <= SPACING_M)
    np.testing.assert_array_equal(frames[:, 1:], np.tile([-5.0, 0.0], (len(frames), 1)))
    angle = np.linspace(0.0, 3.0, 600)
    curve = drive(20 * np.sin(angle), -20 * np.cos(angle), 0.0)
    curve[:, 3] = angle
    frames = placed(curve)
    assert reached(frames, curve) <= 0.5 * SPACING_M
    np.testing.assert_allclose(frames[:, 0], 20 * np.sin(frames[:, 2]), atol=1e-9)


def test_a_second_drive_over_the_same_road_adds_none_in_either_direction() -> None:
    frames = placed(ROAD)
    beside = ROAD.copy()
    beside[:, 1] += 0.3
    assert len(placed(ROAD, ROAD)) == len(frames)
    back = ROAD[::-1].copy()
    back[:, 3] = np.pi
    assert len(placed(ROAD, back)) == len(frames)
    # A lane 0.3 m over may need a frame where it just leaves the reach of two neighbours, no more.
    assert reached(placed(ROAD, beside), beside) <= 0.5 * SPACING_M


def test_a_drive_on_another_road_gets_its_own_and_a_longer_one_what_is_new() -> None:
    other = ROAD.copy()
    other[:, 1] += 20.0
    assert len(placed(ROAD, other)) == 2 * len(placed(ROAD))
    frames, longer = placed(ROAD[:600]), placed(ROAD[:600], ROAD)
    assert longer[len(frames) :, 0].min() > frames[:, 0].max() + 0.5 * SPACING_M
    assert reached(longer, ROAD) <= 0.5 * SPACING_M
