"""Thresholds as a file: what is written is read, and what is wrong is said in one line."""

from pathlib import Path

import pytest

from lgprjax.errors import InputError
from lgprjax.formats import read_thresholds, write_thresholds

VALUES = {
    "strength_by_chance": 5.5,
    "margin_by_chance": 2.5,
    "overlap": 0.6,
    "sigma_scale": 0.6,
}


def write(path: Path, force: bool = False) -> None:
    found_on: dict[str, float | int | str] = {"map": "road.map.h5", "false": 900, "risk": 1e-4}
    write_thresholds(path, VALUES, window_m=4.0, search_m=1.5, found_on=found_on, force=force)


def test_what_is_written_is_read(tmp_path: Path) -> None:
    path = tmp_path / "x.thresholds.toml"
    write(path)
    assert read_thresholds(path, 4.0) == VALUES
    with pytest.raises(InputError, match="--force"):
        write(path)
    write(path, force=True)


@pytest.mark.parametrize(
    ("change", "place", "found"),
    [
        (("lgprjax.thresholds", "lgprjax.map"), "schema", "lgprjax.map"),
        (('version = "1.1"', 'version = "2.0"'), "version", "2.0"),
        (("overlap = 0.6", "overlap = -1.0"), "thresholds.overlap", "-1.0"),
        (("sigma_scale = 0.6", "sigma_scale = true"), "thresholds.sigma_scale", "True"),
        (("margin_by_chance = 2.5", "rand = 2.5"), "thresholds.margin_by_chance", "none"),
        (("[thresholds]", "[thresholds"), "file", "line"),
    ],
)
def test_what_is_wrong_is_named(tmp_path: Path, change: tuple[str, str], place: str, found: str) -> None:
    path = tmp_path / "x.thresholds.toml"
    write(path)
    path.write_text(path.read_text().replace(*change))
    with pytest.raises(InputError) as refused:
        read_thresholds(path, 4.0)
    assert place in str(refused.value)
    assert found in str(refused.value)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("strength", "margin", "refused"), [(0.0, 0.0, None), (0.55, 0.0, "strength"), (0.0, 1.0, "margin")]
)
def test_older_files_are_read_where_they_ask_for_nothing_absolute(
    tmp_path: Path, strength: float, margin: float, refused: str | None
) -> None:
    path = tmp_path / "x.thresholds.toml"
    write(path)
    older = f"[thresholds]\nstrength = {strength}\nmargin = {margin}"
    path.write_text(path.read_text().replace('version = "1.1"', 'version = "1.0"').replace("[thresholds]", older))
    if refused is None:
        assert read_thresholds(path, 4.0) == VALUES
        return
    with pytest.raises(InputError, match=rf"thresholds\.{refused}: expected 0: .*calibrate again") as said:
        read_thresholds(path, 4.0)
    assert "\n" not in str(said.value)


def test_thresholds_of_another_window_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "x.thresholds.toml"
    write(path)
    with pytest.raises(InputError, match="window_m"):
        read_thresholds(path, 0.0)
    with pytest.raises(InputError, match="No such file"):
        read_thresholds(tmp_path / "none.toml", 4.0)
