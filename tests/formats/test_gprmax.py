"""gprMax results in the layouts that versions 3 and 4 publish: single traces, merged B-scans, and bad files."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import numpy as np
import pytest

from lgprjax.formats import DriveLog, SurveyOrigin, check_file, import_gprmax, read_gprmax
from refusals import refused

_DT_S = 2.3586543367496837e-11
_SAMPLES = 510
_PLACE = SurveyOrigin(48.0, 11.0, 0.0)


def _pulse(delay_ns: float, frequency_ghz: float = 0.4, time_ns: np.ndarray | None = None) -> np.ndarray:
    """A Ricker pulse at the simulation's times, or at others."""
    time_ns = np.arange(_SAMPLES) * _DT_S * 1e9 if time_ns is None else time_ns
    square = (np.pi * frequency_ghz * (time_ns - delay_ns)) ** 2
    return np.asarray((1 - 2 * square) * np.exp(-square))


def _header(store: h5py.File, version: str) -> None:
    store.attrs.update({"gprMax": version, "Title": "test", "Iterations": _SAMPLES, "dt": _DT_S, "nrx": 1})


def _write(
    path: Path,
    position_m: float,
    values: np.ndarray,
    *,
    version: int = 3,
    components: tuple[str, ...] = ("Ex", "Ez", "Hx"),
    source: str = "srcs/src1",
) -> Path:
    """One trace; source and receiver 0.1 m apart about ``position_m`` on x."""
    with h5py.File(path, "w") as store:
        _header(store, "3.1.7" if version == 3 else "4.0.1")
        store.attrs.update({"nsrc": 1, "dx_dy_dz": [0.01] * 3, "nx_ny_nz": [100, 60, 1]})
        store.attrs.update({"srcsteps": [10, 0, 0], "rxsteps": [10, 0, 0]})
        store.create_group(source).attrs.update({"Position": [position_m - 0.05, 0.45, 0.0], "Type": "HertzianDipole"})
        receiver = store.create_group("rxs/rx1")
        receiver.attrs.update({"Name": "Rx(30,45,0)", "Position": [position_m + 0.05, 0.45, 0.0]})
        for name in components:
            data = receiver.create_dataset(name, data=(values if name[1] == "z" else 0 * values).astype("f4"))
            if version == 4:
                offset = -_DT_S / 2 if name[0] == "H" else 0.0
                data.attrs.update({"Quantity": name, "SampleInterval": _DT_S, "TimeSampleOffset": offset})
        if version == 4:
            store.create_group("srcs/src1/excitation").attrs["WaveformFrequency"] = 4e8
    return path


def _scan(folder: Path, version: int = 3, count: int = 11) -> list[Path]:
    """A B-scan of files 1 to 11 whose pulse comes 0.1 ns later in every trace, ten centimetres apart."""
    suffix = "out" if version == 3 else "h5"
    return [
        _write(folder / f"scan{i + 1}.{suffix}", 0.25 + 0.1 * i, _pulse(4 + 0.1 * i), version=version)
        for i in range(count)
    ]


def _merged(path: Path, count: int = 11) -> Path:
    with h5py.File(path, "w") as store:
        _header(store, "3.1.7")
        store["rxs/rx1/Ez"] = np.stack([_pulse(4 + 0.1 * i) for i in range(count)], axis=1).astype("f4")
    return path


@pytest.mark.parametrize("version", [3, 4])
def test_single_traces_in_numerical_order(tmp_path: Path, version: int) -> None:
    paths = _scan(tmp_path, version)
    # As a shell hands them over: 1, 10, 11, 2 ...
    profile = read_gprmax(sorted(paths), sample_interval_ns=0.2)
    assert profile.spacing_m == pytest.approx(0.1)
    assert profile.positions_m is not None
    np.testing.assert_allclose(profile.positions_m, 0.25 + 0.1 * np.arange(11), atol=1e-9)
    assert profile.sample_interval_ns == 0.2
    time_ns = np.arange(profile.traces.shape[1]) * 0.2
    due = np.stack([_pulse(4 + 0.1 * i, time_ns=time_ns) for i in range(11)])
    np.testing.assert_allclose(profile.traces, due, atol=5e-3)
    assert profile.centre_frequency_hz == (None if version == 3 else 4e8)
    assert profile.time_zero_ns == 0.0


