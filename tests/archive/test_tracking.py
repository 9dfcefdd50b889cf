"""A drive tracked over generated ground: as right as batch registration, lost and found again, compiled ahead."""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from generated import Site
from lgprjax.archive import RegisteredDrive, register_log
from lgprjax.archive.depth_levels import live_operators
from lgprjax.archive.recordings import recording_of
from lgprjax.archive.registering import live_blocks, true_poses
from lgprjax.archive.tracks import track_of_drive
from lgprjax.formats import DriveLog, MapFile
from lgprjax.pso import SwarmConfig
from lgprjax.registration import (
    LADDER,
    Code,
    Fix,
    LiveBlock,
    RegisterOptions,
    Tracker,
    register_drive,
    tracking_ground,
)
from lgprjax.registration.near import search_of
from lgprjax.registration.prepared import PreparedGround

TRACK, NORMAL, WIDE, LOST = range(4)
OPTIONS = RegisterOptions(search_m=1.5, track=True)
GARBAGE = slice(200, 400)
"""Scans of other ground in the middle of the drive: 7 m."""
DRIFT_M = 3.0
"""What the log's prior is led astray by over them, beside the metre that it is wrong from the start."""

_compiled = [0]


def count(event: str, duration_secs: float, **kwargs: str | int) -> None:  # noqa: ARG001
    """Count every program that is traced, whoever asks for it."""
    _compiled[0] += event == "/jax/core/compile/jaxpr_trace_duration"


jax.monitoring.register_event_duration_secs_listener(count)


class Replay(NamedTuple):
    """A drive as a tracker saw it."""

    fix: Fix
    rung: np.ndarray
    truth: np.ndarray
    compiled: int


def joined(fixes: list[Fix]) -> Fix:
    return Fix(*(np.concatenate(field) for field in zip(*fixes, strict=True)))


def garbled(blocks: Iterator[LiveBlock], other: np.ndarray) -> Iterator[LiveBlock]:
    """The drive with a stretch of other ground, over which its prior drifts away for good."""
    low = 0
    for block in blocks:
        scan = np.arange(low, low + len(block.traces))
        low += len(scan)
        foreign = (scan >= GARBAGE.start) & (scan < GARBAGE.stop)
        pose = block.track.pose.copy()
        pose[:, 0] += DRIFT_M * np.clip((scan - GARBAGE.start) / (GARBAGE.stop - GARBAGE.start), 0.0, 1.0)
        traces = np.where(foreign[:, None, None], other[scan], block.traces)
        yield block._replace(traces=traces, track=block.track._replace(pose=pose))


@pytest.fixture(scope="module")
def lost(site: Site) -> Replay:
    """The live drive with garbage in its middle."""
    with DriveLog.open(site.logs["impostor"]) as log:
        other = np.concatenate([traces for _, traces, _ in recording_of(log).blocks(512, 0)])
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        frame = source.description.frame
        track, truth = track_of_drive(log, frame).track, true_poses(log, frame)
        assert truth is not None
        ground = tracking_ground(source, OPTIONS)
        tracker = Tracker(ground, live_operators(source, log, track), log.description.array, OPTIONS)
        tracker.warm_up()
        before = _compiled[0]
        parts = [tracker.feed(block) for block in garbled(live_blocks(log, track, None), other)]
        compiled = _compiled[0] - before
    return Replay(joined([p.fix for p in parts]), np.concatenate([p.rung for p in parts]), truth, compiled)


@pytest.fixture(scope="module")
def tracked(site: Site) -> RegisteredDrive:
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        return register_log(source, log, OPTIONS)


def test_nothing_compiles_after_warm_up(lost: Replay) -> None:
    """Over a drive with every rung of the ladder and a change of tile every few metres."""
    assert set(np.unique(lost.rung)) == {TRACK, NORMAL, WIDE, LOST}
    assert lost.compiled == 0
    before = _compiled[0]
    jax.jit(lambda x: x + 1.0)(jnp.zeros(3)).block_until_ready()
    assert _compiled[0] > before


@pytest.mark.campaign
def test_nothing_compiles_over_ten_thousand_scans(site: Site) -> None:
    """The garbled drive fifteen times over: the vehicle is put back to the start each time, its prior wrong again."""
    with DriveLog.open(site.logs["impostor"]) as log:
        other = np.concatenate([traces for _, traces, _ in recording_of(log).blocks(512, 0)])
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        track = track_of_drive(log, source.description.frame).track
        ground = tracking_ground(source, OPTIONS)
        tracker = Tracker(ground, live_operators(source, log, track), log.description.array, OPTIONS)
        tracker.warm_up()
        before = _compiled[0]
        rounds = [[tracker.feed(block) for block in garbled(live_blocks(log, track, None), other)] for _ in range(15)]
        compiled = _compiled[0] - before
    shares = [np.mean(np.concatenate([p.fix.code for p in parts]) == Code.OK) for parts in rounds]
    rung = np.concatenate([p.rung for parts in rounds for p in parts])
    print(f"{len(rung)} scans, rungs {np.bincount(rung)}, ok {np.round(shares, 3)}")
    assert len(rung) > 10_000
    assert set(np.unique(rung)) == {TRACK, NORMAL, WIDE, LOST}
    assert compiled == 0
    assert min(shares) > max(shares) - 0.05


