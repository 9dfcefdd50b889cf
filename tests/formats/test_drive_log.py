"""Drive log: what is written comes back, and a bad one is refused in one line."""

from collections.abc import Callable
from dataclasses import fields, replace
from itertools import pairwise
from pathlib import Path
from typing import Any, cast

import h5py
import numpy as np
import pytest

from formats.samples import make_description, make_track, write_drive
from lgprjax.formats import (
    DriveDescription,
    DriveLog,
    DriveWriter,
    NavigationTrack,
    OdometryTrack,
    TraceRecording,
    VehicleLog,
)
from refusals import refused


def _same_track(found: NavigationTrack, due: NavigationTrack) -> None:
    for field in fields(due):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(due, field.name))


def _written(folder: Path, description: DriveDescription) -> Path:
    """Six scans of silence."""
    path = folder / "a.drive.h5"
    with DriveWriter.create(path, description, channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(6) * 0.1, np.zeros((6, 3, 8), np.uint8))
    return path


_OF_PATH = "heading from the path, roll taken as 0: no topic tells them"
_ALL = {"east_m", "north_m", "height_m", "heading_deg", "roll_deg"}


@pytest.mark.parametrize(
    ("provenance", "value", "stated"),
    [
        ({"made_by": "lgprjax import grounded"}, 0.05, set()),
        ({"made_by": "lgprjax import lines"}, 0.04, _ALL),
        ({"made_by": "lgprjax import mcap", "notes": []}, 0.05, _ALL),
        ({"made_by": "lgprjax import mcap", "notes": [_OF_PATH]}, 0.05, {"east_m", "north_m", "height_m"}),
    ],
)
def test_sigmas_that_an_importer_made_up_are_not_stated(
    tmp_path: Path, provenance: dict[str, object], value: float, stated: set[str]
) -> None:
    """Up to 1.4 importers of surveys wrote 0.05 m and 0.5 degrees that nobody had measured."""
    track = make_track()
    metres, degrees = np.full(len(track.time_s), value), np.full(len(track.time_s), 10.0 * value)
    names = {"east_m": metres, "north_m": metres, "height_m": metres, "heading_deg": degrees, "roll_deg": degrees}
    track = replace(track, **{f"sigma_{name}": values for name, values in names.items()})
    path = _written(tmp_path, replace(make_description(), navigation=track, provenance=provenance))
    with DriveLog.open(path) as log:
        for found in (log.description.navigation, VehicleLog.open(path).navigation):
            assert {name for name in names if getattr(found, f"sigma_{name}") is not None} == stated


def test_a_description_comes_back(tmp_path: Path) -> None:
    due = make_description()
    due = replace(due, array=due.array._replace(zero_slip_m=1.469))
    path = _written(tmp_path, due)
    with DriveLog.open(path) as log:
        found = log.description
        assert (log.scans, log.channels, log.samples) == (6, 3, 8)
    assert (found.name, found.t0_utc, found.provenance) == (due.name, due.t0_utc, due.provenance)
    assert found.recording == due.recording
    for part, other in zip(found.array, due.array, strict=True):
        np.testing.assert_array_equal(part, other)
    _same_track(found.navigation, due.navigation)
    assert found.truth is not None
    assert due.truth is not None
    _same_track(found.truth, due.truth)
    assert found.truth.sigma_east_m is None
    np.testing.assert_array_equal(found.odometry.distance_m, due.odometry.distance_m)
    assert found.vehicle is not None
    assert found.vehicle["mode"].dtype == np.int8


def test_optional_parts_stay_absent(tmp_path: Path) -> None:
    recording = TraceRecording(0.2, 0.0, 0.0, None, 8)
    track = make_track(sigmas=False)
    bare = replace(make_description(), truth=None, vehicle=None, recording=recording, navigation=track)
    path = _written(tmp_path, bare)
    with DriveLog.open(path) as log:
        found = log.description
    assert (found.truth, found.vehicle, found.recording) == (None, None, recording)
    _same_track(found.navigation, track)
    assert found.array.zero_slip_m == 0.0
    with h5py.File(path) as store:
        assert "zero_slip_m" not in store["/array"].attrs