def test_interval_is_chosen_by_the_energy_it_would_lose(tmp_path: Path) -> None:
    # A Ricker pulse of 0.4 GHz has 1e-4 of its energy above 1.01 GHz, one of 1.6 GHz above four times that.
    for frequency_ghz, interval_ns in ((0.4, 0.25), (1.6, 0.05)):
        paths = [_write(tmp_path / f"f{frequency_ghz}_{i}.out", 0.1 * i, _pulse(4, frequency_ghz)) for i in range(2)]
        profile = read_gprmax(paths)
        assert profile.sample_interval_ns == interval_ns
        lost = profile.metadata["energy_above_passband"]
        assert isinstance(lost, float)
        assert 0 < lost < 1e-4
        time_ns = np.arange(profile.traces.shape[1]) * interval_ns
        np.testing.assert_allclose(profile.traces[0], _pulse(4, frequency_ghz, time_ns), atol=0.02)


def test_merged_scan_takes_its_positions_from_the_options(tmp_path: Path) -> None:
    merged = read_gprmax([_merged(tmp_path / "scan_merged.out")], start_m=0.25, step_m=0.1)
    single = read_gprmax(_scan(tmp_path))
    np.testing.assert_allclose(merged.traces, single.traces, atol=1e-6)
    assert merged.positions_m is not None
    assert single.positions_m is not None
    np.testing.assert_allclose(merged.positions_m, single.positions_m)
    assert merged.spacing_m == pytest.approx(0.1)
    assert merged.metadata["positions"] == "given"


def test_components_sources_and_the_magnetic_half_step(tmp_path: Path) -> None:
    for version in (3, 4):
        only = [
            _write(tmp_path / f"{version}h{i}.h5", i, _pulse(4), version=version, components=("Hz",)) for i in (1, 2)
        ]
        profile = read_gprmax(only, time_zero_ns=1.5)
        assert profile.metadata["component"] == "Hz"
        assert profile.time_zero_ns == pytest.approx(1.5 + 0.5 * _DT_S * 1e9)
    paths = _scan(tmp_path, count=2)
    assert np.abs(read_gprmax(paths, component="Ex").traces).max() == 0.0
    assert np.abs(read_gprmax(paths).traces).max() > 0.9
    # A transmission line is a source too.
    paths = [_write(tmp_path / f"t{i}.out", 0.3 * i, _pulse(4), source="tls/tl1") for i in range(3)]
    assert read_gprmax(paths).spacing_m == pytest.approx(0.3)


def test_drive_stands_where_the_model_does(tmp_path: Path) -> None:
    output = tmp_path / "a.drive.h5"
    import_gprmax(_scan(tmp_path, 4), time_zero_ns=2.5, place=_PLACE, output=output)
    assert check_file(output) == []
    with DriveLog.open(output) as log:
        description = log.description
        traces, _ = log.read_traces(0, log.scans)
    # Position 0 of the model is the origin; the first trace lies 0.25 m north of it (111.2 km a degree).
    assert (description.navigation.latitude_deg[0] - 48.0) * 111.2e3 == pytest.approx(0.25, abs=2e-3)
    np.testing.assert_allclose(description.odometry.distance_m, 0.1 * np.arange(11), atol=1e-9)
    assert description.recording.time_zero_ns == 2.5  # type: ignore[union-attr]
    assert traces.dtype == np.float32
    assert description.provenance["simulated_interval_ns"] == pytest.approx(_DT_S * 1e9)
    assert description.provenance["sample_interval_ns"] == 0.25
    inputs = description.provenance["inputs"]
    assert isinstance(inputs, list)
    assert [entry["file"] for entry in inputs][:3] == ["scan1.h5", "scan2.h5", "scan3.h5"]


def _edited(change: Callable[[h5py.File], None]) -> Callable[[list[Path]], None]:
    def edit(paths: list[Path]) -> None:
        with h5py.File(paths[1], "r+") as store:
            change(store)

    return edit


def _replace(store: h5py.File, values: np.ndarray) -> None:
    del store["rxs/rx1/Ez"]
    store["rxs/rx1/Ez"] = values


def _position(path: str, values: list[float]) -> Callable[[h5py.File], None]:
    return lambda store: store[path].attrs.__setitem__("Position", values)


