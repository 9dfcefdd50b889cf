"""The import verbs as a field engineer meets them: what goes in, what comes out, one clear line when it cannot."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import segyio

from canon.commands import run, shell, succeed
from formats.samples import dzt_header, write_dt1
from formats.side_samples import cor_row
from formats.survey_sample import write_survey
from lgprjax.cli.recognised import recognised
from lgprjax.formats import DriveLog, TraceRecording
from vendor_sets import COUNTS, write_cmu, write_gprmax, write_iprb, write_mala_pair, write_segy

_VERBS: dict[str, tuple[Callable[[Path], list[Path]], str, tuple[object, ...], int]] = {
    "mala": (lambda folder: write_mala_pair(folder, ".rd3"), "mala", (), 1),
    "mala 32 bit": (lambda folder: write_mala_pair(folder, ".rd7"), "mala", (), 1),
    "iprb": (write_iprb, "iprb", (), 2),
    "segy": (write_segy, "segy", (), 1),
    "segy told": (lambda folder: write_segy(folder, 4000), "segy", ("--sample-interval-ns", 0.2), 1),
    "gprmax": (write_gprmax, "gprmax", ("--sample-interval-ns", 0.2), 1),
    "cmu": (write_cmu, "cmu", ("--time-window-ns", 8, "--time-zero-ns", 0.4), 1),
    "lines of rd7": (lambda folder: write_mala_pair(folder, ".rd7"), "lines", ("--line-spacing-m", 0.5), 1),
    "lines of iprb": (write_iprb, "lines", ("--line-spacing-m", 0.5), 2),
    "lines of segy": (write_segy, "lines", ("--line-spacing-m", 0.5), 1),
}


@pytest.mark.parametrize("case", _VERBS)
def test_import_check_and_what_is_in_it(case: str, tmp_path: Path) -> None:
    make, verb, options, channels = _VERBS[case]
    paths = make(tmp_path)
    output = tmp_path / "X.drive.h5"
    place = ("--latitude-deg", 48, "--longitude-deg", 11, "--heading-deg", 30)
    *_, result, following = succeed("import", verb, *paths, *options, *place, "-o", output).splitlines()
    assert result == f"result: wrote {output}: 12 scans, {channels} channel{'s' if channels > 1 else ''}"
    assert following == f"next: lgprjax check {output} --health"
    succeed("check", output)
    with DriveLog.open(output) as log:
        assert (log.scans, log.channels, log.samples) == (12, channels, 40)
        description = log.description
        traces, valid = log.read_traces(0, log.scans)
    assert valid.all()
    if verb != "gprmax":
        np.testing.assert_array_equal(traces, np.repeat(COUNTS[:, None], channels, axis=1))
    assert isinstance(description.recording, TraceRecording)
    assert description.recording.sample_interval_ns == pytest.approx(0.2)
    if "--time-zero-ns" in options:
        assert description.recording.time_zero_ns == options[-1]
    np.testing.assert_allclose(description.odometry.distance_m, 0.05 * np.arange(12), atol=1e-6)
    np.testing.assert_allclose(description.navigation.heading_deg, 30.0, atol=1e-3)
    assert abs(description.navigation.latitude_deg[0] - 48) < 1e-5
    # An output is not replaced unasked, and then as a whole.
    before = output.read_bytes()
    run("import", verb, *paths, *options, "-o", output).refusal.check("output", "--force", file=output)
    assert output.read_bytes() == before
    assert "latitude 0, longitude 0" in succeed("import", verb, *paths, *options, "-o", output, "--force")


def test_segy_with_a_utm_zone_needs_no_origin(tmp_path: Path) -> None:
    (path,) = write_segy(tmp_path)
    with segyio.open(str(path), "r+", ignore_geometry=True) as store:
        for index in range(12):
            store.header[index] = {73: 50_000_000 + 5 * index, 77: 531_600_000}
    assert "latitude 0" not in succeed("import", "segy", path, "--utm-zone", "32N", "-o", tmp_path / "X.drive.h5")
    with DriveLog.open(tmp_path / "X.drive.h5") as log:
        # Due east on the central meridian of zone 32.
        np.testing.assert_allclose(log.description.navigation.longitude_deg, 9.0, atol=1e-4)
        np.testing.assert_allclose(log.description.navigation.heading_deg, 90.0, atol=1e-3)


def _cut(path: Path, size: int) -> None:
    path.write_bytes(path.read_bytes()[:size])


# What makes or damages the files, the words, the status, what is refused, and values.
_BAD: dict[str, tuple[Callable[[Path], object], str, int, str, tuple[object, ...]]] = {
    "mala wrong suffix": (write_segy, "mala line.sgy", 1, "line.sgy: file name", (".rd3", ".rd7")),
    "segy no interval": (lambda folder: write_segy(folder, 4000), "segy line.sgy", 1, "line.sgy: sample interval", ()),
    "gprmax cut": (
        lambda folder: _cut(write_gprmax(folder)[4], 900),
        "gprmax scan*.out",
        1,
        "scan5.out: file",
        ("HDF5",),
    ),
    "gprmax needless step": (write_gprmax, "gprmax scan*.out --step-m 0.1", 1, "scan1.out: --step-m", ()),
    "iprb cut": (
        lambda folder: _cut(write_iprb(folder)[1], -5),
        "iprb SITE_001_A*.iprb",
        1,
        "SITE_001_A02.iprb: traces",
        (12, "SITE_001_A02.iprh", 11),
    ),
    "cmu no window": (write_cmu, "cmu SEQUENCE", 2, "--time-window-ns", ()),
    "cmu no odometry": (
        lambda folder: (write_cmu(folder)[0] / "we_odom.csv").unlink(),
        "cmu SEQUENCE --time-window-ns 8",
        1,
        "SEQUENCE/we_odom.csv: file",
        (),
    ),
    "iprb nothing": (lambda _: None, "iprb", 2, "channels", ()),
}


@pytest.mark.parametrize("case", _BAD)
def test_bad_input_is_one_line_and_leaves_nothing(case: str, here: Path) -> None:
    make, words, status, about, values = _BAD[case]
    make(here)
    before = sorted(here.rglob("*"))
    (given,) = shell(f"lgprjax import {words} -o X.drive.h5")
    done = run(*(next(here.iterdir()).name if word == "SEQUENCE" else word for word in given))
    assert (done.status, done.about) == (status, about.replace("SEQUENCE", before[0].name if before else ""))
    assert [value for value in values if str(value) not in done.err] == []
    assert sorted(here.rglob("*")) == before


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
    succeed("import", *make(tmp_path), *options, "-o", output)
    with DriveLog.open(output) as log:
        assert log.description.provenance["made_by"] == made_by
        assert log.scans == 12


def test_what_is_recognised(here: Path) -> None:
    """Files by their names, folders by what is in them."""
    for words, known in (
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
        ("", None),
    ):
        given = words.split()
        assert recognised(given) == (given if known is None else [known, *given]), words
    for name, known in (("run.npy", "grounded"), ("gpr_meas.csv", "cmu")):
        folder = here / known
        folder.mkdir()
        assert recognised([str(folder)]) == [str(folder)]
        (folder / name).touch()
        assert recognised([str(folder)]) == [known, str(folder)]


def test_table_has_a_row_a_line_and_says_what_is_assumed(tmp_path: Path) -> None:
    paths, _ = write_survey(tmp_path, firsts=[10, 12, 9], reversed_lines=[1], inverted=[2], time_zeros={0: 0.0})
    output = tmp_path / "X.drive.h5"
    told = succeed("import", *paths, "--line-spacing-m", 0.5, "-o", output).splitlines()
    _, *rows, legend, assumed, origin, extent, wrote, _ = told
    assert [row.split()[:2] for row in rows] == [[path.name, "100"] for path in paths]
    assert ["reversed" in row for row in rows] == [False, True, False]
    assert ["inverted" in row for row in rows] == [False, False, True]
    assert ["first break" in row for row in rows] == [True, False, False]
    assert legend.endswith("tape")
    named = ("time (unknown)", "speed (1 m/s)", "(latitude 0, longitude 0)", "direction (as stored)")
    assert all(each in assumed for each in named)
    assert wrote.startswith(f"result: wrote {output}: 102 scans, 3 channels")
    assert "latitude 0, longitude 0" in origin
    assert all(length in extent for length in ("25.2 m", "1.00 m"))
    # A single line cannot tell its direction; where it lies was said.
    told = succeed("import", paths[0], "--latitude-deg", 48, "-o", output, "--force").splitlines()
    _, row, _, assumed, place, wrote, _ = told
    assert place.startswith("place: 48.0000 N, 0.0000 E; extent: 24.7 m")
    assert "assumed" in row
    assert wrote.startswith(f"result: wrote {output}: ")
    assert "direction (as stored)" in assumed
    assert "latitude" not in assumed


def test_receiver_beside_the_line_leaves_no_origin_to_be_said(tmp_path: Path) -> None:
    path = write_dt1(tmp_path / "a.DT1", COUNTS)
    rows = [cor_row(1 + n, latitude=f"{46.2 + 1e-6 * n:.7f}\tN") for n in range(12)]
    path.with_suffix(".cor").write_text("".join(rows), newline="")
    out = succeed("import", path, "-o", tmp_path / "X.drive.h5")
    assert "receiver" in out
    assert "latitude 0" not in out
    assert "--latitude-deg" not in out


def test_cut_line_is_told_in_the_table(tmp_path: Path) -> None:
    path = write_dt1(tmp_path / "a.DT1", COUNTS)
    path.write_bytes(path.read_bytes()[:-9])
    assert "--partial" in run("import", path, "-o", tmp_path / "X.drive.h5").err
    assert "11 of 12" in succeed("import", path, "--partial", "-o", tmp_path / "X.drive.h5")
