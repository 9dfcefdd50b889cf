"""A road is dug up after it was mapped: two later drives mend the map, one alone does not, and no other road can."""

import errno
import hashlib
import os
import re
import shutil
from collections.abc import Callable, Iterator
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import h5py
import numpy as np
import pytest

from canon.map import of_many_grounds
from canon.trench import TrenchSite, parts
from lgprjax.batch.register import true_poses
from lgprjax.formats import DriveLog, DriveWriter, MapFile, TraceRecording, check_file, locked_map
from lgprjax.mapping import UpdatedMap, update_map
from lgprjax.mapping.matching import passes_at, places_of_drives, route_of
from lgprjax.mapping.update import LocatedDrive, locate_drive
from lgprjax.radar import ArrayGeometry
from refusals import refused


class Updated(NamedTuple):
    """An updated map."""

    path: Path
    update: UpdatedMap


@pytest.fixture(scope="module", autouse=True)
def quick() -> Iterator[None]:
    """What foreign ground reaches on the new map is not looked at here; ``tests/cli`` updates one that measures it. A
    drive is located on a map once, whatever else then comes of it."""
    known: dict[tuple[str, str], LocatedDrive] = {}

    def locate_once(source: MapFile, log: DriveLog, progress: Callable[[int], None]) -> LocatedDrive:
        key = digest(source.path), digest(log.path)
        if key not in known:
            known[key] = locate_drive(source, log, progress)
        return known[key]

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("lgprjax.mapping.update.measure_chance", of_many_grounds)
        patch.setattr("lgprjax.mapping.update.locate_drive", locate_once)
        yield


@pytest.fixture(scope="module")
def once(trench: TrenchSite, tmp_path_factory: pytest.TempPathFactory) -> Updated:
    """By the first of the newer drives, in place."""
    path = tmp_path_factory.mktemp("once") / "road.map.h5"
    shutil.copyfile(trench.map, path)
    return Updated(path, update_map(path, [trench.newer[0]]))


@pytest.fixture(scope="module")
def twice(trench: TrenchSite, tmp_path_factory: pytest.TempPathFactory) -> Updated:
    """By both of them at once, as a new map."""
    path = tmp_path_factory.mktemp("twice") / "new.map.h5"
    return Updated(path, update_map(trench.map, [trench.newer[1], trench.newer[0]], path))


def digest(path: Path) -> str:
    return hashlib.sha256(path.read_bytes()).hexdigest()


def test_one_newer_drive_is_added_and_tells_of_the_trench(trench: TrenchSite, once: Updated) -> None:
    (update,) = once.update.drives
    assert (update.number, update.baseline, update.retired, update.released) == (1, 2, 0, 0)
    assert update.located_m > 9.0
    assert {stretch.baseline for stretch in update.changed} == {0, 1}
    for stretch in update.changed:
        assert stretch.agreeing == ()
        # The array's centre stands 3 m ahead of where a drive begins.
        assert stretch.start_m + 3.0 == pytest.approx(trench.trench_m[0], abs=1.0)
        assert stretch.stop_m + 3.0 == pytest.approx(trench.trench_m[1], abs=1.0)
        assert stretch.score < 0.6 * stretch.usual
    with MapFile.open(once.path) as source:
        new, held = source.drive == 2, source.retired == 1
        inside, outside = parts(trench, source.pose[:, 0])
        assert not held[~new].any()
        assert held[new & inside].all()
        assert not held[new & outside].any()
    assert check_file(once.path) == []


def test_labels_follow_the_map(trench: TrenchSite, once: Updated) -> None:
    """GNSS was wrong by 0.64 m; across the trench, where nothing matches, labels are carried by their own shape."""
    with MapFile.open(once.path) as source, DriveLog.open(trench.newer[0]) as log:
        true = true_poses(log, source.description.frame)
        assert true is not None
        stations = np.flatnonzero(source.drive == 2)
        time_s = source.read_stored(stations).place[:, 7] * 1e-4
        truth = np.stack([np.interp(time_s, log.scan_time_s, true[:, axis]) for axis in (0, 1)], axis=1)
        left = np.hypot(*(source.pose[stations, :2] - truth).T)
    assert np.sqrt(np.mean(left**2)) < 0.04
    assert left.max() < 0.12
    (update,) = once.update.drives
    assert update.moved_rms_m == pytest.approx(0.64, abs=0.15)
    # The old baselines say 1 cm and a tenth of a degree; the new one shares their errors and cannot say less.
    assert 0.01 < update.label_sigma_m < 0.1


