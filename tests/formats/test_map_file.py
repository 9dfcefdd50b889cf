"""The subsurface database on disk: round trip, copies, files of version 1.0, damage, and what a tile is made from."""

import json
import re
from pathlib import Path

import h5py
import numpy as np
import pytest

from canon.map import GAIN, made_stations, write_made_map
from lgprjax.errors import InputError
from lgprjax.formats import MAP_PRECISIONS, MapFile, MapWriter, check_file, copy_stations
from lgprjax.formats.map_layout import BLOCK
from lgprjax.subsurface import GroundMap, StationBlock
from refusals import refused

STATIONS = 1500
BYTES = 0xA5


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("maps")


@pytest.fixture(scope="module")
def blocks(folder: Path) -> list[StationBlock]:
    """The same stations in every precision."""
    written = [write_made_map(folder / f"{name}.map.h5", each) for name, each in MAP_PRECISIONS.items()]
    return written[0]


def gained_correlation(a: np.ndarray, b: np.ndarray) -> float:
    a, b = a.astype(np.float64) * GAIN, b.astype(np.float64) * GAIN
    return float(np.sum(a * b) / np.sqrt(np.sum(a**2) * np.sum(b**2)))


@pytest.mark.parametrize(("name", "least"), [("full", 0.9999995), ("standard", 0.985), ("small", 0.95)])
def test_stations_come_back(folder: Path, blocks: list[StationBlock], name: str, least: float) -> None:
    with MapFile.open(folder / f"{name}.map.h5") as source:
        assert len(source.places) == 2 * STATIONS
        assert source.precision == MAP_PRECISIONS[name]
        assert source.description.weight == ()
        assert not source.retired.any()
        read = source.read_stations(np.arange(2 * STATIONS))
        whole = StationBlock(*(np.concatenate(fields) for fields in zip(*blocks, strict=True)))
        np.testing.assert_array_equal(read.valid, whole.valid)
        np.testing.assert_allclose(source.pose[:, :3], whole.pose[:, :3], atol=0.51e-4)
        np.testing.assert_allclose(source.pose[:, 3:], whole.pose[:, 3:], atol=0.51e-5)
        np.testing.assert_allclose(source.ground_up_m, whole.ground_up_m, atol=0.51e-4)
        np.testing.assert_array_equal(source.drive, np.repeat([0, 1], STATIONS))
        np.testing.assert_allclose(read.antenna_m, whole.antenna_m, atol=4e-4)
        assert not read.profile[~read.valid].any()
        assert gained_correlation(read.profile, whole.profile) > least
        some = np.array([3, 4, 5, 255, 256, 1023, 1024, 1499, 1500, 2999])
        part = source.read_stations(some)
        np.testing.assert_allclose(part.profile, read.profile[some], atol=1e-5)
        np.testing.assert_array_equal(part.antenna_m, read.antenna_m[some])
        np.testing.assert_array_equal(source.places.read(some).pose, source.pose[some])
    assert check_file(folder / f"{name}.map.h5") == []


def test_fewer_bits_take_fewer_bytes(folder: Path, blocks: list[StationBlock]) -> None:
    assert len(blocks) == 2
    sizes = []
    for name in ("full", "standard", "small"):
        path = folder / f"{name}.map.h5"
        with MapFile.open(path) as source:
            parts = source.stored_bytes()
        assert sum(parts.values()) == path.stat().st_size
        assert min(parts.values()) > 0
        sizes.append(parts["traces"])
    assert sizes[0] > 4 * sizes[1]
    assert sizes[1] > 1.3 * sizes[2]
    # How it is stored is told, and every array is under checksums.
    with h5py.File(folder / "standard.map.h5") as store:
        assert store.attrs["precision"].decode() == "standard"
        assert json.loads(store.attrs["chain"])["step_m"] > 0.0
        assert all(store["baselines"][name].fletcher32 for name in store["baselines"])
        assert "time_s" not in store["baselines"]


def test_retired_stations_are_not_valid_and_weights_are_read(tmp_path: Path) -> None:
    path, old = tmp_path / "a.map.h5", tmp_path / "old.map.h5"
    write_made_map(old, MAP_PRECISIONS["standard"], weight=(0.5, 1.0))
    retired = np.zeros(2 * STATIONS, np.uint8)
    retired[200:230] = 3
    with MapFile.open(old) as source, MapWriter.create(path) as writer:
        copy_stations(source, writer)
        writer.finish(source.description, source.tile_frame, source.height_reference_m, {}, retired=retired)
    with MapFile.open(path) as source:
        assert source.description.weight == (0.5, 1.0)
        np.testing.assert_array_equal(source.retired, retired)
        valid = source.read_stations(np.arange(190, 240)).valid
        assert valid[:10].all()
        assert not valid[10:40].any()
        assert valid[40:].all()
        stored = source.read_stored(np.arange(200, 230))
        assert stored.valid.all()


