"""Damaged files of vendors, receivers, fields and tables: each is read right, or refused in one line."""

import re
import resource
import time
import tracemalloc
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pyproj

from formats.samples import dzt_header, write_dt1, write_iprb, write_mala
from formats.segy_sample import segy_bytes, write_segy
from formats.side_samples import cor_row, dzg_text, gga, gps_text, rmc
from formats.test_signal_tables import SIGNAL_MAP, columns, write_csv
from lgprjax.errors import InputError
from lgprjax.formats import (
    DriveLog,
    FieldPlaces,
    Profile,
    SidePositions,
    VehicleLog,
    check_file,
    import_lines,
    places_of_traces,
    read_field,
    read_profile,
    read_side_file,
)
from lgprjax.formats.field_files import KeepOut
from lgprjax.formats.signal_tables import import_signals
from lgprjax.runtime.cart import CartFixes, read_cart_fixes
from runtime.test_cart_clocks import fix, pvt, without_checksums

TRACES = np.random.default_rng(7).integers(-30000, 30000, (24, 40))
_LONGEST_S = 2.0
_GEOD = pyproj.Geod(ellps="WGS84")
_SIDE = (".GPS", ".DZG", ".cor", ".txt", ".xyz")
# Readers' own objects, and messages.
_SPARE_BYTES = 256 * 1024
_EXTREMES = [
    *(b"-1", b"0", b"-0", b"1e308", b"-1e308", b"1e-320", b"999999999", b"1000000000", b"2147483648", b"4294967296"),
    *(b"18446744073709551616", b"nan", b"inf", b"-inf", b"", b"1_000", b"0x10", b"1e", b"--5", b"0.5", b"9" * 5000),
    "٣".encode(),
]
_WORDS = [
    *(b"\0\0", b"\xff\xff", b"\x7f\xff", b"\xff\x7f", b"\x80\0", b"\0\x80", b"\1\0", b"\0\1", b"\0" * 4, b"\xff" * 4),
    *(np.array(value, "<f4").tobytes() for value in (np.nan, np.inf, -np.inf, 3e38, 1e-40, -1.0, 0.0, 1e9)),
    *(np.array(value, ">i4").tobytes() for value in (-(2**31), 2**31 - 1, 10**9)),
    *(np.array(value, ">f8").tobytes() for value in (np.nan, 1e300)),
]


Read = Profile | SidePositions | CartFixes | VehicleLog | DriveLog | FieldPlaces


class Subject(NamedTuple):
    """A file that is read, what is damaged (it, or a file beside it), and which of that is text.

    Attributes:
        read: reads the file; whether only its intact part counts is the second argument.
        fatal: whether damage may be refused: a companion of a line that has a wheel may not.
        spare_bytes: what a read may take besides ten times the size of its files.
    """

    make: Callable[[Path], Path]
    damaged: tuple[str, ...]
    text: tuple[str, ...]
    read: Callable[[Path, bool], Read] = lambda path, partial: (
        read_side_file(path) if path.suffix in _SIDE else read_profile(path, partial=partial)
    )
    fatal: bool = True
    spare_bytes: int = _SPARE_BYTES


def _dzt(path: Path) -> Path:
    block = dzt_header(word=2, channels=2, samples=40)
    path.write_bytes(block + block + (TRACES + 32768).astype("<u2").tobytes())
    return path


def _ubx(path: Path) -> Path:
    path.write_bytes(b"".join(pvt(n, validDate=int(n > 10)) for n in range(40)))
    return path


def _segy(path: Path) -> Path:
    headers = {71: -100, 73: 50_000_000 + 20 * np.arange(24), 77: 400_000_000 + np.arange(24), 89: 1}
    return write_segy(path, TRACES, headers=headers)


def _revision_2(path: Path) -> Path:
    """IEEE floats marked IBM, little-endian, with every header and trailer that revision 2 knows."""
    states = {(3269, "I"): 40, (3217, "H"): 0, (3273, "d"): 4e-4, (3507, "i"): 1, (3513, "Q"): 24, (3529, "i"): 1}
    words = (TRACES / 7.0).astype(np.float32).view(np.uint32)
    options = {"order": "<", "code": 1, "revision": b"\1\2", "extended": 1, "additional": 1, "trailers": 1}
    path.write_bytes(segy_bytes(words, states=states, **options))  # type: ignore[arg-type]
    return path


