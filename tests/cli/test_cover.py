"""``lgprjax cover``: plan, record, export as a person meets them, and one line for each field that is none."""

import csv
import hashlib
import json
import zipfile
from html.parser import HTMLParser
from pathlib import Path

import numpy as np
import pytest

from drawn_field import FIELD_M, VEHICLE, Drive, cover_rows, write_cover_run
from lgprjax.cli import main
from lgprjax.errors import InputError
from lgprjax.formats import WorkedRecord, check_file, read_cover_plan, read_worked
from lgprjax.frames import LocalFrame
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.skid.setup import load_skid

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


def run(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(each) for each in ("cover", *arguments)])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def geojson(path: Path, corners_m: np.ndarray) -> Path:
    east, north = corners_m.T.astype(np.float64)
    latitude, longitude, _ = FRAME.to_geodetic(east, north, np.zeros(len(east)))
    ring = [[float(x), float(y)] for x, y in zip(longitude, latitude, strict=True)]
    path.write_text(json.dumps({"type": "Polygon", "coordinates": [[*ring, *ring[:1]]]}))
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
    assert run(*plan, "--overlap", 0, "--order", "boustrophedon") == 0
    digest = hashlib.sha256((folder / "f.cover.geojson").read_bytes()).hexdigest()
    for name, drive, begin_s in (
        ("one", Drive(lines[:2], stop_s=3.0), 0.0),
        ("two", Drive(lines[2:4], sigma_m=0.03), 600.0),
    ):
        write_cover_run(folder / name, *cover_rows(drive), begin_s=begin_s, plan_sha256=digest)
    (folder / "e.toml").write_text(EVIDENCE)
    record = (
        "record",
        folder / "one",
        folder / "two",
        "--plan",
        folder / "f.cover.geojson",
        "--evidence",
        folder / "e.toml",
    )
    assert run(*record, "-o", folder / "r.worked.h5", "--cell-m", 0.1) == 0
    return folder


