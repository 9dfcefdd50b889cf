"""``lgprjax cover``: plan, record, export as a person meets them, and one line for each field that is none."""

import csv
import hashlib
import json
import re
import zipfile
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from canon.commands import Done
from canon.commands import run as run_words
from drawn_field import FIELD_M, VEHICLE, Drive, cover_rows, write_cover_run
from lgprjax.formats import WorkedRecord, check_file, read_cover_plan, read_worked
from lgprjax.frames import LocalFrame
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.skid.setup import load_skid
from refusals import refused

FRAME = LocalFrame(40.0, -100.0, 0.0)
EVIDENCE = """
task = "T-7"
hazard_area = "HA-12"
operator = "A. N."
[[find]]
kind = "detonation"
time_utc = "2027-01-15T08:01:00"
latitude_deg = 40.00001
longitude_deg = -99.99996
note = "in swath 2"
[[control_point]]
name = "M1"
when = "before"
latitude_deg = 40.0
longitude_deg = -100.0
measured_latitude_deg = 40.0
measured_longitude_deg = -100.0
sigma_m = 0.0
[[control_point]]
name = "M1"
when = "after"
latitude_deg = 40.0
longitude_deg = -100.0
measured_latitude_deg = 40.0
measured_longitude_deg = -100.0
sigma_m = 0.0
"""


def outside(record: WorkedRecord) -> np.ndarray:
    """Cells beyond the field of 8 x 5 m."""
    cells = record.cells
    rows, columns = np.indices(cells.probability.shape)
    east, north = cells.east_m + 0.1 * (columns + 0.5), cells.north_m + 0.1 * (rows + 0.5)
    return np.asarray((east < 0.0) | (east > 8.0) | (north < 0.0) | (north > 5.0))


def run(*words: object) -> Done:
    return run_words("cover", *words)


def succeed(*words: object) -> str:
    done = run(*words)
    assert done.status == 0, done.err
    return done.out


def geojson(path: Path, *rings_m: np.ndarray) -> Path:
    """A field of its border and its keep-outs."""
    rings = []
    for east, north in (ring_m.T.astype(np.float64) for ring_m in rings_m):
        latitude, longitude, _ = FRAME.to_geodetic(east, north, np.zeros(len(east)))
        ring = [[float(x), float(y)] for x, y in zip(longitude, latitude, strict=True)]
        rings.append([*ring, *ring[:1]])
    path.write_text(json.dumps({"type": "Polygon", "coordinates": rings}))
    return path