def _dt1_floats(path: Path) -> Path:
    write_dt1(path, np.zeros(TRACES.shape))
    heads = np.frombuffer(path.read_bytes(), np.dtype([("head", "<f4", 32), ("samples", "<i2", 40)]))["head"].copy()
    heads[:, 5] = 4.0
    traces = TRACES.astype("<f4")
    path.write_bytes(b"".join(head.tobytes() + trace.tobytes() for head, trace in zip(heads, traces, strict=True)))
    return path


def _kmz(path: Path) -> Path:
    with zipfile.ZipFile(path, "w", zipfile.ZIP_DEFLATED) as archive:
        archive.writestr("doc.kml", _KML)
        archive.writestr("files/icon.png", np.random.default_rng(3).bytes(3000))
    return path


def side(text: str) -> Callable[[Path], Path]:
    def make(path: Path) -> Path:
        path.write_text(text, newline="")
        return path

    return make


def _cart() -> list[str]:
    """Sentences of a cart's log, an epoch each, the date wrong at first."""
    return [fix(n, date=lambda s, utc: "120136" if s < 2.0 else f"{utc:%d%m%y}") for n in range(40)]


def _read_cart(path: Path, _partial: bool) -> Read:
    return read_cart_fixes(path)


def _read_field(path: Path, _partial: bool) -> Read:
    return read_field(path)


def _read_signals(path: Path, _partial: bool) -> Read:
    output = path.with_suffix(".drive.h5")
    import_signals(path, SIGNAL_MAP, output, force=True)
    return VehicleLog.open(output)


def _read_lines(path: Path, partial: bool) -> Read:
    output = path.with_suffix(".drive.h5")
    import_lines([path], output=output, force=True, partial=partial)
    assert check_file(output) == []
    return DriveLog.open(output)


def _beside(name: str, text: str) -> Subject:
    """A line with a wheel, and a file beside it that is damaged."""

    def make(path: Path) -> Path:
        path.with_name(name).write_text(text, newline="")
        return write_dt1(path, TRACES)

    return Subject(make, (name,), (name,), _read_lines, fatal=False, spare_bytes=1 << 24)


def _table(path: Path) -> Path:
    return write_csv(path, {name: values[::4] for name, values in columns().items()})


