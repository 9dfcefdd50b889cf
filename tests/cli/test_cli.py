"""The command line as a person meets it: statuses, one clear line, nothing half-written."""

import json
import resource
import shutil
import subprocess
import sys
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pandas as pd
import pytest

from canon.commands import run, succeed
from canon.site import Site
from canon.story import Story
from lgprjax.cli.options import check_words
from lgprjax.cli.verbs import every_verb
from lgprjax.formats import DriveLog, DriveWriter, MapFile


def listing(folder: Path) -> set[str]:
    return {str(path.relative_to(folder)) for path in folder.rglob("*")}


def attribute(path: str, name: str, value: object) -> Callable[[h5py.File], None]:
    def change(store: h5py.File) -> None:
        store[path].attrs[name] = value

    return change


def swap_times(store: h5py.File) -> None:
    store["/radar/time_s"][10:12] = store["/radar/time_s"][10:12][::-1]


def short_array(store: h5py.File) -> None:
    held = store["/array/x_m"]
    about, x = dict(held.attrs), held[:-1]
    del store["/array/x_m"]
    store["/array/x_m"] = x
    store["/array/x_m"].attrs.update(about)


def one_scan(store: h5py.File) -> None:
    for name in ("time_s", "traces", "valid"):
        store[f"/radar/{name}"].resize(1, axis=0)


def no_odometry(store: h5py.File) -> None:
    del store["/odometry/distance_m"]


