"""The import verbs as a field engineer meets them: what goes in, what comes out, one clear line when it cannot."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import segyio

from formats.samples import dzt_header, write_dt1
from formats.side_samples import cor_row
from formats.survey_sample import write_survey
from lgprjax.cli import main
from lgprjax.cli.recognised import recognised
from lgprjax.formats import DriveLog
from vendor_sets import COUNTS, write_cmu, write_gprmax, write_iprb, write_mala_pair, write_segy


def run(*arguments: object) -> int:
    """Exit status of a command."""
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    code = stopped.value.code
    assert isinstance(code, int)
    return code


_VERBS: dict[str, tuple[Callable[[Path], list[Path]], str, tuple[object, ...], int]] = {
    "mala": (lambda folder: write_mala_pair(folder, ".rd3"), "mala", (), 1),
    "mala 32 bit": (lambda folder: write_mala_pair(folder, ".rd7"), "mala", (), 1),
    "iprb": (write_iprb, "iprb", (), 2),
    "segy": (write_segy, "segy", (), 1),
    "segy told": (lambda folder: write_segy(folder, 4000), "segy", ("--sample-interval-ns", 0.2), 1),
    "gprmax": (write_gprmax, "gprmax", ("--sample-interval-ns", 0.2), 1),
    "cmu": (write_cmu, "cmu", ("--time-window-ns", 8), 1),
    "lines of rd7": (lambda folder: write_mala_pair(folder, ".rd7"), "lines", ("--line-spacing-m", 0.5), 1),
    "lines of iprb": (write_iprb, "lines", ("--line-spacing-m", 0.5), 2),
    "lines of segy": (write_segy, "lines", ("--line-spacing-m", 0.5), 1),
}


@pytest.mark.parametrize("case", _VERBS)
def test_import_check_and_what_is_in_it(case: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    make, verb, options, channels = _VERBS[case]
    paths = make(tmp_path)
    output = tmp_path / "X.drive.h5"
    place = ("--latitude-deg", 48, "--longitude-deg", 11, "--heading-deg", 30)
    assert run("import", verb, *paths, *options, *place, "-o", output) == 0
    assert capsys.readouterr().out.endswith(f"wrote {output}\n")
    assert run("check", output) == 0
    with DriveLog.open(output) as log:
        assert (log.scans, log.channels, log.samples) == (12, channels, 40)
        description = log.description
        traces, valid = log.read_traces(0, log.scans)
    assert valid.all()
    if verb != "gprmax":
        np.testing.assert_array_equal(traces, np.repeat(COUNTS[:, None], channels, axis=1))
    assert description.recording.sample_interval_ns == pytest.approx(0.2)  # type: ignore[union-attr]
    np.testing.assert_allclose(description.odometry.distance_m, 0.05 * np.arange(12), atol=1e-6)
    np.testing.assert_allclose(description.navigation.heading_deg, 30.0, atol=1e-3)
    assert abs(description.navigation.latitude_deg[0] - 48) < 1e-5
    # An output is not replaced unasked, and then as a whole.
    before = output.read_bytes()
    assert run("import", verb, *paths, *options, "-o", output) == 1
    assert "--force" in capsys.readouterr().err
    assert output.read_bytes() == before
    assert run("import", verb, *paths, *options, "-o", output, "--force") == 0
    assert "set to latitude 0, longitude 0" in capsys.readouterr().out


def test_segy_with_a_utm_zone_needs_no_origin(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    (path,) = write_segy(tmp_path)
    with segyio.open(str(path), "r+", ignore_geometry=True) as store:
        for index in range(12):
            store.header[index] = {73: 50_000_000 + 5 * index, 77: 531_600_000}
    assert run("import", "segy", path, "--utm-zone", "32N", "-o", tmp_path / "X.drive.h5") == 0
    assert "latitude 0" not in capsys.readouterr().out
    with DriveLog.open(tmp_path / "X.drive.h5") as log:
        # Due east on the central meridian of zone 32.
        np.testing.assert_allclose(log.description.navigation.longitude_deg, 9.0, atol=1e-4)
        np.testing.assert_allclose(log.description.navigation.heading_deg, 90.0, atol=1e-3)


@pytest.mark.parametrize(
    ("case", "status", "words"),
    [
        (
            "mala wrong suffix",
            1,
            "expected a name that ends in .rd3 or .rd7 (lgprjax import FILE recognises the format), found 'line.sgy'",
        ),
        ("segy no interval", 1, "sample interval: expected one interval word that reads as picoseconds"),
        ("gprmax cut", 1, "scan5.out: file: expected a whole gprMax file (HDF5)"),
        ("gprmax needless step", 1, "--step-m: expected a merged B-scan"),
        ("iprb cut", 1, "SITE_001_A02.iprb: traces: expected 12 as SITE_001_A02.iprh says, found 11 and a part"),
        ("cmu no window", 2, "--time-window-ns"),
        ("cmu no odometry", 1, "we_odom.csv: file: expected a readable file"),
        ("iprb nothing", 2, "channels: expected at least one file, found none"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(
    case: str, status: int, words: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "X.drive.h5"
    if case == "mala wrong suffix":
        command: tuple[object, ...] = ("mala", *write_segy(tmp_path))
    elif case == "segy no interval":
        command = ("segy", *write_segy(tmp_path, 4000))
    elif case.startswith("gprmax"):
        paths = write_gprmax(tmp_path)
        command = ("gprmax", *paths, "--step-m", 0.1) if case.endswith("step") else ("gprmax", *paths)
        if case.endswith("cut"):
            paths[4].write_bytes(paths[4].read_bytes()[:900])
    elif case == "iprb cut":
        paths = write_iprb(tmp_path)
        paths[1].write_bytes(paths[1].read_bytes()[:-5])
        command = ("iprb", *paths)
    elif case == "iprb nothing":
        command = ("iprb",)
    else:
        (sequence,) = write_cmu(tmp_path)
        command = ("cmu", sequence) if case.endswith("window") else ("cmu", sequence, "--time-window-ns", 8)
        if case.endswith("odometry"):
            (sequence / "we_odom.csv").unlink()
    before = sorted(tmp_path.rglob("*"))
    assert run("import", *command, "-o", output) == status
    error = capsys.readouterr().err
    assert words in error
    assert status == 2 or len(error.strip().splitlines()) == 1
    assert sorted(tmp_path.rglob("*")) == before


@pytest.mark.parametrize("verb", ["mala", "iprb", "segy", "gprmax", "cmu", "lines"])
def test_help_tells_the_layout_and_the_units(verb: str, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("import", verb, "--help") == 0
    text = capsys.readouterr().out
    told = {
        "mala": ".rd7",
        "iprb": "_A01.iprb",
        "segy": "lgprjax[segy]",
        "gprmax": "--step-m",
        "cmu": "ts_meas.csv",
        "lines": "SEG-Y",
    }
    assert told[verb] in text
    assert "--latitude-deg" in text


def _dt1(folder: Path) -> list[Path]:
    return [write_dt1(folder / f"LINE{number}.DT1", COUNTS) for number in range(2)]


def _dzt(folder: Path) -> list[Path]:
    path = folder / "line.DZT"
    path.write_bytes(dzt_header(samples=40, bits=32) + COUNTS.astype("<i4").tobytes())
    return [path]


# What makes the files, and the program that made the drive log of them when only the files are named.
_NAMED_ALONE: dict[str, tuple[Callable[[Path], list[Path]], tuple[object, ...], str]] = {
    "dt1": (_dt1, ("--line-spacing-m", 0.5), "lgprjax import lines"),
    "dzt": (_dzt, (), "lgprjax import lines"),
    "rd3": (lambda folder: write_mala_pair(folder, ".rd3"), (), "lgprjax import lines"),
    "rd7": (lambda folder: write_mala_pair(folder, ".rd7"), (), "lgprjax import lines"),
    "iprb": (write_iprb, (), "lgprjax import iprb"),
    "iprb by tape": (write_iprb, ("--line-spacing-m", 0.5), "lgprjax import lines"),
    "segy": (write_segy, (), "lgprjax import segy"),
    "gprmax": (write_gprmax, (), "lgprjax import gprmax"),
    "cmu": (write_cmu, ("--time-window-ns", 8), "lgprjax import cmu"),
}


@pytest.mark.parametrize("case", _NAMED_ALONE)
def test_files_tell_their_format(case: str, tmp_path: Path) -> None:
    make, options, made_by = _NAMED_ALONE[case]
    output = tmp_path / "X.drive.h5"
    assert run("import", *make(tmp_path), *options, "-o", output) == 0
    with DriveLog.open(output) as log:
        assert log.description.provenance["made_by"] == made_by
        assert log.scans == 12


@pytest.mark.parametrize(
    ("words", "known"),
    [
        ("a.MCAP -o x.drive.h5", "mcap"),
        ("scan.h5 -o x.drive.h5", "gprmax"),
        ("-o x.h5 a.DT1", "lines"),
        ("a.drive.h5", None),
        ("a.map.h5", None),
        ("notes.pdf", None),
        ("--help", None),
        ("dt1 a.DZT", None),
        ("a.sgy b.SGY --line-spacing-m 1", "lines"),
        ("a.segy --lines-at-m=0", "lines"),
        ("S_001_A01.iprb S_002_A01.iprb", "lines"),
        ("--latitude-deg 48 S_001_A01.iprb S_001_a02.IPRB", "iprb"),
    ],
)
def test_what_is_recognised(words: str, known: str | None) -> None:
    given = words.split()
    assert recognised(given) == (given if known is None else [known, *given])
    assert recognised([]) == []


@pytest.mark.parametrize(("name", "known"), [("run.npy", "grounded"), ("gpr_meas.csv", "cmu")])
def test_folders_are_recognised_by_what_is_in_them(name: str, known: str, tmp_path: Path) -> None:
    assert recognised([str(tmp_path)]) == [str(tmp_path)]
    (tmp_path / name).touch()
    assert recognised([str(tmp_path)]) == [known, str(tmp_path)]


def test_table_has_a_row_a_line_and_says_what_is_assumed(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    paths, _ = write_survey(tmp_path, firsts=[10, 12, 9], reversed_lines=[1], inverted=[2], time_zeros={0: 0.0})
    output = tmp_path / "X.drive.h5"
    assert run("import", *paths, "--line-spacing-m", 0.5, "-o", output) == 0
    head, *rows, legend, assumed, extent, wrote, origin = capsys.readouterr().out.splitlines()
    assert head.split()[:6] == ["line", "traces", "header", "break", "wave", "zero"]
    assert [row.split()[0] for row in rows] == [path.name for path in paths]
    assert [row.split()[1] for row in rows] == ["100"] * 3
    assert ["reversed" in row for row in rows] == [False, True, False]
    assert ["inverted" in row for row in rows] == [False, False, True]
    assert ["first break" in row for row in rows] == [True, False, False]
    assert legend.endswith("positions from: tape")
    assert assumed.startswith("assumed, as no instrument recorded it: time (unknown), speed (1 m/s)")
    assert "place on the earth (latitude 0, longitude 0)" in assumed
    assert "direction (as stored)" in assumed
    assert wrote == f"wrote {output}"
    assert origin.startswith("the site's origin was set to latitude 0, longitude 0")
    assert extent == "extent: 25.2 m from west to east, 1.00 m from south to north"
    # A single line cannot tell its direction; where it lies was said.
    assert run("import", paths[0], "--latitude-deg", 48, "-o", output, "--force") == 0
    head, row, _, assumed, place, wrote = capsys.readouterr().out.splitlines()
    assert place.startswith("place: 48.0000 N, 0.0000 E; extent: 24.7 m from west to east")
    assert "assumed" in row
    assert head.startswith("line")
    assert wrote == f"wrote {output}"
    assert "direction (as stored)" in assumed
    assert "place on the earth" not in assumed


def test_receiver_beside_the_line_leaves_no_origin_to_be_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = write_dt1(tmp_path / "a.DT1", COUNTS)
    rows = [cor_row(1 + n, latitude=f"{46.2 + 1e-6 * n:.7f}\tN") for n in range(12)]
    path.with_suffix(".cor").write_text("".join(rows), newline="")
    assert run("import", path, "-o", tmp_path / "X.drive.h5") == 0
    out = capsys.readouterr().out
    assert "positions from: receiver" in out
    assert "latitude 0" not in out
    assert "--latitude-deg" not in out


def test_cut_line_is_told_in_the_table(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    path = write_dt1(tmp_path / "a.DT1", COUNTS)
    path.write_bytes(path.read_bytes()[:-9])
    assert run("import", path, "-o", tmp_path / "X.drive.h5") == 1
    assert "read the whole ones with lgprjax import --partial" in capsys.readouterr().err
    assert run("import", path, "--partial", "-o", tmp_path / "X.drive.h5") == 0
    assert "11 of 12 traces" in capsys.readouterr().out