def test_a_copy_holds_the_same_numbers_and_goes_on_in_the_same_code(folder: Path, tmp_path: Path) -> None:
    path, later = tmp_path / "copy.map.h5", made_stations(400, 9, aside_m=-0.5)
    with MapFile.open(folder / "standard.map.h5") as source:
        shifted = source.pose + [10.0, -20.0, 0.0, 0.1, 0.0]
        with MapWriter.create(path, precision=MAP_PRECISIONS["full"]) as writer:
            copy_stations(source, writer)
            copy_stations(source, writer, shifted)
            writer.append(later, 2)
            writer.finish(source.description, source.tile_frame, source.height_reference_m, {})
        every = np.arange(2 * STATIONS)
        with MapFile.open(path) as copy:
            assert copy.precision == source.precision
            first, again = copy.read_stored(every), copy.read_stored(every + 2 * STATIONS)
            stored = source.read_stored(every)
            for a, b in zip(first, stored, strict=True):
                for one, other in zip(a, b, strict=True) if isinstance(a, tuple) else [(a, b)]:
                    np.testing.assert_array_equal(one, other)
            np.testing.assert_array_equal(again.traces[0], stored.traces[0])
            np.testing.assert_allclose(copy.pose[2 * STATIONS : 4 * STATIONS], shifted, atol=1e-4)
            # Antennas turn with their array, by 0.1 rad about its centre.
            a, b = (copy.read_stations(np.array([n])).antenna_m[0] for n in (700, 700 + 2 * STATIONS))
            turn = np.array([[np.cos(0.1), np.sin(0.1)], [-np.sin(0.1), np.cos(0.1)]])
            np.testing.assert_allclose(b[:, :2], a[:, :2] @ turn, atol=2e-5)
            own = copy.read_stations(np.arange(4 * STATIONS, 4 * STATIONS + 400))
            assert gained_correlation(own.profile, later.profile) > 0.98
            assert copy.description.label_sigma_m == (0.0, 0.0, 0.0)
    # Two drives, twice one after the other: the order of drives is broken, and said to be.
    (finding,) = check_file(path)
    assert finding.place == "/baselines"


def test_another_code_is_not_appended(folder: Path, tmp_path: Path) -> None:
    def write() -> None:
        with (
            MapFile.open(folder / "standard.map.h5") as coded,
            MapFile.open(folder / "full.map.h5") as sampled,
            MapWriter.create(tmp_path / "a.map.h5") as writer,
        ):
            copy_stations(coded, writer)
            copy_stations(sampled, writer)

    with refused("/code/basis"):
        write()
    assert not list(tmp_path.iterdir())


