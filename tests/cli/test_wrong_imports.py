"""Wrong inputs of ``import``: each is told in one line that says what is wrong where and what to do, or in a note."""

import io
import os
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from canon.commands import run, succeed
from formats.samples import dzt_header, write_drive, write_dt1, write_mala
from formats.segy_sample import write_segy
from formats.side_samples import gga, gps_text
from formats.test_grounded import _write_run
from formats.test_signal_tables import columns, write_csv
from lgprjax.cli import main
from vendor_sets import COUNTS, write_cmu

_MAP = (Path(__file__).parents[2] / "tuning" / "signals.toml").read_text(encoding="utf-8")
_SIGNALS = "import signals a.csv --columns m.toml"


def _lines(*names: str) -> list[Path]:
    return [write_dt1(Path(f"{name}.DT1"), COUNTS) for name in names or ("L1",)]


def _dzt(name: str = "a.DZT", keep: int | None = None, **header: float) -> None:
    Path(name).write_bytes(dzt_header(samples=40, bits=32, **header) + COUNTS.astype("<i4").tobytes())  # type: ignore[arg-type]
    if keep is not None:
        Path(name).write_bytes(Path(name).read_bytes()[:keep])


def _two_channels() -> None:
    header = dzt_header(samples=40, bits=32, channels=2, word=2048)
    for name in ("a.DZT", "b.DZT"):
        Path(name).write_bytes(header * 2 + np.repeat(COUNTS[:, None], 2, 1).astype("<i4").tobytes())


def _beside(name: str, rows: int, columns_: int = 3, *, step: float = 0.05, head: str = "") -> None:
    """A line of twelve traces, and a table of places beside it."""
    _lines()
    _dzt("L1.DZT")
    cells = ((f"{step * row:.3f}", "0.0", "10.0")[:columns_] for row in range(rows))
    Path(name).write_text(head + "".join(",".join(row) + "\n" for row in cells), encoding="utf-8")


def _grid(east_m: float, north_m: float, head: str = "E,N,Z\n") -> None:
    _lines()
    rows = "".join(f"{east_m + 0.05 * row:.2f},{north_m},10\n" for row in range(12))
    Path("topo_L1.txt").write_text(head + rows, encoding="utf-8")


def _segy(*names: str, x: float, y: float, unit: int = 1, apart: float = 0.0) -> None:
    """Lines along x in steps of a twentieth, in metres or seconds of arc."""
    for number, name in enumerate(names):
        at = np.rint(100 * x) + 5 * np.arange(12)
        write_segy(Path(name), COUNTS, headers={71: -100, 73: at, 77: round(100 * (y + number * apart)), 89: unit})


def _signals(
    change: Callable[[str], str] = str, columns_of: Callable[[str], str] = str, **values: float | np.ndarray
) -> Path:
    table = columns() | {name: np.broadcast_to(value, 400) for name, value in values.items()}
    write_csv(Path("a.csv"), table)
    Path("a.csv").write_text(change(Path("a.csv").read_text()), encoding="utf-8")
    Path("m.toml").write_text(columns_of(_MAP), encoding="utf-8")
    return Path("a.csv")


def _plane_map(text: str) -> str:
    """The example of columns with metres in place of degrees."""
    for name, other in (("latitude", "north"), ("longitude", "east")):
        head, found, rest = text.partition(f"[signals.{name}]")
        text = head + found.replace(name, other) + rest.replace('unit = "deg"', 'unit = "m"', 1)
    return text


def _words(rows: range) -> Callable[[str], str]:
    """Puts a word in the column of speeds, in rows as a spreadsheet counts."""

    def change(text: str) -> str:
        lines = text.splitlines()
        for row in rows:
            cells = lines[row - 1].split(",")
            lines[row - 1] = ",".join([cells[0], "err", *cells[2:]])
        return "\n".join(lines) + "\n"

    return change


def _cmu(row: int, cell: int, text: str) -> None:
    write_cmu(Path())[0].rename("seq")
    lines = Path("seq/gpr_meas.csv").read_text().splitlines()
    cells = lines[row].split(",")
    lines[row] = ",".join([*cells[:cell], text, *cells[cell + 1 :]])
    Path("seq/gpr_meas.csv").write_text("\n".join(lines) + "\n")


def _gps(fixes: int, first: int = 1) -> Path:
    _lines()
    Path("L1.GPS").write_text(gps_text([[gga(n)] for n in range(fixes)], first=first), newline="")
    return Path("L1.GPS")


def _run_files(scale: float = 1.0) -> None:
    _write_run(Path("run"), 0.5 * np.arange(6))
    np.save("run/run_UTM_point.npy", scale * np.load("run/run_UTM_point.npy"))


