"""The check reports every problem of a file, for every kind of file."""

from pathlib import Path

import h5py
import numpy as np

from canon.map import write_made_map
from formats.samples import write_drive
from lgprjax.errors import InputError
from lgprjax.formats import MAP_PRECISIONS, DriveLog, check_file
from refusals import refused


def test_every_problem_of_a_drive_is_reported_in_one_go(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    assert check_file(path) == []
    with h5py.File(path, "r+") as store:
        store["/radar/time_s"][2] = 0.0
        store["/radar/traces"].attrs["sample_interval_ns"] = -1.0
        store["/array/x_m"].attrs["unit"] = "ft"
        del store["/gnss_ins/roll_deg"]
        store.attrs["t0_utc"] = "noon"
    assert {finding.place for finding in check_file(path)} == {
        "/radar/time_s",
        "/radar/traces@sample_interval_ns",
        "/array/x_m@unit",
        "/gnss_ins/roll_deg",
        "/@t0_utc",
    }


def test_non_finite_traces_are_a_warning(tmp_path: Path) -> None:
    traces = np.zeros((2000, 11, 200), np.float32)
    traces[1900, 3, 7:9] = np.nan
    (finding,) = check_file(write_drive(tmp_path / "a.drive.h5", traces))
    assert (finding.place, finding.severity) == ("/radar/traces", "warning")
    for number in (2, traces.size, (1900 * 11 + 3) * 200 + 7):
        assert str(number) in finding.found
    assert str(finding).startswith("warning: ")


def test_damaged_data_are_found(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    with h5py.File(path) as store:
        chunk = store["/radar/traces"].id.get_chunk_info(0)
    with path.open("r+b") as stream:
        stream.seek(chunk.byte_offset)
        stream.write(b"\xff" * chunk.size)
    (finding,) = check_file(path)
    assert (finding.place, finding.severity) == ("/radar/traces", "error")


def test_random_damage_is_found_or_harmless(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    whole = path.read_bytes()
    rng = np.random.default_rng(5)
    noticed = 0
    for _ in range(24):
        damaged = np.frombuffer(whole, np.uint8).copy()
        damaged[rng.integers(0, len(whole), 4)] = rng.integers(0, 256, 4)
        path.write_bytes(damaged.tobytes())
        try:
            with DriveLog.open(path) as log:
                log.read_traces(0, log.scans)
        except InputError:
            noticed += len(check_file(path)) > 0
    # All of the structure is under checksums; only bytes of small arrays can change unseen.
    assert noticed > 20


def test_what_is_no_hdf5_is_one_finding(tmp_path: Path) -> None:
    for suffix in (".drive.h5", ".map.h5", ".fixes.h5"):
        path = tmp_path / f"a{suffix}"
        for content in (None, b"", b"not HDF5", b"\x89HDF\r\n\x1a\n" + bytes(40)):
            if content is not None:
                path.write_bytes(content)
            (finding,) = check_file(path)
            assert (finding.place, finding.severity) == ("file", "error")


def test_only_a_newer_major_version_is_a_problem(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    for version, count in (("1.0", 0), ("1.99", 0), ("2.0", 1), ("1", 1)):
        with h5py.File(path, "r+") as store:
            store.attrs["schema_version"] = version
        assert len(check_file(path)) == count, version


def test_a_file_of_another_name_is_what_it_says_that_it_is(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5").rename(tmp_path / "mine.h5")
    assert check_file(path) == []
    with h5py.File(path, "r+") as store:
        del store["odometry"]
    assert check_file(path)[0].file == str(path)
    with h5py.File(path, "r+") as store:
        store.attrs["schema"] = "somebody.else"
    with refused("file name", ".drive.h5", "mine.h5"):
        check_file(path)
    with refused("file name", ".drive.h5", "a.sgy"):
        check_file(tmp_path / "a.sgy")


def test_a_good_map_has_no_findings_and_a_bad_one_all(tmp_path: Path) -> None:
    path = tmp_path / "a.map.h5"
    write_made_map(path, MAP_PRECISIONS["full"], stations=300)
    assert check_file(path) == []
    with h5py.File(path, "r+") as store:
        store["/baselines/traces"][0, 1, 1] = np.nan
        store["/gain"][0] = np.nan
        store.attrs["anchor_latitude_deg"] = 91.0
        del store["/tiles"]
    findings = {finding.place: finding for finding in check_file(path)}
    assert set(findings) == {"/baselines/traces", "/gain", "/@anchor_latitude_deg", "/tiles"}
    # In a map, unlike in a drive, a value that is not finite is an error: nothing may enter it unseen.
    assert findings["/baselines/traces"].severity == "error"


def test_a_map_of_half_a_form_is_no_map(tmp_path: Path) -> None:
    """Codes need what explains them, places the stretches; traces in two forms are one too many."""
    path = tmp_path / "a.map.h5"
    write_made_map(path, MAP_PRECISIONS["standard"], stations=300)
    with h5py.File(path, "r+") as store:
        del store["/code/basis"], store["/stretches"]
        traces = store["/baselines"].create_dataset("traces", data=np.zeros((600, 5, 40), np.float16))
        traces.attrs["unit"] = ""
    places = {finding.place for finding in check_file(path)}
    assert places == {"/code/basis", "/stretches", "/baselines/traces or /baselines/codes"}
