"""The search of a drive where the drive is not a plain one: standing, reverse, lost, off the map, travel unknown."""

from itertools import repeat

import numpy as np
import pytest

from canon.site import Replay, Site, part_of, replay, scans_of
from lgprjax.registration import Code, LiveBlock, RegisterOptions, Registration

OPTIONS = RegisterOptions(search_m=1.5)
STEP_M = 4.5 / 126
GAP = 350
PIECE = 360
GARBAGE = slice(200, 400)
"""Scans of other ground in the middle of the drive: 7 m."""
DRIFT_M = 1.5
"""What the log's prior is led astray by over them, beside the metre that it is wrong from the start."""


def shifted(block: LiveBlock, east_m: np.ndarray | float, north_m: np.ndarray | float = 0.0) -> LiveBlock:
    """With a prior that is elsewhere; travel and heading are as they were."""
    pose = block.track.pose.copy()
    pose[:, 0] += east_m
    pose[:, 1] += north_m
    return block._replace(track=block.track._replace(pose=pose))


@pytest.fixture(scope="module")
def scans(site: Site) -> LiveBlock:
    return scans_of(site, "live")


@pytest.fixture(scope="module")
def plain(site: Site, scans: LiveBlock) -> Replay:
    return replay(site, scans, OPTIONS)


def over_other_ground(site: Site, scans: LiveBlock, options: RegisterOptions, drift_m: float) -> Replay:
    """The live drive with other ground in its middle, over which its prior drifts away for good."""
    other = scans_of(site, "impostor")
    traces = scans.traces.copy()
    traces[GARBAGE] = other.traces[GARBAGE]
    number = np.arange(len(traces))
    away = drift_m * np.clip((number - GARBAGE.start) / (GARBAGE.stop - GARBAGE.start), 0.0, 1.0)
    return replay(site, shifted(scans._replace(traces=traces), away), options)


def test_a_plain_drive_is_located(plain: Replay) -> None:
    assert plain.ok.mean() > 0.9
    assert plain.off_m[plain.ok].max() < 0.3
    assert np.all(plain.fix.p_false[plain.ok] <= OPTIONS.risk)


def test_on_board_it_does_not_matter_how_scans_come(site: Site, scans: LiveBlock, plain: Replay) -> None:
    """One truth: a vehicle's blocks are as long as its last search took, a replay's are not.

    Once the background is known, nearly the same scans have a fix as in a whole drive.
    """
    options = RegisterOptions(search_m=1.5, track=True)
    some = part_of(scans, slice(0, 200))
    drawn = np.random.default_rng(7).integers(1, 5, 200)
    one, other = (replay(site, some, options, block_scans=4, sizes=sizes) for sizes in (None, drawn))
    np.testing.assert_array_equal(one.fix.code, other.fix.code)
    np.testing.assert_array_equal(one.fix.pose, other.fix.pose)
    assert one.ok.mean() > 0.5
    assert one.off_m[one.ok].max() < 0.3
    assert set(one.fix.code[:50]) == {Code.NO_WINDOW}
    known = np.abs(some.track.travel_m - some.track.travel_m[0]) > 2.3
    assert np.mean(one.ok[known] == plain.ok[:200][known]) >= 0.95


def test_a_vehicle_that_stands_keeps_its_fix(site: Site, scans: LiveBlock, plain: Replay) -> None:
    """Three hundred scans of one place in the middle of the drive."""
    at, stand = 300, 300
    held = np.concatenate([np.arange(at), np.full(stand, at), np.arange(at, at + 200)])
    found = replay(site, part_of(scans, held), OPTIONS)
    there = slice(at, at + stand)
    assert plain.ok[at]
    assert found.ok[there].all()
    assert np.ptp(found.fix.pose[there, :2], axis=0).max() < 1e-6
    assert found.off_m[found.ok].max() < 0.3
    assert found.ok[at + stand :].mean() > plain.ok[at : at + 200].mean() - 0.05


def test_backing_up_is_located(site: Site, scans: LiveBlock) -> None:
    back = part_of(scans, np.arange(len(scans.traces))[::-1])
    moved = back.track._replace(travel_m=back.track.travel_m, speed_mps=-back.track.speed_mps)
    found = replay(site, back._replace(track=moved), OPTIONS)
    assert np.all(np.diff(moved.travel_m) <= 0.0)
    assert found.ok.mean() > 0.85
    assert found.off_m[found.ok].max() < 0.3


