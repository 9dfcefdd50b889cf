"""The generated site of the tests: drives, map and registrations, made once a session in float32 as shipped."""

import pickle
from collections.abc import Callable, Iterable, Iterator
from itertools import repeat
from pathlib import Path
from typing import NamedTuple

import jax
import numpy as np
import pytest

from canon.shared import shared_folder
from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.batch.register import HeldGround, true_poses
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.recordings.drives import live_operators, recording_of, track_of_drive
from lgprjax.registration import DriveFixes, Fix, LiveBlock, RegisterOptions, Registration, Track, carry_back
from lgprjax.simulation import write_drives


class Site(NamedTuple):
    """Files of one generated site."""

    folder: Path
    logs: dict[str, Path]
    map: Path


class Replay(NamedTuple):
    """A drive as it was fed, and what came of it.

    Attributes:
        block: the scans.
        fix, time_scale: of each.
        beside: the part of the east and north covariances due to map and odometer.
    """

    block: LiveBlock
    fix: Fix
    time_scale: np.ndarray
    beside: np.ndarray

    @property
    def ok(self) -> np.ndarray:
        """Scans with a fix."""
        return np.asarray(self.fix.code == 0)

    @property
    def off_m(self) -> np.ndarray:
        """Distance of each fix from the truth."""
        assert self.block.truth is not None
        return np.asarray(np.hypot(*(self.fix.pose[:, :2] - self.block.truth[:, :2]).T))


def make_site(folder: Path, seed: int, length_m: float) -> Site:
    """Render the drives of a site and build its map."""
    from benchmarks.village import village_drives  # found once conftest has named where the benchmarks are

    logs = write_drives(village_drives(seed, length_m), folder)
    database = folder / "site.map.h5"
    build_map([logs["baseline_left"], logs["baseline_right"]], database)
    return Site(folder, logs, database)


def site_in(folder: Path) -> Site:
    """Site that ``make_site`` wrote."""
    logs = {path.name.removesuffix(".drive.h5"): path for path in sorted(folder.glob("*.drive.h5"))}
    return Site(folder, logs, folder / "site.map.h5")


def register_site(site: Site, name: str) -> RegisteredDrive:
    """Register one of the site's drives by default, prior wrong by a metre."""
    with MapFile.open(site.map) as source, DriveLog.open(site.logs[name]) as log:
        return register_log(source, log, RegisterOptions(search_m=1.5))


def registered_once(factory: pytest.TempPathFactory, site: Site, name: str) -> RegisteredDrive:
    """As ``register_site``, once a session for all workers."""

    def make(folder: Path) -> None:
        (folder / "drive.pickle").write_bytes(pickle.dumps(register_site(site, name)))

    found = pickle.loads((shared_folder(factory, f"registered_{name}", make) / "drive.pickle").read_bytes())
    assert isinstance(found, RegisteredDrive)
    return found


def scans_of(site: Site, name: str, scans: int | None = None) -> LiveBlock:
    """A drive's scans, or its first ones, as one block with their truth."""
    with MapFile.open(site.map) as source, DriveLog.open(site.logs[name]) as log:
        frame = source.description.frame
        track, truth = track_of_drive(log, frame).track, true_poses(log, frame)
        parts = list(recording_of(log).blocks(512, 0))
    assert truth is not None
    whole = slice(0, scans)
    traces, valid = (np.concatenate([part[n] for part in parts])[whole] for n in (1, 2))
    return LiveBlock(traces, valid, Track(*(field[whole] for field in track)), truth[whole])


def part_of(block: LiveBlock, chosen: slice | np.ndarray) -> LiveBlock:
    """Some scans of a block."""
    truth = None if block.truth is None else block.truth[chosen]
    return LiveBlock(block.traces[chosen], block.valid[chosen], Track(*(f[chosen] for f in block.track)), truth)


def replay(
    site: Site,
    block: LiveBlock,
    options: RegisterOptions,
    *,
    block_scans: int = 512,
    sizes: Iterable[int] | None = None,
    watch: Callable[[Registration], None] = lambda _: None,
    back: bool = False,
) -> Replay:
    """Feed scans that were made from the site's live drive, some at a time.

    Args:
        site: whose map is searched, and whose live drive says how the scans were recorded.
        block: the scans.
        options: of the search.
        block_scans: fed at a time; sizes: of one feed after the other, no more than these.
        watch: told after each feed.
        back: places are carried back at the end, as ``register`` does.
    """
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        held, array = HeldGround(source, options), log.description.array
        operators = live_operators(source, log, track_of_drive(log, source.description.frame).track)

        def begin() -> Registration:
            return Registration(
                held.ground,
                operators,
                array,
                options,
                chance=held.chance,
                recorded=block.traces.shape[2],
                prepared=held.prepared_for(array),
                block_scans=block_scans,
            )

        def blocks(first: int, stop: int) -> Iterator[LiveBlock]:
            for begun in range(first, stop, block_scans):
                yield part_of(block, slice(begun, min(begun + block_scans, stop)))

        drive, parts = begin(), []
        low = 0
        for count in repeat(block_scans) if sizes is None else sizes:
            parts.append(drive.feed(part_of(block, slice(low, low + count))._replace(truth=None)))
            watch(drive)
            low += count
            if low >= len(block.traces):
                break
        found: DriveFixes = jax.tree.map(lambda *fields: np.concatenate(fields), *parts)
        if back:
            found = carry_back(found, block.track, blocks, begin)
    return Replay(block, found.fix, found.time_scale, found.map_odometry_covariance)
