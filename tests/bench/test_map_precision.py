"""The table of precisions and the long road on disk: coded as if built so, rows of made-up fixes, a road laid twice."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.long_map import RepeatedRoad
from benchmarks.map_precision import Outcome, Size, ratio_of, recode, row_of, size_of
from benchmarks.stored_road import write_road
from canon.map import write_made_map
from lgprjax.formats import MAP_PRECISIONS, MapFile
from lgprjax.subsurface import GroundMap


def test_a_map_coded_anew_is_what_it_would_have_been(tmp_path: Path) -> None:
    full, direct, again = (tmp_path / f"{name}.map.h5" for name in ("full", "direct", "again"))
    write_made_map(full, MAP_PRECISIONS["full"], stations=700)
    write_made_map(direct, MAP_PRECISIONS["standard"], stations=700)
    with MapFile.open(full) as source:
        recode(source, again, MAP_PRECISIONS["standard"])
    a, b = size_of(direct, full), size_of(again, full)
    assert a.correlation == pytest.approx(b.correlation, abs=1e-4)
    assert 0.98 < a.correlation < 0.9995
    assert a.trace_bytes == pytest.approx(b.trace_bytes, rel=0.01)
    assert a.numbers == 1400 * 5 * 40
    assert a.length_m == pytest.approx(2 * 699 * 0.04, rel=0.02)
    assert size_of(full, full).correlation == pytest.approx(1.0)


def outcome(error_m: np.ndarray, ok: np.ndarray) -> Outcome:
    return Outcome(error_m, ok, 1, 50)


def test_a_row_tells_errors_of_what_is_ok_and_how_sure_their_ratio_is() -> None:
    rng = np.random.default_rng(1)
    error_m, ok = np.abs(rng.normal(0.0, 0.01, 2800)), np.ones(2800, bool)
    error_m[:100], ok[:100] = np.nan, False
    full = outcome(error_m, ok)
    worse = outcome(1.5 * error_m, ok)
    worse.error_m[200] = 0.4
    sizes = [Size(10.0, 1000, 800, 1600, 0.9), Size(30.0, 3000, 2400, 4800, 0.7)]
    row = row_of("x", sizes, worse, full)
    assert (row["bytes_per_m"], row["trace_bytes_per_m"], row["bits_a_number"]) == (100, 80, 4.0)
    assert row["correlation"] == 0.8
    assert row["ok"] == pytest.approx(2700 / 2800, abs=1e-4)
    assert (row["wrong_ok"], row["impostor_ok"], row["scans"]) == (1, 1, 2800)
    right = row_of("y", sizes, outcome(1.5 * error_m, ok), full)
    assert right["rms_ratio"] == pytest.approx(1.5, abs=1e-3)
    low, high = ratio_of(outcome(1.5 * error_m, ok), full, np.random.default_rng(0))
    assert low == pytest.approx(1.5, abs=1e-6)
    assert high == pytest.approx(1.5, abs=1e-6)
    other = outcome(np.abs(rng.normal(0.0, 0.01, 2800)), ok)
    low, high = ratio_of(other, full, np.random.default_rng(0))
    assert low < 1.0 < high
    assert high - low < 0.2


def test_a_road_laid_twice_is_the_repeated_road(tmp_path: Path) -> None:
    path, once, twice = tmp_path / "road.map.h5", RepeatedRoad(40.0, 40.0), RepeatedRoad(80.0, 40.0)
    write_road(path, once, 2, MAP_PRECISIONS["full"])
    with MapFile.open(path) as source:
        assert len(source.places) == len(twice.pose)
        np.testing.assert_allclose(source.pose, twice.pose, atol=1e-4)
        np.testing.assert_allclose(source.tile_frame, twice.tile_frame, atol=1e-9)
        stored, held = (GroundMap(each, half_along_m=3.0, half_cross_m=3.0) for each in (source, twice))
        number = len(source.tile_frame) // 2
        a, b = (np.asarray(each.tile(number).coefficients) for each in (stored, held))
        np.testing.assert_allclose(a, b, atol=0.01 * np.abs(b).max())
    assert list(tmp_path.iterdir()) == [path]