def _to_version_1_0(path: Path, block: StationBlock) -> None:
    """What version 1.0 wrote: floats, nothing that names a precision."""
    with h5py.File(path, "r+") as store:
        held = store["baselines"]
        for name in ("place", "antenna", "valid"):
            del held[name]
        del store["stretches"], store.attrs["precision"]
        store.attrs["schema_version"] = "1.0"
        scans = len(block.pose)
        old = {
            "pose": ("m, m, m, rad, rad", block.pose),
            "ground_up_m": ("m", block.ground_up_m),
            "antenna_m": ("m", block.antenna_m.astype(np.float32)),
            "drive": ("", np.repeat([0, 1], scans // 2).astype(np.int32)),
            "time_s": ("s", block.time_s),
            "valid": ("", block.valid),
        }
        for name, (unit, values) in old.items():
            held.create_dataset(name, data=values).attrs["unit"] = unit


def test_a_file_of_version_1_0_is_read_and_copied(folder: Path, tmp_path: Path) -> None:
    path, new = tmp_path / "old.map.h5", tmp_path / "new.map.h5"
    blocks = write_made_map(path, MAP_PRECISIONS["full"])
    whole = StationBlock(*(np.concatenate(fields) for fields in zip(*blocks, strict=True)))
    _to_version_1_0(path, whole)
    assert check_file(path) == []
    with MapFile.open(path) as old, MapFile.open(folder / "full.map.h5") as present:
        assert old.precision == MAP_PRECISIONS["full"]
        np.testing.assert_array_equal(old.pose, whole.pose)
        some = np.array([5, 300, 301, 2999])
        a, b = old.read_stations(some), present.read_stations(some)
        np.testing.assert_array_equal(a.profile, b.profile)
        np.testing.assert_allclose(a.antenna_m, b.antenna_m, atol=4e-4)
        grounds = [GroundMap(each, half_along_m=4.0, half_cross_m=4.0).tile(5) for each in (old, present)]
        a_tile, b_tile = (np.asarray(tile.coefficients, np.float64) for tile in grounds)
        assert np.sum(a_tile * b_tile) > 0.9995 * np.linalg.norm(a_tile) * np.linalg.norm(b_tile)
        with MapWriter.create(new) as writer:
            copy_stations(old, writer)
            writer.finish(old.description, old.tile_frame, old.height_reference_m, {})
    with MapFile.open(new) as copy:
        np.testing.assert_array_equal(copy.read_stations(some).profile, a.profile)
        np.testing.assert_allclose(copy.pose, whole.pose, atol=0.51e-4)


def _damage(path: Path, dataset: str, chunk: int) -> None:
    with h5py.File(path) as store:
        found = store[dataset].id.get_chunk_info(chunk)
    with path.open("r+b") as stream:
        stream.seek(found.byte_offset + found.size // 2)
        stream.write(bytes([BYTES]) * 8)


@pytest.mark.parametrize("dataset", ["codes", "place"])
def test_damage_is_told_where_it_is_read_and_nowhere_else(tmp_path: Path, dataset: str) -> None:
    path = tmp_path / "a.map.h5"
    write_made_map(path, MAP_PRECISIONS["standard"])
    # Only the last station's place is read on opening: chunk 1 is none that holds it.
    _damage(path, f"baselines/{dataset}", 1)
    low = BLOCK if dataset == "codes" else 1024
    stop = 2 * low
    with MapFile.open(path) as source:
        source.read_stations(np.arange(low - 10, low))
        source.read_stations(np.arange(stop, stop + 10))
        with pytest.raises(InputError) as caught:
            source.read_stations(np.arange(low + 5, low + 20))
        told = re.fullmatch(rf"/baselines/{dataset}, stations (\d+) to (\d+)", caught.value.place)
        assert told is not None
        assert low <= int(told[1]) <= low + 5
        ground = GroundMap(source, half_along_m=4.0, half_cross_m=4.0)
        bad = next(n for n in range(len(source.tile_frame)) if np.isin(low + 5, _under(source, n)))
        with pytest.raises(InputError) as caught:
            ground.tile(bad)
        assert caught.value.place.startswith(f"/baselines/{dataset}, ")
    (finding,) = check_file(path)
    assert (finding.place, finding.severity) == (f"/baselines/{dataset}", "error")


def _under(source: MapFile, tile: int) -> np.ndarray:
    """Stations of the first baseline within a metre of a frame, by the made-up road."""
    road = made_stations(STATIONS, 1).pose
    return np.flatnonzero(np.hypot(*(road[:, :2] - source.tile_frame[tile, :2]).T) < 1.0)


def test_random_damage_is_told_or_harmless(tmp_path: Path) -> None:
    path = tmp_path / "a.map.h5"
    write_made_map(path, MAP_PRECISIONS["standard"], stations=800)
    with MapFile.open(path) as source:
        right = source.read_stations(np.arange(1600))
        gain = source.description.gain
    whole = path.read_bytes()
    rng = np.random.default_rng(5)
    told = 0
    for _ in range(24):
        damaged = np.frombuffer(whole, np.uint8).copy()
        damaged[rng.integers(0, len(whole), 4)] = rng.integers(0, 256, 4)
        path.write_bytes(damaged.tobytes())
        try:
            with MapFile.open(path) as source:
                read = source.read_stations(np.arange(1600))
                # Of what can change unseen (arrays of a few hundred bytes) none scales single stations.
                if np.array_equal(source.description.gain, gain):
                    np.testing.assert_array_equal(read.profile, right.profile)
        except InputError:
            told += 1
    assert told > 18


def test_parts_that_do_not_agree_are_told(tmp_path: Path) -> None:
    path = tmp_path / "a.map.h5"
    write_made_map(path, MAP_PRECISIONS["standard"], weight=(1.0, 1.0))
    with h5py.File(path, "r+") as store:
        store["stretches/reach_m"][10] *= 0.5
    assert {finding.place for finding in check_file(path)} == {"/stretches/reach_m"}
    with h5py.File(path, "r+") as store:
        del store["drives/weight"]
        store["drives"].create_dataset("weight", data=np.ones(3)).attrs["unit"] = ""
    with refused("/drives/weight", 2, found=3):
        MapFile.open(path)
    assert {finding.place for finding in check_file(path)} == {"/drives/weight"}
    with h5py.File(path, "r+") as store:
        del store["drives/weight"]
        store["code/basis"][3] *= 1.1
    with refused("/code/basis"):
        MapFile.open(path)
    assert "/code/basis" in {finding.place for finding in check_file(path)}


def test_a_gain_that_is_not_the_codes_is_refused(folder: Path, tmp_path: Path) -> None:
    def write() -> None:
        with MapFile.open(folder / "standard.map.h5") as source, MapWriter.create(tmp_path / "a.map.h5") as writer:
            copy_stations(source, writer)
            wrong = source.description._replace(gain=2.0 * GAIN)
            writer.finish(wrong, source.tile_frame, source.height_reference_m, {})

    with refused("/gain"):
        write()
    assert not list(tmp_path.iterdir())
