"""The chance of maps that hold none: measured once, kept in the user's cache folder, and no worse off without it."""

from pathlib import Path

import numpy as np
import pytest

from canon.map import write_made_map
from lgprjax.batch import chance as chance_cache
from lgprjax.batch import chance_of
from lgprjax.formats import MAP_PRECISIONS, MapFile
from lgprjax.registration import POOLED, Chance

MEASURED = POOLED._replace(pieces=99, own=True, scale=np.array([2.0, 2.1, 2.2, 2.3, 2.4]))


class Measure:
    """Counts how often a map is measured."""

    def __init__(self) -> None:
        self.times = 0

    def __call__(self, _: MapFile) -> Chance:
        self.times += 1
        return MEASURED


@pytest.fixture
def measure(monkeypatch: pytest.MonkeyPatch) -> Measure:
    counting = Measure()
    monkeypatch.setattr(chance_cache, "measure_chance", counting)
    return counting


@pytest.fixture
def cache(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "cache"))
    return tmp_path / "cache" / "lgprjax"


def told(path: Path) -> Chance:
    with MapFile.open(path) as source:
        return chance_of(source)


def check(chance: Chance) -> None:
    for one, other in zip(chance, MEASURED, strict=True):
        np.testing.assert_array_equal(one, other)


def test_a_map_without_a_chance_is_measured_once(tmp_path: Path, cache: Path, measure: Measure) -> None:
    one, same, other = (tmp_path / f"{name}.map.h5" for name in ("one", "same", "other"))
    write_made_map(one, MAP_PRECISIONS["standard"], 700)
    write_made_map(other, MAP_PRECISIONS["standard"], 800)
    same.write_bytes(one.read_bytes())
    check(told(one))
    check(told(one))
    check(told(same))
    assert measure.times == 1
    check(told(other))
    assert measure.times == 2
    assert len(list(cache.iterdir())) == 2


def test_a_damaged_cache_is_measured_anew_and_mended(tmp_path: Path, cache: Path, measure: Measure) -> None:
    path = tmp_path / "one.map.h5"
    write_made_map(path, MAP_PRECISIONS["standard"], 700)
    told(path)
    (kept,) = cache.iterdir()
    whole = kept.read_bytes()
    damages = (b"", b"{", b'{"method": 1}', b"\xff", whole.replace(b"2.4", b"NaN"))
    for number, damage in enumerate(damages):
        kept.write_bytes(damage)
        check(told(path))
        assert measure.times == 2 + number, damage
        assert kept.read_bytes() == whole
    check(told(path))
    assert measure.times == 1 + len(damages)


def test_a_cache_that_cannot_be_written_costs_only_the_time(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, measure: Measure
) -> None:
    (tmp_path / "file").write_text("no folder")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "file"))
    path = tmp_path / "one.map.h5"
    write_made_map(path, MAP_PRECISIONS["standard"], 700)
    check(told(path))
    check(told(path))
    assert measure.times == 2
