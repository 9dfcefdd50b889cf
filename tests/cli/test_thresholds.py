"""``lgprjax thresholds`` and what ``register`` does with its file."""

import json
import tomllib
from pathlib import Path

import pandas as pd
import pytest

from canon.commands import run, succeed
from canon.site import Site
from canon.trench import first_scans


@pytest.fixture(scope="module")
def calibrated(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Thresholds of windows of 2 m, on the site's own live drive: shorter ones leave its 25 m too coarse a tail."""
    folder = tmp_path_factory.mktemp("thresholds")
    path, figures = folder / "site.thresholds.toml", folder / "figures.json"
    risk = ("--window-m", 2, "--risk", 1e-3, "--json", figures)
    succeed("thresholds", site.map, site.logs["live"], "-o", path, *risk)
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


def test_register_uses_it(site: Site, calibrated: Path, tmp_path: Path) -> None:
    drives = [first_scans(site.logs[name], tmp_path / f"{name}.drive.h5", 120) for name in ("live", "impostor")]
    succeed("register", site.map, *drives, "-o", tmp_path, "--window-m", 2, "--thresholds", calibrated)
    live, impostor = (pd.read_csv(tmp_path / f"{name}.fixes.csv") for name in ("live", "impostor"))
    tried = live["code"] != "no_window"
    assert (live["code"][tried] == "ok").mean() > 0.9
    assert not (impostor["code"] == "ok").any()


def test_what_thresholds_cannot_be_made_or_used_for(site: Site, calibrated: Path, tmp_path: Path) -> None:
    live, before = site.logs["live"], calibrated.read_text()
    bare = ("register", site.map, live, "-o", tmp_path / "out", "--thresholds", calibrated)
    assert run(*bare).about == "--thresholds"
    assert run(*bare, "--window-m", 2, "--search", "filter").about == "--search filter"
    assert run(*bare, "--window-m", 2, "--causal").about == "--causal"
    done = run(*bare, "--window-m", 1)
    assert done.status == 1
    done.refusal.check("window_m", file=calibrated)
    assert not (tmp_path / "out").exists()
    make = ("thresholds", site.map, live, "-o")
    run(*make, calibrated, "--window-m", 1).refusal.check("output", "--force", file=calibrated)
    assert calibrated.read_text() == before
    path = tmp_path / "x.toml"
    for wrong, about in (
        ((*make, path, "--window-m", 1, "--risk", 2), "--risk"),
        (("thresholds", site.map, "-o", path, "--window-m", 1), "drives"),
        ((*make, path), "--window-m"),
    ):
        done = run(*wrong)
        assert (done.status, done.about) == (2, about)
    # A drive over other ground.
    done = run("thresholds", site.map, site.logs["impostor"], "-o", path, "--window-m", 1)
    assert done.status == 1
    assert "impostor" in done.about
    assert not path.exists()


@pytest.mark.parametrize("verb", ["thresholds", "register"])
def test_searches_that_cannot_be_are_usage_errors(site: Site, tmp_path: Path, verb: str) -> None:
    searches: tuple[tuple[str, object], ...] = (
        *(("--search-m", "nan"), ("--search-m", 0.1), ("--search-m", 100), ("--window-m", -1), ("--time-scale", 3)),
    )
    for option, value in searches:
        window = () if option == "--window-m" else ("--window-m", 1)
        done = run(verb, site.map, site.logs["live"], "-o", tmp_path / "x.toml", *window, option, value)
        assert (done.status, done.about) == (2, option)
        assert not (tmp_path / "x.toml").exists()