def test_a_lost_drive_is_found_again(site: Site, scans: LiveBlock) -> None:
    """Over other ground nothing wrong is believed; where the map's own comes back, the drive is found.

    With the drift it is 2.3 m beside its prior, outside the region that was asked for.
    """
    traces = scans.traces.copy()
    traces[GARBAGE] = scans_of(site, "impostor").traces[GARBAGE]
    number = np.arange(len(traces))
    drift_m = DRIFT_M * np.clip((number - GARBAGE.start) / (GARBAGE.stop - GARBAGE.start), 0.0, 1.0)
    found = replay(site, shifted(scans._replace(traces=traces), drift_m), OPTIONS)
    ok = found.ok
    assert found.off_m[ok].max() < 0.3
    # A window of 8 m that reaches back before the other ground may still know its place; none that lies on it does.
    assert not ok[GARBAGE.start + int(6.5 / STEP_M) : GARBAGE.stop].any()
    assert ok[GARBAGE.stop :].any()
    back = int(np.argmax(ok[GARBAGE.stop :]))
    assert back * STEP_M < 6.0
    assert ok[GARBAGE.stop + back :].mean() > 0.7


@pytest.mark.parametrize("back", [False, pytest.param(True, marks=pytest.mark.long)])
def test_a_piece_of_the_map_in_other_ground_is_soon_forgotten(site: Site, scans: LiveBlock, back: bool) -> None:
    """1.5 m of the map's own ground in another's: windows that found it do not confirm it, however near they search,
    and carry it back no farther."""
    own = slice(PIECE, PIECE + int(1.5 / STEP_M))
    traces = scans_of(site, "impostor").traces[: len(scans.traces)]
    traces[own] = scans.traces[own]
    found = replay(site, part_of(scans, slice(0, len(traces)))._replace(traces=traces), OPTIONS, back=back)
    ok = np.flatnonzero(found.ok)
    assert len(ok)
    assert (own.start - ok.min()) * STEP_M < (3.0 if back else 0.01)
    assert (ok.max() - own.stop) * STEP_M < 1.5
    assert found.off_m[ok].max() < 0.3


@pytest.fixture(scope="module")
def noisy(scans: LiveBlock) -> LiveBlock:
    """A day on which it takes metres to be certain."""
    noise = np.random.default_rng(3).normal(0.0, 4.0 * scans.traces.std(), scans.traces.shape).astype(np.float32)
    return scans._replace(traces=scans.traces + noise)


@pytest.mark.parametrize(("most", "least", "apart_m"), [(4096, 0.99, 1e-3), (100, 0.2, 0.1)])
def test_a_place_is_carried_back_to_where_the_vehicle_stood(
    site: Site, noisy: LiveBlock, most: int, least: float, apart_m: float
) -> None:
    """At the start; no more scans about a place are held at once than memory is meant for."""
    stand = 300
    held = part_of(noisy, np.concatenate([np.zeros(stand, int), np.arange(300)]))
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lgprjax.registration.search._MOST_SCANS", most)
        found = replay(site, held, OPTIONS, back=True)
    ok = found.ok[:stand]
    assert ok.mean() > least
    assert np.ptp(found.fix.pose[:stand, :2][ok], axis=0).max() < apart_m
    assert found.off_m[found.ok].max() < 0.3


def test_the_first_metres_are_found_from_what_lies_ahead(site: Site, noisy: LiveBlock) -> None:
    """These metres have fixes as well, once there is a place."""
    forward, found = (replay(site, noisy, OPTIONS, back=back) for back in (False, True))
    first = int(np.argmax(forward.ok))
    assert first * STEP_M > 1.0
    assert found.ok[:first].mean() > 0.95
    assert found.ok.mean() > 0.97
    # What had a fix keeps it.
    np.testing.assert_array_equal(found.fix.pose[forward.ok], forward.fix.pose[forward.ok])
    assert found.off_m[found.ok].max() < 0.3
    assert np.all(found.fix.p_false[found.ok] <= OPTIONS.risk)
    sigma_m = np.sqrt(np.trace(found.fix.covariance[:, :2, :2], axis1=1, axis2=2))
    assert np.all(found.off_m[found.ok] <= 4.0 * sigma_m[found.ok])