def test_the_plan_is_there_and_tells_its_figures(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    options = ("--vehicle", work / "v.vehicle.toml", "--overlap", 0.1, "--json", tmp_path / "p.json")
    order = ("--order", "boustrophedon", "--turning-room-m", 9, "--heading-deg", 0)
    assert run("plan", work / "f.geojson", "-o", tmp_path / "x.cover.geojson", *options, *order) == 0
    said = capsys.readouterr().out
    assert "m beyond the perimeter: this ground must be safe to drive on" in said
    assert "no [body]" in said
    figures = json.loads((tmp_path / "p.json").read_text())
    # Lines northward over 8 m: ceil((8 - 1) / 0.9) + 1 = 9 of 5 m.
    assert (figures["lines"], figures["line_length_m"]) == (9, 45.0)
    assert figures["turning_room_m"] == 9.0
    assert figures["tightest_radius_m"] >= 1.0 - 1e-6
    plan = read_cover_plan(tmp_path / "x.cover.geojson")
    assert plan.vehicle_sha256 == hashlib.sha256((work / "v.vehicle.toml").read_bytes()).hexdigest()
    first = plan.pattern.lines[0]
    assert np.degrees(np.arctan2(*(first.end_m - first.start_m))) == pytest.approx(0.0, abs=1e-6)


def test_three_corners_make_the_same_plan(work: Path, tmp_path: Path) -> None:
    latitude, longitude, _ = FRAME.to_geodetic(FIELD_M[:3, 0], FIELD_M[:3, 1], np.zeros(3))
    rows = [f"{lat:.12f},{lon:.12f}" for lat, lon in zip(latitude, longitude, strict=True)]
    marked = tmp_path / "run"
    marked.mkdir()
    (marked / "corners.csv").write_text("\n".join(["latitude_deg,longitude_deg", *rows]) + "\n")
    options = ("--vehicle", work / "v.vehicle.toml", "--overlap", 0, "--order", "boustrophedon")
    assert run("plan", marked, "-o", tmp_path / "x.cover.geojson", *options) == 0
    one, other = (read_cover_plan(path).pattern for path in (tmp_path / "x.cover.geojson", work / "f.cover.geojson"))
    for a, b in zip(one.lines, other.lines, strict=True):
        np.testing.assert_allclose([*a.start_m, *a.end_m], [*b.start_m, *b.end_m], atol=1e-4)


def test_the_record_tells_what_was_worked(work: Path) -> None:
    assert check_file(work / "r.worked.h5") == []
    record = read_worked(work / "r.worked.h5")
    assert [each["folder"] for each in record.provenance["runs"]] == ["one", "two"]
    digest = hashlib.sha256((work / "f.cover.geojson").read_bytes()).hexdigest()
    assert record.provenance["plan"] == {"file": "f.cover.geojson", "sha256": digest}
    # Four of five metres of width were driven.
    cells = record.cells
    rows, columns = np.indices(cells.probability.shape)
    east, north = cells.east_m + 0.1 * (columns + 0.5), cells.north_m + 0.1 * (rows + 0.5)
    inside = (east > 0.0) & (east < 8.0) & (north > 0.0) & (north < 5.0)
    # Sigma 1.7 cm on two of the lines, 3.3 cm on the others: 1.645 of it are not claimed on either side of each.
    assert 0.70 < np.mean(cells.state[0][inside] == 2) <= 0.8
    assert (cells.state[0][inside & (north > 4.3)] == 0).all()


def test_gaps_are_planned_again(work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    gaps, output = ("--gaps", work / "r.worked.h5"), ("-o", tmp_path / "g.cover.geojson")
    vehicle = ("--vehicle", work / "v.vehicle.toml")
    # From the plan itself: it holds the field.
    assert run("plan", work / "f.cover.geojson", *output, *vehicle, *gaps, "--level", 0.95) == 0
    again, first = read_cover_plan(tmp_path / "g.cover.geojson"), read_cover_plan(work / "f.cover.geojson")
    assert again.frame == first.frame
    assert again.pattern.line_length_m < first.pattern.line_length_m
    assert any(4.0 < line.start_m[1] < 5.0 for line in again.pattern.lines)
    elsewhere = geojson(tmp_path / "e.geojson", FIELD_M + np.array([1.0, 0.0]))
    assert run("plan", elsewhere, "-o", tmp_path / "h.cover.geojson", *vehicle, *gaps) == 1
    assert "expected the field of the record, f, found corners up to 1.00 m" in capsys.readouterr().err


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


def test_the_export_is_whole(work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyogrio")
    options = ("--organisation", "Us & <them>", "--benchmark-deg", 40.001, -100.0, "--json", tmp_path / "e.json")
    arguments = ("export", work / "r.worked.h5", "-o", tmp_path / "out", *options)
    assert run(*arguments) == 0
    assert "A machine pass is not clearance" in capsys.readouterr().out
    names = sorted(path.name for path in (tmp_path / "out").iterdir())
    assert names == [
        "r.cells.csv", "r.geojson", "r.gpkg", "r.html", "r.kml", "r.shp.zip", "r.turning_points.csv"
    ]  # fmt: skip
    with (tmp_path / "out" / "r.cells.csv").open() as file:
        cells = list(csv.DictReader(file))
    # 8 x 5 m in cells of 0.1 m; their states are the record's, and their places are where the record has them.
    assert len(cells) == 4000
    record = read_worked(work / "r.worked.h5")
    assert sum(row["state_p95"] == "processed" for row in cells) == np.count_nonzero(
        record.cells.state[0][record.cells.probability >= 0.95 * 65535] == 2
    ) - np.count_nonzero(outside(record) & (record.cells.state[0] == 2))
    latitude, longitude = (np.array([float(cells[-1][f"{name}_deg"])]) for name in ("latitude", "longitude"))
    east, north, _ = record.frame.to_local(latitude, longitude, np.zeros(1))
    assert (east[0], north[0]) == pytest.approx((float(cells[-1]["east_m"]), float(cells[-1]["north_m"])), abs=1e-3)
    with zipfile.ZipFile(tmp_path / "out" / "r.shp.zip") as archive:
        shapes = {name for name in archive.namelist() if name.endswith(".shp")}
    assert {"perimeter.shp", "swaths.shp", "processed_p95.shp", "gaps.shp", "finds.shp"} <= shapes
    import pyogrio

    table = pyogrio.raw.read(f"/vsizip/{tmp_path / 'out' / 'r.shp.zip'}/finds.shp")
    assert dict(zip(table[0]["fields"], [column[0] for column in table[3]], strict=True))["note"] == "in swath 2"
    text = (tmp_path / "out" / "r.html").read_text(encoding="utf-8")
    page = Page(text)
    words = " ".join(page.words)
    assert all(source.startswith(("#", "data:image/png")) for source in page.sources)
    assert "Us & <them>" in words
    for path in (
        work / "r.worked.h5",
        work / "f.cover.geojson",
        work / "one" / "0000.lgprun",
        work / "two" / "0000.lgprun",
    ):
        assert hashlib.sha256(path.read_bytes()).hexdigest() in words
    assert "cleared" not in text
    for word in (
        "T-7",
        "HA-12",
        "detonation",
        "control points measured 2 times: 0.0 cm east",
        "signature",
        "operator or remote link",
        "not processed",
        "uncertain",
        "99.6 %",
        "TP4",
    ):
        assert word in words
    assert "cleared" not in words.lower()
    figures = json.loads((tmp_path / "e.json").read_text())
    for layer in figures["layers"]:
        assert layer["sentence"] in words
    with (tmp_path / "out" / "r.turning_points.csv").open(newline="") as stream:
        rows = list(csv.DictReader(stream))
    assert float(rows[1]["bearing_from_benchmark_deg"]) == pytest.approx(180.0, abs=1e-3)
    before = (tmp_path / "out" / "r.html").read_bytes()
    assert run(*arguments) == 1
    assert "expected a new file, or --force" in capsys.readouterr().err
    assert (tmp_path / "out" / "r.html").read_bytes() == before
    assert run(*arguments, "--force") == 0


def test_the_confidence_is_asked_for(work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    pytest.importorskip("pyogrio")
    exported = ("export", work / "r.worked.h5", "-o")
    assert run(*exported, tmp_path / "usual") == 0
    assert run(*exported, tmp_path / "same", "--confidence", 0.996, 0.95) == 0
    for name in ("r.cells.csv", "r.geojson", "r.kml", "r.html"):
        assert (tmp_path / "usual" / name).read_bytes() == (tmp_path / "same" / name).read_bytes()
    capsys.readouterr()
    assert run(*exported, tmp_path / "out", "--confidence", 0.99, "--json", tmp_path / "e.json") == 0
    said = capsys.readouterr().out
    (layer,) = json.loads((tmp_path / "e.json").read_text())["layers"]
    assert layer["level"] == 0.99
    assert "with probability 99 % or more" in layer["sentence"]
    assert layer["sentence"] in said
    with (tmp_path / "out" / "r.cells.csv").open() as file:
        cells = list(csv.DictReader(file))
    assert list(cells[0])[4:] == ["probability", "state_p99"]
    assert {row["state_p99"] == "processed" for row in cells if float(row["probability"]) >= 0.99} == {True}
    processed = sum(row["state_p99"] == "processed" for row in cells)
    assert processed * 0.01 == pytest.approx(layer["processed_m2"], abs=1e-6)
    text = (tmp_path / "out" / "r.html").read_text(encoding="utf-8")
    assert layer["sentence"] in " ".join(Page(text).words)
    assert "99.6 %" not in text
    layers = {
        each["properties"]["layer"] for each in json.loads((tmp_path / "out" / "r.geojson").read_text())["features"]
    }
    assert {name for name in layers if name.startswith("processed")} == {"processed_p99"}
    # A record that is made so says the same, and still answers for the usual levels.
    made = ("record", work / "one", work / "two", "--plan", work / "f.cover.geojson", "--evidence", work / "e.toml")
    assert run(*made, "-o", tmp_path / "r.worked.h5", "--cell-m", 0.1, "--confidence", 0.99) == 0
    assert check_file(tmp_path / "r.worked.h5") == []
    record, usual = read_worked(tmp_path / "r.worked.h5"), read_worked(work / "r.worked.h5")
    assert record.cells.level.tolist() == [0.99]
    np.testing.assert_array_equal(record.cells.probability, usual.cells.probability)
    again = ("export", tmp_path / "r.worked.h5", "-o", tmp_path / "back", "--confidence", 0.95, 0.996)
    assert run(*again) == 0
    assert (tmp_path / "back" / "r.cells.csv").read_bytes() == (tmp_path / "usual" / "r.cells.csv").read_bytes()


@pytest.mark.parametrize("level", ["0.5", "1", "99", "nan"])
def test_an_impossible_confidence_is_one_line(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], level: str
) -> None:
    export = ("export", work / "r.worked.h5", "-o", tmp_path / "out")
    record = ("record", work / "one", "--plan", work / "f.cover.geojson", "-o", tmp_path / "r.worked.h5")
    for arguments in (export, record):
        assert run(*arguments, "--confidence", level) == 2
        (line,) = filter(str.strip, capsys.readouterr().err.splitlines())
        assert f"--confidence: expected different levels above 0.5, 0.9999 at most, found {level}" in line
    assert not list(tmp_path.iterdir())


_BAD_FIELDS = {
    "collinear": ([[0.0, 0.0], [10.0, 0.0], [20.0, 0.0]], "corner"),
    "crossed": ([[0.0, 0.0], [10.0, 10.0], [10.0, 0.0], [0.0, 10.0]], "side 1 meets side 3"),
    "200 km apart": ([[0.0, 0.0], [200e3, 0.0], [200e3, 50.0], [0.0, 50.0]], "at most"),
    "narrower than the tool": ([[0.0, 0.0], [20.0, 0.0], [20.0, 0.8], [0.0, 0.8]], "at least the tool's 1.00 m"),
}


@pytest.mark.parametrize("name", _BAD_FIELDS)
def test_a_field_that_is_none_is_one_line(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], name: str
) -> None:
    corners, message = _BAD_FIELDS[name]
    field = geojson(tmp_path / "f.geojson", np.array(corners))
    assert run("plan", field, "-o", tmp_path / "x.cover.geojson", "--vehicle", work / "v.vehicle.toml") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert line.startswith(f"lgprjax: {field}: ")
    assert message in line
    assert [path.name for path in tmp_path.iterdir()] == ["f.geojson"]


@pytest.mark.parametrize(
    ("coordinates", "message"),
    [
        ([], "an empty one"),
        ([[[512345.0, 4428123.0], [512375.0, 4428123.0], [512375.0, 4428143.0]]], "metres of a projection"),
        ([[[40.0, -100.0], [40.0, -99.9997], [40.0002, -99.9997]]], "look swapped"),
    ],
)
def test_coordinates_that_are_none_are_one_line(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str], coordinates: object, message: str
) -> None:
    field = tmp_path / "f.geojson"
    field.write_text(json.dumps({"type": "Polygon", "coordinates": coordinates}))
    assert run("plan", field, "-o", tmp_path / "x.cover.geojson", "--vehicle", work / "v.vehicle.toml") == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert message in line


def test_wrong_vehicles_and_outputs_are_one_line(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    for old, new, message in (
        ('"skid_steer"', '"counter_steer"', "steering_kind: expected skid_steer"),
        ("width_m = 1.0\n", "", "tool.width_m: expected a number, measured for the vehicle"),
        ("smallest_radius_m = 1.0", "smallest_radius_m = 0.0", "skid_steer.smallest_radius_m: expected a number"),
    ):
        (tmp_path / "v.vehicle.toml").write_text(VEHICLE.replace(old, new))
        output = ("-o", tmp_path / "x.cover.geojson", "--vehicle", tmp_path / "v.vehicle.toml")
        assert run("plan", work / "f.geojson", *output) == 1
        assert message in capsys.readouterr().err
    vehicle = ("--vehicle", work / "v.vehicle.toml")
    assert run("plan", work / "f.geojson", "-o", work / "f.cover.geojson", *vehicle) == 1
    assert "one that exists" in capsys.readouterr().err
    assert run("plan", work / "f.geojson", "-o", tmp_path / "x.json", *vehicle) == 2
    assert "ends in .cover.geojson" in capsys.readouterr().err
    options = ("-o", tmp_path / "x.cover.geojson", *vehicle)
    assert run("plan", work / "f.geojson", *options, "--turning-room-m", 0, "--order", "boustrophedon") == 1
    assert "m of turning room, found 0.00 m" in capsys.readouterr().err


def test_runs_and_records_that_are_none_are_one_line(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    plan, output = ("--plan", work / "f.cover.geojson"), ("-o", tmp_path / "r.worked.h5")
    (tmp_path / "empty").mkdir()
    for arguments, message in (
        (("record", tmp_path / "empty", *plan, *output), "segments of a recorded run"),
        (("record", work / "one", "--plan", work / "f.geojson", *output), "expected a coverage plan"),
        (("record", work / "one", work / "one", *plan, *output), "expected each run once"),
        (("export", work / "f.geojson", "-o", tmp_path / "out"), "expected an HDF5 file, found another format"),
        (("export", work / "r.worked.h5", "-o", work / "f.geojson"), "expected a folder, found a file"),
    ):
        assert run(*arguments) == 1
        (line,) = filter(str.strip, capsys.readouterr().err.splitlines())
        assert message in line
    assert run("record", work / "one", *plan, *output, "--cell-m", 5) == 2
    assert [path.name for path in tmp_path.iterdir()] == ["empty"]


NOTCHED_M = np.array([[0, 0], [14, 0], [14, 9], [9, 9], [9, 5], [5, 5], [5, 9], [0, 9]], float)


def test_a_plan_of_sides_and_keep_outs_is_accepted_on_board(
    work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Side 1 has no room: the plan, preflight and the control loop check the same ground."""
    east, north = NOTCHED_M.T
    latitude, longitude, _ = FRAME.to_geodetic(east, north, np.zeros(len(east)))
    hole = FRAME.to_geodetic(np.array([6.5, 7.5, 7.5]), np.array([2.0, 2.0, 3.0]), np.zeros(3))
    rings = [
        [[float(x), float(y)] for x, y in zip(*each, strict=True)]
        for each in ((longitude, latitude), (hole[1], hole[0]))
    ]
    (tmp_path / "f.geojson").write_text(
        json.dumps({"type": "Polygon", "coordinates": [[*ring, ring[0]] for ring in rings]})
    )
    options = ("--vehicle", work / "v.vehicle.toml", "--order", "free", "--keep-out-buffer-m", 0.3)
    output = ("-o", tmp_path / "x.cover.geojson", "--picture", tmp_path / "x.png")
    assert run("plan", tmp_path / "f.geojson", *output, *options, "--sides", "1:none", "rest:6") == 0
    said = capsys.readouterr().out
    assert "1 keep-out" in said
    assert "6.00 m beyond the perimeter" in said
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
    # Nothing safe lies south of the side without room.
    assert float(np.asarray(loaded.fence)[:, :, 1].min()) > -6.1
    south = [ring for part in plan.ground.polygons_m for ring in part]
    assert not any(((ring[:, 0] > 0.5) & (ring[:, 0] < 13.5) & (ring[:, 1] < -0.01)).any() for ring in south)
    # What was declared holds for a plan that is made from this one, and a plan that was changed declares nothing.
    again = tmp_path / "again.cover.geojson"
    assert run("plan", tmp_path / "x.cover.geojson", "-o", again, *options) == 0
    assert "room outside the sides as x.cover.geojson declares it" in capsys.readouterr().out
    assert read_cover_plan(again).rooms_m == plan.rooms_m == (0.0, *[6.0] * (len(NOTCHED_M) - 1))
    changed = json.loads((tmp_path / "x.cover.geojson").read_text())
    changed["lgprjax"]["rooms_m"][0] = 6.0
    (tmp_path / "changed.cover.geojson").write_text(json.dumps(changed))
    assert run("plan", tmp_path / "changed.cover.geojson", "-o", tmp_path / "y.cover.geojson", *options) == 1
    assert "found one that was changed since" in capsys.readouterr().err
    # A vehicle file with a longer body is refused at start, by the name of the place.
    longer = (
        work / "v.vehicle.toml"
    ).read_text() + "[body]\nfront_m = 1.1\nrear_m = 3.0\nleft_m = 0.6\nright_m = 0.6\n"
    (tmp_path / "w.vehicle.toml").write_text(longer)
    text = (tmp_path / "run.toml").read_text().replace(f"{work}/v.vehicle.toml", "w.vehicle.toml")
    (tmp_path / "run.toml").write_text(text)
    with pytest.raises(InputError, match="within the ground declared safe"):
        load_skid(read_config(tmp_path / "run.toml"))


def test_sides_and_moved_corners_are_told(work: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    corners = FIELD_M[:3] + np.array([[0.0, 0.0], [0.0, 0.0], [0.15, 0.0]])
    latitude, longitude, _ = FRAME.to_geodetic(corners[:, 0], corners[:, 1], np.zeros(3))
    rows = [f"{lat:.12f},{lon:.12f}" for lat, lon in zip(latitude, longitude, strict=True)]
    (tmp_path / "c.csv").write_text("\n".join(["latitude_deg,longitude_deg", *rows]) + "\n")
    options = ("--vehicle", work / "v.vehicle.toml", "--overlap", 0, "--order", "best")
    assert run("plan", tmp_path / "c.csv", "-o", tmp_path / "x.cover.geojson", *options) == 0
    said = capsys.readouterr().out
    assert "corner 3 moved by 0.15 m" in said
    assert "the fourth corner follows" in said
    assert all(order in said for order in ("zamboni", "boustrophedon", "racetrack", "free"))
    for sides in ("5:none", "1:soft", "none", "2-1:3"):
        assert run("plan", tmp_path / "c.csv", "-o", tmp_path / "y.cover.geojson", *options, "--sides", sides) == 2
        assert "sides: expected SIDE:ROOM" in capsys.readouterr().err
