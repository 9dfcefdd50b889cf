"""Drive log: what is written comes back, and a bad one is refused in one line."""

import os
import subprocess
import sys
from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import h5py
import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from formats.samples import make_description, make_track, write_drive
from lgprjax.errors import InputError
from lgprjax.formats import DriveDescription, DriveLog, DriveWriter, NavigationTrack, TraceRecording, VehicleLog


def _same_track(found: NavigationTrack, due: NavigationTrack) -> None:
    for field in fields(due):
        np.testing.assert_array_equal(getattr(found, field.name), getattr(due, field.name))


_OF_PATH = "heading from the path, roll taken as 0: no topic tells them"
_ALL = {"east_m", "north_m", "height_m", "heading_deg", "roll_deg"}


@pytest.mark.parametrize(
    ("provenance", "value", "stated"),
    [
        ({"made_by": "lgprjax import grounded"}, 0.05, set()),
        ({"made_by": "lgprjax import lines"}, 0.04, _ALL),
        ({"made_by": "test"}, 0.05, _ALL),
        (
            {"made_by": "lgprjax import mcap", "notes": [_OF_PATH]},
            0.05,
            {"east_m", "north_m", "height_m"},
        ),
        ({"made_by": "lgprjax import mcap", "notes": []}, 0.05, _ALL),
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
    description = replace(make_description(), navigation=track, provenance=provenance)
    path = tmp_path / "a.drive.h5"
    with DriveWriter.create(path, description, channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(6) * 0.1, np.zeros((6, 3, 8), np.uint8))
    with DriveLog.open(path) as log:
        for found in (log.description.navigation, VehicleLog.open(path).navigation):
            assert {name for name in names if getattr(found, f"sigma_{name}") is not None} == stated


def test_a_log_without_sigmas_says_nothing_of_them(tmp_path: Path) -> None:
    description = replace(make_description(), navigation=make_track(sigmas=False))
    path = tmp_path / "a.drive.h5"
    with DriveWriter.create(path, description, channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(6) * 0.1, np.zeros((6, 3, 8), np.uint8))
    with DriveLog.open(path) as log:
        _same_track(log.description.navigation, description.navigation)


def test_description_comes_back(tmp_path: Path) -> None:
    due = make_description()
    with DriveLog.open(write_drive(tmp_path / "a.drive.h5")) as log:
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
    path = tmp_path / "a.drive.h5"
    recording = TraceRecording(0.2, 0.0, 0.0, None, 8)
    description = replace(make_description(), truth=None, vehicle=None, recording=recording)
    with DriveWriter.create(path, description, channels=3, dtype=np.int16) as writer:
        writer.append(np.arange(2.0), np.ones((2, 3, 8), np.int16))
    with DriveLog.open(path) as log:
        assert log.description.truth is None
        assert log.description.vehicle is None
        assert log.description.recording == recording


@settings(max_examples=15, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    traces=hnp.arrays(
        st.sampled_from([np.uint8, np.int16, np.int32]),
        hnp.array_shapes(min_dims=3, max_dims=3, min_side=2, max_side=6),
    ),
    cuts=st.lists(st.integers(0, 6), max_size=3),
    data=st.data(),
)
def test_round_trip(tmp_path: Path, traces: np.ndarray, cuts: list[int], data: st.DataObject) -> None:
    scans, channels, samples = traces.shape
    valid = data.draw(hnp.arrays(bool, (scans, channels)))
    gaps = st.floats(1e-6, 1e3)
    times = np.cumsum(data.draw(hnp.arrays(np.float64, scans, elements=gaps)))
    path = tmp_path / "a.drive.h5"
    description = make_description(channels=channels, samples=samples)
    with DriveWriter.create(path, description, channels=channels, dtype=traces.dtype, force=True) as writer:
        for start, stop in zip([0, *sorted(cuts)], [*sorted(cuts), scans], strict=True):
            if start < scans:
                writer.append(times[start:stop], traces[start:stop], valid[start:stop])
    with DriveLog.open(path) as log:
        np.testing.assert_array_equal(log.scan_time_s, times)
        found, found_valid = log.read_traces(0, scans)
        assert found.dtype == np.float32
        np.testing.assert_array_equal(found, traces.astype(np.float32) - np.float32(128))
        np.testing.assert_array_equal(found_valid, valid)
        parts = list(log.chunks(2))
        np.testing.assert_array_equal(np.concatenate([part for _, part, _ in parts]), found)
        assert [start for start, _, _ in parts] == list(range(0, scans, 2))


@pytest.mark.parametrize("zero_slip_m", [0.0, 1.469])
def test_where_a_body_does_not_slip_is_kept(tmp_path: Path, zero_slip_m: float) -> None:
    path, traces = tmp_path / "a.drive.h5", np.ones((4, 3, 8), np.uint8)
    description = make_description()
    array = description.array._replace(zero_slip_m=zero_slip_m)
    with DriveWriter.create(path, replace(description, array=array), channels=3, dtype=traces.dtype) as writer:
        writer.append(np.arange(4.0), traces)
    with DriveLog.open(path) as log:
        assert log.description.array.zero_slip_m == zero_slip_m
    with h5py.File(path) as store:
        assert ("zero_slip_m" in store["/array"].attrs) == (zero_slip_m != 0.0)


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


def test_finite_traces_with_an_overflowing_sum_stay_valid(tmp_path: Path) -> None:
    traces = np.full((2, 3, 8), 3e38, np.float32)
    with DriveLog.open(write_drive(tmp_path / "a.drive.h5", traces)) as log:
        found, valid = log.read_traces(0, 2)
    assert valid.all()
    np.testing.assert_array_equal(found, traces)


def test_file_describes_itself_and_is_chunked_by_scans(tmp_path: Path) -> None:
    traces = np.zeros((3000, 11, 369), np.uint8)
    path = write_drive(tmp_path / "a.drive.h5", traces)
    with h5py.File(path) as store:
        dataset = store["/radar/traces"]
        assert dataset.chunks[1:] == (11, 369)
        assert 0.9 < np.prod(dataset.chunks) / 2**20 <= 1
        assert (dataset.compression, dataset.shuffle) == ("gzip", True)
        assert store["/gnss_ins/time_s"].attrs["unit"] == b"s"
        bare: list[str] = []
        store.visititems(
            lambda name, item: (
                bare.append(name)
                if isinstance(item, h5py.Dataset) and not {"unit", "description"} <= set(item.attrs)
                else None
            )
        )
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


_BAD: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: path.unlink(), "file: expected a readable file, found No such file or directory"),
    "empty": (lambda path: path.write_bytes(b""), "file: expected an HDF5 file, found an empty file"),
    "text": (lambda path: path.write_text("scan,time_s\n"), "file: expected an HDF5 file, found another format"),
    "cut short": (_cut(0.6), "file: expected a whole HDF5 file, found one that is cut short or damaged"),
    "other schema": (
        _set("schema", "lgprjax.map"),
        "@schema: expected lgprjax.drive, a drive log, found 'lgprjax.map', which is a subsurface database",
    ),
    "no schema": (
        _edit(lambda store: store.attrs.__delitem__("schema")),
        "@schema: expected lgprjax.drive, a drive log, found none",
    ),
    "newer": (
        _set("schema_version", "2.0"),
        "@schema_version: expected version 1.x or older (update lgprjax), found 2.0",
    ),
    "no version": (_set("schema_version", "new"), "@schema_version: expected a version such as 1.7, found 'new'"),
    "time falls": (_put("/radar/time_s", 3, 0.0), "/radar/time_s: expected strictly increasing values, found 1 of 6"),
    "time repeats": (_put("/odometry/time_s", 1, 0.0), "/odometry/time_s: expected strictly increasing values"),
    "time nan": (_put("/radar/time_s", 2, np.nan), "/radar/time_s: expected finite values, found 1 of 6"),
    "nan position": (_put("/gnss_ins/latitude_deg", 0, np.nan), "/gnss_ins/latitude_deg: expected finite values"),
    "latitude": (_put("/gnss_ins/latitude_deg", 0, 95.0), "/gnss_ins/latitude_deg: expected values from -90 to 90"),
    "sigma": (
        _put("/gnss_ins/sigma_east_m", 2, -1.0),
        "expected values of zero or more, found 1 of 5 values otherwise",
    ),
    "channel order": (_put("/array/y_m", 2, 9.0), "/array/y_m: expected strictly decreasing values"),
    "interval zero": (
        _set("sample_interval_ns", 0.0, "/radar/traces"),
        "expected a number, finite, from 0.001 to 1000, found 0",
    ),
    "interval negative": (_set("sample_interval_ns", -0.2, "/radar/traces"), "from 0.001 to 1000, found -0.2"),
    "interval nan": (_set("sample_interval_ns", np.nan, "/radar/traces"), "from 0.001 to 1000, found nan"),
    "no interval": (
        _edit(lambda s: s["/radar/traces"].attrs.__delitem__("sample_interval_ns")),
        "from 0.001 to 1000, found none",
    ),
    "interval text": (_set("sample_interval_ns", "0.2", "/radar/traces"), "from 0.001 to 1000, found '0.2'"),
    "t0": (_set("t0_utc", "yesterday"), "/@t0_utc: expected a UTC time in ISO 8601, found 'yesterday'"),
    "t0 zone": (_set("t0_utc", "2024-05-01T12:00:00+02:00"), "/@t0_utc: expected a UTC time in ISO 8601"),
    "provenance": (_set("provenance", "{"), "/@provenance: expected a JSON object, found text that is no JSON"),
    "no group": (_drop("/odometry"), "/odometry: expected a group, found none"),
    "group for dataset": (
        _edit(lambda store: (store.__delitem__("/radar/time_s"), store.create_group("/radar/time_s"))),
        "/radar/time_s: expected a dataset, found another object",
    ),
    "no dataset": (_drop("/gnss_ins/roll_deg"), "/gnss_ins/roll_deg: expected a dataset, found none"),
    "no radar": (_drop("/radar/traces"), "/radar/traces or /radar/sweeps: expected exactly one of them, found neither"),
    "unit": (_set("unit", "ft", "/array/x_m"), "/array/x_m@unit: expected 'm', found 'ft'"),
    "type": (_replace("/odometry/distance_m", np.zeros(4, np.int32)), "expected float64, found type int32"),
    "length": (_replace("/odometry/distance_m", np.zeros(3)), "odometry = 4 as in /odometry/time_s, found shape (3,)"),
    "axes": (_replace("/odometry/distance_m", np.zeros((4, 1))), "expected axes [odometry], found shape (4, 1)"),
    "channels": (_replace("/array/x_m", np.zeros(4)), "channel = 3 as in /radar/traces, found shape (4,)"),
    "one scan": (
        _edit(lambda store: [store[f"/radar/{name}"].resize(1, axis=0) for name in ("time_s", "traces", "valid")]),
        "/radar/time_s: expected at least 2 along the axis scan, found 1",
    ),
}