def _folder() -> None:
    Path("d").mkdir()
    write_dt1(Path("d/L1.DT1"), COUNTS)


def _nothing() -> None:
    """No file at all."""


_GROUNDED = "import run --utm-zone 19N --sample-interval-ns 0.16 --scan-rate-hz 126"
# What a person did: makes the files, words without -o, what the answer is about, values that it names.
WRONG: dict[str, tuple[Callable[[], object], str, str, tuple[str, ...]]] = {
    # Files.
    "a text named .DT1": (
        lambda: (_lines(), Path("L1.DT1").write_text("notes\n" * 400)),
        "import L1.DT1",
        "L1.DT1: header of trace 0",
        ("40", "2"),
    ),
    "a picture named .DZT": (
        lambda: Path("a.DZT").write_bytes(b"\x89PNG\r\n\x1a\n" + bytes(range(256)) * 20),
        "import a.DZT",
        "a.DZT: header",
        (),
    ),
    "a truncated file": (lambda: _dzt(keep=2800), "import a.DZT", "a.DZT: traces", ("11", "--partial")),
    "a header without traces": (lambda: _dzt(keep=1024), "import a.DZT", "a.DZT: traces", ()),
    "an empty header file": (lambda: (_lines(), Path("L1.HD").write_bytes(b"")), "import L1.DT1", "L1.HD: file", ()),
    "a line without its header": (
        lambda: write_mala(Path("a.rd3"), COUNTS.astype("<i2")).with_suffix(".rad").unlink(),
        "import a.rd3",
        "a.rd3: header file",
        ("a.rad",),
    ),
    "a folder of lines": (_folder, "import d", "d", ("d/L1.DT1",)),
    "a folder for a line": (_folder, "import dzt d", "d: file", ()),
    "a folder for lines": (_folder, "import lines d", "d: file", ()),
    "the header in place of the line": (_lines, "import L1.HD", "L1.HD", ("L1.DT1",)),
    "the topography in place of the line": (lambda: _beside("L1.xyz", 103), "import L1.xyz", "L1.xyz", ("L1.DT1",)),
    "a topography of no line": (lambda: Path("L9.xyz").write_text("0 0 1\n"), "import L9.xyz", "L9.xyz", ()),
    "a drive log": (lambda: write_drive(Path("a.drive.h5")), "import a.drive.h5", "a.drive.h5", ()),
    "an archive": (lambda: Path("a.zip").write_bytes(b"PK"), "import a.zip", "a.zip", ()),
    "one file twice": (_lines, "import L1.DT1 ./L1.DT1 --line-spacing-m 1", "L1.DT1: lines", ()),
    "files of several channels": (_two_channels, "import a.DZT b.DZT --line-spacing-m 1", "a.DZT: channels", ("2",)),
    "lines of other lengths in time": (
        lambda: (_lines(), write_dt1(Path("L2.DT1"), COUNTS[:, :30])),
        "import L1.DT1 L2.DT1 --line-spacing-m 1",
        "L2.DT1: samples a trace",
        ("40", "L1.DT1", "30"),
    ),
    # Options.
    "one place for two lines": (
        lambda: _lines("L1", "L2"),
        "import lines L1.DT1 L2.DT1 --lines-at-m 0",
        "--lines-at-m",
        ("2", "1", "0"),
    ),
    "places with commas": (
        lambda: _lines("L1", "L2"),
        "import L1.DT1 L2.DT1 --lines-at-m 0,0.25",
        "--lines-at-m",
        ("'0,0.25'",),
    ),
    "places in millimetres": (
        lambda: _lines("L1", "L2"),
        "import L1.DT1 L2.DT1 --lines-at-m 0 2500",
        "--lines-at-m",
        ("100", "2500"),
    ),
    "a length in millimetres": (_lines, "import L1.DT1 --length-m 48500", "L1.DT1: trace spacing", ("10", "4409")),
    "a length of nothing": (_lines, "import L1.DT1 --length-m 0", "--length-m", ("0",)),
    "a latitude of none": (_lines, "import L1.DT1 --latitude-deg 131", "--latitude-deg", ("-90", "131")),
    "a line of none reversed": (_lines, "import L1.DT1 --reversed-lines 7", "--reversed-lines", ("0", "7")),
    "no scan a second": (
        _run_files,
        "import run --utm-zone 19N --sample-interval-ns 0.16 --scan-rate-hz 0",
        "--scan-rate-hz",
        ("0",),
    ),
    "a line recorded by time": (lambda: _dzt(per_m=0.0), "import a.DZT", "a.DZT: trace spacing", ("--length-m",)),
    # Positions.
    "places in millimetres beside a line": (
        lambda: _beside("L1.xyz", 12, step=50.0),
        "import L1.DT1",
        "L1.DT1: trace spacing",
        ("50",),
    ),
    "places of a grid": (
        lambda: _grid(360e3, 5116e3),
        "import L1.DT1",
        "topo_L1.txt: positions",
        ("10", "--utm-zone", "360000.5", "5116000"),
    ),
    "easting and northing exchanged": (
        lambda: _grid(5116e3, 360e3),
        "import L1.DT1 --utm-zone 33N",
        "topo_L1.txt: positions",
        ("UTM",),
    ),
    "metres of no UTM zone": (
        lambda: _grid(2360e3, 5116e3),
        "import L1.DT1 --utm-zone 33N",
        "topo_L1.txt: positions",
        ("UTM", "100000", "900000", "2.36e+06"),
    ),
    "a receiver's file of a longer line among others": (
        lambda: (_gps(300), _lines("L2")),
        "import L1.DT1 L2.DT1",
        "L1.GPS: traces",
        ("12", "L1.DT1", "288", "300"),
    ),
    "SEG-Y in degrees that are none": (
        lambda: _segy("a.sgy", x=46.19 * 3600, y=131.0 * 3600, unit=2),
        "import a.sgy",
        "a.sgy: trace spacing",
        ("--length-m", "46.19", "131"),
    ),
    "SEG-Y lines of a grid without its zone": (
        lambda: _segy("a.sgy", "b.sgy", x=360e3, y=511e3, apart=0.5),
        "import a.sgy b.sgy",
        "a.sgy: positions",
        ("--utm-zone", "360000"),
    ),
    "SEG-Y lines that tell the way along only": (
        lambda: _segy("a.sgy", "b.sgy", x=1.0, y=1.0),
        "import a.sgy b.sgy",
        "a.sgy: coordinates",
        ("--lines-at-m",),
    ),
    "positions of a run in degrees": (lambda: _run_files(1e-5), _GROUNDED, "run/run_UTM_point.npy: positions", ()),
    "a word among amplitudes": (
        lambda: _cmu(4, 7, "x"),
        "import seq --time-window-ns 8",
        "seq/gpr_meas.csv: row 4 below the heading, column 8",
        ("'x'",),
    ),
    # Tables of signals.
    "half a column of words": (
        lambda: _signals(_words(range(3, 203))),
        _SIGNALS,
        "a.csv: column 'v_kmh'",
        ("200", "400", "'err'", "3"),
    ),
    "decimal commas between commas": (
        lambda: _signals(lambda text: text.replace(".", ",")),
        _SIGNALS,
        "a.csv: row 2",
        ("10", "20"),
    ),
    "a table in Latin-1": (
        lambda: (_signals(), Path("a.csv").write_bytes(b"\xb0," + Path("a.csv").read_bytes())),
        _SIGNALS,
        "a.csv: file",
        ("CSV", "UTF-8", "0xb0"),
    ),
    "a table without a header": (lambda: _signals(lambda text: text.partition("\n")[2]), _SIGNALS, "a.csv: row 1", ()),
    "a header alone": (lambda: _signals(lambda text: text.partition("\n")[0]), _SIGNALS, "a.csv: rows", ()),
    "a name twice": (
        lambda: _signals(lambda text: text.replace("heading", "v_kmh", 1)),
        _SIGNALS,
        "a.csv: row 1",
        ("'v_kmh'",),
    ),
    "time that falls": (
        lambda: _signals(t_ms=np.where(np.arange(400) == 50, 4000.0, 5000.0 + 20.0 * np.arange(400))),
        _SIGNALS,
        "a.csv: time of 'v_kmh'",
        ("4.000000", "5.980000", "52"),
    ),
    "time in another unit": (
        lambda: _signals(t_ms=5.0 + 0.02 * np.arange(400)),
        _SIGNALS,
        "a.csv: column 't_ms'",
        ("1", "0.00798"),
    ),
    "east and north of no zone": (
        lambda: _signals(columns_of=lambda text: 'utm_zone = "33N"\n' + _plane_map(text), lat=5116e3, lon=2360e3),
        _SIGNALS,
        "a.csv: east and north",
        ("UTM",),
    ),
    "east and north without their zone": (
        lambda: _signals(columns_of=_plane_map, lat=5116e3, lon=360e3),
        _SIGNALS,
        "m.toml: utm_zone",
        ("33N", "5116000", "a.csv"),
    ),
    "a zone beside degrees": (
        lambda: _signals(columns_of=lambda text: 'utm_zone = "33N"\n' + text),
        _SIGNALS,
        "m.toml: utm_zone",
        ("'33N'",),
    ),
    "a folder for a table": (
        lambda: _signals().with_suffix(".d.csv").mkdir(),
        "import signals a.d.csv --columns m.toml",
        "a.d.csv: file",
        ("CSV",),
    ),
    "a spreadsheet": (
        lambda: (_signals(), Path("a.xlsx").write_bytes(b"PK")),
        "import signals a.xlsx --columns m.toml",
        "a.xlsx: file name",
        ("CSV",),
    ),
    # Words.
    "signals without import": (_nothing, "signals a.csv --columns m.toml", "signals", ("import signals",)),
    "signal": (_nothing, "signal a.csv", "signal", ("import signals",)),
    "a part of another group": (_nothing, "plan a.geojson", "plan", ("cover plan",)),
    "a recording for a verb": (_lines, "L1.DT1", "L1.DT1", ("import L1.DT1",)),
    "a format misspelt": (_nothing, "import seg-y a.sgy", "seg-y", ("segy",)),
    "a table without its format": (_signals, "import a.csv", "a.csv", ("FILE", "--columns", "COLUMNS.toml")),
}


