"""Baselines whose labels disagree, on a ring: passes, matches, the graph and the map that comes out."""

import json
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pytest

from lgprjax.formats import MapFile
from lgprjax.mapping import align
from lgprjax.mapping.align import (
    AgreedBaselines,
    MatchPlan,
    PassMatches,
    agree_baselines,
    chains_of,
    match_again,
    match_passes,
    pairs_of,
    passes_of,
    plan_matches,
    refine_map,
    supported,
)
from lgprjax.registration import POOLED, Code
from plane_ground import STEP_M, write_plane_map
from refusals import refused

RADIUS_M = 7.0
ROUND_M = 2.0 * np.pi * RADIUS_M


class Ring(NamedTuple):
    """A map of a ring, true poses (east_m, north_m, yaw_rad) of its stations, and how far along the ring each is."""

    path: Path
    truth: np.ndarray
    at_m: np.ndarray


def on_ring(at_m: np.ndarray, aside_m: np.ndarray, direction: int) -> np.ndarray:
    """Poses on a ring about the origin, counter-clockwise or clockwise; aside is outward."""
    angle = at_m / RADIUS_M
    radius = RADIUS_M + aside_m
    return np.stack([radius * np.cos(angle), radius * np.sin(angle), angle + direction * 0.5 * np.pi], axis=1)


def slow(at_m: np.ndarray, size: float, phase: float) -> np.ndarray:
    """An error that changes over tens of metres."""
    return size * np.stack(
        [np.cos(at_m / 25.0 + phase), np.sin(at_m / 31.0 + 2.0 * phase), 0.01 * np.cos(at_m / 28.0 + phase)], axis=1
    )


@pytest.fixture(scope="module")
def ring(tmp_path_factory: pytest.TempPathFactory) -> Ring:
    """A drive of a lap and a half, one of a lap the other way, and a third far away."""
    first, second = np.arange(0.0, 1.5 * ROUND_M, STEP_M), np.arange(0.0, 1.05 * ROUND_M, STEP_M)
    away = np.arange(0.0, 12.0, STEP_M)
    truth = [
        on_ring(first, 0.1 * np.sin(first / 9.0), 1),
        on_ring(20.0 - second, 0.1 * np.cos(second / 7.0), -1),
        np.stack([100.0 + away, np.full_like(away, 40.0), np.zeros_like(away)], axis=1),
    ]
    label = [
        pose + slow(path, 0.35, 1.0 + 2.0 * n)
        for n, (pose, path) in enumerate(zip(truth, (first, second, away), strict=True))
    ]
    path = tmp_path_factory.mktemp("ring") / "ring.map.h5"
    write_plane_map(path, truth, label, sigma_m=0.35)
    return Ring(path, np.concatenate(truth), np.concatenate([first, 20.0 - second, away]))


@pytest.fixture(scope="module")
def matched(ring: Ring) -> tuple[MatchPlan, PassMatches]:
    with MapFile.open(ring.path) as source:
        plan = plan_matches(source)
        return plan, match_passes(source, plan)


@pytest.fixture(scope="module")
def first(ring: Ring, matched: tuple[MatchPlan, PassMatches]) -> AgreedBaselines:
    with MapFile.open(ring.path) as source:
        return agree_baselines(source, matched[1])


@pytest.fixture(scope="module")
def again(ring: Ring, matched: tuple[MatchPlan, PassMatches], first: AgreedBaselines) -> PassMatches:
    with MapFile.open(ring.path) as source:
        correction = (first.pose - source.pose)[:, [0, 1, 3]]
        return match_again(source, matched[0], correction)


@pytest.fixture(scope="module")
def agreed(ring: Ring, again: PassMatches) -> AgreedBaselines:
    with MapFile.open(ring.path) as source:
        return agree_baselines(source, again)


def test_a_lap_ends_where_it_meets_its_own_ground(ring: Ring) -> None:
    with MapFile.open(ring.path) as source:
        passes = passes_of(source, 2.0)
        drive = source.drive
    assert [len(np.unique(passes.of_station[drive == n])) for n in range(3)] == [2, 2, 1]
    for number in np.unique(passes.of_station):
        own = np.flatnonzero(passes.of_station == number)
        assert len(np.unique(drive[own])) == 1
        assert np.all(np.diff(own) == 1)
        # Two metres before the round is full, labels wrong by some decimetres.
        assert np.ptp(ring.at_m[own]) <= ROUND_M
    first = np.flatnonzero((drive == 0) & (passes.of_station == 0))
    assert np.ptp(ring.at_m[first]) == pytest.approx(ROUND_M - 2.0, abs=1.5)


