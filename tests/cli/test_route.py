"""``lgprjax route``: list, select, export as a person meets them."""

import csv
import json
from pathlib import Path

import pytest

from canon.commands import run, succeed
from canon.site import Site
from canon.story import Story
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


def test_routes_are_listed(story: Story) -> None:
    assert "right" in story.step("route list").done.out
    held = story.json("routes.json")
    assert [each["route"] for each in held["routes"]] == ["left", "right"]
    for each in held["routes"]:
        assert 20.0 < each["length_m"] < 25.0
        # The site's road begins at 35 degrees at 42° N, 71° W.
        assert abs(each["start_heading_deg"] - 35.0) < 5.0
        assert abs(each["start_latitude_deg"] - 42.0) < 1e-3


def test_a_stretch_is_selected_and_exported(site: Site, story: Story, tmp_path: Path) -> None:
    vehicle, path = tmp_path / "v.vehicle.toml", tmp_path / "x.route.toml"
    vehicle.write_text(_VEHICLE.format(largest=0.5))
    options = ("--from-m", 5, "--to-m", 25, "--against", "--cruise-mps", 2.5, "--vehicle", vehicle)
    assert "20.0 m" in succeed("route", "select", site.map, "baseline_right", "-o", path, *options)
    route = read_route(path)
    assert (route.from_m, route.to_m, route.direction, route.cruise_mps) == (5.0, 25.0, "against", 2.5)

    succeed("route", "export", path, "-o", tmp_path / "w.csv")
    with (tmp_path / "w.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert abs(float(rows[-1]["arc_m"]) - 20.0) < 0.15
    # Recorded eastward, driven westward.
    assert all(abs(float(row["heading_deg"]) - 270.0) < 8.0 for row in rows)
    assert float(rows[0]["longitude_deg"]) > float(rows[-1]["longitude_deg"])
    assert max(float(row["speed_mps"]) for row in rows) == 2.5
    whole = json.loads((story.folder / "w.geojson").read_text())
    points = next(each["geometry"] for each in whole["features"] if each["geometry"]["type"] == "LineString")
    assert len(points["coordinates"]) > 90
    assert (story.folder / "w.gpx").read_text(encoding="utf-8").count("<trkpt") > 90


@pytest.mark.parametrize(
    ("words", "status", "about", "values"),
    [
        ("select MAP nowhere -o DIR/x.route.toml", 1, "MAP: route", ("baseline_left, baseline_right", "nowhere")),
        ("select MAP baseline_left -o DIR/x.toml", 2, "-o", (".route.toml",)),
        (
            "select MAP baseline_left -o DIR/x.route.toml --from-m 30 --to-m 20",
            1,
            "DIR/x.route.toml: from_m, to_m",
            (30, 20),
        ),
        ("select MAP baseline_left -o DIR/x.route.toml --cruise-mps 0", 1, "route: cruise_mps", (0,)),
        ("select DIR/none.map.h5 baseline_left -o DIR/x.route.toml", 1, "DIR/none.map.h5: file", ()),
        # Straight wheels, or nearly: no road of this world.
        ("select MAP baseline_left -o DIR/x.route.toml --vehicle STIFF", 1, "DIR/x.route.toml: baseline_left: ", ()),
        ("export MAP -o DIR/w.csv", 2, "ROUTE", ()),
        ("export MAP baseline_left -o DIR/w.kml", 1, "DIR/w.kml: output", (".csv, .geojson", ".gpx")),
        ("export DIR/none.route.toml -o DIR/w.csv", 1, "DIR/none.route.toml: file", ()),
        ("export DIR/none.route.toml baseline_left -o DIR/w.csv", 2, "ROUTE", ()),
    ],
)
def test_what_cannot_be_done_is_one_line_and_leaves_nothing(
    words: str,
    status: int,
    about: str,
    values: tuple[object, ...],
    site: Site,
    tmp_path: Path,
    tmp_path_factory: pytest.TempPathFactory,
) -> None:
    stiff = tmp_path_factory.mktemp("stiff") / "v.vehicle.toml"
    stiff.write_text(_VEHICLE.format(largest=0.001))

    def filled(text: str) -> str:
        return text.replace("MAP", str(site.map)).replace("DIR", str(tmp_path)).replace("STIFF", str(stiff))

    done = run("route", *filled(words).split())
    assert done.status == status
    assert done.about.startswith(filled(about))
    assert [value for value in values if str(value) not in done.err] == []
    assert list(tmp_path.iterdir()) == []
