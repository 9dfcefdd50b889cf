"""``lgprjax route``: list, select, export as a person meets them."""

import csv
import json
from pathlib import Path

import pytest

from canon.site import Site
from lgprjax.cli import main
from lgprjax.formats import read_route

_VEHICLE = """
schema = "lgprjax.vehicle"
schema_version = "1.1"
name = "test"
steering_kind = "counter_steer"
[chassis]
wheelbase_m = 3.8
[steering]
rear_ratio = 0.63
largest_wheel_angle_rad = {largest}
[pursuit]
anchor_m = 6.5
"""


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(each) for each in ("route", *arguments)])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def test_routes_are_listed(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("list", site.map, "--json", tmp_path / "r.json") == 0
    assert "baseline_right" in capsys.readouterr().out
    held = json.loads((tmp_path / "r.json").read_text())
    assert [each["route"] for each in held["routes"]] == ["baseline_left", "baseline_right"]
    for each in held["routes"]:
        assert 34.0 < each["length_m"] < 41.0
        # The generated road begins eastward at 42° N, 71° W.
        assert abs(each["start_heading_deg"] - 90.0) < 5.0
        assert abs(each["start_latitude_deg"] - 42.0) < 1e-3
    assert run("list", site.map, "--json", tmp_path / "r.json") == 1
    assert "one that exists" in capsys.readouterr().err


def test_a_stretch_is_selected_and_exported(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    vehicle, path = tmp_path / "v.vehicle.toml", tmp_path / "x.route.toml"
    vehicle.write_text(_VEHICLE.format(largest=0.5))
    options = ("--from-m", 5, "--to-m", 25, "--against", "--cruise-mps", 2.5, "--vehicle", vehicle)
    assert run("select", site.map, "baseline_right", "-o", path, *options) == 0
    assert "20.0 m in 1 leg" in capsys.readouterr().out
    route = read_route(path)
    assert (route.from_m, route.to_m, route.direction, route.cruise_mps) == (5.0, 25.0, "against", 2.5)

    assert run("export", path, "-o", tmp_path / "w.csv") == 0
    with (tmp_path / "w.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert abs(float(rows[-1]["arc_m"]) - 20.0) < 0.15
    # Recorded eastward, driven westward.
    assert all(abs(float(row["heading_deg"]) - 270.0) < 8.0 for row in rows)
    assert float(rows[0]["longitude_deg"]) > float(rows[-1]["longitude_deg"])
    assert max(float(row["speed_mps"]) for row in rows) == 2.5
    for name in ("w.gpx", "w.geojson"):
        assert run("export", site.map, "baseline_left", "-o", tmp_path / name) == 0
        assert (tmp_path / name).stat().st_size > 10_000


def test_a_route_that_the_vehicle_cannot_drive_is_refused(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    vehicle = tmp_path / "v.vehicle.toml"
    # Straight wheels, or nearly: no road of this world.
    vehicle.write_text(_VEHICLE.format(largest=0.001))
    path = tmp_path / "x.route.toml"
    assert run("select", site.map, "baseline_left", "-o", path, "--vehicle", vehicle) == 1
    told = capsys.readouterr().err
    assert "m along the route: expected a radius of at least" in told
    assert told.count("\n") == 1
    assert not path.exists()


@pytest.mark.parametrize(
    ("arguments", "status", "message"),
    [
        (("select", "MAP", "nowhere", "-o", "DIR/x.route.toml"), 1, "expected one of baseline_left, baseline_right"),
        (("select", "MAP", "baseline_left", "-o", "DIR/x.toml"), 2, "ends in .route.toml"),
        (
            ("select", "MAP", "baseline_left", "-o", "DIR/x.route.toml", "--from-m", "30", "--to-m", "20"),
            1,
            "a stretch",
        ),
        (("select", "MAP", "baseline_left", "-o", "DIR/x.route.toml", "--cruise-mps", "0"), 1, "cruise_mps"),
        (("select", "DIR/none.map.h5", "baseline_left", "-o", "DIR/x.route.toml"), 1, "none.map.h5"),
        (("export", "MAP", "-o", "DIR/w.csv"), 2, "ROUTE: expected the name of one"),
        (("export", "MAP", "baseline_left", "-o", "DIR/w.kml"), 1, "suffix .csv, .geojson or .gpx"),
        (("export", "DIR/none.route.toml", "-o", "DIR/w.csv"), 1, "a readable file"),
        (("export", "DIR/none.route.toml", "baseline_left", "-o", "DIR/w.csv"), 2, "expected none with a route file"),
    ],
)
def test_what_cannot_be_done_is_one_line_and_leaves_nothing(
    arguments: tuple[str, ...],
    status: int,
    message: str,
    site: Site,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    named = [each.replace("MAP", str(site.map)).replace("DIR", str(tmp_path)) for each in arguments]
    assert run(*named) == status
    told = capsys.readouterr().err
    assert message in told
    assert told.count("\n") == 1
    assert list(tmp_path.iterdir()) == []
