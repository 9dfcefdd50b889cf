"""``lgprjax thresholds`` and what ``register`` does with its file."""

import json
import tomllib
from pathlib import Path

import pandas as pd
import pytest

from canon.site import Site
from lgprjax.cli import main


def run(*arguments: object) -> int:
    """Exit status of a command."""
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    code = stopped.value.code
    assert isinstance(code, int)
    return code


@pytest.fixture(scope="module")
def calibrated(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thresholds of windows of 2 m, on the site's own live drive: shorter ones leave its 25 m too coarse a tail."""
    folder = tmp_path_factory.mktemp("thresholds")
    path, figures = folder / "site.thresholds.toml", folder / "figures.json"
    status = run(
        "thresholds", site.map, site.logs["live"], "-o", path, "--window-m", 2, "--risk", 1e-3, "--json", figures
    )
    assert status == 0
    told = json.loads(figures.read_text())
    assert told["right"] > 0.95 * told["matches"]
    assert told["false"] > 300
    assert told["pass"] > 0.95
    return path


def test_the_file_says_what_it_was_found_on(site: Site, calibrated: Path) -> None:
    held = tomllib.loads(calibrated.read_text())
    assert held["window_m"] == 2.0
    assert held["search_m"] == 2.5
    assert set(held["thresholds"]) == {"strength_by_chance", "margin_by_chance", "overlap", "sigma_scale"}
    assert held["found_on"]["map"] == site.map.name
    assert held["found_on"]["drives"] == site.logs["live"].name
    # The limits lie above every false match that was seen.
    assert held["thresholds"]["strength_by_chance"] > held["found_on"]["highest_false_strength"] * 0.9
    assert 0.2 < held["thresholds"]["sigma_scale"] < 3.0


def test_register_uses_it(site: Site, calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    drives = (site.logs["live"], site.logs["impostor"])
    status = run("register", site.map, *drives, "-o", tmp_path, "--window-m", 2, "--thresholds", calibrated)
    assert status == 0
    assert "few scans of impostor are ok, most are low_correlation: " in capsys.readouterr().out
    live, impostor = (pd.read_csv(tmp_path / f"{name}.fixes.csv") for name in ("live", "impostor"))
    tried = live["code"] != "no_window"
    assert (live["code"][tried] == "ok").mean() > 0.9
    assert not (impostor["code"] == "ok").any()


def test_thresholds_of_another_window_are_refused(
    site: Site, calibrated: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bare = ("register", site.map, site.logs["live"], "-o", tmp_path / "out", "--thresholds", calibrated)
    assert run(*bare) == 2
    assert "--thresholds: needs --window-m as well" in capsys.readouterr().err
    assert run(*bare, "--window-m", 1) == 1
    said = capsys.readouterr().err.strip()
    assert "window_m" in said
    assert len(said.splitlines()) == 1
    assert not (tmp_path / "out").exists()


def test_nothing_is_overwritten_and_no_risk_is_nonsense(site: Site, calibrated: Path, tmp_path: Path) -> None:
    before = calibrated.read_text()
    assert run("thresholds", site.map, site.logs["live"], "-o", calibrated, "--window-m", 1) == 1
    assert calibrated.read_text() == before
    live = site.logs["live"]
    assert run("thresholds", site.map, live, "-o", tmp_path / "x.toml", "--window-m", 1, "--risk", 2) == 2
    assert run("thresholds", site.map, "-o", tmp_path / "x.toml", "--window-m", 1) == 2
    assert run("thresholds", site.map, site.logs["live"], "-o", tmp_path / "x.toml") == 2


@pytest.mark.parametrize(
    ("option", "value"),
    [("--search-m", "nan"), ("--search-m", 0.1), ("--search-m", 100), ("--window-m", -1), ("--time-scale", 3)],
)
@pytest.mark.parametrize("verb", ["thresholds", "register"])
def test_searches_that_cannot_be_are_usage_errors(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str], verb: str, option: str, value: float | str
) -> None:
    window = () if option == "--window-m" else ("--window-m", 1)
    assert run(verb, site.map, site.logs["live"], "-o", tmp_path / "x.toml", *window, option, value) == 2
    assert option in capsys.readouterr().err
    assert not (tmp_path / "x.toml").exists()


def test_a_drive_over_other_ground_calibrates_nothing(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "x.toml"
    assert run("thresholds", site.map, site.logs["impostor"], "-o", path, "--window-m", 1) == 1
    said = capsys.readouterr().err
    assert "impostor" in said
    assert "a drive over the ground of" in said
    assert not path.exists()