def test_a_lost_drive_is_found_again(lost: Replay) -> None:
    """No fix on other ground, and within 2 m of the map's own ground a lock on the narrowest rung."""
    ok = np.asarray(lost.fix.code) == Code.OK
    # The track filter's memory makes the first scan or two of either ground a mixture.
    assert not ok[GARBAGE.start + 2 : GARBAGE.stop].any()
    assert np.any(lost.rung[GARBAGE] == LOST)
    off = np.hypot(*(np.asarray(lost.fix.pose)[:, :2] - lost.truth[:, :2]).T)
    assert np.max(off[ok]) < 0.3
    back = GARBAGE.stop + int(np.argmax(ok[GARBAGE.stop :]))
    print(f"found again {back - GARBAGE.stop} scans after the garbage; rungs {np.bincount(lost.rung)}")
    assert back - GARBAGE.stop < 2.0 / (4.5 / 126)
    assert np.mean(lost.rung[back + 40 :] == TRACK) > 0.7
    assert ok[back:].mean() > 0.75


def test_tracked_fixes_agree_with_batch_fixes(site: Site, tracked: RegisteredDrive) -> None:
    """Within 2 cm on the same tile, and nearly always on another; as many ok."""
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        track = tracked.track
        ground = tracking_ground(source, OPTIONS)
        blocks = live_blocks(log, track, None)
        operators = live_operators(source, log, track)
        batch = joined([p.fix for p in register_drive(ground, operators, log.description.array, blocks, OPTIONS)])
        both = (np.asarray(tracked.fix.code) == Code.OK) & (np.asarray(batch.code) == Code.OK)
        pose = np.asarray(tracked.fix.pose)
        scans = np.flatnonzero(both)
        tiles = [(ground.tile_near(pose[n, :2], 1.5), ground.tile_near(track.pose[n, :2], 1.5)) for n in scans]
    off = np.hypot(*(pose[both, :2] - np.asarray(batch.pose)[both, :2]).T)
    same = np.array([a == b for a, b in tiles])
    shares = [np.mean(np.asarray(fix.code) == Code.OK) for fix in (tracked.fix, batch)]
    print(f"ok {shares[0]:.3f} tracked, {shares[1]:.3f} batch; apart {off[same].max():.4f} m, {off[~same].max():.4f} m")
    assert same.sum() > 200
    assert off[same].max() < 0.02
    assert np.percentile(off, 95) < 0.02
    assert shares[0] > shares[1] - 0.01


def test_most_of_a_clear_drive_is_on_the_narrowest_rung(tracked: RegisteredDrive) -> None:
    assert tracked.rung is not None
    assert np.mean(tracked.rung == TRACK) > 0.9
    assert tracked.truth is not None
    ok = np.asarray(tracked.fix.code) == Code.OK
    off = np.hypot(*(np.asarray(tracked.fix.pose)[:, :2] - tracked.truth[:, :2]).T)
    assert np.max(off[ok]) < 0.3
    assert np.isfinite(tracked.correlation_at_truth).mean() > 0.99


def test_no_impostor_is_called_ok(site: Site) -> None:
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["impostor"]) as log:
        drive = register_log(source, log, OPTIONS)
    assert drive.rung is not None
    assert not np.any(np.asarray(drive.fix.code) == Code.OK)
    assert set(np.unique(drive.rung)) == {NORMAL}


def test_windows_are_tracked(site: Site) -> None:
    """Half-metre windows over 300 scans: a fix a scan once the first window is full."""
    options = RegisterOptions(search_m=1.5, window_m=0.5, track=True)
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        frame = source.description.frame
        track, truth = track_of_drive(log, frame).track, true_poses(log, frame)
        assert truth is not None
        tracker = Tracker(
            tracking_ground(source, options), live_operators(source, log, track), log.description.array, options
        )
        block = next(live_blocks(log, track, None))
        short = LiveBlock(block.traces[:300], block.valid[:300], type(track)(*(f[:300] for f in block.track)))
        found = tracker.feed(short)
    code = np.asarray(found.fix.code)
    full = code != Code.NO_WINDOW
    assert list(full) == list(found.rung >= 0)
    assert np.argmax(full) == pytest.approx(0.5 / (4.5 / 126), abs=1)
    ok = code == Code.OK
    assert np.mean(ok[full]) > 0.93
    off = np.asarray(found.fix.pose)[ok, :2] - truth[:300][ok, :2]
    assert np.max(np.hypot(*off.T)) < 0.3


def test_the_swarm_grows_with_the_rung(site: Site) -> None:
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        prepared = PreparedGround(tracking_ground(source, OPTIONS), log.description.array)
        options = RegisterOptions(swarm=SwarmConfig(24, 12, neighbours=3))
        searches = [search_of(rung, prepared, options) for rung in LADDER]
    sizes = [(s.layout.spec.swarm.particles, s.layout.spec.swarm.iterations) for s in searches if s.layout.spec.swarm]
    assert sizes == [(16, 8), (24, 12), (32, 16), (48, 24)]
    assert all(s.layout.spec.swarm is not None and s.layout.spec.swarm.neighbours == 3 for s in searches)
    assert sorted(s.places for s in searches) == [s.places for s in searches]
