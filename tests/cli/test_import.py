"""The import verbs as a field engineer meets them: what goes in, what comes out, one clear line when it cannot."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import segyio

from lgprjax.cli import main
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
    assert capsys.readouterr().out == f"wrote {output}\n"
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
    assert "put at latitude 0, longitude 0" in capsys.readouterr().out


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
        ("mala wrong suffix", 1, "expected a name that ends in .rd3 or .rd7, found 'line.sgy'"),
        ("segy no interval", 1, "sample interval: expected one interval word that reads as picoseconds"),
        ("gprmax cut", 1, "scan5.out: file: expected a whole gprMax file (HDF5)"),
        ("gprmax needless step", 1, "--step-m: expected a merged B-scan"),
        ("iprb cut", 1, "SITE_001_A02.iprb: size: expected 12 traces of 40 samples"),
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