def test_a_second_newer_drive_outvotes_the_old_ground(trench: TrenchSite, twice: Updated) -> None:
    update = twice.update.drives[1]
    assert {(stretch.baseline, stretch.agreeing) for stretch in update.changed} == {(0, (2,)), (1, (2,))}
    assert update.held_back == 0
    assert update.released > 50
    with MapFile.open(twice.path) as source, MapFile.open(trench.map) as old:
        inside, outside = parts(trench, source.pose[:, 0])
        assert np.all(source.retired[inside & (source.drive < 2)] == 2)
        assert not source.retired[source.drive >= 2].any()
        assert not source.retired[outside].any()
        # Nothing is deleted: what was stored is stored.
        stations = np.arange(len(old.places))
        was, stored = old.read_stored(stations), source.read_stored(stations)
        np.testing.assert_array_equal(stored.place, was.place)
        np.testing.assert_array_equal(stored.valid, was.valid)
        for mine, theirs in zip(stored.traces, was.traces, strict=True):
            np.testing.assert_array_equal(mine, theirs)
    assert check_file(twice.path) == []
    assert list(twice.path.parent.iterdir()) == [twice.path]


def test_weights_have_reasons(twice: Updated) -> None:
    weights = twice.update.weights
    with MapFile.open(twice.path) as source:
        assert source.description.weight == tuple(each.weight for each in weights)
        rows = source.provenance["weights"]
    assert [row["reasons"] for row in rows] == [each.reasons for each in weights]  # type: ignore[attr-defined]
    assert len(weights) == 4
    assert max(each.weight for each in weights) == 1.0
    # A year older, and as good: about half of the weight.
    assert 0.3 < weights[0].weight < 0.8
    # Days older than the newest, and by how many others it is confirmed.
    assert {"304", "3"} <= set(re.findall(r"\d+", weights[0].reasons))


def test_provenance_goes_on_and_drives_at_once_are_as_drives_one_by_one(
    trench: TrenchSite, once: Updated, twice: Updated
) -> None:
    """They were given the younger first."""
    assert [drive.name for drive in twice.update.drives] == ["newer1", "newer2"]
    with MapFile.open(twice.path) as source:
        inputs, updates = source.provenance["inputs"], source.provenance["updates"]
        assert source.provenance["steps"]
    assert isinstance(inputs, list)
    assert isinstance(updates, list)
    assert [row.get("update") for row in inputs] == [None, None, 1, 2]
    assert [row["number"] for row in updates] == [1, 2]
    assert updates[0]["map_sha256"] == digest(trench.map)
    assert updates[1]["map_sha256"] == digest(once.path)


def test_the_route_of_the_map_goes_over_what_is_in_force(trench: TrenchSite, twice: Updated) -> None:
    """So that ``map verify`` looks at the new ground in the trench, not at what was retired there."""
    with MapFile.open(twice.path) as source:
        drives = places_of_drives(source, 1.0)
        route = route_of(drives, 1.0)
        passes = passes_at(source, route)
        station = np.array([drives[n].station[place] for n, place in zip(route.drive, route.place, strict=True)])
        assert not source.retired[station[station >= 0]].any()
        length_m = float(np.ptp(source.pose[:, 0]))
    inside, outside = parts(trench, route.pose[:, 0], room_m=2.0)
    # Before the trench, in it and after it: each of these ways is of whole metres.
    assert length_m - 3.0 < len(route.at_m) <= length_m
    assert inside.sum() >= 2
    assert np.all(route.drive[inside] == 2)
    assert np.all(passes[inside] == 2)
    assert np.all(passes[outside] >= 3)


def test_a_line_walked_the_other_way_makes_as_many_stations(trench: TrenchSite, once: Updated, tmp_path: Path) -> None:
    """The same drive as an imported line whose traces are stored from its other end."""
    drive, path = tmp_path / "line.drive.h5", tmp_path / "road.map.h5"
    _as_a_line(trench.newer[0], drive)
    (update,) = update_map(trench.map, [drive], path).drives
    assert check_file(path) == []
    with MapFile.open(path) as source, MapFile.open(once.path) as plain:
        back, along = (each.pose[each.drive == 2] for each in (source, plain))
    assert update.stations == len(back)
    assert len(back) > 100
    assert abs(len(back) - len(along)) <= 1
    # The last station of one is the first of the other, and the antennas keep their sides.
    for one, other in ((0, -1), (-1, 0)):
        assert np.hypot(*(back[one, :2] - along[other, :2])) < 0.2
    assert abs(np.median(back[:, 3]) - np.median(along[:, 3])) < 0.1


def _as_a_line(drive: Path, target: Path) -> None:
    """A drive as if it had been imported from a survey line of which nobody knows the direction."""
    with DriveLog.open(drive) as log:
        recording = log.description.recording
        assert isinstance(recording, TraceRecording)
        provenance = log.description.provenance | {"lines": [], "assumed": {"direction": "as stored"}}
        description = replace(log.description, recording=replace(recording, zero_level=0.0), provenance=provenance)
        traces, valid = (each[::-1] for each in log.read_traces(0, log.scans))
        with DriveWriter.create(target, description, channels=log.channels, dtype=np.float32) as writer:
            writer.append(log.scan_time_s, traces.astype(np.float32), valid)


