"""The command line as a person meets it: statuses, one clear line, nothing half-written."""

import json
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import h5py
import numpy as np
import pandas as pd
import pytest

from canon.site import Site
from lgprjax.cli import main
from lgprjax.formats import DriveLog, DriveWriter, MapFile


def run(*arguments: object) -> int:
    """Exit status of a command."""
    with pytest.raises(SystemExit) as stopped:
        main([str(a) for a in arguments])
    code = stopped.value.code
    assert isinstance(code, int)
    return code


def listing(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


@pytest.fixture(scope="module")
def short(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 120 scans of the live drive: a small log to damage."""
    path = tmp_path_factory.mktemp("short") / "short.drive.h5"
    with DriveLog.open(site.logs["live"]) as log:
        traces, _ = log.read_traces(0, 120)
        with DriveWriter.create(path, log.description, channels=log.channels, dtype=np.uint8) as writer:
            writer.append(log.scan_time_s[:120], (traces + 128).astype(np.uint8))
    return path


def edited(source: Path, target: Path, change: Callable[[h5py.File], None]) -> Path:
    target.write_bytes(source.read_bytes())
    with h5py.File(target, "r+") as store:
        change(store)
    return target


def delete(path: str) -> Callable[[h5py.File], None]:
    def change(store: h5py.File) -> None:
        del store[path]

    return change


def attribute(path: str, name: str, value: object) -> Callable[[h5py.File], None]:
    def change(store: h5py.File) -> None:
        store[path].attrs[name] = value

    return change


def swap_times(store: h5py.File) -> None:
    times = store["/radar/time_s"][()]
    times[[10, 11]] = times[[11, 10]]
    store["/radar/time_s"][...] = times


def short_array(store: h5py.File) -> None:
    x = store["/array/x_m"][()]
    unit, text = store["/array/x_m"].attrs["unit"], store["/array/x_m"].attrs["description"]
    del store["/array/x_m"]
    store["/array/x_m"] = x[:-1]
    store["/array/x_m"].attrs["unit"], store["/array/x_m"].attrs["description"] = unit, text


def truncate(source: Path, target: Path) -> Path:
    target.write_bytes(source.read_bytes()[: source.stat().st_size // 2])
    return target


def one_scan(store: h5py.File) -> None:
    for name in ("time_s", "traces", "valid"):
        store[f"/radar/{name}"].resize(1, axis=0)


BAD_LOGS: dict[str, tuple[Callable[[Path, Path], Path], str]] = {
    "truncated": (truncate, "whole HDF5 file"),
    "empty": (lambda _, t: (t.write_bytes(b""), t)[1], "empty file"),
    "wrong magic": (lambda _, t: (t.write_bytes(b"GIF89a" * 100), t)[1], "another format"),
    "missing": (lambda _, t: t, "No such file"),
    "missing dataset": (lambda s, t: edited(s, t, delete("/odometry/distance_m")), "/odometry/distance_m"),
    "wrong unit": (lambda s, t: edited(s, t, attribute("/odometry/distance_m", "unit", "ft")), "'ft'"),
    "wrong shape": (lambda s, t: edited(s, t, short_array), "/array/"),
    "zero interval": (
        lambda s, t: edited(s, t, attribute("/radar/traces", "sample_interval_ns", 0.0)),
        "sample_interval_ns",
    ),
    "negative interval": (
        lambda s, t: edited(s, t, attribute("/radar/traces", "sample_interval_ns", -0.1)),
        "from 0.001 to 1000",
    ),
    "time not rising": (lambda s, t: edited(s, t, swap_times), "strictly increasing"),
    "newer schema": (lambda s, t: edited(s, t, attribute("/", "schema_version", "2.0")), "update lgprjax"),
    "one scan": (lambda s, t: edited(s, t, one_scan), "at least 2"),
}


@pytest.mark.parametrize("case", BAD_LOGS)
@pytest.mark.parametrize("verb", ["check", "map", "register"])
def test_bad_log_is_one_line_and_status_1(
    case: str, verb: str, site: Site, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    make, expected = BAD_LOGS[case]
    bad = make(short, tmp_path / "bad.drive.h5")
    before = listing(tmp_path)
    commands = {
        "check": ("check", bad),
        "map": ("map", "build", bad, "-o", tmp_path / "new.map.h5"),
        "register": ("register", site.map, bad, "-o", tmp_path / "new"),
    }
    assert run(*commands[verb]) == 1
    out, err = capsys.readouterr()
    told = out if verb == "check" else err
    assert expected in told
    assert "bad.drive.h5" in told
    assert "Traceback" not in out + err
    if verb != "check":
        assert len(err.strip().splitlines()) == 1
    assert listing(tmp_path) - before <= {"new"}
    assert not list(tmp_path.glob("new/*"))


def test_a_broken_second_drive_costs_nothing(
    site: Site, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    bad = truncate(short, tmp_path / "bad.drive.h5")
    assert run("register", site.map, short, bad, "-o", tmp_path / "new") == 1
    assert "bad.drive.h5" in capsys.readouterr().err
    assert listing(tmp_path) == {"bad.drive.h5"}


def test_output_below_a_file_is_one_line(
    site: Site, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").write_text("x")
    assert run("register", site.map, short, "-o", tmp_path / "file" / "out") == 1
    assert run("demo", "--output", tmp_path / "file") == 1
    assert len(capsys.readouterr().err.strip().splitlines()) == 2


def test_a_silent_drive_makes_no_map(short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    silent = tmp_path / "silent.drive.h5"
    with DriveLog.open(short) as log:
        quiet = np.full((log.scans, log.channels, log.samples), 128, np.uint8)
        description, times = log.description, log.scan_time_s
    with DriveWriter.create(silent, description, channels=quiet.shape[1], dtype=np.uint8) as writer:
        writer.append(times, quiet)
    assert run("map", "build", silent, "-o", tmp_path / "m.map.h5") == 1
    assert "a signal that changes" in capsys.readouterr().err
    assert listing(tmp_path) == {"silent.drive.h5"}


def test_map_that_is_no_map(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("register", site.logs["live"], site.logs["live"], "-o", tmp_path / "new") == 1
    assert "lgprjax.map" in capsys.readouterr().err
    assert run("map", "info", site.logs["live"]) == 1


def test_nan_and_inf_are_reported_by_check(short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A bad scan never stops a drive: check warns, and the status stays 0."""
    bad = tmp_path / "nan.drive.h5"
    with DriveLog.open(short) as log:
        traces, _ = log.read_traces(0, 60)
        traces = traces + np.float32(128)
        traces[7, 2, 5], traces[9] = np.nan, np.inf
        with DriveWriter.create(bad, log.description, channels=log.channels, dtype=np.float32) as writer:
            writer.append(log.scan_time_s[:60], traces)
    assert run("check", bad) == 0
    assert "warning" in capsys.readouterr().out


def test_output_that_exists_is_refused_before_any_work(
    site: Site, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    database = tmp_path / "m.map.h5"
    database.write_text("precious")
    assert run("map", "build", short, "-o", database) == 1
    assert "--force" in capsys.readouterr().err
    assert database.read_text() == "precious"
    folder = tmp_path / "out"
    folder.mkdir()
    (folder / "short.fixes.csv").write_text("precious")
    assert run("register", site.map, short, "-o", folder) == 1
    assert "--force" in capsys.readouterr().err
    assert (folder / "short.fixes.csv").read_text() == "precious"
    assert listing(folder) == {"short.fixes.csv"}


def test_register_writes_what_it_promises(
    site: Site, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    folder = tmp_path / "out"
    assert run("register", site.map, short, "-o", folder, "--json", tmp_path / "figures.json") == 0
    told = capsys.readouterr().out
    assert "report.html" in told
    assert "few scans" not in told
    assert listing(folder) == {
        "short.fixes.csv",
        "short.fixes.h5",
        "short-trajectory.png",
        "short-confidence.png",
        "short-match.png",
        "short-map.png",
        "short-scans.html",
        "codes.png",
        "summary.json",
        "report.html",
    }
    table = pd.read_csv(folder / "short.fixes.csv")
    assert list(table.columns) == [
        *("scan", "time_s", "latitude_deg", "longitude_deg", "height_m", "heading_deg", "roll_deg"),
        *("sigma_along_m", "sigma_cross_m", "correlation", "margin", "overlap_channels", "code"),
        *("time_scale", "p_false", "window_m"),
    ]
    assert len(table) == 120
    ok = table[table["code"] == "ok"]
    # The first metre or so may be too little ground to be sure.
    assert (table["code"][40:] == "ok").mean() > 0.95
    assert ok["latitude_deg"].between(41.9, 42.1).all()
    with h5py.File(folder / "short.fixes.h5") as fixes:
        heading_deg, sigma_rad = fixes["heading_deg"][:], np.sqrt(fixes["covariance"][:, 3, 3])
    # Until the ground has confirmed the log's heading, a single scan of an array a metre wide knows it to 3 degrees.
    ours = ok.index.to_numpy()
    assert np.degrees(sigma_rad[ours]).max() < 4.0
    assert (np.abs(heading_deg - 90.0) < np.degrees(4.0 * sigma_rad))[ours].all()
    assert ok["height_m"].between(30.1, 30.5).all()
    assert (ok["p_false"] <= 1e-4).all()
    assert table["window_m"].dropna().between(0.0, 8.0).all()
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert "risk 0.0001 in each 4 m of travel" in page
    declined = set(table["code"]) - {"ok"}
    assert all(f"<td>{code}</td>" in page for code in declined)
    first = (folder / "short.fixes.csv").read_text().splitlines()[60].split(",")
    assert all(len(first[column].split(".")[1]) >= 9 for column in (2, 3))
    (figures,) = json.loads((tmp_path / "figures.json").read_text())
    assert figures["tried"] == 120
    assert run("check", folder / "short.fixes.csv", folder / "short.fixes.h5", site.map) == 0
    capsys.readouterr()
    # Another drive into the same folder: nothing of the first is lost, and page and summary have both.
    shutil.copyfile(short, tmp_path / "again.drive.h5")
    held = {path: path.read_bytes() for path in folder.glob("short*")}
    assert run("register", site.map, tmp_path / "again.drive.h5", "-o", folder, "--json", "-") == 0
    (alone,) = json.loads(capsys.readouterr().out)
    assert alone["name"] == "again"
    assert {path: path.read_bytes() for path in folder.glob("short*")} == held
    assert [entry["name"] for entry in json.loads((folder / "summary.json").read_text())] == ["short", "again"]
    page = (folder / "report.html").read_text(encoding="utf-8")
    assert all(page.count(f"<h2>{name} on ") == 1 for name in ("short", "again"))
    # The same drive once more is refused; --force replaces its files and leaves the other's.
    assert run("register", site.map, tmp_path / "again.drive.h5", "-o", folder) == 1
    assert "again.fixes.csv" in capsys.readouterr().err
    assert run("register", site.map, tmp_path / "again.drive.h5", "-o", folder, "--force") == 0
    assert {path: path.read_bytes() for path in folder.glob("short*")} == held
    assert [entry["name"] for entry in json.loads((folder / "summary.json").read_text())] == ["short", "again"]


@pytest.mark.parametrize("verb", ["map", "register"])
def test_full_disk_is_one_line_and_leaves_nothing_half_written(
    verb: str, site: Site, short: Path, tmp_path: Path
) -> None:
    """Files may grow to 60 kB and no further, as on a disk that fills up."""
    target = tmp_path / ("m.map.h5" if verb == "map" else "out")
    words = ["map", "build", short] if verb == "map" else ["register", site.map, short]
    limit = "import resource; resource.setrlimit(resource.RLIMIT_FSIZE, (60_000, 60_000))"
    code = f"{limit}; from lgprjax.cli import main; main({[str(w) for w in (*words, '-o', target)]!r})"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 1, done.stderr
    assert len(done.stderr.strip().splitlines()) == 1
    assert "File too large" in done.stderr
    left = listing(tmp_path)
    assert not [name for name in left if "partial" in name]
    # What was finished before the disk was full is whole.
    files = [tmp_path / name for name in left if name.endswith((".h5", ".csv"))]
    assert not files or run("check", *files) == 0


def test_map_info(site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    assert run("map", "info", site.map, "--json", tmp_path / "info.json") == 0
    figures = json.loads((tmp_path / "info.json").read_text())
    assert figures["baselines"] == 2
    assert figures["channels"] == 11
    assert 60 < figures["length_m"] < 80
    assert figures["labels"].startswith("sigma ")
    assert "cm" in figures["labels"]
    told = capsys.readouterr().out
    assert "baselines" in told
    with MapFile.open(site.map) as source:
        chance = source.chance
    assert chance is not None
    assert chance.own
    assert figures["noise_floor"] == f"own; {chance.pieces} independent pieces"
    # The tail share · exp(-(z² - start)/scale) reaches the risk just there.
    assert list(figures["least_score"]) == ["0 m", "1 m", "2 m", "4 m", "8 m"]
    z = np.array(list(figures["least_score"].values()))
    reached = chance.share * np.exp(-(z**2 - chance.start) / chance.scale)
    # Any of the five windows may pass.
    np.testing.assert_allclose(np.log10(5.0 * reached), -4.0, atol=0.1)


def test_map_info_tells_of_maps_that_borrow_a_noise_floor_or_have_none_yet(
    site: Site, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    small, old = tmp_path / "small.map.h5", tmp_path / "old.map.h5"
    for path in (small, old):
        path.write_bytes(site.map.read_bytes())
    with h5py.File(small, "r+") as store:
        store["chance"].attrs["own"], store["chance"].attrs["pieces"] = 0.0, 17.0
    with h5py.File(old, "r+") as store:
        del store["chance"]
    assert run("map", "info", small, "--json", tmp_path / "small.json") == 0
    told = json.loads((tmp_path / "small.json").read_text())["noise_floor"]
    assert told == "pooled over many grounds: this map is too small for its own; 17 independent pieces"
    assert run("map", "info", old, "--json", tmp_path / "old.json") == 0
    assert json.loads((tmp_path / "old.json").read_text())["least_score"] is None
    assert "measured at the first registration" in " ".join(capsys.readouterr().out.replace("│", " ").split())


@pytest.mark.parametrize(
    "option",
    [
        *("--search-m=-1", "--search-m=nan", "--search-m=0.2", "--search-m=100", "--window-m=-2", "--time-scale=3"),
        *("--risk=0", "--risk=0.5", "--thresholds=none.toml"),
    ],
)
def test_lengths_that_make_no_sense(
    option: str, site: Site, short: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert run("register", site.map, short, "-o", tmp_path / "o", option) == 2
    assert option.split("=")[0] in capsys.readouterr().err
    assert not (tmp_path / "o").exists()


@pytest.mark.parametrize(
    "arguments",
    [["nonsense"], ["register"], ["register", "m.map.h5", "-o", "o"], ["import", "abc"], ["map"], ["check"]],
)
def test_usage_is_status_2(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*arguments) == 2
    capsys.readouterr()


@pytest.mark.parametrize(
    "arguments", [[], ["import"], ["import", "grounded"], ["map", "build"], ["register"], ["demo"]]
)
def test_help(arguments: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    assert run(*arguments, "--help") == 0
    assert "usage: lgprjax" in capsys.readouterr().out


def test_installed_command_starts_fast_and_without_a_device() -> None:
    """``--help`` imports no JAX: the answer is there in a second."""
    probe = "import sys; from lgprjax.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
    probe += "print('jax' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "False"


@pytest.mark.real
def test_vendor_files_import(real_data: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    lines = [real_data / "gpr_o_parallel_lines" / f"XLINE{n:02d}.DT1" for n in (1, 3, 5)]
    files = {
        "dt1": real_data / "gprpy_yosemite" / "XLINE00.DT1",
        "dzt": real_data / "hautefeuille" / "FILE__001.DZT",
        "mala": real_data / "gprpymini_mala500" / "utility_example.rd3",
    }
    for kind, path in files.items():
        output = tmp_path / f"{kind}.drive.h5"
        assert run("import", kind, path, "-o", output) == 0
        assert run("check", output) == 0
    output = tmp_path / "lines.drive.h5"
    assert run("import", "lines", *lines, "--line-spacing-m", 0.4, "-o", output) == 0
    assert run("check", output) == 0
    with DriveLog.open(output) as log:
        assert (log.channels, log.samples) == (3, 250)
    assert run("import", "lines", *lines, "--line-spacing-m", 0.4, "-o", output) == 1
    assert "--force" in capsys.readouterr().err
    assert run("import", "dzt", files["dt1"], "-o", tmp_path / "x.drive.h5") == 1
    assert not (tmp_path / "x.drive.h5").exists()


def test_grounded_run_imports_by_the_documented_call(tmp_path: Path) -> None:
    folder = tmp_path / "run_0001"
    folder.mkdir()
    rng = np.random.default_rng(0)
    np.save(folder / "run.npy", rng.integers(0, 255, (60, 369, 11), dtype=np.uint8))
    along, across = np.arange(60) * 0.2, (5 - np.arange(11)) * 0.127
    points = np.stack(np.broadcast_arrays(330_000 + along[:, None], 4_700_000 + across[None, :]), axis=-1)
    np.save(folder / "run_UTM_point.npy", points)
    output = tmp_path / "X.drive.h5"
    grounded = ("import", "grounded", folder, "--utm-zone", "19N", "--sample-interval-ns", 0.16)
    assert run(*grounded, "--scan-rate-hz", 126, "-o", output) == 0
    with DriveLog.open(output) as log:
        assert (log.scans, log.channels, log.samples) == (60, 11, 369)
    assert run(*grounded, "--scan-rate-hz", -1, "-o", tmp_path / "Y.drive.h5") == 2
    assert listing(tmp_path) == {"run_0001", "run_0001/run.npy", "run_0001/run_UTM_point.npy", "X.drive.h5"}