@pytest.mark.parametrize("case", _BAD)
def test_bad_log_is_one_clear_line(tmp_path: Path, case: str) -> None:
    spoil, words = _BAD[case]
    path = write_drive(tmp_path / "a.drive.h5")
    spoil(path)
    with pytest.raises(InputError) as caught:
        DriveLog.open(path)
    assert words in str(caught.value)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


def test_damaged_radar_data_are_one_clear_line(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    with h5py.File(path) as store:
        chunk = store["/radar/traces"].id.get_chunk_info(0)
    with path.open("r+b") as stream:
        stream.seek(chunk.byte_offset)
        stream.write(b"\xff" * chunk.size)
    with (
        DriveLog.open(path) as log,
        pytest.raises(InputError, match="/radar/traces, scans 0 to 2: expected readable data"),
    ):
        log.read_traces(0, 2)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (lambda d: replace(d, recording=replace(d.recording, sample_interval_ns=0.0)), "from 0.001 to 1000, found 0"),
        (lambda d: replace(d, vehicle={"time_s": np.arange(2.0), "speed": np.arange(2.0)}), "found speed"),
        (lambda d: replace(d, t0_utc="now"), "expected a UTC time"),
    ],
)
def test_writer_refuses_a_bad_description_at_once(
    tmp_path: Path, change: Callable[[DriveDescription], DriveDescription], words: str
) -> None:
    with pytest.raises(InputError) as caught:
        DriveWriter.create(tmp_path / "a.drive.h5", change(make_description()), channels=3, dtype=np.uint8)
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


