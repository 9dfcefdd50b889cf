"""Health of a drive and of a map from the command line: tables, JSON, pictures, statuses."""

import json
import shutil
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

import lgprjax as lx
from canon.site import Site
from lgprjax.cli import main
from vendor_sets import write_segy


def run(*arguments: object) -> int:
    """Exit status of a command."""
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    code = stopped.value.code
    assert isinstance(code, int)
    return code


def one_line(text: str) -> str:
    assert text.count("\n") == 1
    return text.strip()


def test_check_health_of_a_damaged_drive(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    damaged = tmp_path / "damaged.drive.h5"
    shutil.copyfile(site.logs["live"], damaged)
    with h5py.File(damaged, "r+") as store:
        store["radar/traces"][:, 3] = 128
    assert run("check", damaged, "--health", "--json", tmp_path / "health.json") == 0
    shown = capsys.readouterr().out
    assert "dead_channels" in shown
    assert "channel 3" in shown
    assert "recording bad" in shown
    written = json.loads((tmp_path / "health.json").read_text())
    (health,) = written["health"]
    assert written["findings"] == []
    assert health["verdict"] == "bad"
    dead = next(row for row in health["figures"] if row["name"] == "dead_channels")
    assert dead["where"][0]["channel"] == 3


def test_check_says_what_was_assumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """With --health as a verdict of its own that turns the whole neither good nor bad; without it in a line."""
    drive = tmp_path / "line.drive.h5"
    assert run("import", "segy", *write_segy(tmp_path), "-o", drive) == 0
    told = capsys.readouterr().out
    assert "assumed, as no instrument recorded it: time (unknown), speed (1 m/s), odometry (" in told
    assert run("check", drive) == 0
    shown = capsys.readouterr().out
    assert "place on the earth (latitude 0, longitude 0)" in shown
    assert "not recorded" in shown
    assert run("check", drive, "--health", "--json", tmp_path / "health.json") == 0
    shown = capsys.readouterr().out
    (health,) = json.loads((tmp_path / "health.json").read_text())["health"]
    assert shown.splitlines()[-1].endswith(f"; not recorded, and not judged: {', '.join(health['assumed'])}")
    assert f"recording {health['verdict']};" in shown
    jitter = next(row for row in health["figures"] if row["name"] == "time_jitter")
    assert (jitter["verdict"], jitter["value"], jitter["look"]) == ("not recorded", None, None)
    assert "not recorded: time_jitter: no instrument recorded time (unknown)" in shown


def test_a_drive_without_radar_is_judged_by_its_odometry_and_gnss(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plain = tmp_path / "plain.drive.h5"
    shutil.copyfile(site.logs["live"], plain)
    with h5py.File(plain, "r+") as store:
        del store["radar"], store["array"]
    assert run("check", plain, "--health", "--json", tmp_path / "health.json") == 0
    shown = capsys.readouterr().out
    assert "not measured: radar and its clock: a drive without radar" in shown
    (health,) = json.loads((tmp_path / "health.json").read_text())["health"]
    assert (health["kind"], health["scans"]) == ("no radar", 0)
    assert {"gnss_outage", "odometer_scale"} <= {row["name"] for row in health["figures"]}
    assert shown.splitlines()[-1] == f"{plain}: recording {health['verdict']}"
    checked = lx.check(plain, health=True).health
    assert checked is not None
    assert (checked.kind, checked.verdict) == ("no radar", health["verdict"])
    # Without GNSS at that time there is nothing to judge, and that is said.
    with h5py.File(plain, "r+") as store:
        store["gnss_ins/time_s"][:] += 1e4
    assert run("check", plain, "--health") == 0
    assert capsys.readouterr().out.splitlines()[-1] == f"{plain}: nothing could be judged"


def test_check_without_health_writes_findings_as_before(site: Site, tmp_path: Path) -> None:
    assert run("check", site.logs["live"], "--json", tmp_path / "plain.json") == 0
    assert json.loads((tmp_path / "plain.json").read_text()) == []


def test_health_of_what_is_no_drive_is_wrong_usage(site: Site, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("check", site.map, "--health") == 2
    assert "--health" in one_line(capsys.readouterr().err)


def test_health_of_a_broken_log_is_bad_input(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    broken = tmp_path / "broken.drive.h5"
    broken.write_bytes(site.logs["live"].read_bytes()[:20_000])
    assert run("check", broken, "--health") == 1
    assert "recording" not in capsys.readouterr().out


def test_map_verify_writes_tables_and_a_picture(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    folder = tmp_path / "verified"
    assert run("map", "verify", site.map, "--output", folder, "--json", tmp_path / "map.json") == 0
    shown = capsys.readouterr().out
    for kind in ("coverage", "holes", "weak", "ambiguous", "offset", "disagreement"):
        assert kind in shown
    assert "a kilometre of route" in shown
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
    assert run("map", "verify", site.map, "--output", folder) == 1
    assert "--force" in one_line(capsys.readouterr().err)


def test_map_verify_of_a_broken_map_is_bad_input(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    broken = tmp_path / "broken.map.h5"
    broken.write_bytes(site.map.read_bytes()[:5_000])
    assert run("map", "verify", broken, "--output", tmp_path / "out") == 1
    assert "broken.map.h5" in one_line(capsys.readouterr().err)
    assert not (tmp_path / "out").exists()