@pytest.mark.parametrize("done", WRONG)
def test_the_answer_says_what_to_do(done: str, here: Path) -> None:
    make, words, about, values = WRONG[done]
    make()
    before = sorted(here.rglob("*"))
    answer = run(*words.split(), "-o", "x.drive.h5")
    # Bad input is in a place of a file, wrong usage an option or a word.
    assert answer.status == (1 if ": " in about else 2)
    assert answer.about == about
    told = answer.err.partition(about)[2]
    assert [value for value in values if value not in told] == []
    assert sorted(here.rglob("*")) == before


# Imports that succeed: makes the files, the words, how a line begins, and values in it.
SAID: dict[str, tuple[Callable[[], object], str, str, tuple[str, ...]]] = {
    "no place": (_lines, "import L1.DT1", "extent", ("0.55 m", "0.00 m")),
    "an array's width": (
        lambda: _lines("L1", "L2"),
        "import L1.DT1 L2.DT1 --lines-at-m 0 3 --heading-deg 0 --latitude-deg -33.5 --longitude-deg -70.6",
        "place",
        ("33.5000 S", "70.6000 W", "3.00 m", "0.55 m"),
    ),
    "another UTM zone": (
        lambda: _segy("a.sgy", x=360e3, y=5116e3),
        "import a.sgy --utm-zone 23S",
        "place",
        ("44.0958 S", "46.7490 W", "0.55 m", "0.01 m"),
    ),
    "latitude and longitude exchanged": (
        lambda: _signals(
            columns_of=lambda text: text.replace('"lat"', '"x"').replace('"lon"', '"lat"').replace('"x"', '"lon"')
        ),
        _SIGNALS,
        "place",
        ("11.0000 N", "46.0000 E", "7.74 m", "55.6 m"),
    ),
    "some words": (
        lambda: _signals(_words(range(11, 14))),
        _SIGNALS,
        "skipped in speed",
        ("3 of 400", "'v_kmh'", "'err'", "row 11"),
    ),
    "notes beside a line": (
        lambda: _beside("L1.txt", 0, head="walked by Anna\n"),
        "import L1.DZT",
        "note: L1.txt",
        (),
    ),
    "positions of nobody knows which line": (
        lambda: _beside("GPS.xyz", 103),
        "import L1.DZT",
        "note: GPS.xyz",
        ("L1.DZT",),
    ),
    "points along a line": (lambda: _beside("L1.csv", 5, 2), "import L1.DZT", "note: L1.csv", ()),
    "a length beside a topography": (lambda: _beside("L1.xyz", 103), "import L1.DZT --length-m 3", "note: L1.xyz", ()),
    "a topography ten times as long": (
        lambda: _beside("L1.xyz", 12, step=0.5),
        "import L1.DT1",
        "note: L1.DT1",
        ("5.50 m", "0.55 m"),
    ),
    "too many rows beside a DT1": (
        lambda: _beside("L1.xyz", 103),
        "import L1.DT1",
        "note: L1.xyz: not used: rows",
        ("12", "L1.DT1", "103"),
    ),
    "too many rows beside a DZT": (
        lambda: _beside("L1.xyz", 103),
        "import L1.DZT",
        "note: L1.xyz: not used: rows",
        ("12", "L1.DZT", "103"),
    ),
    "too many distances": (
        lambda: _beside("L1.csv", 30, 2),
        "import L1.DZT",
        "note: L1.csv: not used: rows",
        ("12", "L1.DZT", "30"),
    ),
    "distances of another line": (
        lambda: _beside("L1.csv", 5, 2, step=1.0),
        "import L1.DT1",
        "note: L1.csv: not used: rows",
        ("0.55", "L1.DT1", "4"),
    ),
    "a receiver's file of a longer line": (
        lambda: _gps(300),
        "import L1.DT1",
        "note: L1.GPS: not used: traces",
        ("12", "L1.DT1", "288", "300"),
    ),
    "a receiver's file of later traces": (
        lambda: _gps(30, first=100),
        "import L1.DT1",
        "note: L1.GPS: not used: traces",
        ("30",),
    ),
    "a receiver without a fix": (
        lambda: (_lines(), Path("L1.GPS").write_text(gps_text([[gga(n, quality=0)] for n in range(12)]), newline="")),
        "import L1.DT1",
        "note: L1.GPS: not used: positions",
        ("without fix 12",),
    ),
    "a receiver that stood still": (
        lambda: (_lines(), Path("L1.GPS").write_text(gps_text([[gga(5)], *[[]] * 5, [gga(5)]]), newline="")),
        "import L1.DT1",
        "note: L1.GPS: not used: positions",
        (),
    ),
    "a damaged file of a receiver": (
        lambda: _gps(12).write_bytes(Path("L1.GPS").read_bytes().replace(b"Trace #7", b"Trace x7")),
        "import L1.DT1",
        "note: L1.GPS: not used: line 13",
        (),
    ),
    "an empty topography": (
        lambda: (_lines(), Path("L1.xyz").write_bytes(b"")),
        "import L1.DT1",
        "note: L1.xyz: not used: file",
        (),
    ),
    "a header's length and a tape": (_lines, "import L1.DT1 --length-m 5", "note: L1.DT1", ("0.55 m", "5.00 m")),
    "dead traces": (lambda: write_dt1(Path("L1.DT1"), 0 * COUNTS), "import L1.DT1", "note: L1.DT1", ()),
    "a copy": (lambda: _lines("L1", "L2"), "import L1.DT1 L2.DT1 --line-spacing-m 1", "note: L2.DT1", ("L1.DT1",)),
    "a zone of nothing": (_lines, "import L1.DT1 --utm-zone 33N", "note", ("33N",)),
    "a zone beside a tape": (
        lambda: _segy("a.sgy", x=360e3, y=5116e3),
        "import a.sgy --utm-zone 33N --length-m 5",
        "note",
        ("33N",),
    ),
    "a place beside places": (lambda: _gps(12), "import L1.DT1 --latitude-deg 48", "note", ("latitude",)),
}