_GPS = gps_text(
    [[gga(0, quality=0), rmc(0)], [rmc(1), "$GPVTG,93.5,T,93.7,M,000.1,N,000.2,K,A*22"], *([gga(n)] for n in (1, 2, 3))]
)
_DZG = dzg_text({0: [rmc(0), gga(0)], **{9 * n: [gga(n)] for n in range(1, 3)}})
_COR = "".join(cor_row(3 * n + 1) for n in range(9))
_TOPOGRAPHY = "N,E,Z\r\n" + "".join(f"12.5,{0.25 * n:g},{10 + n / 100:g}\r\n" for n in range(10))
_CORNERS = [(179.99, -16.5), (179.994, -16.5), (179.994, -16.49), (179.99, -16.49), (179.99, -16.5)]
_KML = (
    '<?xml version="1.0" encoding="ISO-8859-1"?>\n<kml xmlns="http://www.opengis.net/kml/2.2">\n<Placemark><name>a</name>'
    "\n<Polygon>\n<outerBoundaryIs><LinearRing><coordinates>\n"
    + "\n".join(f"{x},{y},310.5" for x, y in _CORNERS)
    + "\n</coordinates></LinearRing></outerBoundaryIs>\n</Polygon></Placemark></kml>\n"
)
_NOTE = "a field on both sides of the antimeridian, cut there as RFC 7946 has it; " * 12
_GEOJSON = (
    f'{{"type": "FeatureCollection", "features": [{{"type": "Feature", "properties":\n{{"note": "{_NOTE}"}},\n'
    '"geometry": {"type": "MultiPolygon", "coordinates": [[[\n'
    + ",\n".join(f"[{180.0 if x > 179.99 else x}, {y}]" for x, y in _CORNERS)
    + "]],\n[[[-180.0, -16.5], [-179.99, -16.5], [-179.99, -16.49], [-180.0, -16.49], [-180.0, -16.5]]]]}}]}\n"
)
_TABLE = "latitude_deg;longitude_deg;height_m\n" + "".join(
    f"{y:.4f};{x:.4f};310,5\n".replace(".", ",") for x, y in _CORNERS[:-1]
)
SUBJECTS = {
    "a.DT1": Subject(lambda path: write_dt1(path, TRACES), ("a.DT1", "a.HD"), ("a.HD",)),
    "a.DZT": Subject(_dzt, ("a.DZT",), ()),
    "a.rd3": Subject(lambda path: write_mala(path, TRACES.astype("<i2")), ("a.rd3", "a.rad"), ("a.rad",)),
    "a.iprb": Subject(lambda path: write_iprb(path, TRACES), ("a.iprb", "a.iprh"), ("a.iprh",)),
    "a.sgy": Subject(_segy, ("a.sgy",), ()),
    "a.GPS": Subject(side(_GPS), ("a.GPS",), ("a.GPS",)),
    "a.DZG": Subject(side(_DZG), ("a.DZG",), ("a.DZG",)),
    "a.cor": Subject(side(_COR), ("a.cor",), ("a.cor",)),
    "topo_a.txt": Subject(side(_TOPOGRAPHY), ("topo_a.txt",), ("topo_a.txt",)),
    "a.xyz": Subject(side(_TOPOGRAPHY.replace("N,E,Z\r\n", "").replace(",", " ")), ("a.xyz",), ("a.xyz",)),
    "a.nmea": Subject(
        lambda path: side("".join(_cart()))(path), ("a.nmea",), ("a.nmea",), _read_cart, spare_bytes=1 << 20
    ),
    "bare.nmea": Subject(
        lambda path: side(without_checksums("".join(_cart())))(path),
        ("bare.nmea",),
        ("bare.nmea",),
        _read_cart,
        spare_bytes=1 << 20,
    ),
    "a.ubx": Subject(_ubx, ("a.ubx",), (), _read_cart, spare_bytes=1 << 20),
    "a.csv": Subject(_table, ("a.csv",), ("a.csv",), _read_signals, spare_bytes=1 << 24),
    "g.DT1": _beside("g.GPS", gps_text([[gga(n)] for n in range(24)])),
    "z.DT1": _beside("z.DZG", dzg_text({6 * n: [gga(n)] for n in range(4)})),
    "c.DT1": _beside("c.cor", "".join(cor_row(n) for n in range(1, 24, 2))),
    "r.sgy": Subject(_revision_2, ("r.sgy",), ()),
    "f.DT1": Subject(_dt1_floats, ("f.DT1", "f.HD"), ("f.HD",)),
    "f.kml": Subject(side(_KML), ("f.kml",), ("f.kml",), _read_field),
    "f.kmz": Subject(_kmz, ("f.kmz",), (), _read_field),
    "f.geojson": Subject(side(_GEOJSON), ("f.geojson",), ("f.geojson",), _read_field),
    "f.csv": Subject(side(_TABLE), ("f.csv",), ("f.csv",), _read_field),
}


def _damage_bytes(rng: np.random.Generator, data: bytes) -> bytes:
    """Bytes changed, cut off, cut out, inserted or repeated, or a word of the headers made extreme."""
    at, end = sorted(int(each) for each in rng.integers(0, len(data) + 1, 2))
    match int(rng.integers(0, 7)):
        case 0:
            changed = bytearray(data)
            for place in rng.integers(0, max(len(data), 1), int(rng.integers(1, 6))) if data else ():
                changed[place] = int(rng.integers(0, 256))
            return bytes(changed)
        case 1:
            return data[:at]
        case 2:
            return data[:at] + data[min(end, at + 300) :]
        case 3:
            return data[:at] + rng.bytes(int(rng.integers(1, 200))) + data[at:]
        case 4:
            return data[:end] + data[at:]
        case 5:
            return data[:at] + bytes(int(rng.integers(1, 3000))) + data[at:]
        case _:
            # Most words of binary headers lie in the first 200 bytes; those of SEG-Y from 3200 on.
            head = int(rng.choice([0, 1024, 3200, 3600])) + int(rng.integers(0, 100)) * 2
            word = _WORDS[int(rng.integers(0, len(_WORDS)))]
            return data[:head] + word + data[head + len(word) :]