def test_places_are_paired_with_earlier_passes_only_and_with_few(ring: Ring) -> None:
    with MapFile.open(ring.path) as source:
        passes = passes_of(source, 2.0)
        pairs = pairs_of(source, passes, 1.0)
    assert np.all(pairs.ground < pairs.number)
    # The drive that is alone has nothing to be paired with.
    assert not np.any(np.isin([pairs.number, pairs.ground], passes.of_station[-1]))
    of_station = np.unique(pairs.station, return_counts=True)[1]
    assert of_station.max() == 2
    apart = np.hypot(*(ring.truth[pairs.station, None, :2] - ring.truth[None, ::7, :2]).reshape(-1, 2).T)
    apart = apart.reshape(len(pairs.station), -1)
    on = passes.of_station[::7][None] == pairs.ground[:, None]
    assert np.where(on, apart, np.inf).min(axis=1).max() < 4.0


@pytest.mark.parametrize("name", ["matched", "again"])
def test_matches_say_where_places_are_on_the_ground_of_the_other_pass(
    ring: Ring, name: str, request: pytest.FixtureRequest
) -> None:
    found = request.getfixturevalue(name)
    rows: PassMatches = found if isinstance(found, PassMatches) else found[1]
    ok = rows.code == Code.OK
    with MapFile.open(ring.path) as source:
        label = source.pose[:, [0, 1, 3]]
    # In the ground's labels: the truth, carried by what the ground's own label is wrong by.
    truth, ground = ring.truth[rows.station[ok]], ring.truth[rows.ground[ok]]
    turn = label[rows.ground[ok], 2] - ground[:, 2]
    lever = truth[:, :2] - ground[:, :2]
    expected = label[rows.ground[ok], :2] + np.stack(
        [
            np.cos(turn) * lever[:, 0] - np.sin(turn) * lever[:, 1],
            np.sin(turn) * lever[:, 0] + np.cos(turn) * lever[:, 1],
        ],
        axis=1,
    )
    off = np.hypot(*(rows.found[ok, :2] - expected).T)
    yaw = np.degrees(np.mod(rows.found[ok, 2] - truth[:, 2] - turn + np.pi, 2.0 * np.pi) - np.pi)
    assert ok.mean() > 0.8
    assert np.sqrt(np.mean(off**2)) < 0.03
    assert np.abs(yaw).max() < 1.0


def mutual_m(ring: Ring, pose: np.ndarray, rows: PassMatches, used: np.ndarray) -> float:
    """Root mean square of the difference of two labels' errors where they share ground."""
    wrong = pose[:, :2] - ring.truth[:, :2]
    return float(np.sqrt(np.mean(np.sum((wrong[rows.station[used]] - wrong[rows.ground[used]]) ** 2, axis=1))))


def test_labels_agree_afterwards(
    ring: Ring, matched: tuple[MatchPlan, PassMatches], first: AgreedBaselines, agreed: AgreedBaselines
) -> None:
    rows = matched[1]
    used = supported(rows)
    with MapFile.open(ring.path) as source:
        before = mutual_m(ring, source.pose, rows, used)
        untouched = source.pose[source.drive == 2]
        drive = source.drive
    after = mutual_m(ring, agreed.pose, rows, used)
    once = mutual_m(ring, first.pose, rows, used)
    assert before > 0.3
    assert after <= once <= 0.05
    assert agreed.after.rms_m < 0.04 < agreed.before.rms_m
    assert agreed.kept > 0.95 * agreed.used
    np.testing.assert_array_equal(agreed.pose[drive == 2], untouched)
    assert [change.kept > 0 for change in agreed.baselines] == [True, True, False]
    assert np.isnan(agreed.baselines[2].sigma_after_m)
    assert agreed.baselines[0].sigma_after_m < 0.3


