"""A map's chance in its file: written before the map has its name, read back, none where it is of another kind."""

from pathlib import Path

import h5py
import numpy as np
import pytest

from canon.map import write_made_map
from lgprjax.formats import (
    MAP_PRECISIONS,
    MapFile,
    MapWriter,
    chance_as_text,
    chance_of_text,
    check_file,
    copy_stations,
)
from lgprjax.registration import POOLED, Chance
from refusals import refused

CHANCE = Chance(
    start=np.array([20.5, 19.25, 17.0, 15.0, 13.0]),
    share=np.array([0.1, 0.1, 0.11, 0.12, 0.1]),
    scale=np.array([2.0, 2.5, 3.0, 3.5, 4.0]),
    area_m2=np.array([8.0, 8.5, 8.25, 8.0, 7.75]),
    pieces=171,
    own=True,
    sigma_scale=1.375,
    left_out=41,
    label_scatter_m=0.03125,
)


def same(a: Chance, b: Chance) -> bool:
    return all(np.array_equal(np.asarray(one), np.asarray(other)) for one, other in zip(a, b, strict=True))


@pytest.fixture(scope="module")
def old(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A map as older versions wrote it: without a chance."""
    path = tmp_path_factory.mktemp("old") / "old.map.h5"
    write_made_map(path, MAP_PRECISIONS["standard"])
    return path


def with_chance(old: Path, path: Path) -> None:
    """A copy of a map, with a chance that was measured on what had been written."""
    seen = []

    def measure(unnamed: MapFile) -> Chance:
        assert not path.exists()
        some = np.arange(250, 1300, 7)
        seen.append((unnamed.description, unnamed.pose, unnamed.read_stations(some).profile))
        return CHANCE

    with MapFile.open(old) as source, MapWriter.create(path) as writer:
        copy_stations(source, writer)
        writer.finish(source.description, source.tile_frame, source.height_reference_m, {})
        writer.add_chance(measure)
        ((description, pose, profile),) = seen
        assert description.channels == source.description.channels
        np.testing.assert_array_equal(pose, source.pose)
        np.testing.assert_array_equal(profile, source.read_stations(np.arange(250, 1300, 7)).profile)


def test_what_is_measured_on_the_unnamed_map_is_read_from_the_named_one(old: Path, tmp_path: Path) -> None:
    path = tmp_path / "new.map.h5"
    with_chance(old, path)
    assert check_file(path) == []
    with MapFile.open(path) as source:
        assert source.chance is not None
        assert same(source.chance, CHANCE)
    with MapFile.open(old) as source:
        assert source.chance is None


def test_a_measurement_that_fails_leaves_no_map(old: Path, tmp_path: Path) -> None:
    path = tmp_path / "new.map.h5"

    def measure(_: MapFile) -> Chance:
        raise RuntimeError("no")

    def write() -> None:
        with MapFile.open(old) as source, MapWriter.create(path) as writer:
            copy_stations(source, writer)
            writer.finish(source.description, source.tile_frame, source.height_reference_m, {})
            writer.add_chance(measure)

    with pytest.raises(RuntimeError, match="no"):
        write()
    assert list(tmp_path.iterdir()) == []


def test_a_chance_of_another_kind_is_none_and_a_damaged_one_named(old: Path, tmp_path: Path) -> None:
    def another_method(store: h5py.File) -> None:
        store["chance"].attrs["method"] += 1

    def another_window(store: h5py.File) -> None:
        store["chance/window_m"][-1] = 9.0

    for change in (another_method, another_window):
        path = tmp_path / f"{change.__name__}.map.h5"
        with_chance(old, path)
        with h5py.File(path, "r+") as store:
            change(store)
        with MapFile.open(path) as source:
            assert source.chance is None
    path = tmp_path / "new.map.h5"
    with_chance(old, path)
    with h5py.File(path, "r+") as store:
        store["chance/scale"][2] = -1.0
    with refused("/chance/scale", "1 of 5"):
        MapFile.open(path)


def test_a_map_of_schema_1_2_has_the_scale_of_many_grounds(old: Path, tmp_path: Path) -> None:
    path = tmp_path / "new.map.h5"
    with_chance(old, path)
    with h5py.File(path, "r+") as store:
        for name in ("sigma_scale", "left_out"):
            del store["chance"].attrs[name]
        store.attrs["schema_version"] = "1.2"
    assert check_file(path) == []
    with MapFile.open(path) as source:
        assert source.chance is not None
        assert same(source.chance, CHANCE._replace(sigma_scale=POOLED.sigma_scale, left_out=0))


def test_text_comes_back_and_damaged_text_does_not() -> None:
    text = chance_as_text(CHANCE)
    back = chance_of_text(text)
    assert back is not None
    assert same(back, CHANCE)
    poor = [text.replace("1.375", sigma) for sigma in ("NaN", "Infinity", "-1.375", "0.0")]
    poor += ["", "[]", text[:-20], text.replace('"method": ', '"method": 9'), text.replace("20.5", "-20.5")]
    for damaged in poor:
        assert damaged != text
        assert chance_of_text(damaged) is None