def _damage_text(rng: np.random.Generator, data: bytes) -> bytes:
    """Numbers made extreme, lines doubled, removed, swapped or joined, or all of it in another encoding."""
    lines = data.splitlines(keepends=True)
    if not lines:
        return data
    at, other = (int(each) for each in rng.integers(0, len(lines), 2))
    match int(rng.integers(0, 7)):
        case 0 | 1:
            numbers = list(re.finditer(rb"-?\d+(?:\.\d+)?", data))
            if not numbers:
                return data
            number = numbers[int(rng.integers(0, len(numbers)))]
            return data[: number.start()] + _EXTREMES[int(rng.integers(0, len(_EXTREMES)))] + data[number.end() :]
        case 2:
            lines.insert(at, lines[other])
        case 3:
            del lines[at : at + int(rng.integers(1, 4))]
        case 4:
            lines[at], lines[other] = lines[other], lines[at]
        case 5:
            lines[at] = lines[at].rstrip(b"\r\n")
        case _:
            text = data.decode("latin-1")
            coding = ("utf-16", "utf-8-sig", "utf-32", "cp037")[int(rng.integers(0, 4))]
            return text.encode(coding, errors="replace")
    return b"".join(lines)


def _check_profile(profile: Profile) -> None:
    traces, _, samples = profile.channels.shape
    assert traces > 0
    assert samples > 0
    assert np.isfinite(profile.sample_interval_ns)
    assert profile.sample_interval_ns > 0
    assert np.isfinite(profile.time_zero_ns)
    assert profile.spacing_m is None or (np.isfinite(profile.spacing_m) and profile.spacing_m > 0)
    assert profile.positions_m is None or (
        len(profile.positions_m) == traces and bool(np.isfinite(profile.positions_m).all())
    )


def _check_side(positions: SidePositions) -> None:
    rows = len(positions.trace)
    assert rows == len(positions.x) == len(positions.y) == len(positions.z) == positions.counts["rows"] > 0
    assert np.all(np.diff(positions.trace) > 0)
    assert np.isfinite([positions.x, positions.y]).all()
    limit = (180.0, 90.0) if positions.kind == "degrees" else (1e8, 1e8)
    assert np.abs(positions.x).max() <= limit[0]
    assert np.abs(positions.y).max() <= limit[1]
    assert len(places_of_traces(positions, 50).x) == 50


def _check_places(latitude_deg: np.ndarray, longitude_deg: np.ndarray, time_s: np.ndarray) -> None:
    """Places on the earth, and no step that a vehicle cannot make, by a distance of its own."""
    assert np.isfinite([latitude_deg, longitude_deg]).all()
    assert np.abs(latitude_deg).max() <= 90.0
    assert np.abs(longitude_deg).max() <= 180.0
    assert np.all(np.diff(time_s) > 0.0)
    step_m = _GEOD.inv(longitude_deg[:-1], latitude_deg[:-1], longitude_deg[1:], latitude_deg[1:])[2]
    # The sphere that the test of plausibility takes for the earth is within half a percent.
    assert np.all(step_m <= 1.01 * (70.0 * np.diff(time_s) + 30.0) + 1.0)


def _check_cart(fixes: CartFixes) -> None:
    assert len(fixes.utc_ns) > 0
    assert np.all(np.diff(fixes.utc_ns) > 0)
    assert np.all((fixes.sigma_m > 0.0) & np.isfinite(fixes.sigma_m))
    own = np.asarray(fixes.sigma_m) < 1.0
    time_s = (fixes.utc_ns - fixes.utc_ns[0]) / 1e9
    _check_places(fixes.latitude_deg[own], fixes.longitude_deg[own], time_s[own])