@pytest.mark.parametrize(
    ("times", "shape", "dtype", "words"),
    [
        ([0.0, 0.0], (2, 3, 8), np.uint8, "/radar/time_s: expected finite, strictly increasing times"),
        ([np.nan, 1.0], (2, 3, 8), np.uint8, "/radar/time_s: expected finite"),
        ([0.0, 1.0], (2, 3, 7), np.uint8, "/radar/traces: expected shape (2, 3, 8), found shape (2, 3, 7)"),
        ([0.0, 1.0], (2, 3, 8), np.float32, "/radar/traces: expected type uint8, found type float32"),
        ([0.0], (1, 3, 8), np.uint8, "expected at least 2 along the axis scan, found 1"),
        ([], (0, 3, 8), np.uint8, "expected at least 2 along the axis scan, found 0"),
    ],
)
def test_writer_refuses_bad_scans_and_leaves_nothing(
    tmp_path: Path, times: list[float], shape: tuple[int, ...], dtype: type, words: str
) -> None:
    with (
        pytest.raises(InputError) as caught,
        DriveWriter.create(tmp_path / "a.drive.h5", make_description(), channels=3, dtype=np.uint8) as writer,
    ):
        writer.append(np.array(times), np.zeros(shape, dtype))
    assert words in str(caught.value)
    assert list(tmp_path.iterdir()) == []