def test_a_place_is_not_carried_back_far_over_other_ground(site: Site, scans: LiveBlock) -> None:
    """12 m of other ground, then the map's own: windows of 8 m that reach ahead know their place for some metres."""
    begin = int(12.0 / STEP_M)
    traces = scans.traces.copy()
    traces[:begin] = scans_of(site, "impostor").traces[:begin]
    found = replay(site, scans._replace(traces=traces), OPTIONS, back=True)
    ok = np.flatnonzero(found.ok)
    assert found.ok[begin:].mean() > 0.9
    assert (begin - ok.min()) * STEP_M < 6.5
    assert found.off_m[ok].max() < 0.3


def test_a_prior_beyond_all_that_is_searched_gives_no_fix(site: Site, scans: LiveBlock) -> None:
    """5 m off where one and a half, then three, are searched."""
    assert not replay(site, shifted(scans, 4.2), OPTIONS).ok.any()


def test_off_the_map_has_a_code_of_its_own(site: Site, scans: LiveBlock) -> None:
    found = replay(site, shifted(part_of(scans, slice(0, 200)), 0.0, 80.0), OPTIONS)
    assert set(np.unique(found.fix.code)) == {Code.OFF_MAP}
    assert np.isnan(found.fix.pose).all()
    assert np.all(found.fix.p_false == 1.0)


def test_half_an_array_on_the_map_is_too_little(site: Site, scans: LiveBlock) -> None:
    """The lane's rim, and a region too narrow to reach back onto the lane."""
    block = part_of(scans, slice(0, 200))
    assert block.truth is not None
    yaw = block.truth[:, 3]
    pose = block.track.pose.copy()
    # The two baselines lie 0.3 m to either side, the array is 1.4 m wide.
    pose[:, :2] = block.truth[:, :2] + 1.45 * np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
    found = replay(site, block._replace(track=block.track._replace(pose=pose)), RegisterOptions(search_m=0.1))
    assert not found.ok.any()
    assert np.mean(np.isin(found.fix.code, (Code.LOW_OVERLAP, Code.OFF_MAP))) > 0.95
    assert np.any(found.fix.code == Code.LOW_OVERLAP)


def test_no_window_reaches_over_a_gap_in_travel(site: Site, scans: LiveBlock, plain: Replay) -> None:
    """What the vehicle did between two legs nobody knows: here it is 5 m that odometry has not counted."""
    kept = np.concatenate([np.arange(GAP), np.arange(GAP + 140, len(scans.traces))])
    block = part_of(scans, kept)
    travel = block.track.travel_m.copy()
    travel[GAP:] -= travel[GAP] - travel[GAP - 1]
    leg = (np.arange(len(kept)) >= GAP).astype(np.int64)
    found = replay(site, block._replace(track=block.track._replace(travel_m=travel, leg=leg)), OPTIONS)
    window_m = found.fix.window_m[GAP:]
    known = np.isfinite(window_m)
    # The first scans of the new leg still have what was carried on from the one before, which is no fix.
    known[: int(0.15 / STEP_M)] = False
    assert np.all(window_m[known] <= travel[GAP:][known] - travel[GAP] + 0.15)
    assert found.off_m[found.ok].max() < 0.3
    assert found.ok[GAP + 60 :].mean() > 0.85
    assert np.max(plain.fix.window_m[GAP : GAP + 28]) >= 1.0


def test_noise_of_the_prior_is_none_of_the_fix(site: Site, scans: LiveBlock, plain: Replay) -> None:
    """A GNSS that scatters by 0.2 m from scan to scan, where odometry does not."""
    noise = 0.2 * np.random.default_rng(4).normal(size=(2, len(scans.traces)))
    found = replay(site, shifted(scans, noise[0], noise[1]), OPTIONS)
    both = found.ok & plain.ok
    assert found.ok.mean() > plain.ok.mean() - 0.05
    assert found.off_m[found.ok].max() < 0.3
    off = np.hypot(*(found.fix.pose[both, :2] - plain.fix.pose[both, :2]).T)
    assert np.median(off) < 0.01


def test_memory_does_not_grow_with_the_drive(site: Site, scans: LiveBlock) -> None:
    held: list[int] = []

    def count(drive: Registration) -> None:
        stops = drive.search._stops
        held.append(0 if stops is None else len(stops.number))

    found = replay(site, part_of(scans, np.tile(np.arange(0, 200), 3)), OPTIONS, sizes=repeat(100), watch=count)
    assert len(found.fix.code) == 600
    assert max(held) <= 2 * (8.0 / 0.1)