def _check_drive(log: DriveLog | VehicleLog) -> None:
    track = log.navigation if isinstance(log, VehicleLog) else log.description.navigation
    odometry = log.odometry if isinstance(log, VehicleLog) else log.description.odometry
    _check_places(track.latitude_deg, track.longitude_deg, track.time_s)
    assert np.isfinite(odometry.distance_m).all()
    if isinstance(log, DriveLog):
        # The line is a metre long by its wheel, and no companion moves it by more than a receiver can.
        assert 0.0 < odometry.distance_m[-1] - odometry.distance_m[0] < 3e3


def _check_field(places: FieldPlaces) -> None:
    every: tuple[FieldPlaces | KeepOut, ...] = (places, *places.keep_outs)
    for each in every:
        numbers = np.stack([each.latitude_deg, each.longitude_deg, each.height_m])
        assert numbers.shape[1] > 0
        assert np.isfinite(numbers).all()
        assert np.abs(each.latitude_deg).max() <= 90.0
        assert np.abs(each.longitude_deg - each.longitude_deg[0]).max() <= 180.0


_CHECKS: dict[type, Callable[..., None]] = {
    Profile: _check_profile,
    SidePositions: _check_side,
    CartFixes: _check_cart,
    VehicleLog: _check_drive,
    DriveLog: _check_drive,
    FieldPlaces: _check_field,
}


def trial(path: Path, *, partial: bool, longest_s: float = _LONGEST_S) -> tuple[str, str]:
    """How a read ended (``read`` or ``refused``), and what is wrong with that."""
    subject = SUBJECTS.get(path.name, Subject(lambda each: each, (), ()))
    size = sum(each.stat().st_size for each in path.parent.iterdir())
    before, start = tracemalloc.get_traced_memory()[0], time.perf_counter()
    tracemalloc.reset_peak()
    read: Read | None = None
    try:
        read = subject.read(path, partial)
    except InputError as error:
        lines = str(error).splitlines()
        short = len(lines) == 1 and len(str(error)) < 500
        wrong = "" if short and subject.fatal else f"no short line, or of a companion: {str(error)[:200]!r}"
    except Exception as error:
        wrong = f"{type(error).__name__}: {error}"
    else:
        wrong = ""
    taken_s, peak = time.perf_counter() - start, tracemalloc.get_traced_memory()[1] - before
    if taken_s > longest_s:
        wrong += f" {taken_s:.1f} s"
    if peak > 10 * size + subject.spare_bytes:
        wrong += f" {peak} bytes of memory for files of {size}"
    if read is not None and not wrong:
        try:
            _CHECKS[type(read)](read)
        except AssertionError as error:
            wrong = f"read as nonsense: {error}"
    return ("refused" if read is None else "read"), wrong


def check_damages(name: str, count: int, folder: Path) -> dict[str, int]:
    """Damage a file of a reader so often; how many were read and how many refused."""
    subject = SUBJECTS[name]
    path = subject.make(folder / name)
    sound = {each: (folder / each).read_bytes() for each in subject.damaged}
    tracemalloc.start()
    try:
        assert trial(path, partial=False, longest_s=60.0) == ("read", "")
        ended, wrong = {"read": 0, "refused": 0}, []
        memory_kib = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
        for number in range(count):
            rng = np.random.default_rng([number, list(SUBJECTS).index(name)])
            which = subject.damaged[int(rng.integers(0, len(subject.damaged)))]
            data = sound[which]
            for _ in range(int(rng.integers(1, 4))):
                as_text = which in subject.text and rng.random() < 0.6
                data = _damage_text(rng, data) if as_text else _damage_bytes(rng, data)
            (folder / which).write_bytes(data)
            # A companion is tried by a whole import.
            longest_s = _LONGEST_S if subject.fatal else 10.0 * _LONGEST_S
            how, fault = trial(path, partial=bool(rng.random() < 0.5), longest_s=longest_s)
            ended[how] += 1
            if fault:
                wrong.append(f"{number} ({which}): {fault}")
            (folder / which).write_bytes(sound[which])
    finally:
        tracemalloc.stop()
    assert wrong == []
    # Some are still read and many are not: the damage is neither too mild nor too strong to find anything.
    assert min(ended.values()) > 0.05 * count or not subject.fatal
    # Libraries in C do not tell tracemalloc what they take.
    assert resource.getrusage(resource.RUSAGE_SELF).ru_maxrss - memory_kib < 100_000
    return ended