def _spoil_header(path: Path) -> None:
    """Overwrite the first byte, a version, of the header of the source."""
    with h5py.File(path) as store:
        address = h5py.h5o.get_info(store["srcs/src1"].id).addr
    with path.open("r+b") as stream:
        stream.seek(address)
        stream.write(b"\xff")


_DIVERGED = np.full(_SAMPLES, np.inf, np.float32)
_RX = "rxs/rx1"
# What is done to the second of four files, the place, and values that are named.
_SPOILT: list[tuple[Callable[[list[Path]], Any], str, tuple[object, ...]]] = [
    (lambda p: p[1].unlink(), "file", ()),
    (lambda p: p[1].write_bytes(b""), "file", ("HDF5",)),
    (lambda p: p[1].write_bytes(p[1].read_bytes()[:3000]), "file", ("HDF5",)),
    (lambda p: p[1].write_bytes(b"text" * 99), "file", ("HDF5",)),
    (lambda p: _spoil_header(p[1]), "file", ("HDF5",)),
    (_edited(lambda s: s.__delitem__("rxs")), "rxs", ()),
    (_edited(lambda s: s.attrs.__delitem__("dt")), "@dt", ()),
    (_edited(lambda s: s.attrs.__setitem__("dt", -1.0)), "dt", (-1,)),
    (_edited(lambda s: s.attrs.__setitem__("dt", 2 * _DT_S)), "recording", ("scan1.out", "Ez", 510)),
    (_edited(lambda s: _replace(s, np.ones(9, "f4"))), "recording", ("Ez", 9)),
    (_edited(_position(_RX, [1e300, 0.4, 0.0])), f"/{_RX}@Position", ("1e+300",)),
    (_edited(lambda s: _replace(s, _DIVERGED)), f"/{_RX}/Ez", ()),
    (_edited(lambda s: _replace(s, np.ones(9, "i4"))), f"/{_RX}/Ez", ("int32", 9)),
    (_edited(lambda s: _replace(s, np.ones((510, 4), "f4"))), "traces", (4,)),
    (_edited(lambda s: s.create_group("srcs/src2").attrs.__setitem__("Position", [0, 0, 0])), "sources", (2,)),
    (_edited(lambda s: s[_RX].attrs.__delitem__("Position")), f"/{_RX}@Position", ()),
    (_edited(_position(_RX, [0.4, 0.9, 0.0])), "position", ()),
    (_edited(_position(_RX, [0.0, 0.45, 0.0])), "position", (0.15, 0.25)),
]
# Options, the place, and values that are named.
_OPTIONS: list[tuple[dict[str, Any], str, tuple[object, ...]]] = [
    ({"component": "Ey"}, f"{_RX}/Ey", ("Ex, Ez, Hx",)),
    ({"receiver": 2}, "rxs/rx2", ("rx1",)),
    ({"receiver": 0}, "receiver", (1, 0)),
    ({"sample_interval_ns": -1.0}, "sample interval", (-1,)),
    ({"sample_interval_ns": 0.01}, "sample interval", (0.0235865, 0.01)),
    ({"step_m": 0.1}, "--step-m", ()),
    ({"time_zero_ns": np.nan}, "time zero", ("nan",)),
]


def test_bad_scans_are_refused_and_leave_nothing(tmp_path: Path) -> None:
    for number, (spoil, place, values) in enumerate(_SPOILT):
        folder = tmp_path / str(number)
        folder.mkdir()
        paths = _scan(folder, count=4)
        spoil(paths)
        before = sorted(folder.iterdir())
        with refused(place, *values, file=paths[1]):
            import_gprmax(paths, place=_PLACE, output=folder / "a.drive.h5")
        assert sorted(folder.iterdir()) == before
    paths = _scan(tmp_path, count=4)
    for options, place, values in _OPTIONS:
        with refused(place, *values, file=paths[0]):
            import_gprmax(paths, place=_PLACE, output=tmp_path / "a.drive.h5", **options)
    assert not (tmp_path / "a.drive.h5").exists()


def test_scans_that_are_too_little(tmp_path: Path) -> None:
    with refused("positions", "--step-m", "none", file="m.out"):
        read_gprmax([_merged(tmp_path / "m.out")])
    with refused("positions", 2, found=1):
        read_gprmax(_scan(tmp_path, count=1))
    with refused("gprMax files", "none"):
        read_gprmax([])