@pytest.mark.parametrize(("dtype", "cuts"), [(np.uint8, ()), (np.int16, (2, 2)), (np.int32, (1, 4))])
def test_traces_come_back_however_they_were_appended(tmp_path: Path, dtype: type, cuts: tuple[int, ...]) -> None:
    rng = np.random.default_rng(4)
    traces = rng.integers(np.iinfo(dtype).min, np.iinfo(dtype).max, (5, 2, 6), dtype=dtype, endpoint=True)
    valid, times = rng.random((5, 2)) > 0.5, np.cumsum(rng.uniform(1e-6, 1e3, 5))
    path, description = tmp_path / "a.drive.h5", make_description(channels=2, samples=6)
    with DriveWriter.create(path, description, channels=2, dtype=dtype) as writer:
        for start, stop in pairwise((0, *cuts, 5)):
            writer.append(times[start:stop], traces[start:stop], valid[start:stop])
    with DriveLog.open(path) as log:
        np.testing.assert_array_equal(log.scan_time_s, times)
        found, found_valid = log.read_traces(0, 5)
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, traces.astype(np.float32) - np.float32(128))
        np.testing.assert_array_equal(found_valid, valid)
        parts = list(log.chunks(2))
    np.testing.assert_array_equal(np.concatenate([part for _, part, _ in parts]), found)
    assert [start for start, _, _ in parts] == [0, 2, 4]


def test_non_finite_traces_are_marked_and_zero(tmp_path: Path) -> None:
    traces = np.ones((4, 3, 8), np.float32) + 127
    traces[1, 2, 5] = np.nan
    traces[3, 0, 0] = -np.inf
    with DriveLog.open(write_drive(tmp_path / "a.drive.h5", traces)) as log:
        found, valid = log.read_traces(0, 4)
        log.read_traces(1, 2)
        assert log.non_finite_scans == 2
    due = np.ones((4, 3), bool)
    due[1, 2] = due[3, 0] = False
    np.testing.assert_array_equal(valid, due)
    np.testing.assert_array_equal(found, 0.0)
    # Finite ones whose sum overflows stay valid.
    with DriveLog.open(write_drive(tmp_path / "b.drive.h5", np.full((2, 3, 8), 3e38, np.float32))) as log:
        assert log.read_traces(0, 2)[1].all()


