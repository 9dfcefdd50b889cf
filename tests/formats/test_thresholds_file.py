"""Thresholds as a file: what is written is read, and what is wrong is refused at its place."""

from pathlib import Path

import pytest

from lgprjax.formats import read_thresholds, write_thresholds
from refusals import refused

VALUES = {"strength_by_chance": 5.5, "margin_by_chance": 2.5, "overlap": 0.6, "sigma_scale": 0.6}


@pytest.fixture
def path(tmp_path: Path) -> Path:
    path = tmp_path / "x.thresholds.toml"
    _write(path)
    return path


def _write(path: Path, force: bool = False) -> None:
    found_on: dict[str, float | int | str] = {"map": "road.map.h5", "false": 900, "risk": 1e-4}
    write_thresholds(path, VALUES, window_m=4.0, search_m=1.5, found_on=found_on, force=force)


def test_what_is_written_is_read(path: Path) -> None:
    assert read_thresholds(path, 4.0) == VALUES
    with refused("output", "--force", file=path):
        _write(path)
    _write(path, force=True)


@pytest.mark.parametrize(
    ("old", "new", "place", "value"),
    [
        ("lgprjax.thresholds", "lgprjax.map", "schema", "lgprjax.map"),
        ('version = "1.1"', 'version = "2.0"', "version", "2.0"),
        ("overlap = 0.6", "overlap = -1.0", "thresholds.overlap", "-1.0"),
        ("sigma_scale = 0.6", "sigma_scale = true", "thresholds.sigma_scale", "True"),
        ("margin_by_chance = 2.5", "rand = 2.5", "thresholds.margin_by_chance", "none"),
        ("[thresholds]", "[thresholds", "file", "TOML"),
    ],
)
def test_what_is_wrong_is_named(path: Path, old: str, new: str, place: str, value: str) -> None:
    path.write_text(path.read_text().replace(old, new))
    with refused(place, value, file=path):
        read_thresholds(path, 4.0)


def test_older_files_are_read_where_they_ask_for_nothing_absolute(path: Path) -> None:
    text = path.read_text().replace('version = "1.1"', 'version = "1.0"')
    for strength, margin, place in ((0.0, 0.0, None), (0.55, 0.0, "strength"), (0.0, 1.0, "margin")):
        older = f"[thresholds]\nstrength = {strength}\nmargin = {margin}"
        path.write_text(text.replace("[thresholds]", older))
        if place is None:
            assert read_thresholds(path, 4.0) == VALUES
        else:
            with refused(f"thresholds.{place}", 0, found=max(strength, margin)):
                read_thresholds(path, 4.0)


def test_thresholds_of_another_window_and_none_are_refused(path: Path) -> None:
    with refused("window_m", 4):
        read_thresholds(path, 0.0)
    with refused("file", file="none.toml"):
        read_thresholds(path.with_name("none.toml"), 4.0)
