"""Wrong inputs, fifty of them drawn up before their messages were read aloud: each is told in a line what to do.

A line of the list: what a person did, the words of the command, and what the answer must name. The answer begins with
the command's name, is one line of standard error, and the status is 1 for bad input or 2 for wrong usage.
"""

import io
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from canon.map import write_made_map
from formats.samples import write_dt1
from lgprjax.cli import main
from lgprjax.formats import MAP_PRECISIONS

_ONBOARD = Path(__file__).parents[2] / "onboard"

# What was done: words, what is named.
WRONG: dict[str, tuple[str, tuple[str, ...]]] = {
    # Words.
    "a verb misspelt": ("regster m.map.h5 x.drive.h5", ("regster", "register", "lgprjax --help")),
    "a verb of elsewhere": ("localise x.drive.h5", ("localise", "no such verb", "register", "lgprjax --help")),
    "a verb of a group misspelt": ("map biuld x.drive.h5 -o m.map.h5", ("biuld", "build", "lgprjax map --help")),
    "a verb of a group left out": ("map x.drive.h5", ("x.drive.h5", "build", "info")),
    "an option misspelt": ("register m.map.h5 x.drive.h5 -o r --widow-m 4", ("--widow-m", "--window-m")),
    "an option of another verb": (
        "check x.drive.h5 --search-m 2",
        ("--search-m", "no such option", "register and thresholds", "check --help"),
    ),
    "an option of a short kind": ("map build x.drive.h5 -p m.map.h5", ("-p", "no such option")),
    "no output": ("register m.map.h5 x.drive.h5", ("-o DIR", "is needed", "folder")),
    "no value": ("register m.map.h5 x.drive.h5 -o", ("-o", "expected DIR", "nothing after it")),
    "no value before an option": ("register m.map.h5 x.drive.h5 -o r --risk --force", ("--risk", "NUMBER")),
    "a word for a number": ("register m.map.h5 x.drive.h5 -o r --search-m far", ("--search-m", "a number", "'far'")),
    "a unit beside a number": (
        "register m.map.h5 x.drive.h5 -o r --search-m 2m",
        ("--search-m", "a number", "'2m'", "leave out the unit"),
    ),
    "a comma in a number": (
        "register m.map.h5 x.drive.h5 -o r --search-m 2,5",
        ("--search-m", "a number", "'2,5'", "a point"),
    ),
    "a fraction for a count": ("register m.map.h5 x.drive.h5 -o r --workers 1.5", ("--workers", "whole number")),
    "a choice misspelt": ("map build x.drive.h5 -o m.map.h5 --precision smal", ("--precision", "full", "mean small?")),
    "a word too many": ("export x.drive.h5 y.drive.h5 -o x.mcap", ("y.drive.h5", "one word too many", "DRIVE")),
    "nothing to work on": ("tune -o out", ("STUDY.toml", "is needed", "the study file")),
    "two numbers of three": (
        "import mcap r.mcap -o x.drive.h5 --gnss-m 1 2",
        ("--gnss-m", "3 values, X Y Z", "found 1 2"),
    ),
    "no side behind the option": (
        "cover plan empty.geojson -o p.cover.geojson --vehicle v.toml --sides",
        ("--sides", "SIDE:ROOM", "nothing after it"),
    ),
    "a shell that is none": ("--completion powershell", ("--completion", "bash, zsh, fish, tcsh", "powershell")),
    "a needed number left out": ("import cmu . -o x.drive.h5", ("--time-window-ns", "is needed", "travel time")),
    # Numbers.
    "a search of nothing": ("register m.map.h5 x.drive.h5 -o r --search-m 0", ("--search-m", "length in metres", "0")),
    "a negative window": ("register m.map.h5 x.drive.h5 -o r --window-m -2", ("--window-m", "length in metres", "-2")),
    "a time scale in percent": ("register m.map.h5 x.drive.h5 -o r --time-scale 105", ("--time-scale", "0.5 to 2")),
    "a risk in percent": ("register m.map.h5 x.drive.h5 -o r --risk 5", ("--risk", "1e-9 to 0.01", "5")),
    "a frequency in GHz": ("map build line.drive.h5 -o m.map.h5 --centre-frequency-mhz 0.4", ("1 to 10000", "0.4")),
    "thresholds of no window": (
        "register m.map.h5 x.drive.h5 -o r --thresholds t.toml",
        ("--thresholds", "--window-m"),
    ),
    "threads of nobody": ("register m.map.h5 x.drive.h5 -o r --threads 2", ("--threads", "--workers")),
    "a speed of light": ("view LINE.DT1 --velocity-m-per-ns 3e8", ("velocity", "3e+08")),
    "two kinds of a run": ("run c.run.toml --simulate --preflight", ("--simulate", "--preflight", "only one of them")),
    "lock step of a real run": ("run c.run.toml --lockstep", ("--lockstep", "--simulate")),
    "a level without gaps": (
        "cover plan empty.geojson -o p.cover.geojson --vehicle v.toml --level 0.9",
        ("--level", "--gaps as well"),
    ),
    "an outage without a confidence": (
        "cover plan empty.geojson -o p.cover.geojson --vehicle v.toml --drop-out-s 30",
        ("--drop-out-s", "confidence beside it"),
    ),
    "a picture in the plan's place": (
        "cover plan empty.geojson -o p.cover.geojson --vehicle v.toml --picture p.cover.geojson",
        ("p.cover.geojson", "a file of its own for each output"),
    ),
    "figures of a real run": ("run c.run.toml --json f.json", ("--json", "--simulate or --replay")),
    "lines a country apart": (
        "import lines LINE.DT1 LINE2.DT1 -o x.drive.h5 --line-spacing-m 1e9",
        ("--line-spacing-m", "up to 100"),
    ),
    "a zone without its hemisphere": ("import LINE.DT1 -o x.drive.h5 --utm-zone 33", ("--utm-zone", "N or S", "'33'")),
    "a zone by a band's letter": ("import LINE.DT1 -o x.drive.h5 --utm-zone 33X", ("--utm-zone", "N or S", "'33X'")),
    "a zone the wrong way round": (
        "import LINE.DT1 -o x.drive.h5 --utm-zone N33",
        ("--utm-zone", "such as 19N", "'N33'"),
    ),
    "a zone that is none": ("import segy LINE.sgy -o x.drive.h5 --utm-zone 61N", ("--utm-zone", "1 to 60", "'61N'")),
    "a window longer than the drive": (
        "thresholds site.map.h5 line.drive.h5 -o t.toml --window-m 100",
        ("line.drive.h5", "wrong places 110 m", "of travel", "a smaller search or window"),
    ),
    # Files.
    "a file that is not there": ("check nowhere.drive.h5", ("nowhere.drive.h5", "No such file", "check its name")),
    "a link to nothing": (
        "check link.drive.h5",
        ("link.drive.h5", "No such file", "a link to elsewhere.drive.h5, which is not there"),
    ),
    "a folder for a file": ("map info .", ("a readable file", "Is a directory", "a file in it")),
    "an empty file": ("map build empty.drive.h5 -o m.map.h5", ("empty.drive.h5", "an empty file", "again")),
    "a text for a map": ("map info text.map.h5", ("text.map.h5", "HDF5", "another format", "lgprjax import")),
    "HDF5 of another program": (
        "map info other.map.h5",
        ("other.map.h5", "lgprjax.map, a subsurface database", "another program"),
    ),
    "a vendor file without its header": ("view ALONE.DT1", ("ALONE.DT1", "ALONE.HD beside it", "copy it")),
    "a vendor file cut short": ("view CUT.DT1", ("CUT.DT1", "traces", "found")),
    "a file of no known kind": ("import notes.txt -o x.drive.h5", ("notes.txt", "dt1", "lines")),
    "a recording named as another": ("import dzt LINE.DT1 -o x.drive.h5", ("LINE.DT1", ".dzt", "recognises")),
    "lines without places": ("import lines LINE.DT1 LINE2.DT1 -o x.drive.h5", ("--line-spacing-m", "--lines-at-m")),
    "a site with a key misspelt": ("simulate wrong.toml -o d", ("wrong.toml", "colour")),
    "a site with a table's brackets doubled": (
        "simulate doubled.toml -o d",
        ("doubled.toml", "ground", "expected a table, found an array of tables"),
    ),
    "a vehicle with a table's brackets doubled": (
        "check doubled.vehicle.toml",
        ("doubled.vehicle.toml", "body", "expected a table, found an array of tables"),
    ),
    "an example site that is none": ("simulate vilage -o d", ("vilage", "village")),
    "a field without corners": (
        "cover plan empty.geojson -o p.cover.geojson --vehicle v.toml",
        ("empty.geojson", "one Polygon"),
    ),
    "an output of another kind": ("export line.drive.h5 -o x.csv", ("--output", ".mcap", "x.csv")),
    "a drive log without its suffix": ("import LINE.DT1 -o line", ("-o", "ends in .drive.h5", "'line'")),
    "a map without its suffix": ("map build line.drive.h5 --output=site", ("--output", "ends in .map.h5", "'site'")),
    "figures into no folder": (
        "check line.drive.h5 --json no/f.json",
        ("no/f.json", "a folder that exists", "make it", "no"),
    ),
    "an output that exists": ("import LINE.DT1 -o kept.drive.h5", ("kept.drive.h5", "--force", "exists")),
    "a folder as an output": ("import LINE.DT1 -o folder", ("folder", "a file name")),
    "a drive log for a configuration": (
        "run line.drive.h5 --simulate",
        ("line.drive.h5", "TOML", "HDF5", "drive logs"),
    ),
    "a drive log for a study": ("tune line.drive.h5 -o t", ("line.drive.h5", "TOML", "HDF5", "drive logs")),
    "a vehicle for a configuration": (
        "run doubled.vehicle.toml",
        ("doubled.vehicle.toml", "the configuration of a run", "a vehicle file"),
    ),
    "a site for a configuration": ("run site.toml", ("site.toml", "the configuration of a run", "lgprjax simulate")),
    "a configuration for a study": (
        "tune flail.run.toml -o t",
        ("flail.run.toml", "a study", "the configuration of a run"),
    ),
    "runs for a run": ("events runs", ("runs", "a folder of runs", "such as runs/second")),
    "runs for a run to replay": ("run flail.run.toml --replay runs", ("runs", "a folder of runs", "runs/second")),
    "a configuration for a run": ("recover flail.run.toml -o x.drive.h5", ("a recorded run", "recording.folder names")),
    "a segment for a run": ("events runs/first/0000.lgprun", ("one of its segments", "name its folder, runs/first")),
    "a run that is not there": ("events nowhere", ("nowhere", "a recorded run", "no folder")),
    "results below a file": (
        "register site.map.h5 line.drive.h5 -o kept.drive.h5/r",
        ("a folder that can be made", "Not a"),
    ),
    "a vehicle of the other kind": (
        "run flail.run.toml --simulate",
        ("flail.vehicle.toml", "steering_kind", "counter_steer", "skid_steer"),
    ),
    "a button misspelt": (
        "run button.run.toml --simulate",
        ("button.run.toml", "simulation.script[", "].button", "steering, plus", "'sterring'"),
    ),
    "a fault misspelt": (
        "run fault.run.toml --simulate",
        ("fault.run.toml", "simulation.faults[1].kind", "perhaps gnss_off", "gnss_of"),
    ),
    "weather that is none": (
        "run hail.run.toml --simulate",
        ("hail.run.toml", "simulation.weather", "'rain'", "'hail'"),
    ),
    "an address of another kind": (
        "run tcp.run.toml --preflight",
        ("tcp.run.toml", "ports.radar.url", "socket://HOST:PORT", "'tcp://10.0.0.7:5001'"),
    ),
    "a road and a field at once": (
        "run both.run.toml --simulate",
        ("both.run.toml", "either [coverage], or map and routes", "found map, routes, coverage, ports.radar"),
    ),
    "a configuration to check": ("check flail.run.toml", ("flail.run.toml", "lgprjax run flail.run.toml --preflight")),
    "a site to check": ("check site.toml", ("site.toml", "a suffix among", "lgprjax simulate site.toml -o DIR")),
    "a folder to check": ("check runs", ("runs", "expected a file, found a folder", "name a file in it")),
    "a way for a border": (
        "cover plan way.geojson -o p.cover.geojson --vehicle flail.vehicle.toml",
        ("way.geojson", "one Polygon, the border of the field", "none, but LineString"),
    ),
    "a field for a study": ("tune way.geojson -o t", ("way.geojson", "expected TOML, found JSON", "fields")),
    "a field for a configuration": ("run way.geojson --preflight", ("way.geojson", "expected TOML, found JSON")),
    "a plan for a record": ("cover export plan.cover.geojson -o h", ("the plan of a field", "lgprjax cover record")),
    "a table of fixes for a drive": ("export x.fixes.csv -o x.mcap", ("fixes as a table", "X.fixes.h5")),
    "settings for a map": ("map info site.toml", ("site.toml", "an HDF5 file", "TOML, a text of settings")),
    "a text for a map to compare": ("compare notes.txt x.fixes.csv", ("notes.txt", "another format")),
    "a map for fixes to compare": (
        "compare site.map.h5 line.drive.h5",
        ("site.map.h5", "lgprjax.fixes, the fixes of a drive", "a subsurface database"),
    ),
    "a drive log for a run to recover": (
        "recover line.drive.h5 -o y.drive.h5",
        ("line.drive.h5", "the folder of a recorded run", "a drive log", "what lgprjax recover makes"),
    ),
    "an empty bag": (
        "import empty.bag -o x.drive.h5",
        ("empty.bag", "a whole ROS bag", "found an empty file", "again"),
    ),
    "a text for a bag": ("import text.bag -o x.drive.h5", ("text.bag", "a whole ROS bag", "found another format")),
    "an empty gprMax file": ("import gprmax empty.out -o x.drive.h5", ("empty.out", "found an empty file", "again")),
    "an empty SEG-Y file": ("import empty.sgy -o x.drive.h5", ("empty.sgy", "expected data, found an empty file")),
    "a folder to draw": ("view folder", ("folder", "a recording or a map", "found a folder", "name a file in it")),
    "a picture for a recording": ("view photo.dzt", ("photo.dzt", "header", "a DZT header")),
    "a recording to check": ("check LINE.DT1", ("LINE.DT1", "a suffix among", "lgprjax import LINE.DT1 -o X.drive.h5")),
    "the health of a map": ("check --health site.map.h5", ("--health", "drive logs only", "found site.map.h5")),
    "a demonstration into a file": ("demo -o notes.txt", ("notes.txt", "a folder that can be made", "exists")),
    "a study that is not UTF-8": ("tune latin.toml -o t", ("latin.toml", "no text in UTF-8", "from byte 9")),
    "a heading that is no number": (
        "import LINE.DT1 -o x.drive.h5 --heading-deg nan",
        ("--heading-deg", "expected degrees, found nan"),
    ),
    "a corner that is no number": (
        "cover plan nan.geojson -o p.cover.geojson --vehicle flail.vehicle.toml",
        ("nan.geojson", "corner 2", "a number", "'nan'"),
    ),
    "a benchmark off the earth": (
        "cover export line.drive.h5 -o h --benchmark-deg 100 200",
        ("--benchmark-deg", "latitude from -90 to 90", "found 100 200"),
    ),
    "figures in place of an input": (
        "register site.map.h5 line.drive.h5 -o r --json line.drive.h5 --force",
        ("line.drive.h5", "another file than those that are read"),
    ),
    # Things that do not fit together.
    "a map for a drive": (
        "register site.map.h5 site.map.h5 -o r",
        ("site.map.h5", "lgprjax.drive", "lgprjax.map", "a subsurface database"),
    ),
    "one drive twice": ("register site.map.h5 line.drive.h5 line.drive.h5 -o r", ("line", "twice")),
    "a drive of another radar": (
        "register site.map.h5 ground.drive.h5 -o r",
        ("ground.drive.h5", "MHz", "another sensor than the map's"),
    ),
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Files that the commands name, and that are not what their names say."""
    folder = tmp_path_factory.mktemp("wrong")
    (folder / "empty.drive.h5").write_bytes(b"")
    (folder / "text.map.h5").write_text("a text\n", encoding="utf-8")
    (folder / "notes.txt").write_text("a text\n", encoding="utf-8")
    (folder / "kept.drive.h5").write_text("kept\n", encoding="utf-8")
    (folder / "wrong.toml").write_text('name = "x"\ncolour = "red"\n[ground]\nlength_m = 60\n', encoding="utf-8")
    (folder / "empty.geojson").write_text('{"type": "FeatureCollection", "features": []}', encoding="utf-8")
    (folder / "doubled.toml").write_text('name = "x"\n[[ground]]\nlength_m = 60\n', encoding="utf-8")
    flail = (_ONBOARD / "made_up_flail.vehicle.toml").read_text(encoding="utf-8")
    (folder / "doubled.vehicle.toml").write_text(flail.replace("[body]", "[[body]]"), encoding="utf-8")
    (folder / "flail.vehicle.toml").write_text(flail, encoding="utf-8")
    run = (_ONBOARD / "simulated.run.toml").read_text(encoding="utf-8").replace("../out/onboard/", "")
    (folder / "flail.run.toml").write_text(run.replace("made_up.v", "flail.v"), encoding="utf-8")
    mistyped = run.replace('"made_up.v', f'"{_ONBOARD}/made_up.v').replace('button = "steering"', 'button = "sterring"')
    (folder / "button.run.toml").write_text(mistyped, encoding="utf-8")
    own = run.replace('"made_up.v', f'"{_ONBOARD}/made_up.v')
    (folder / "fault.run.toml").write_text(f'{own}\nfaults = [{{ kind = "gnss_of", at_s = 3 }}]\n', encoding="utf-8")
    (folder / "hail.run.toml").write_text(own.replace("seed = 2\n", 'seed = 2\nweather = "hail"\n'), encoding="utf-8")
    (folder / "tcp.run.toml").write_text(own.replace("socket://127.0.0.1:1", "tcp://10.0.0.7:5001"), encoding="utf-8")
    (folder / "both.run.toml").write_text(f"{own}\n[coverage]\nspeed_mps = 0.3\n", encoding="utf-8")
    way = '{"type": "LineString", "coordinates": [[11, 48], [11.001, 48]]}'
    (folder / "way.geojson").write_text(way, encoding="utf-8")
    (folder / "site.toml").write_text('name = "x"\n[[drive]]\nname = "live"\n', encoding="utf-8")
    for name in ("empty.bag", "empty.out", "empty.sgy"):
        (folder / name).write_bytes(b"")
    for name in ("text.bag", "x.fixes.csv", "plan.cover.geojson"):
        (folder / name).write_text("a text\n", encoding="utf-8")
    (folder / "photo.dzt").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(2048))
    (folder / "latin.toml").write_bytes('name = "H\xfcgel"\n'.encode("latin-1"))
    corners = "[[11, 48], [NaN, 48], [11.001, 48.001], [11, 48]]"
    (folder / "nan.geojson").write_text(f'{{"type": "Polygon", "coordinates": [{corners}]}}', encoding="utf-8")
    for name in ("first", "second"):
        (folder / "runs" / name).mkdir(parents=True)
        (folder / "runs" / name / "0000.lgprun").write_bytes(b"")
    (folder / "link.drive.h5").symlink_to("elsewhere.drive.h5")
    (folder / "folder").mkdir()
    with h5py.File(folder / "other.map.h5", "w") as store:
        store["data"] = np.zeros(3)
    rng = np.random.default_rng(3)
    for name in ("LINE", "LINE2", "CUT", "ALONE"):
        write_dt1(folder / f"{name}.DT1", (2000.0 * np.cumsum(rng.normal(size=(40, 60)), axis=0)).astype(np.int16))
    (folder / "CUT.DT1").write_bytes((folder / "CUT.DT1").read_bytes()[:-400])
    (folder / "ALONE.HD").unlink()
    with pytest.raises(SystemExit):
        main(["import", str(folder / "LINE.DT1"), "-o", str(folder / "line.drive.h5")])
    write_made_map(folder / "site.map.h5", MAP_PRECISIONS["standard"])
    # A radar of a tenth of the frequencies: the same traces, ten times as long.
    shutil.copyfile(folder / "line.drive.h5", folder / "ground.drive.h5")
    with h5py.File(folder / "ground.drive.h5", "r+") as store:
        store["/radar/traces"].attrs["sample_interval_ns"] *= 10.0
    return folder


def test_drives_of_two_continents_make_no_map(
    folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    with pytest.raises(SystemExit):
        main(["import", "LINE.DT1", "-o", "boston.drive.h5", "--latitude-deg", "42.36", "--longitude-deg", "-71.06"])
    capsys.readouterr()
    with pytest.raises(SystemExit) as stopped:
        main(["map", "build", "line.drive.h5", "boston.drive.h5", "-o", "m.map.h5"])
    assert stopped.value.code == 1
    told = capsys.readouterr().err
    # Of a sphere: arccos(cos 42.36 cos 71.06) of 6371 km.
    away = float(told.partition("begins ")[2].partition(" km")[0])
    assert away == pytest.approx(6371.0 * np.arccos(np.cos(np.radians(42.36)) * np.cos(np.radians(71.06))), rel=0.005)
    assert "within 50 km of line.drive.h5" in told
    assert not Path("m.map.h5").exists()


def test_there_are_fifty_and_more() -> None:
    assert len(WRONG) >= 50


@pytest.mark.parametrize("done", WRONG)
def test_the_answer_says_what_to_do(
    done: str, folder: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(folder)
    words, named = WRONG[done]
    before = {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()}
    with pytest.raises(SystemExit) as stopped:
        main(words.split())
    out, err = capsys.readouterr()
    assert stopped.value.code in (1, 2)
    if words.startswith("check") and not err:
        err = out.replace("error: ", "lgprjax: ")
    told = err.splitlines()
    assert len(told) == 1, err
    assert told[0].startswith("lgprjax: ")
    assert [part for part in named if part not in told[0]] == [], told[0]
    assert "Traceback" not in out + err
    assert {path: path.read_bytes() for path in folder.rglob("*") if path.is_file()} == before


@pytest.mark.parametrize("encoding", ["ascii", "latin-1", "utf-8"])
def test_a_terminal_of_any_encoding_shows_the_answer(
    encoding: str, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(folder)
    shown = io.TextIOWrapper(io.BytesIO(), encoding=encoding)
    monkeypatch.setattr("sys.stdout", shown)
    for words in (["map", "info", "site.map.h5"], ["check", "\udcb5\u20ac.drive.h5"]):
        with pytest.raises(SystemExit):
            main(words)
    shown.flush()
    told = shown.buffer.getvalue()
    assert (" deg" if encoding == "ascii" else "\u00b0").encode(encoding) in told
    # A name as it is on the disk, its odd byte too.
    euro = "\u20ac".encode(encoding, "backslashreplace")
    assert b"error: \xb5" + euro + b".drive.h5: file: expected" in told