def test_a_file_tells_its_units_and_is_chunked_by_scans(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5", np.zeros((3000, 11, 369), np.uint8))
    bare: list[str] = []

    def look(name: str, item: h5py.HLObject) -> None:
        if isinstance(item, h5py.Dataset) and not {"unit", "description"} <= set(item.attrs):
            bare.append(name)

    with h5py.File(path) as store:
        dataset = store["/radar/traces"]
        assert dataset.chunks[1:] == (11, 369)
        assert 0.9 < np.prod(dataset.chunks) / 2**20 <= 1
        assert (dataset.compression, dataset.shuffle) == ("gzip", True)
        assert store["/gnss_ins/time_s"].attrs["unit"] == b"s"
        store.visititems(look)
    assert bare == []


def _edit(change: Callable[[h5py.File], object]) -> Callable[[Path], None]:
    def apply(path: Path) -> None:
        with h5py.File(path, "r+") as store:
            change(store)

    return apply


def _set(name: str, value: object, holder: str = "/") -> Callable[[Path], None]:
    return _edit(lambda store: store[holder].attrs.__setitem__(name, value))


def _put(place: str, index: object, value: object) -> Callable[[Path], None]:
    return _edit(lambda store: store[place].__setitem__(index, value))


def _drop(place: str) -> Callable[[Path], None]:
    return _edit(lambda store: store.__delitem__(place))


def _replace(place: str, values: np.ndarray) -> Callable[[Path], None]:
    def change(store: h5py.File) -> None:
        attributes = dict(store[place].attrs)
        del store[place]
        store[place] = values
        store[place].attrs.update(attributes)

    return _edit(change)


def _cut(share: float) -> Callable[[Path], object]:
    return lambda path: path.write_bytes(path.read_bytes()[: int(path.stat().st_size * share)])


def _delete_attribute(name: str, holder: str = "/") -> Callable[[Path], None]:
    return _edit(lambda store: store[holder].attrs.__delitem__(name))


def _group_for_dataset(store: h5py.File) -> None:
    del store["/radar/time_s"]
    store.create_group("/radar/time_s")


def _one_scan(store: h5py.File) -> None:
    for name in ("time_s", "traces", "valid"):
        store[f"/radar/{name}"].resize(1, axis=0)


_INTERVAL = "/radar/traces@sample_interval_ns"
# What is done to a log, the place that is named, and values of expected and found.
_BAD: list[tuple[Callable[[Path], object], str, tuple[object, ...]]] = [
    (lambda path: path.unlink(), "file", ()),
    (lambda path: path.write_text("scan,time_s\n"), "file", ("HDF5",)),
    (_cut(0.6), "file", ("HDF5",)),
    (_set("schema", "lgprjax.map"), "@schema", ("lgprjax.drive", "lgprjax.map")),
    (_delete_attribute("schema"), "@schema", ("lgprjax.drive", "none")),
    (_set("schema_version", "2.0"), "@schema_version", ("1.x", "2.0")),
    (_put("/radar/time_s", 3, 0.0), "/radar/time_s", ("1 of 6",)),
    (_put("/radar/time_s", 2, np.nan), "/radar/time_s", ("1 of 6",)),
    (_put("/gnss_ins/latitude_deg", 0, 95.0), "/gnss_ins/latitude_deg", (-90, 90)),
    (_put("/gnss_ins/sigma_east_m", 2, -1.0), "/gnss_ins/sigma_east_m", ("1 of 5",)),
    (_put("/array/y_m", 2, 9.0), "/array/y_m", ("1 of 3",)),
    (_set("sample_interval_ns", np.nan, "/radar/traces"), _INTERVAL, (0.001, 1000, "nan")),
    (_set("sample_interval_ns", "0.2", "/radar/traces"), _INTERVAL, ("'0.2'",)),
    (_set("t0_utc", "2024-05-01T12:00:00+02:00"), "/@t0_utc", ("+02:00",)),
    (_set("provenance", "{"), "/@provenance", ("JSON",)),
    (_drop("/odometry"), "/odometry", ("none",)),
    (_edit(_group_for_dataset), "/radar/time_s", ()),
    (_drop("/gnss_ins/roll_deg"), "/gnss_ins/roll_deg", ("none",)),
    (_drop("/radar/traces"), "/radar/traces or /radar/sweeps", ()),
    (_set("unit", "ft", "/array/x_m"), "/array/x_m@unit", ("'m'", "'ft'")),
    (_replace("/odometry/distance_m", np.zeros(4, np.int32)), "/odometry/distance_m", ("float64", "int32")),
    (_replace("/odometry/distance_m", np.zeros(3)), "/odometry/distance_m", ("/odometry/time_s", "(3,)")),
    (_replace("/odometry/distance_m", np.zeros((4, 1))), "/odometry/distance_m", ("[odometry]", "(4, 1)")),
    (_edit(_one_scan), "/radar/time_s", (2, "scan")),
]


def test_a_bad_log_is_refused_where_it_is_bad(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    whole = path.read_bytes()
    for spoil, place, values in _BAD:
        path.write_bytes(whole)
        spoil(path)
        with refused(place, *values, file=path):
            DriveLog.open(path)


def test_damaged_radar_data_are_refused_when_read(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    with h5py.File(path) as store:
        chunk = store["/radar/traces"].id.get_chunk_info(0)
    with path.open("r+b") as stream:
        stream.seek(chunk.byte_offset)
        stream.write(b"\xff" * chunk.size)
    with DriveLog.open(path) as log, refused("/radar/traces, scans 0 to 2"):
        log.read_traces(0, 2)


def _create(folder: Path, description: DriveDescription) -> DriveWriter:
    return DriveWriter.create(folder / "a.drive.h5", description, channels=3, dtype=np.uint8)


def test_the_writer_refuses_a_bad_description_at_once(tmp_path: Path) -> None:
    good = make_description()
    assert isinstance(good.recording, TraceRecording)
    unknown = {"time_s": np.arange(2.0), "speed": np.arange(2.0)}
    for wrong, place, value in (
        (replace(good, recording=replace(good.recording, sample_interval_ns=0.0)), _INTERVAL, 1000),
        (replace(good, vehicle=unknown), "vehicle", "speed"),
        (replace(good, t0_utc="now"), "/@t0_utc", "now"),
    ):
        with refused(place, value):
            _create(tmp_path, wrong)
        assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("times", "shape", "dtype", "place", "values"),
    [
        ([0.0, 0.0], (2, 3, 8), np.uint8, "/radar/time_s", ()),
        ([np.nan, 1.0], (2, 3, 8), np.uint8, "/radar/time_s", ()),
        ([0.0, 1.0], (2, 3, 7), np.uint8, "/radar/traces", ((2, 3, 8), (2, 3, 7))),
        ([0.0, 1.0], (2, 3, 8), np.float32, "/radar/traces", ("uint8", "float32")),
        ([0.0], (1, 3, 8), np.uint8, "/radar/time_s", ("scan",)),
        ([], (0, 3, 8), np.uint8, "/radar/time_s", ("scan",)),
    ],
)
def test_the_writer_refuses_bad_scans_and_leaves_nothing(
    tmp_path: Path, times: list[float], shape: tuple[int, ...], dtype: type, place: str, values: tuple[object, ...]
) -> None:
    with refused(place, *values), _create(tmp_path, make_description()) as writer:
        writer.append(np.array(times), np.zeros(shape, dtype))
    assert list(tmp_path.iterdir()) == []


def test_the_writer_names_an_argument_that_is_no_array(tmp_path: Path, request: pytest.FixtureRequest) -> None:
    if request.config.getoption("jaxtyping_packages", None):
        pytest.skip("types are checked before the writer sees the arguments")
    good = {"scan_time_s": np.arange(2.0), "traces": np.zeros((2, 3, 8), np.uint8), "valid": None}
    for name, wrong, file, place in (
        ("scan_time_s", None, "call", "scan_time_s"),
        ("scan_time_s", 0.5, "a.drive.h5", "/radar/time_s"),
        ("traces", [[1, 2], [3]], "call", "traces"),
        ("valid", ["yes", "no"], "call", "valid"),
    ):
        arguments: dict[str, Any] = good | {name: wrong}
        with refused(place, file=file), _create(tmp_path, make_description()) as writer:
            writer.append(**arguments)
    for times, file, place in (
        (None, "a.drive.h5", "/odometry/time_s"),
        ([[0.0], [1.0, 2.0]], "call", "/odometry/time_s"),
    ):
        odometry = OdometryTrack(cast("Any", times), np.arange(3.0))
        with refused(place, file=file):
            _create(tmp_path, replace(make_description(), odometry=odometry))
    assert list(tmp_path.iterdir()) == []


def test_a_refused_block_does_not_spoil_the_log(tmp_path: Path) -> None:
    with _create(tmp_path, make_description()) as writer:
        writer.append(np.arange(3.0), np.zeros((3, 3, 8), np.uint8))
        with refused("/radar/time_s", "scan 3"):
            writer.append(np.array([1.0]), np.zeros((1, 3, 8), np.uint8))
        writer.append(np.array([3.0]), np.zeros((1, 3, 8), np.uint8))
    with DriveLog.open(tmp_path / "a.drive.h5") as log:
        assert log.scans == 4