# What the file is in place of the log, or what is changed in the log; the place that is named, and values.
BAD_LOGS: dict[str, tuple[Callable[[Any], bytes | None], str, tuple[object, ...]]] = {
    "truncated": (lambda log: log[: len(log) // 2], "file", ("HDF5",)),
    "empty": (lambda _: b"", "file", ("HDF5",)),
    "wrong magic": (lambda _: b"GIF89a" * 100, "file", ("HDF5",)),
    "missing dataset": (no_odometry, "/odometry/distance_m", ()),
    "wrong unit": (attribute("/odometry/distance_m", "unit", "ft"), "/odometry/distance_m@unit", ("'ft'",)),
    "wrong shape": (short_array, "/array/x_m", (10, 11)),
    "negative interval": (
        attribute("/radar/traces", "sample_interval_ns", -0.1),
        "/radar/traces@sample_interval_ns",
        (0.001, 1000, -0.1),
    ),
    "time not rising": (swap_times, "/radar/time_s", ()),
    "newer schema": (attribute("/", "schema_version", "2.0"), "@schema_version", ("2.0",)),
    "one scan": (one_scan, "/radar/time_s", (2, 1)),
}


@pytest.mark.parametrize("case", BAD_LOGS)
def test_bad_log_is_one_line_and_status_1(case: str, site: Site, short: Path, tmp_path: Path) -> None:
    change, place, values = BAD_LOGS[case]
    bad = tmp_path / "bad.drive.h5"
    if place == "file":
        bad.write_bytes(change(short.read_bytes()) or b"")
    else:
        shutil.copyfile(short, bad)
        with h5py.File(bad, "r+") as store:
            change(store)
    for words in (
        ("map", "build", bad, "-o", tmp_path / "m.map.h5"),
        ("register", site.map, bad, "-o", tmp_path / "r"),
    ):
        done = run(*words)
        assert done.status == 1
        done.refusal.check(place, *values, file=bad)
    checked = run("check", bad)
    assert checked.status == 1
    assert f"{bad}: {place}: " in checked.out
    assert "Traceback" not in checked.out + checked.err
    assert listing(tmp_path) <= {"bad.drive.h5", "r"}


def test_what_cannot_be_used_costs_nothing(site: Site, short: Path, tmp_path: Path) -> None:
    """A second drive that is broken, a drive that heard nothing, a drive in place of the map, a file in a folder's."""
    bad, silent = tmp_path / "bad.drive.h5", tmp_path / "silent.drive.h5"
    bad.write_bytes(short.read_bytes()[:5000])
    with DriveLog.open(short) as log:
        quiet = np.full((log.scans, log.channels, log.samples), 128, np.uint8)
        with DriveWriter.create(silent, log.description, channels=quiet.shape[1], dtype=np.uint8) as writer:
            writer.append(log.scan_time_s, quiet)
    (tmp_path / "file").write_text("x")
    before = listing(tmp_path)
    out = ("-o", tmp_path / "new")
    assert run("register", site.map, short, bad, *out).refusal.file == str(bad)
    assert run("map", "build", silent, "-o", tmp_path / "m.map.h5").refusal.file == str(silent)
    run("register", short, short, *out).refusal.check(None, "lgprjax.map", "lgprjax.drive", file=short)
    assert run("map", "info", short).refusal.file == str(short)
    assert run("register", site.map, short, "-o", tmp_path / "file" / "out").refusal.place == "output"
    assert run("demo", "--output", tmp_path / "file").status == 1
    assert listing(tmp_path) == before


def test_nan_and_inf_are_reported_by_check(short: Path, tmp_path: Path) -> None:
    """A bad scan never stops a drive: check warns, and the status stays 0."""
    bad = tmp_path / "nan.drive.h5"
    with DriveLog.open(short) as log:
        traces, _ = log.read_traces(0, 60)
        traces[7, 2, 5], traces[9] = np.nan, np.inf
        with DriveWriter.create(bad, log.description, channels=log.channels, dtype=np.float32) as writer:
            writer.append(log.scan_time_s[:60], traces)
    assert "warning" in succeed("check", bad)


def test_output_that_exists_is_refused_before_any_work(site: Site, short: Path, tmp_path: Path) -> None:
    for words, kept in (
        (("map", "build", short, "-o", tmp_path / "m.map.h5"), tmp_path / "m.map.h5"),
        (("register", site.map, short, "-o", tmp_path / "out"), tmp_path / "out" / "short.fixes.csv"),
    ):
        kept.parent.mkdir(exist_ok=True)
        kept.write_text("precious")
        done = run(*words)
        assert done.status == 1
        done.refusal.check("output", "--force", file=kept)
        assert kept.read_text() == "precious"
    assert listing(tmp_path / "out") == {"short.fixes.csv"}


def test_register_writes_what_it_promises(story: Story) -> None:
    step = story.step("register", 1)
    figures = ("trajectory.png", "confidence.png", "match.png", "map.png", "scans.html")
    of_all = {"codes.png", "summary.json", "report.html"}
    of_live = {"live.fixes.csv", "live.fixes.h5", *(f"live-{name}" for name in figures)}
    assert step.wrote == {"forced.json", *(f"forced/{name}" for name in of_live | of_all)}
    assert "report.html" in step.done.out
    table = pd.read_csv(story.folder / "forced/live.fixes.csv")
    assert list(table.columns) == [
        *("scan", "time_s", "latitude_deg", "longitude_deg", "height_m", "heading_deg", "roll_deg"),
        *("sigma_along_m", "sigma_cross_m", "correlation", "margin", "overlap_channels", "code"),
        *("time_scale", "p_false", "window_m"),
    ]
    ok = table["code"] == "ok"
    assert ok.mean() > 0.5
    assert (table["p_false"][ok] <= 1e-4).all()
    assert (table["window_m"][ok] == 2.0).all()
    with h5py.File(story.folder / "forced/live.fixes.h5") as fixes:
        heading_deg, sigma_rad = fixes["heading_deg"][:], np.sqrt(fixes["covariance"][:, 3, 3])
    with DriveLog.open(story.folder / "drives/live.drive.h5") as log:
        truth = log.description.truth
        assert truth is not None
        known_deg = np.interp(log.scan_time_s, truth.time_s, truth.heading_deg)
    assert (np.abs(heading_deg - known_deg) < np.degrees(4.0 * sigma_rad))[ok.to_numpy()].all()
    page = (story.folder / "forced/report.html").read_text(encoding="utf-8")
    assert all(f"<td>{code}</td>" in page for code in set(table["code"]) - {"ok"})
    row = (story.folder / "forced/live.fixes.csv").read_text().splitlines()[1 + int(np.flatnonzero(ok)[0])].split(",")
    assert all(len(row[column].split(".")[1]) >= 9 for column in (2, 3))
    (figures_of,) = json.loads((story.folder / "forced.json").read_text())
    assert figures_of["tried"] == (table["code"] != "no_window").sum()
    assert figures_of["ok"] == ok.sum()


def test_every_command_ends_with_its_result_and_a_command_that_there_is(story: Story) -> None:
    verbs = dict(every_verb())
    following = set()
    for step in story.steps:
        if step.done.status == 0:
            # With --json - it goes to standard error.
            lines = (step.done.err or step.done.out).splitlines()
            if lines[-1].startswith("next: lgprjax "):
                words = lines.pop().removeprefix("next: lgprjax ").split()
                name = next(each for each in (" ".join(words[:2]), words[0]) if each in verbs)
                check_words(verbs[name].options, words[len(name.split()) :])
                following.add(name)
            assert lines[-1].startswith("result: "), step.words
            assert sum(line.startswith(("result: ", "next: ")) for line in lines) == 1, step.words
    assert {"map verify", "export", "check", "route select", "cover export"} <= following


def test_another_drive_into_the_same_folder_loses_nothing_of_the_first(story: Story) -> None:
    for number in (2, 4):  # and once more by force
        wrote = story.step("register", number).wrote
        assert {"forced/impostor.fixes.h5", "forced/summary.json", "forced/report.html"} <= wrote
        assert not [name for name in wrote if name.startswith("forced/live")]
    (alone,) = json.loads(story.step("register", 2).done.out)
    assert alone["name"] == "impostor"
    assert alone["ok"] == 0
    assert [entry["name"] for entry in json.loads((story.folder / "forced/summary.json").read_text())] == [
        *("live", "impostor")
    ]
    page = (story.folder / "forced/report.html").read_text(encoding="utf-8")
    assert all(page.count(f"<h2>{name} on ") == 1 for name in ("live", "impostor"))
    assert story.step("register", 3).done.refusal.file.endswith("impostor.fixes.csv")


@pytest.mark.parametrize("verb", ["map", "register", "export"])
def test_full_disk_is_one_line_and_leaves_nothing_half_written(
    verb: str, site: Site, short: Path, tmp_path: Path
) -> None:
    """Files may grow to some size and no further, as on a disk that fills up."""
    words, target, size = {
        "map": (("map", "build", short), "m.map.h5", 60_000),
        "register": (("register", site.map, short), "out", 60_000),
        "export": (("export", short), "x.mcap", 6_000),
    }[verb]
    _, most = resource.getrlimit(resource.RLIMIT_FSIZE)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # of JAX, where it cannot keep a program
        resource.setrlimit(resource.RLIMIT_FSIZE, (size, most))
        try:
            done = run(*words, "-o", tmp_path / target)
        finally:
            resource.setrlimit(resource.RLIMIT_FSIZE, (most, most))
    assert done.status == 1
    assert done.refusal.file.startswith(str(tmp_path / target))
    left = listing(tmp_path)
    assert not [name for name in left if "partial" in name]
    # What was finished before the disk was full is whole.
    files = [tmp_path / name for name in left if name.endswith((".h5", ".csv"))]
    assert not files or succeed("check", *files)


def test_a_map_is_built_as_it_is_asked_for(story: Story) -> None:
    usual, asked = story.json("info.json"), json.loads(story.step("map info", 1).done.out)
    assert [each["precision"] for each in (usual, asked)] == ["standard", "small"]
    # 0.3 to 2 times the centre frequency, 250 MHz by the log.
    assert [each["band_mhz"] for each in (usual, asked)] == [[75.0, 500.0], [60.0, 400.0]]
    assert asked["baselines"] == 1
    assert asked["bytes_per_m_traces"] < usual["bytes_per_m_traces"]


def test_map_info(site: Site, tmp_path: Path) -> None:
    assert "baselines" in succeed("map", "info", site.map, "--json", tmp_path / "info.json")
    figures = json.loads((tmp_path / "info.json").read_text())
    assert (figures["baselines"], figures["channels"]) == (2, 11)
    assert 60 < figures["length_m"] < 80
    with MapFile.open(site.map) as source:
        chance = source.chance
    assert chance is not None
    assert chance.own
    assert str(chance.pieces) in figures["noise_floor"]
    # The tail share · exp(-(z² - start)/scale) reaches the risk just there; any of the five windows may pass.
    assert list(figures["least_score"]) == ["0 m", "1 m", "2 m", "4 m", "8 m"]
    z = np.array(list(figures["least_score"].values()))
    reached = chance.share * np.exp(-(z**2 - chance.start) / chance.scale)
    np.testing.assert_allclose(np.log10(5.0 * reached), -4.0, atol=0.1)
    # Maps that borrow a noise floor, or have none yet.
    other = tmp_path / "other.map.h5"
    shutil.copyfile(site.map, other)
    with h5py.File(other, "r+") as store:
        store["chance"].attrs["own"], store["chance"].attrs["pieces"] = 0.0, 17.0
    assert "17" in json.loads(succeed("map", "info", other, "--json", "-"))["noise_floor"]
    with h5py.File(other, "r+") as store:
        del store["chance"]
    assert json.loads(succeed("map", "info", other, "--json", "-"))["least_score"] is None


@pytest.mark.parametrize(
    "option",
    [
        *("--search-m=-1", "--search-m=nan", "--search-m=0.2", "--search-m=100", "--window-m=-2", "--time-scale=3"),
        *("--risk=0", "--risk=0.5", "--thresholds=none.toml"),
    ],
)
def test_lengths_that_make_no_sense(option: str, site: Site, short: Path, tmp_path: Path) -> None:
    done = run("register", site.map, short, "-o", tmp_path / "o", option)
    assert (done.status, done.about) == (2, option.split("=")[0])
    assert not (tmp_path / "o").exists()


def test_installed_command_starts_fast_and_without_a_device() -> None:
    """``--help`` imports no JAX: the answer is there in a second."""
    probe = "import sys; from lgprjax.cli import main\ntry: main(['--help'])\nexcept SystemExit: pass\n"
    probe += "print('jax' in sys.modules)"
    done = subprocess.run([sys.executable, "-c", probe], capture_output=True, text=True, check=True, timeout=60)
    assert done.stdout.splitlines()[-1] == "False"


@pytest.mark.real
def test_vendor_files_import(real_data: Path, tmp_path: Path) -> None:
    lines = [real_data / "gpr_o_parallel_lines" / f"XLINE{n:02d}.DT1" for n in (1, 3, 5)]
    files = {
        "dt1": real_data / "gprpy_yosemite" / "XLINE00.DT1",
        "dzt": real_data / "hautefeuille" / "FILE__001.DZT",
        "mala": real_data / "gprpymini_mala500" / "utility_example.rd3",
    }
    for kind, path in files.items():
        succeed("import", kind, path, "-o", tmp_path / f"{kind}.drive.h5")
        succeed("check", tmp_path / f"{kind}.drive.h5")
    output = tmp_path / "lines.drive.h5"
    joined = ("import", "lines", *lines, "--line-spacing-m", 0.4, "-o", output)
    succeed(*joined)
    with DriveLog.open(output) as log:
        assert (log.channels, log.samples) == (3, 250)
    run(*joined).refusal.check("output", "--force", file=output)
    assert run("import", "dzt", files["dt1"], "-o", tmp_path / "x.drive.h5").status == 1
    assert not (tmp_path / "x.drive.h5").exists()


def test_grounded_run_imports_by_the_documented_call(tmp_path: Path) -> None:
    folder = tmp_path / "run_0001"
    folder.mkdir()
    rng = np.random.default_rng(0)
    np.save(folder / "run.npy", rng.integers(0, 255, (60, 369, 11), dtype=np.uint8))
    along, across = np.arange(60) * 0.2, (5 - np.arange(11)) * 0.127
    points = np.stack(np.broadcast_arrays(330_000 + along[:, None], 4_700_000 + across[None, :]), axis=-1)
    np.save(folder / "run_UTM_point.npy", points)
    grounded = ("import", "grounded", folder, "--utm-zone", "19N", "--sample-interval-ns", 0.16)
    succeed(*grounded, "--scan-rate-hz", 126, "-o", tmp_path / "X.drive.h5")
    with DriveLog.open(tmp_path / "X.drive.h5") as log:
        assert (log.scans, log.channels, log.samples) == (60, 11, 369)
    assert run(*grounded, "--scan-rate-hz", -1, "-o", tmp_path / "Y.drive.h5").status == 2
    assert listing(tmp_path) == {"run_0001", "run_0001/run.npy", "run_0001/run_UTM_point.npy", "X.drive.h5"}