@pytest.mark.parametrize("wrong", ["elsewhere", "off", "twice", "channels"])
def test_a_drive_that_does_not_belong_there_changes_nothing(
    wrong: str, trench: TrenchSite, once: Updated, tmp_path: Path
) -> None:
    path, drive = tmp_path / "road.map.h5", tmp_path / "wrong.drive.h5"
    shutil.copyfile(once.path, path)
    if wrong == "elsewhere":
        shutil.copyfile(trench.elsewhere, drive)
        refusal = refused("fixes", "5 m", "20 %", file=drive, found="0 m")
    elif wrong == "off":
        shutil.copyfile(trench.newer[1], drive)
        with h5py.File(drive, "r+") as store:
            store["gnss_ins/latitude_deg"][...] += 1e-3
        # A thousandth of a degree is 111 m; the road is a little nearer than that.
        refusal = refused("/gnss_ins", "1.5 m", file=drive, found="110 m")
    elif wrong == "twice":
        shutil.copyfile(trench.newer[0], drive)
        refusal = refused("drive", "road.map.h5", file=drive, found="newer1.drive.h5")
    else:
        _with_fewer_channels(trench.newer[1], drive)
        refusal = refused("/array/y_m", 11, file=drive, found=9)
    before = digest(path)
    with refusal:
        update_map(path, [drive])
    assert digest(path) == before
    assert sorted(tmp_path.iterdir()) == [path, drive]


def _with_fewer_channels(source: Path, target: Path) -> None:
    with DriveLog.open(source) as log:
        array = log.description.array
        fewer = ArrayGeometry(array.x_m[:9], array.y_m[:9], array.time_offset_s[:9], array.height_m)
        traces, _ = log.read_traces(0, 64)
        description = replace(log.description, array=fewer)
        with DriveWriter.create(target, description, channels=9, dtype=np.uint8) as writer:
            writer.append(log.scan_time_s[:64], (traces[:, :9] + 128).astype(np.uint8))


def test_readers_keep_the_map_that_they_opened(trench: TrenchSite, once: Updated, tmp_path: Path) -> None:
    path = tmp_path / "road.map.h5"
    shutil.copyfile(once.path, path)
    with MapFile.open(path) as reader, MapFile.open(once.path) as old:
        update_map(path, [trench.newer[1]])
        stations = np.arange(len(old.places))
        assert len(reader.places) == len(old.places)
        for mine, theirs in zip(reader.read_stations(stations), old.read_stations(stations), strict=True):
            np.testing.assert_array_equal(mine, theirs)
    with MapFile.open(path) as source:
        assert len(source.description.label_sigma_m) == 4
    assert list(tmp_path.iterdir()) == [path]


# In the scratch map's stations, and when the new map is written.
@pytest.mark.parametrize("share", [0.5, 1.5])
def test_a_full_disk_is_one_line_and_the_old_map_stays(
    share: float, trench: TrenchSite, once: Updated, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "road.map.h5"
    shutil.copyfile(once.path, path)
    before, room = digest(path), share * path.stat().st_size
    real, written = os.pwrite, [0.0]

    def filling(file: int, data: bytes, offset: int) -> int:
        written[0] += len(data)
        if written[0] > room:
            raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))
        return real(file, data, offset)

    monkeypatch.setattr(os, "pwrite", filling)
    with refused("output", file=path, found=os.strerror(errno.ENOSPC)):
        update_map(path, [trench.newer[1]])
    assert digest(path) == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_damaged_map_is_refused(trench: TrenchSite, once: Updated, tmp_path: Path) -> None:
    path = tmp_path / "road.map.h5"
    shutil.copyfile(once.path, path)
    with h5py.File(path, "r") as store:
        chunk = store["baselines/codes"].id.get_chunk_info(0)
    data = bytearray(path.read_bytes())
    data[chunk.byte_offset + chunk.size // 2] ^= 0x55
    path.write_bytes(bytes(data))
    before = digest(path)
    with refused("/baselines/codes, stations 0 to 255", file=path):
        update_map(path, [trench.newer[1]])
    assert digest(path) == before
    assert list(tmp_path.iterdir()) == [path]


def test_a_map_at_work_and_an_output_that_exists_are_left_alone(
    trench: TrenchSite, once: Updated, tmp_path: Path
) -> None:
    """Behind a link it is the map that is locked."""
    path, link = tmp_path / "road.map.h5", tmp_path / "link.map.h5"
    shutil.copyfile(once.path, path)
    link.symlink_to(path)
    with locked_map(path), refused(None, file=path, found=os.getpid()):
        update_map(link, [trench.newer[1]])
    path.write_bytes(b"something")
    with refused("output", "--force", file=path):
        update_map(once.path, [trench.newer[1]], path)
    assert path.read_bytes() == b"something"