@pytest.fixture(scope="module")
def work(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with a vehicle, a field, two runs over parts of it, their plan and their record."""
    folder = tmp_path_factory.mktemp("cover")
    (folder / "v.vehicle.toml").write_text(VEHICLE)
    geojson(folder / "f.geojson", FIELD_M)
    lines = tuple((line, 0.5 + line) for line in range(5))
    vehicle = ("--vehicle", folder / "v.vehicle.toml")
    plan = ("plan", folder / "f.geojson", "-o", folder / "f.cover.geojson", *vehicle)
    succeed(*plan, "--overlap", 0, "--order", "boustrophedon")
    digest = hashlib.sha256((folder / "f.cover.geojson").read_bytes()).hexdigest()
    for name, drive, begin_s in (
        ("one", Drive(lines[:2], stop_s=3.0), 0.0),
        ("two", Drive(lines[2:4], sigma_m=0.03), 600.0),
    ):
        write_cover_run(folder / name, *cover_rows(drive), begin_s=begin_s, plan_sha256=digest)
    (folder / "e.toml").write_text(EVIDENCE)
    succeed(*recorded(folder), "-o", folder / "r.worked.h5")
    return folder


def recorded(folder: Path) -> tuple[object, ...]:
    """Words of the command that makes the record."""
    evidence = ("--plan", folder / "f.cover.geojson", "--evidence", folder / "e.toml")
    return ("record", folder / "one", folder / "two", *evidence, "--cell-m", 0.1)


def test_the_plan_is_there_and_tells_its_figures(work: Path, tmp_path: Path) -> None:
    options = ("--vehicle", work / "v.vehicle.toml", "--overlap", 0.1, "--json", tmp_path / "p.json")
    order = ("--order", "boustrophedon", "--turning-room-m", 9, "--heading-deg", 0)
    # The ground beyond the perimeter, and the body that the vehicle file does not tell.
    assert "[body]" in succeed("plan", work / "f.geojson", "-o", tmp_path / "x.cover.geojson", *options, *order)
    figures = json.loads((tmp_path / "p.json").read_text())
    # Lines northward over 8 m: ceil((8 - 1) / 0.9) + 1 = 9 of 5 m.
    assert (figures["lines"], figures["line_length_m"]) == (9, 45.0)
    assert figures["turning_room_m"] == 9.0
    assert figures["tightest_radius_m"] >= 1.0 - 1e-6
    plan = read_cover_plan(tmp_path / "x.cover.geojson")
    assert plan.vehicle_sha256 == hashlib.sha256((work / "v.vehicle.toml").read_bytes()).hexdigest()
    first = plan.pattern.lines[0]
    assert np.degrees(np.arctan2(*(first.end_m - first.start_m))) == pytest.approx(0.0, abs=1e-6)


def write_corners(path: Path, corners_m: np.ndarray) -> Path:
    latitude, longitude, _ = FRAME.to_geodetic(corners_m[:, 0], corners_m[:, 1], np.zeros(3))
    rows = [f"{lat:.12f},{lon:.12f}" for lat, lon in zip(latitude, longitude, strict=True)]
    path.parent.mkdir(exist_ok=True)
    path.write_text("\n".join(["latitude_deg,longitude_deg", *rows]) + "\n")
    return path


def test_three_corners_make_the_same_plan(work: Path, tmp_path: Path) -> None:
    marked = write_corners(tmp_path / "run" / "corners.csv", FIELD_M[:3]).parent
    options = ("--vehicle", work / "v.vehicle.toml", "--overlap", 0, "--order", "boustrophedon")
    succeed("plan", marked, "-o", tmp_path / "x.cover.geojson", *options)
    one, other = (read_cover_plan(path).pattern for path in (tmp_path / "x.cover.geojson", work / "f.cover.geojson"))
    for a, b in zip(one.lines, other.lines, strict=True):
        np.testing.assert_allclose([*a.start_m, *a.end_m], [*b.start_m, *b.end_m], atol=1e-4)


def test_sides_and_moved_corners_are_told(work: Path, tmp_path: Path) -> None:
    corners = write_corners(tmp_path / "c.csv", FIELD_M[:3] + np.array([[0.0, 0.0], [0.0, 0.0], [0.15, 0.0]]))
    # The default order is the best one.
    options = ("--vehicle", work / "v.vehicle.toml", "--overlap", 0)
    said = succeed("plan", corners, "-o", tmp_path / "x.cover.geojson", *options)
    assert re.search(r"corner 3 .*0\.15 m", said)
    assert all(order in said for order in ("zamboni", "boustrophedon", "racetrack", "free"))
    for sides in ("5:none", "1:soft", "none", "2-1:3"):
        wrong = run("plan", corners, "-o", tmp_path / "y.cover.geojson", *options, "--sides", sides)
        assert wrong.status == 2
        wrong.refusal.check("--sides", "SIDE:ROOM", found=sides)


def test_the_record_tells_what_was_worked(work: Path) -> None:
    assert check_file(work / "r.worked.h5") == []
    record = read_worked(work / "r.worked.h5")
    assert [each["folder"] for each in record.provenance["runs"]] == ["one", "two"]
    digest = hashlib.sha256((work / "f.cover.geojson").read_bytes()).hexdigest()
    assert record.provenance["plan"] == {"file": "f.cover.geojson", "sha256": digest}
    # Four of five metres of width were driven.
    cells = record.cells
    inside, state = ~outside(record), cells.state[0]
    north = cells.north_m + 0.1 * (np.indices(cells.probability.shape)[0] + 0.5)
    # Sigma 1.7 cm on two of the lines, 3.3 cm on the others: 1.645 of it are not claimed on either side of each.
    assert 0.70 < np.mean(state[inside] == 2) <= 0.8
    assert (state[inside & (north > 4.3)] == 0).all()


def test_gaps_are_planned_again(work: Path, tmp_path: Path) -> None:
    gaps, output = ("--gaps", work / "r.worked.h5"), ("-o", tmp_path / "g.cover.geojson")
    vehicle = ("--vehicle", work / "v.vehicle.toml")
    # From the plan itself: it holds the field.
    succeed("plan", work / "f.cover.geojson", *output, *vehicle, *gaps, "--level", 0.95)
    again, first = read_cover_plan(tmp_path / "g.cover.geojson"), read_cover_plan(work / "f.cover.geojson")
    assert again.frame == first.frame
    assert again.pattern.line_length_m < first.pattern.line_length_m
    assert any(4.0 < line.start_m[1] < 5.0 for line in again.pattern.lines)
    elsewhere = geojson(tmp_path / "e.geojson", FIELD_M + np.array([1.0, 0.0]))
    wrong = run("plan", elsewhere, "-o", tmp_path / "h.cover.geojson", *vehicle, *gaps)
    assert wrong.status == 1
    wrong.refusal.check(None, file=elsewhere, found="1.00 m")


class Page(HTMLParser):
    """Words of a page, and whatever would be fetched from elsewhere."""

    def __init__(self, text: str) -> None:
        super().__init__()
        self.words: list[str] = []
        self.sources: list[str] = []
        self.feed(text)

    def handle_starttag(self, _: str, attrs: list[tuple[str, str | None]]) -> None:
        self.sources += [value or "" for name, value in attrs if name in ("src", "href")]

    def handle_data(self, data: str) -> None:
        self.words.append(data)


def rows_of(path: Path) -> list[dict[str, str]]:
    with path.open(newline="") as stream:
        return list(csv.DictReader(stream))


def test_the_export_is_whole(work: Path, tmp_path: Path) -> None:
    pyogrio = pytest.importorskip("pyogrio")
    out = tmp_path / "out"
    options = ("--organisation", "Us & <them>", "--benchmark-deg", 40.001, -100.0, "--json", tmp_path / "e.json")
    said = succeed("export", work / "r.worked.h5", "-o", out, *options)
    assert {path.name for path in out.iterdir()} == {
        *("r.cells.csv", "r.geojson", "r.gpkg", "r.html", "r.kml", "r.shp.zip", "r.turning_points.csv")
    }
    cells = rows_of(out / "r.cells.csv")
    # 8 x 5 m in cells of 0.1 m; their states are the record's, and their places are where the record has them.
    assert len(cells) == 4000
    record = read_worked(work / "r.worked.h5")
    processed = (record.cells.state[0] == 2) & (record.cells.probability >= 0.95 * 65535) & ~outside(record)
    assert sum(row["state_p95"] == "processed" for row in cells) == np.count_nonzero(processed)
    latitude, longitude = (np.array([float(cells[-1][f"{name}_deg"])]) for name in ("latitude", "longitude"))
    east, north, _ = record.frame.to_local(latitude, longitude, np.zeros(1))
    assert (east[0], north[0]) == pytest.approx((float(cells[-1]["east_m"]), float(cells[-1]["north_m"])), abs=1e-3)
    with zipfile.ZipFile(out / "r.shp.zip") as archive:
        shapes = {name for name in archive.namelist() if name.endswith(".shp")}
    assert {"perimeter.shp", "swaths.shp", "processed_p95.shp", "gaps.shp", "finds.shp"} <= shapes
    table = pyogrio.raw.read(f"/vsizip/{out / 'r.shp.zip'}/finds.shp")
    assert dict(zip(table[0]["fields"], [column[0] for column in table[3]], strict=True))["note"] == "in swath 2"
    page = Page((out / "r.html").read_text(encoding="utf-8"))
    words = " ".join(page.words)
    assert all(source.startswith(("#", "data:image/png")) for source in page.sources)
    named = ("Us & <them>", "T-7", "HA-12", "detonation", "99.6 %", "TP4", "uncertain", "signature")
    read = (work / "r.worked.h5", work / "f.cover.geojson", *(work / run / "0000.lgprun" for run in ("one", "two")))
    digests = [hashlib.sha256(path.read_bytes()).hexdigest() for path in read]
    sentences = [layer["sentence"] for layer in json.loads((tmp_path / "e.json").read_text())["layers"]]
    assert len(sentences) == 2
    assert [each for each in (*named, *digests, *sentences) if each not in words] == []
    # A machine pass is not clearance, which no page may say it is.
    assert "clearance" in said
    assert "cleared" not in words.lower()
    bearing = float(rows_of(out / "r.turning_points.csv")[1]["bearing_from_benchmark_deg"])
    assert bearing == pytest.approx(180.0, abs=1e-3)
    before = (out / "r.html").read_bytes()
    run("export", work / "r.worked.h5", "-o", out).refusal.check("output", "--force")
    assert (out / "r.html").read_bytes() == before


def test_the_levels_are_those_of_the_option(work: Path, tmp_path: Path) -> None:
    pytest.importorskip("pyogrio")
    exported = ("export", work / "r.worked.h5", "-o")
    succeed(*exported, tmp_path / "usual", "--level", 0.996, 0.95)
    said = succeed(*exported, tmp_path / "out", "--level", 0.99, "--json", tmp_path / "e.json")
    (layer,) = json.loads((tmp_path / "e.json").read_text())["layers"]
    assert layer["level"] == 0.99
    assert "99 %" in layer["sentence"]
    assert layer["sentence"] in said
    cells = rows_of(tmp_path / "out" / "r.cells.csv")
    assert list(cells[0])[4:] == ["probability", "state_p99"]
    assert {row["state_p99"] == "processed" for row in cells if float(row["probability"]) >= 0.99} == {True}
    processed = sum(row["state_p99"] == "processed" for row in cells)
    assert processed * 0.01 == pytest.approx(layer["processed_m2"], abs=1e-6)
    text = (tmp_path / "out" / "r.html").read_text(encoding="utf-8")
    assert layer["sentence"] in " ".join(Page(text).words)
    assert "99.6 %" not in text
    features = json.loads((tmp_path / "out" / "r.geojson").read_text())["features"]
    layers = {each["properties"]["layer"] for each in features}
    assert {name for name in layers if name.startswith("processed")} == {"processed_p99"}
    # A record that is made so says the same, and still answers for the usual levels.
    succeed(*recorded(work), "-o", tmp_path / "r.worked.h5", "--level", 0.99)
    record, usual = read_worked(tmp_path / "r.worked.h5"), read_worked(work / "r.worked.h5")
    assert record.cells.level.tolist() == [0.99]
    np.testing.assert_array_equal(record.cells.probability, usual.cells.probability)
    succeed("export", tmp_path / "r.worked.h5", "-o", tmp_path / "back", "--level", 0.95, 0.996)
    assert (tmp_path / "back" / "r.cells.csv").read_bytes() == (tmp_path / "usual" / "r.cells.csv").read_bytes()


def test_an_impossible_level_is_one_line(work: Path, tmp_path: Path) -> None:
    export = ("export", work / "r.worked.h5", "-o", tmp_path / "out")
    record = ("record", work / "one", "--plan", work / "f.cover.geojson", "-o", tmp_path / "r.worked.h5")
    for level in ("0.5", "1", "nan"):
        for words in (export, record):
            done = run(*words, "--level", level)
            assert done.status == 2
            done.refusal.check("--level", 0.5, 0.9999, found=level)
    assert not list(tmp_path.iterdir())


_OFF = [[[512345.0, 4428123.0], [512375.0, 4428123.0], [512375.0, 4428143.0]]]
_SWAPPED = [[[40.0, -100.0], [40.0, -99.9997], [40.0002, -99.9997]]]
# Corners in metres, or coordinates; place, values.
_BAD_FIELDS: dict[str, tuple[object, str, tuple[object, ...]]] = {
    "collinear": (np.array([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]]), "corners", ("0.00 m",)),
    "crossed": (np.array([[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]]), "perimeter", (1, 3)),
    "200 km apart": (np.array([[0.0, 0.0], [200e3, 0.0], [200e3, 50.0], [0.0, 50.0]]), "corners", ("2 km", "199.9")),
    "narrower than the tool": (
        np.array([[0.0, 0.0], [20.0, 0.0], [20.0, 0.8], [0.0, 0.8]]),
        "field",
        ("1.00 m", "0.80 m"),
    ),
    "nothing": ([], "geometry", ()),
    "metres of a grid": (_OFF, "corner 1", ("4428123", "512345")),
    "latitude first": (_SWAPPED, "corner 1", ("-100", "swapped")),
}


@pytest.mark.parametrize("name", _BAD_FIELDS)
def test_a_field_that_is_none_is_one_line(work: Path, tmp_path: Path, name: str) -> None:
    corners, place, values = _BAD_FIELDS[name]
    field = tmp_path / "f.geojson"
    if isinstance(corners, np.ndarray):
        geojson(field, corners)
    else:
        field.write_text(json.dumps({"type": "Polygon", "coordinates": corners}))
    options = ("--vehicle", work / "v.vehicle.toml", "--order", "zamboni")
    done = run("plan", field, "-o", tmp_path / "x.cover.geojson", *options)
    assert done.status == 1
    done.refusal.check(place, *values, file=field)
    assert [path.name for path in tmp_path.iterdir()] == ["f.geojson"]


def test_wrong_vehicles_and_outputs_are_one_line(work: Path, tmp_path: Path) -> None:
    wrong = tmp_path / "w.vehicle.toml"
    for old, new, place in (
        ('"skid_steer"', '"counter_steer"', "steering_kind"),
        ("width_m = 1.0\n", "", "tool.width_m"),
        ("smallest_radius_m = 1.0", "smallest_radius_m = 0.0", "skid_steer.smallest_radius_m"),
    ):
        wrong.write_text(VEHICLE.replace(old, new))
        done = run("plan", work / "f.geojson", "-o", tmp_path / "x.cover.geojson", "--vehicle", wrong)
        assert done.status == 1
        done.refusal.check(place, file=wrong)
    plan = ("plan", work / "f.geojson", "--vehicle", work / "v.vehicle.toml", "-o")
    run(*plan, work / "f.cover.geojson").refusal.check("output", "--force", file=work / "f.cover.geojson")
    done = run(*plan, tmp_path / "x.json")
    assert done.status == 2
    done.refusal.check("-o", ".cover.geojson", found="x.json")
    done = run(*plan, tmp_path / "x.cover.geojson", "--turning-room-m", 0, "--order", "boustrophedon")
    assert done.status == 1
    assert "0.00 m" in done.refusal.found


def test_runs_and_records_that_are_none_are_one_line(work: Path, tmp_path: Path) -> None:
    plan, output = ("--plan", work / "f.cover.geojson"), ("-o", tmp_path / "r.worked.h5")
    (tmp_path / "empty").mkdir()
    refusals: tuple[tuple[tuple[object, ...], object], ...] = (
        (("record", tmp_path / "empty", *plan, *output), tmp_path / "empty"),
        (("record", work / "one", "--plan", work / "f.geojson", *output), work / "f.geojson"),
        (("record", work / "one", work / "one", *plan, *output), "one"),
        (("export", work / "f.geojson", "-o", tmp_path / "out"), work / "f.geojson"),
        (("export", work / "r.worked.h5", "-o", work / "f.geojson"), work / "f.geojson"),
    )
    for words, about in refusals:
        done = run(*words)
        assert done.status == 1
        assert done.about.startswith(f"{about}: ")
    done = run("record", work / "one", *plan, *output, "--cell-m", 5)
    assert (done.status, done.about) == (2, "--cell-m")
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


NOTCHED_M = np.array([[0, 0], [14, 0], [14, 9], [9, 9], [9, 5], [5, 5], [5, 9], [0, 9]], float)


def test_a_plan_of_sides_and_keep_outs_is_accepted_on_board(work: Path, tmp_path: Path) -> None:
    """Side 1 has no room: the plan, preflight and the control loop check the same ground."""
    field = geojson(tmp_path / "f.geojson", NOTCHED_M, np.array([[6.5, 2.0], [7.5, 2.0], [7.5, 3.0]]))
    options = ("--vehicle", work / "v.vehicle.toml", "--order", "free", "--keep-out-buffer-m", 0.3)
    output = ("-o", tmp_path / "x.cover.geojson", "--picture", tmp_path / "x.png")
    assert "6.00 m" in succeed("plan", field, *output, *options, "--sides", "1:none", "rest:6")
    assert (tmp_path / "x.png").stat().st_size > 10_000
    assert check_file(tmp_path / "x.cover.geojson") == []
    plan = read_cover_plan(tmp_path / "x.cover.geojson")
    assert plan.ground is not None
    (tmp_path / "run.toml").write_text(
        f'name = "f"\nvehicle = "{work}/v.vehicle.toml"\n[coverage]\nplan = "x.cover.geojson"\n[ports]\n'
        + "".join(f'{name} = {{ url = "/dev/null" }}\n' for name in ("drive_by_wire", "controller", "gnss"))
    )
    loaded = load_skid(read_config(tmp_path / "run.toml"))
    assert loaded.lines == len(plan.pattern.lines)
    # Nothing safe lies south of the side without room, nor in the keep-out.
    assert float(np.asarray(loaded.fence)[:, :, 1].min()) > -6.1
    south = [ring for part in plan.ground.polygons_m for ring in part]
    assert not any(((ring[:, 0] > 0.5) & (ring[:, 0] < 13.5) & (ring[:, 1] < -0.01)).any() for ring in south)
    # What was declared holds for a plan that is made from this one, and a plan that was changed declares nothing.
    again = tmp_path / "again.cover.geojson"
    assert "x.cover.geojson" in succeed("plan", tmp_path / "x.cover.geojson", "-o", again, *options)
    assert read_cover_plan(again).rooms_m == plan.rooms_m == (0.0, *[6.0] * (len(NOTCHED_M) - 1))
    changed = json.loads((tmp_path / "x.cover.geojson").read_text())
    changed["lgprjax"]["rooms_m"][0] = 6.0
    (tmp_path / "changed.cover.geojson").write_text(json.dumps(changed))
    done = run("plan", tmp_path / "changed.cover.geojson", "-o", tmp_path / "y.cover.geojson", *options)
    assert (done.status, done.refusal.file) == (1, str(tmp_path / "changed.cover.geojson"))
    # A vehicle file with a longer body is refused at start.
    body = "[body]\nfront_m = 1.1\nrear_m = 3.0\nleft_m = 0.6\nright_m = 0.6\n"
    (tmp_path / "w.vehicle.toml").write_text((work / "v.vehicle.toml").read_text() + body)
    text = (tmp_path / "run.toml").read_text().replace(f"{work}/v.vehicle.toml", "w.vehicle.toml")
    (tmp_path / "run.toml").write_text(text)
    with refused():
        load_skid(read_config(tmp_path / "run.toml"))
