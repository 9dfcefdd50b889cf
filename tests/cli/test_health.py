"""Health of a drive and of a map from the command line: tables, JSON, pictures, statuses."""

import json
import shutil
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest

import lgprjax as lx
from canon.commands import run, succeed
from canon.site import Site
from vendor_sets import write_segy


def health_of(drive: Path) -> tuple[str, dict[str, Any]]:
    """What is shown, and what is written."""
    figures = drive.with_suffix(".json")
    figures.unlink(missing_ok=True)
    shown = succeed("check", drive, "--health", "--json", figures)
    (health,) = json.loads(figures.read_text())["health"]
    return shown, health


def test_check_health_of_a_damaged_drive(short: Path, tmp_path: Path) -> None:
    damaged = tmp_path / "damaged.drive.h5"
    shutil.copyfile(short, damaged)
    with h5py.File(damaged, "r+") as store:
        store["radar/traces"][:, 3] = 128
    shown, health = health_of(damaged)
    assert "dead_channels" in shown
    assert "channel 3" in shown
    assert health["verdict"] == "bad"
    dead = next(row for row in health["figures"] if row["name"] == "dead_channels")
    assert dead["where"][0]["channel"] == 3
    assert json.loads(damaged.with_suffix(".json").read_text())["findings"] == []
    # Without --health findings alone are written.
    assert json.loads(succeed("check", damaged, "--json", "-")) == []


def test_check_says_what_was_assumed(tmp_path: Path) -> None:
    """With --health as a verdict of its own that turns the whole neither good nor bad; without it in a line."""
    drive = tmp_path / "line.drive.h5"
    for told in (succeed("import", "segy", *write_segy(tmp_path), "-o", drive), succeed("check", drive)):
        assert "time (unknown)" in told
        assert "odometry (" in told
    shown, health = health_of(drive)
    assert any(line.endswith(f": {', '.join(health['assumed'])}") for line in shown.splitlines())
    jitter = next(row for row in health["figures"] if row["name"] == "time_jitter")
    assert (jitter["verdict"], jitter["value"], jitter["look"]) == ("not recorded", None, None)


def test_a_drive_without_radar_is_judged_by_its_odometry_and_gnss(short: Path, tmp_path: Path) -> None:
    plain = tmp_path / "plain.drive.h5"
    shutil.copyfile(short, plain)
    with h5py.File(plain, "r+") as store:
        del store["radar"], store["array"]
    shown, health = health_of(plain)
    assert (health["kind"], health["scans"]) == ("no radar", 0)
    assert {"gnss_outage", "odometer_scale"} <= {row["name"] for row in health["figures"]}
    result, following = shown.splitlines()[-2:]
    assert result.startswith("result: 1 file, 0 with errors")
    assert result.endswith(health["verdict"])
    assert following == f"next: lgprjax map build {plain} -o M.map.h5"
    checked = lx.check(plain, health=True).health
    assert checked is not None
    assert (checked.kind, checked.verdict) == ("no radar", health["verdict"])
    # Without GNSS at that time there is nothing to judge.
    with h5py.File(plain, "r+") as store:
        store["gnss_ins/time_s"][:] += 1e4
    assert not {"good", "bad", "inspect"} & set(succeed("check", plain, "--health", "-q").split())


def test_health_of_what_is_no_drive(site: Site, short: Path, tmp_path: Path) -> None:
    done = run("check", site.map, "--health")
    assert (done.status, done.about) == (2, "--health")
    broken = tmp_path / "broken.drive.h5"
    broken.write_bytes(short.read_bytes()[:20_000])
    assert run("check", broken, "--health").status == 1


def test_map_verify_writes_tables_and_a_picture(site: Site, tmp_path: Path) -> None:
    folder = tmp_path / "verified"
    shown = succeed("map", "verify", site.map, "--output", folder, "--json", tmp_path / "map.json")
    for kind in ("coverage", "holes", "weak", "ambiguous", "offset", "disagreement"):
        assert kind in shown
    assert {path.name for path in folder.iterdir()} == {
        *("places.csv", "agreement.csv", "strips.png", "passes.png", "findings.json")
    }
    written = json.loads((tmp_path / "map.json").read_text())
    assert written == json.loads((folder / "findings.json").read_text())
    places = pd.read_csv(folder / "places.csv")
    assert len(places) == written["length_m"]
    assert np.all(np.diff(places["route_m"]) == pytest.approx(written["step_m"]))
    for picture in ("strips.png", "passes.png"):
        assert (folder / picture).read_bytes().startswith(b"\x89PNG")
    # What is there is not replaced, and is refused before any work.
    assert "--force" in run("map", "verify", site.map, "--output", folder).refusal.expected
    broken = tmp_path / "broken.map.h5"
    broken.write_bytes(site.map.read_bytes()[:5_000])
    assert run("map", "verify", broken, "--output", tmp_path / "out").refusal.file == str(broken)
    assert not (tmp_path / "out").exists()