_NO_ARRAYS = """
import numpy as np
from dataclasses import replace
from formats.samples import make_description
from lgprjax.errors import InputError
from lgprjax.formats import DriveWriter, OdometryTrack

good = {"scan_time_s": np.arange(2.0), "traces": np.zeros((2, 3, 8), np.uint8), "valid": None}
description = make_description()
for name, wrong in (
    ("scan_time_s", None), ("scan_time_s", 0.5), ("traces", None), ("traces", [[1, 2], [3]]), ("valid", ["yes", "no"])
):
    try:
        with DriveWriter.create("a.drive.h5", description, channels=3, dtype=np.uint8) as writer:
            writer.append(**good | {name: wrong})
    except InputError as error:
        print(error)
for wrong in (None, [[0.0], [1.0, 2.0]]):
    try:
        bare = replace(description, odometry=OdometryTrack(wrong, np.arange(3.0)))
        DriveWriter.create("a.drive.h5", bare, channels=3, dtype=np.uint8)
    except InputError as error:
        print(error)
"""


def test_writer_names_an_argument_that_is_no_array(tmp_path: Path) -> None:
    """In a process of its own: here the types of arguments are checked, which they are in the tests alone."""
    told = subprocess.run(
        [sys.executable, "-c", _NO_ARRAYS],
        env={**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)},
        cwd=tmp_path,
        check=True,
        capture_output=True,
        text=True,
    ).stdout
    assert told.splitlines() == [
        "call: scan_time_s: expected an array of numbers, found None",
        "a.drive.h5: /radar/time_s: expected one time for each scan, found shape ()",
        "call: traces: expected an array of numbers, found None",
        "call: traces: expected an array of numbers, found [[1, 2], [3]]",
        "call: valid: expected an array of numbers, found ['yes', 'no']",
        "a.drive.h5: /odometry/time_s: expected axes [odometry], found shape ()",
        "call: /odometry/time_s: expected an array of numbers, found [[0.0], [1.0, 2.0]]",
    ]
    assert list(tmp_path.iterdir()) == []


def test_a_refused_block_does_not_spoil_the_log(tmp_path: Path) -> None:
    path = tmp_path / "a.drive.h5"
    with DriveWriter.create(path, make_description(), channels=3, dtype=np.uint8) as writer:
        writer.append(np.arange(3.0), np.zeros((3, 3, 8), np.uint8))
        with pytest.raises(InputError, match="after scan 3"):
            writer.append(np.array([1.0]), np.zeros((1, 3, 8), np.uint8))
        writer.append(np.array([3.0]), np.zeros((1, 3, 8), np.uint8))
    with DriveLog.open(path) as log:
        assert log.scans == 4


_LONG_DRIVE = """
import resource, sys
from pathlib import Path
import numpy as np
sys.path.insert(0, sys.argv[2])
from formats.samples import make_description
from lgprjax.formats import DriveLog, DriveWriter
peak_mib = lambda: resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024
path = Path(sys.argv[1]) / "a.drive.h5"
block = np.zeros((500, 11, 369), np.uint8)
before = peak_mib()
with DriveWriter.create(path, make_description(channels=11, samples=369), channels=11, dtype=np.uint8) as writer:
    for start in range(0, 60000, 500):
        writer.append(np.arange(start, start + 500) / 126, block)
with DriveLog.open(path) as log:
    assert sum(len(traces) for _, traces, _ in log.chunks(256)) == 60000
print(peak_mib() - before)
"""


def test_memory_stays_small_on_a_long_drive(tmp_path: Path) -> None:
    tests = Path(__file__).parents[1]
    command = [sys.executable, "-c", _LONG_DRIVE, str(tmp_path), str(tests)]
    done = subprocess.run(command, capture_output=True, text=True, check=True, cwd=tests.parent)
    # The traces are 232 MiB; the cache of chunks, a chunk read as float32 and the times fit in a quarter of that.
    assert float(done.stdout) < 60
