"""Wrong inputs, a hundred of them: each is told in one line what is wrong where, and what would be right."""

import csv
import io
import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from canon.commands import run, succeed
from canon.map import write_made_map
from formats.samples import write_dt1
from lgprjax.cli import main
from lgprjax.formats import MAP_PRECISIONS

_ONBOARD = Path(__file__).parents[2] / "onboard"

# What was done: words of the command, what the answer is about, and values that it names, with semicolons between.
with Path(__file__).with_name("wrong_inputs.csv").open(encoding="utf-8", newline="") as _stream:
    WRONG = {row["done"]: row for row in csv.DictReader(_stream)}


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
    succeed("import", folder / "LINE.DT1", "-o", folder / "line.drive.h5")
    write_made_map(folder / "site.map.h5", MAP_PRECISIONS["standard"])
    # A radar of a tenth of the frequencies: the same traces, ten times as long.
    shutil.copyfile(folder / "line.drive.h5", folder / "ground.drive.h5")
    with h5py.File(folder / "ground.drive.h5", "r+") as store:
        store["/radar/traces"].attrs["sample_interval_ns"] *= 10.0
    return folder


def test_drives_of_two_continents_make_no_map(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    succeed("import", "LINE.DT1", "-o", "boston.drive.h5", "--latitude-deg", 42.36, "--longitude-deg", -71.06)
    done = run("map", "build", "line.drive.h5", "boston.drive.h5", "-o", "m.map.h5")
    assert done.status == 1
    done.refusal.check(None, "50 km", "line.drive.h5", file="boston.drive.h5")
    # Of a sphere: arccos(cos 42.36 cos 71.06) of 6371 km.
    away = float(done.refusal.found.partition(" km")[0].split()[-1])
    assert away == pytest.approx(6371.0 * np.arccos(np.cos(np.radians(42.36)) * np.cos(np.radians(71.06))), rel=0.005)
    assert not Path("m.map.h5").exists()


@pytest.mark.parametrize("done", WRONG)
def test_the_answer_says_what_to_do(done: str, folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(folder)
    words, about, values = (WRONG[done][key] for key in ("words", "about", "values"))
    before = {path: path.lstat().st_mtime_ns for path in folder.rglob("*")}
    answer = run(*words.split())
    # Bad input is in a place of a file, wrong usage an option or a word.
    assert answer.status == (1 if ": " in about else 2)
    assert answer.about.replace(f"{folder}/", "") == about
    told = (answer.err or answer.out).partition(about)[2]
    assert [value for value in values.split(";") if value not in told] == []
    assert {path: path.lstat().st_mtime_ns for path in folder.rglob("*")} == before


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
    assert b"\xb5" + euro + b".drive.h5: file: " in told
