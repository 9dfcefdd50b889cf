"""``lgprjax view`` as a geophysicist meets it: a picture of every file, one clear line where there can be none."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import segyio
from matplotlib.figure import Figure

import lgprjax as lx
from canon.commands import run, succeed
from canon.site import Site
from formats.samples import dzt_header, make_description, write_drive, write_dt1
from lgprjax.formats import DriveWriter
from lgprjax.report import LineView
from lgprjax.report.views import stations_of_map, view_of_drive, view_of_profile
from vendor_sets import COUNTS, write_iprb, write_mala_pair, write_segy


def profile_view(path: Path, **options: object) -> LineView:
    known: dict[str, object] = dict.fromkeys(("channel", "speed_m_per_ns", "sample_interval_ns"))
    return view_of_profile(path, **(known | {"raw": True} | options))  # type: ignore[arg-type]


def dt1(folder: Path) -> Path:
    return write_dt1(folder / "line.DT1", COUNTS.astype(np.int16))


def dzt(folder: Path) -> Path:
    stored = (COUNTS + 32768).astype("<u2")
    (folder / "line.DZT").write_bytes(dzt_header(samples=40, range_ns=8.0, per_m=20.0) + stored.tobytes())
    return folder / "line.DZT"


# What writes it; ns of its first and its second sample, metres of its first trace.
VENDORS: dict[str, tuple[Callable[[Path], Path], float, float, float]] = {
    "DT1": (dt1, -1.0, -0.2, 0.0),
    "DZT": (dzt, 0.0, 0.2, 0.0),
    "rd3": (lambda folder: write_mala_pair(folder, ".rd3")[0], 0.0, 0.2, 0.0),
    "rd7": (lambda folder: write_mala_pair(folder, ".rd7")[0], 0.0, 0.2, 0.0),
    "iprb": (lambda folder: write_iprb(folder)[0], 0.0, 0.2, 0.0),
    "SEG-Y": (lambda folder: write_segy(folder)[0], 0.0, 0.2, 0.0),
}


@pytest.mark.parametrize("vendor", VENDORS)
def test_every_vendors_file_becomes_a_picture(vendor: str, here: Path) -> None:
    make, first_ns, second_ns, start_m = VENDORS[vendor]
    path = make(here)
    assert succeed("view", path) == f"result: wrote {path.stem}.png\n"
    assert (here / f"{path.stem}.png").read_bytes().startswith(b"\x89PNG")
    (radargram,) = profile_view(path).radargrams
    assert radargram.in_metres
    np.testing.assert_allclose(radargram.along, start_m + 0.05 * np.arange(12), atol=1e-6)
    np.testing.assert_allclose(radargram.time_ns[:2], [first_ns, second_ns], atol=1e-9)
    recorded = COUNTS.astype(np.float32)
    if vendor == "DZT":
        recorded[:, :2] = 0.0  # marks
    np.testing.assert_array_equal(radargram.amplitude, recorded)


def test_bad_files_and_outputs_are_told_in_one_line(here: Path) -> None:
    (here / "notes.txt").write_text("a line")
    dt1(here).rename(here / "alone.DT1")
    for name in ("text.DT1", "text.drive.h5", "text.map.h5", "text.DZT"):
        (here / name).write_text("no radar")
    for name in (
        *("notes.txt", "text.DT1", "alone.DT1", "missing.DZT", "text.DZT", "text.drive.h5", "text.map.h5"),
        "no.drive.h5",
    ):
        done = run("view", name)
        assert (done.status, done.out) == (1, ""), name
        assert done.refusal.file == name
    assert not list(here.glob("*.png"))
    first, second = write_iprb(here)
    (here / "file").write_text("")
    done = run("view", first, second, "-o", "file")
    assert (done.status, done.refusal.file) == (1, "file")
    path = dt1(here)
    (here / "line.png").write_text("mine")
    run("view", path).refusal.check("output", "--force", file="line.png")
    assert (here / "line.png").read_text() == "mine"
    for wrong in (
        *((path, "-o", "a.html"), (path, "-o", "a.png", "--html"), (path, "--velocity-m-per-ns", 100), ()),
        (first, first),
    ):
        done = run("view", *wrong)
        assert (done.status, done.err.count("\n")) == (2, 1)


def test_pictures_go_where_they_are_told(here: Path) -> None:
    path = dt1(here)
    (here / "out").mkdir()
    succeed("view", path, "-o", "a.png", "--raw", "--velocity-m-per-ns", 0.08)
    succeed("view", path, "-o", "out")
    succeed("view", path, "--html")
    assert (here / "a.png").is_file()
    assert (here / "out" / "line.png").is_file()
    assert (here / "line.html").read_text(encoding="utf-8").startswith("<!doctype html>")
    succeed("view", *write_iprb(here), "-o", "both")
    assert sorted(path.name for path in (here / "both").iterdir()) == ["SITE_001_A01.png", "SITE_001_A02.png"]


def test_of_a_few_channels_all_are_drawn_and_of_many_the_middle_one(here: Path) -> None:
    path = here / "line.DZT"
    for channels, shown in ((2, ["channel 0", "channel 1"]), (5, ["channel 2"])):
        headers = dzt_header(channels=channels, word=1024 * channels) * channels
        path.write_bytes(headers + np.arange(10 * channels * 8, dtype="<u2").tobytes())
        assert [each.name for each in profile_view(path).radargrams] == shown
        # Python draws one of them, and says which.
        title = lx.view(path, raw=True, ax=Figure().add_subplot()).get_title()
        assert title.endswith(f"; channel {channels // 2} of 0 to {channels - 1}")
    (one,) = profile_view(path, channel=4).radargrams
    assert one.name == "channel 4"
    done = run("view", path, "--channel", 5)
    assert done.status == 1
    done.refusal.check("--channel", "0 to 4", found=5)
    succeed("view", path, "--channel", 1)


def test_a_segy_line_shows_where_it_lies_and_can_be_told_its_interval(here: Path) -> None:
    (path,) = write_segy(here, 4000)
    assert run("view", path).status == 1
    succeed("view", path, "--sample-interval-ns", 0.2)
    plan = profile_view(path, sample_interval_ns=0.2).plan
    assert plan is not None
    np.testing.assert_allclose(plan.east_m[:, 0], 0.05 * np.arange(12), atol=1e-6)
    assert run("view", dt1(here), "--sample-interval-ns", 0.2, "--force").status == 1
    with segyio.open(str(path), "r+", ignore_geometry=True) as store:
        for index in range(12):
            store.header[index] = {89: 3, 71: -10000, 73: 70000 + index, 77: 480000}
    degrees = profile_view(path, sample_interval_ns=0.2).plan
    assert degrees is not None
    assert degrees.east_m[-1, 0] == pytest.approx(11e-4 * 111320 * np.cos(np.radians(48.0)), rel=5e-3)


def drive(path: Path) -> LineView:
    return view_of_drive(path, channel=None, raw=True, speed_m_per_ns=None)


def test_a_drive_shows_every_place_once(here: Path) -> None:
    # The sample drive goes 1 m ahead in a second, half a metre back, and on.
    traces = np.random.default_rng(1).integers(0, 256, (300, 3, 8), dtype=np.uint8)
    view = drive(write_drive(here / "a.drive.h5", traces))
    assert [each.name for each in view.radargrams] == ["channel 0", "channel 1", "channel 2"]
    first = view.radargrams[0]
    assert first.in_metres
    assert (np.diff(first.along) > 0).all()
    assert first.time_ns[0] == pytest.approx(-1.5)
    assert view.notes
    np.testing.assert_array_equal(first.amplitude[0], traces[0, 0].astype(np.float32) - 128.0)
    assert view.plan is not None
    assert view.plan.east_m.shape[1] == 3
    # It heads east: the leftmost channel lies farthest north.
    assert view.plan.north_m[0, 0] - view.plan.north_m[0, 2] == pytest.approx(2 * 0.127, abs=1e-6)
    succeed("view", here / "a.drive.h5")
    succeed("view", here / "a.drive.h5", "--html")


def test_a_drive_in_reverse_is_shown_along_its_way(here: Path) -> None:
    path = here / "a.drive.h5"
    known = make_description()
    back = replace(known, odometry=replace(known.odometry, distance_m=-np.arange(4.0)))
    traces = np.random.default_rng(1).integers(0, 256, (100, 3, 8), dtype=np.uint8)
    with DriveWriter.create(path, back, channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(100) / 126, traces)
    view = drive(path)
    first = view.radargrams[0]
    assert first.in_metres
    assert (np.diff(first.along) > 0).all()
    np.testing.assert_array_equal(first.amplitude[-1], traces[-1, 0].astype(np.float32) - 128.0)
    assert len(view.notes) == 1


def test_a_drive_that_stands_is_counted(here: Path) -> None:
    path = here / "a.drive.h5"
    known = make_description()
    still = replace(known, odometry=replace(known.odometry, distance_m=np.zeros(4)))
    with DriveWriter.create(path, still, channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(5) / 126, np.zeros((5, 3, 8), np.uint8))
    view = drive(path)
    assert not view.radargrams[0].in_metres
    succeed("view", path)


def test_a_drive_of_sweeps_becomes_traces(here: Path) -> None:
    path = here / "s.drive.h5"
    known = make_description(samples=61, sweeps=True)
    lookup, frequencies_hz = known.recording.lookup_sweeps, known.recording.frequencies_hz  # type: ignore[union-attr]
    echo = np.exp(-2e-9j * np.pi * frequencies_hz * 30.0)
    calibration = np.tile(lookup[0], (200, 1))
    # Divided by the calibration channel, what comes beside the look-up is an echo after 30 ns.
    sweeps = (lookup[None] + 0.3 * calibration[:, None] * echo).astype(np.complex64)
    with DriveWriter.create(path, known, channels=3, dtype=np.complex64) as writer:
        writer.append_sweeps(np.arange(200) / 126, sweeps, calibration)
    view = drive(path)
    radargram = view.radargrams[1]
    assert radargram.time_ns[int(np.argmax(radargram.amplitude[0]))] == pytest.approx(30.0, abs=1.0)
    assert "sweeps" in radargram.steps[0]


def test_a_map_is_seen_from_above(site: Site, here: Path) -> None:
    stations = stations_of_map(site.map)
    assert stations.level.shape == (len(stations.east_m), 5)
    assert set(stations.baseline) == {0, 1}
    own = stations_of_map(site.map, travel_time_ns=float(stations.time_ns[3]))
    np.testing.assert_array_equal(own.time_ns, stations.time_ns[3:4])
    np.testing.assert_array_equal(own.level[:, 0], stations.level[:, 3])
    assert np.hypot(np.ptp(stations.east_m), np.ptp(stations.north_m)) == pytest.approx(40.0, abs=5.0)
    succeed("view", site.map, site.logs["live"])
    assert {path.name for path in here.iterdir()} == {"site.map.png", f"{site.logs['live'].stem}.png"}
    succeed("view", site.map, "--html")
    assert run("view", site.map, "--raw", "--force").status == 2


@pytest.mark.real
def test_real_files_lie_as_their_bytes_say(real_data: Path, here: Path) -> None:
    """Samples, times and places against the bare bytes, with no reader between."""
    dune = real_data / "gprpy_dune" / "FILE____032.DZT"
    stored = np.frombuffer(dune.read_bytes(), "<u2", offset=1024).reshape(1040, 512).astype(np.float32) - 32768.0
    (radargram,) = profile_view(dune).radargrams
    np.testing.assert_array_equal(radargram.amplitude[:, 2:], stored[:, 2:])
    np.testing.assert_allclose(radargram.along, 0.02 * np.arange(1040), atol=1e-9)
    np.testing.assert_allclose(radargram.time_ns, 0.09375 * np.arange(512), atol=1e-9)

    yosemite = real_data / "gprpy_yosemite" / "XLINE00.DT1"
    records = np.fromfile(yosemite, np.dtype([("header", "<f4", 32), ("samples", "<i2", 1500)]))
    (radargram,) = profile_view(yosemite).radargrams
    np.testing.assert_array_equal(radargram.amplitude, records["samples"].astype(np.float32))
    np.testing.assert_allclose(radargram.along, 0.3048 * records["header"][:, 1], atol=1e-3)

    for folder, name in (
        ("gprpy_dune", "FILE____032.DZT"),
        ("gprpy_yosemite", "XLINE00.DT1"),
        ("gprpymini_mala500", "utility_example.rd3"),
        ("hautefeuille", "FILE__001.DZT"),
        ("charisma_lab_slab", "Lab_specimen_data.DZT"),
        ("flagogna", "XLINE020.DT1"),
        ("gpr_o_parallel_lines", "XLINE01.DT1"),
    ):
        succeed("view", real_data / folder / name)
        assert (here / name).with_suffix(".png").is_file()