@pytest.mark.parametrize("done", SAID)
def test_what_looks_odd_is_said(done: str, here: Path) -> None:
    make, words, begins, values = SAID[done]
    make()
    printed = succeed(*words.split(), "-o", "x.drive.h5")
    told = [line for line in printed.splitlines() if line.startswith(f"{begins}:")]
    assert any(all(value in line for value in values) for line in told), printed
    assert here.joinpath("x.drive.h5").is_file()


def test_lines_of_one_name_are_told_apart_by_their_folders(here: Path) -> None:
    for folder in ("a", "b"):
        (here / folder).mkdir()
        write_dt1(here / folder / "L.DT1", COUNTS)
    told = succeed("import", "a/L.DT1", "b/L.DT1", "--line-spacing-m", 1, "-o", "x.drive.h5").splitlines()
    assert [row.split()[0] for row in told[1:3]] == ["a/L.DT1", "b/L.DT1"]


@pytest.mark.usefixtures("here")
def test_a_name_of_any_bytes_is_read(monkeypatch: pytest.MonkeyPatch) -> None:
    name = os.fsdecode(b"L\xfcneburg.DT1")
    write_dt1(Path(name), COUNTS)
    shown = {name: io.TextIOWrapper(io.BytesIO(), encoding="utf-8") for name in ("stdout", "stderr")}
    for stream, into in shown.items():
        monkeypatch.setattr(f"sys.{stream}", into)
    for given, status in ((name, 0), (os.fsdecode(b"L\xfcneborg.DT1"), 1)):
        with pytest.raises(SystemExit) as stopped:
            main(["import", given, "-o", "x.drive.h5"])
        assert stopped.value.code == status
    for into in shown.values():
        into.flush()
    out, err = (into.buffer.getvalue() for into in shown.values())
    assert b"L\xfcneburg.DT1" in out
    assert b"L\xfcneburg.DT1?" in err
