"""Fixes tables: both files hold the table, and a bad one is refused in one line."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd

from lgprjax.formats import check_file, read_fix_poses, read_fixes, write_fixes
from refusals import refused

_HEADER = (
    "scan,time_s,latitude_deg,longitude_deg,height_m,heading_deg,roll_deg,"
    "sigma_along_m,sigma_cross_m,correlation,margin,overlap_channels,code"
)


def _table(rows: int = 4) -> pd.DataFrame:
    index = np.arange(rows)
    some = np.where(index % 2 == 0, 0.25, np.nan)
    return pd.DataFrame(
        {
            "scan": index,
            "time_s": index / 126,
            "latitude_deg": 42.123456789 + some,
            "longitude_deg": -71.987654321 + some,
            "height_m": some,
            "heading_deg": some,
            "roll_deg": some,
            "sigma_along_m": some,
            "sigma_cross_m": some,
            "correlation": some,
            "margin": some,
            "overlap_channels": np.where(index % 2 == 0, 11, 0),
            "code": np.where(index % 2 == 0, "ok", "no_window"),
        }
    )


def _write(folder: Path, table: pd.DataFrame, **options: object) -> tuple[Path, Path]:
    paths = folder / "a.fixes.csv", folder / "a.fixes.h5"
    write_fixes(*paths, table, attributes={"name": "a", "anchor_height_m": 3.5, "steps": [1, 2]}, **options)  # type: ignore[arg-type]
    return paths


def test_csv_is_as_the_contract_says(tmp_path: Path) -> None:
    path, _ = _write(tmp_path, _table())
    lines = path.read_text().splitlines()
    assert lines[0] == _HEADER
    assert (
        lines[1]
        == "0,0.000000,42.3734567890,-71.7376543210,0.2500,0.250000,0.250000,0.2500,0.2500,0.250000,0.250000,11,ok"
    )
    assert lines[2] == "1,0.007937" + "," * 10 + "0,no_window"


def test_probabilities_keep_their_digits_over_decades(tmp_path: Path) -> None:
    table = _table().assign(p_false=[1.0, 3.25e-31, 0.0, 4.56e-5], window_m=[0.0, 1.0, 8.0, np.nan])
    path, _ = _write(tmp_path, table)
    assert [line.split(",")[-2:] for line in path.read_text().splitlines()[:3]] == [
        ["p_false", "window_m"],
        ["1", "0.000"],
        ["3.25e-31", "1.000"],
    ]
    np.testing.assert_allclose(read_fixes(path)["p_false"], table["p_false"], rtol=1e-9)
    np.testing.assert_array_equal(read_fixes(path)["window_m"], table["window_m"])
    with refused("column p_false", found="4 of 4"):
        _write(tmp_path, table.assign(p_false=1.5), force=True)


def test_both_files_hold_the_table(tmp_path: Path) -> None:
    table = _table(4000)
    pose = np.arange(20000.0).reshape(-1, 5)
    covariance = np.ones((4000, 5, 5), np.float32)
    csv_path, h5_path = _write(tmp_path, table, pose_m=pose, covariance=covariance)
    pd.testing.assert_frame_equal(read_fixes(h5_path), table, check_dtype=False)
    pd.testing.assert_frame_equal(read_fixes(csv_path), table, check_dtype=False, atol=1e-6, rtol=0)
    np.testing.assert_allclose(read_fixes(csv_path)["latitude_deg"], table["latitude_deg"], atol=1e-9, rtol=0)
    found = read_fix_poses(h5_path)
    assert found[0] is not None
    assert found[1] is not None
    np.testing.assert_array_equal(found[0], pose)
    assert found[1].dtype == np.float32
    assert read_fixes(h5_path).attrs["anchor_height_m"] == 3.5
    assert read_fixes(h5_path).attrs["steps"] == "[1, 2]"
    assert check_file(csv_path) == []
    assert check_file(h5_path) == []


def test_optional_parts(tmp_path: Path) -> None:
    csv_path, h5_path = _write(tmp_path, _table().assign(time_scale=1.01))
    assert csv_path.read_text().splitlines()[0] == _HEADER + ",time_scale"
    assert read_fixes(csv_path)["time_scale"].tolist() == [1.01] * 4
    assert read_fix_poses(h5_path) == (None, None)


_BAD_TABLES: list[tuple[Callable[[pd.DataFrame], pd.DataFrame], str, tuple[object, ...]]] = [
    (lambda t: t.drop(columns="margin"), "column margin", ("none",)),
    (lambda t: t.assign(speed=1.0), "columns", ("data_schema/fixes.toml", "speed")),
    (lambda t: t.assign(code="fine"), "column code", ("ok, low_correlation", "4 of 4")),
    (lambda t: t.assign(time_s=0.0), "column time_s", ("3 of 4",)),
    (lambda t: t.assign(latitude_deg=95.0), "column latitude_deg", (-90, 90, "4 of 4")),
    (lambda t: t.assign(sigma_along_m=-1.0), "column sigma_along_m", ("4 of 4",)),
    (lambda t: t.assign(scan=0.5), "column scan", ("int64",)),
    (lambda t: t.iloc[:0], "rows", ("none",)),
]


def test_a_bad_table_is_refused_and_leaves_nothing(tmp_path: Path) -> None:
    for change, place, values in _BAD_TABLES:
        with refused(place, *values):
            _write(tmp_path, change(_table()))
        assert list(tmp_path.iterdir()) == []


def test_what_does_not_fit_or_exists_leaves_both_files(tmp_path: Path) -> None:
    with refused("/pose_m", "(3, 5)"):
        _write(tmp_path, _table(), pose_m=np.zeros((3, 5)))
    assert list(tmp_path.iterdir()) == []
    (tmp_path / "a.fixes.h5").write_text("mine")
    with refused("output", "--force", file="a.fixes.h5"):
        _write(tmp_path, _table())
    assert [path.name for path in tmp_path.iterdir()] == ["a.fixes.h5"]


_BAD_CSV: list[tuple[Callable[[str], str], str, tuple[object, ...]]] = [
    (lambda text: text[:0], "file", ()),
    (lambda text: text.replace("margin", "gap"), "header", ("scan,time_s", "gap")),
    (lambda text: text.replace("0.007937", "soon"), "column time_s, row 1", ("'soon'",)),
    (lambda text: text.replace("\n1,", "\n1.5,"), "column scan, row 1", ("'1.5'",)),
    (lambda text: text.replace("\n1,", "\n,"), "column scan, row 1", ("''",)),
    (lambda text: text.replace("no_window", "NoWindow"), "column code", ("2 of 4",)),
    (lambda text: text.replace("0.007937", ""), "column time_s", ("1 of 4",)),
    (lambda text: text + "9,9,9,9,9,9,9,9,9,9,9,9,9,9,9,9\n", "file", ()),
    (lambda text: text.splitlines()[0] + "\n", "rows", ("none",)),
]


def test_a_bad_csv_is_refused(tmp_path: Path) -> None:
    path, _ = _write(tmp_path, _table())
    text = path.read_text()
    for edit, place, values in _BAD_CSV:
        path.write_text(edit(text))
        with refused(place, *values, file=path):
            read_fixes(path)
        assert place in [finding.place for finding in check_file(path)]