def test_matches_that_are_alone_tie_nothing(matched: tuple[MatchPlan, PassMatches]) -> None:
    rows = matched[1]
    pair = (rows.number == rows.number[0]) & (rows.on == rows.on[0])
    assert pair.sum() > 12
    code = np.where(pair, int(Code.LOW_CORRELATION), rows.code)
    lone = np.flatnonzero(pair)[4]
    code[lone] = Code.OK
    held = supported(rows._replace(code=code))
    assert not held[pair].any()
    # Beyond the map's own ground nothing can be found, and that speaks against nothing.
    some = np.flatnonzero(pair)[np.argsort(rows.station[pair])][:3]
    code = np.where(pair, int(Code.LOW_OVERLAP), rows.code)
    code[some] = Code.OK
    held = supported(rows._replace(code=code))
    assert held[some].all()


def test_a_jump_of_the_labels_ends_a_chain(ring: Ring, tmp_path: Path) -> None:
    with MapFile.open(ring.path) as source:
        whole = chains_of(source)
        assert len(whole.chains) == 3
        np.testing.assert_array_equal(whole.chain, source.drive)
    at_m = np.arange(0.0, 20.0, STEP_M)
    truth = np.stack([at_m, np.zeros_like(at_m), np.zeros_like(at_m)], axis=1)
    jumped = truth.copy()
    jumped[200:300, 1] += 3.0
    write_plane_map(tmp_path / "jumped.map.h5", [truth, truth], [truth, jumped], channels=1)
    with MapFile.open(tmp_path / "jumped.map.h5") as source:
        cut = chains_of(source)
        starts = np.flatnonzero(np.diff(cut.chain)) + 1
        np.testing.assert_array_equal(starts, len(at_m) + np.array([0, 200, 300]))
    assert np.all(np.diff(cut.at_m) >= 0.0)
    assert [round(chain.stop_m - chain.start_m, 1) for chain in cut.chains][1] == pytest.approx(199 * STEP_M, abs=0.1)


def test_a_map_is_rebuilt_without_touching_a_signal(
    ring: Ring, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    output = tmp_path / "agreed.map.h5"
    # On a ring every stretch has a heading of its own, so that measuring takes minutes; it is tested on roads.
    monkeypatch.setattr(align, "measure_chance", lambda _: POOLED)
    with MapFile.open(ring.path) as source:
        plan = plan_matches(source)
        # A tenth of the pairs are enough to see that what is written is what was found.
        few = plan._replace(pairs=type(plan.pairs)(*(field[:40] for field in plan.pairs)))
        written = refine_map(source, few, output)
        numbers = np.arange(0, len(source.pose), 13)
        before, drive, time = source.read_stations(numbers), source.drive, source.pose[numbers]
        with MapFile.open(output) as refined:
            after = refined.read_stations(numbers)
            np.testing.assert_allclose(refined.pose, written.pose, atol=1e-3)
            np.testing.assert_array_equal(refined.drive, drive)
            np.testing.assert_array_equal(after.profile, before.profile)
            np.testing.assert_array_equal(after.valid, before.valid)
            turn = written.pose[numbers, 3] - time[:, 3]
            assert np.abs(turn).max() > 1e-4
            cos, sin = np.cos(turn)[:, None], np.sin(turn)[:, None]
            x, y = before.antenna_m[..., 0], before.antenna_m[..., 1]
            np.testing.assert_allclose(after.antenna_m[..., 0], cos * x - sin * y, atol=2e-3)
            np.testing.assert_allclose(after.antenna_m[..., 1], sin * x + cos * y, atol=2e-3)
            frame = refined.tile_frame
            apart = np.hypot(*(refined.pose[:, None, :2] - frame[None, :, :2]).reshape(-1, 2).T)
            assert (
                apart.reshape(len(refined.pose), -1).min(axis=1).max()
                <= 0.5 * refined.description.tile_spacing_m + 0.01
            )
            provenance = refined.provenance
            assert refined.description.label_sigma_m == source.description.label_sigma_m
        with refused("output", "--force", file=output):
            refine_map(source, few, output)
    assert provenance["inputs"] == [{"file": f"drive {n}", "position_sigma_m": 0.35} for n in range(3)]
    refined_by = provenance["refined"]
    assert isinstance(refined_by, dict)
    assert len(refined_by["sha256"]) == 64
    assert refined_by["tied"][2] is False
    json.dumps(provenance)
