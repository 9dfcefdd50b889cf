"""Signals of a vehicle from elsewhere, CSV, Parquet or MCAP, as a drive log without radar."""

import csv
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from pydantic import Field
from pyproj import Transformer

from lgprjax import __version__
from lgprjax.config import ConfigTable, TableKey, fill_table
from lgprjax.errors import InputError
from lgprjax.files import load_toml
from lgprjax.formats.drive import NavigationTrack, OdometryTrack
from lgprjax.formats.mcap_recording import McapRecording
from lgprjax.formats.plausible import (
    ASTRAY,
    known_sigma,
    left_out_in_words,
    plausible_places,
    plausible_positions,
    reach_in_time_m,
)
from lgprjax.formats.survey_track import check_utm
from lgprjax.formats.vehicle_log import VehicleLog, write_vehicle_log
from lgprjax.frames import LocalFrame

_DEGREE = np.pi / 180.0
_UNITS: dict[str, dict[str, float]] = {
    "time": {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9},
    "speed": {"m/s": 1.0, "km/h": 1.0 / 3.6, "mph": 0.44704},
    "distance": {"m": 1.0, "km": 1e3, "ft": 0.3048},
    "angle": {"rad": 1.0, "deg": _DEGREE},
    "rate": {"rad/s": 1.0, "deg/s": _DEGREE},
    "degrees": {"deg": 1.0, "rad": 1.0 / _DEGREE},
    "volts": {"V": 1.0, "mV": 1e-3},
    "count": {"count": 1.0},
    "share": {"1": 1.0, "%": 0.01},
    "code": {"1": 1.0},
}


class _Signal(NamedTuple):
    """A signal of a column map: kind of its unit, its place in ``/vehicle``, and its range."""

    kind: str
    place: str | None
    low: float
    high: float


_SIGNALS: dict[str, _Signal] = {
    "time": _Signal("time", None, -np.inf, np.inf),
    "speed": _Signal("speed", None, -40.0, 40.0),
    "travel": _Signal("distance", None, -1e6, 1e6),
    "latitude": _Signal("degrees", None, -90.0, 90.0),
    "longitude": _Signal("degrees", None, -360.0, 360.0),
    "height": _Signal("distance", None, -500.0, 9000.0),
    "east": _Signal("distance", None, -1e8, 1e8),
    "north": _Signal("distance", None, -1e8, 1e8),
    "heading": _Signal("degrees", None, -360.0, 360.0),
    "yaw": _Signal("angle", None, -1e3, 1e3),
    "position_sigma": _Signal("distance", None, 0.0, 100.0),
    "heading_sigma": _Signal("degrees", None, 0.0, 90.0),
    "yaw_rate": _Signal("rate", "yaw_rate_radps", -4.0, 4.0),
    "wheel_angle": _Signal("angle", "wheel_angle_rad", -1.3, 1.3),
    "rear_wheel_angle": _Signal("angle", "rear_wheel_angle_rad", -1.3, 1.3),
    "steering_command": _Signal("angle", "steering_command_rad", -1.3, 1.3),
    "potentiometer": _Signal("volts", "steering_potentiometer_v", -1e3, 1e3),
    "encoder": _Signal("count", "encoder_counts", -2e9, 2e9),
    "supply": _Signal("volts", "supply_v", 0.0, 1e3),
    "throttle": _Signal("share", "throttle", 0.0, 1.0),
    "brake": _Signal("share", "brake", 0.0, 1.0),
    "mode": _Signal("code", "mode", 0.0, 7.0),
}
_LEAST_ROWS = 20
_GAP_S = 2.0
_LEAST_S = 1.0
_WORDS_SHARE = 0.05
"""Share of a column's cells that may be words, such as ``error``; they are left out and counted."""
_EMPTY = ("", "nan", "na", "n/a", "null", "none", "-")
_SITE_M = 1e5
"""A site's own metres do not reach this far; those of a grid do."""


class _Column(ConfigTable):
    """Column of a signal, its unit, and the scale and offset applied first."""

    column: str = Field(min_length=1)
    unit: str
    scale: float = 1.0
    offset: float = 0.0


class _SignalMap(ConfigTable):
    """A map of columns: one table per signal, and quantities that the file lacks."""

    name: str | None = None
    serial_number: str | None = None
    t0_utc: str = "1970-01-01T00:00:00+00:00"
    utm_zone: str | None = None
    signals: dict[str, _Column]


class _Series(NamedTuple):
    """A signal and its own times, in the log's units."""

    time_s: Float[np.ndarray, " row"]
    value: Float[np.ndarray, " row"]


class _Table(NamedTuple):
    """Columns of a table, NaN where a cell is empty or no number.

    Attributes:
        columns: values by column name.
        first_row: number of the first row of numbers, as in a spreadsheet.
        words: cells of each column that are neither empty nor a number: their count, and row and text of the first.
        repeated: names shared by several columns.
    """

    columns: dict[str, np.ndarray]
    first_row: int
    words: dict[str, tuple[int, int, str]]
    repeated: frozenset[str]


class ImportedSignals(NamedTuple):
    """Result of an import: number of rows by signal, assumptions for unmeasured quantities, and cells left out."""

    signals: dict[str, int]
    seconds: float
    assumed: dict[str, str]
    left_out: dict[str, str]


def import_signals(
    file: str | Path, columns: str | Path, output: str | Path, *, force: bool = False
) -> ImportedSignals:
    """Write signals of a table or of messages as a drive log without radar.

    Args:
        file: path of a .csv (a header, then numbers; separated by semicolons or tabs, commas may be decimal signs),
            .parquet (needs pyarrow), or .mcap (needs mcap), in which a column is ``/topic:member.of.message``, each
            with its own times.
        columns: path of the TOML map of columns to signals and units.
        output: path of ``X.drive.h5``.
        force: whether to replace an existing output.

    Raises:
        InputError: a file cannot be read; a column, unit or signal is missing, unknown or out of range; a column has
            many cells that are not numbers; times do not rise; neither position nor speed is given; or the output
            cannot be written.
    """
    path, map_file = Path(file), Path(columns)
    asked = fill_table(_SignalMap, TableKey(map_file), load_toml(map_file))
    for name, column in asked.signals.items():
        place = TableKey(map_file, f"signals.{name}")
        if name not in _SIGNALS:
            raise place.refuse("one of " + ", ".join(_SIGNALS), "another name")
        units = _UNITS[_SIGNALS[name].kind]
        if column.unit not in units:
            raise place.at("unit").refuse(" or ".join(units), repr(column.unit))
    series, left_out = _read(path, asked, map_file)
    log, assumed = _as_log(path, asked, map_file, series, left_out)
    write_vehicle_log(output, log, force=force)
    seconds = float(log.odometry.time_s[-1] - log.odometry.time_s[0])
    return ImportedSignals({name: len(one.value) for name, one in series.items()}, seconds, assumed, left_out)


def _read(path: Path, asked: _SignalMap, map_file: Path) -> tuple[dict[str, _Series], dict[str, str]]:
    """The signals, and of which of them cells were left out."""
    readers = {".csv": _read_csv, ".parquet": _read_parquet}
    suffix, first_row, left_out = path.suffix.lower(), 1, dict[str, str]()
    if suffix == ".mcap":
        raw = _read_mcap(path, asked, map_file)
    elif suffix in readers:
        if "time" not in asked.signals:
            raise TableKey(map_file, "signals").refuse("a signal called time", "none")
        table, first_row, words, repeated = readers[suffix](path)
        raw = {}
        for name, column in asked.signals.items():
            if column.column not in table:
                columns = f"a column of {path.name}: {', '.join(table)}"[:300]
                raise TableKey(map_file, f"signals.{name}").refuse(
                    columns, f"{column.column!r}: name the right one, or leave out a signal that you lack"
                )
            if column.column in repeated:
                raise InputError(path, "row 1", "one column of each name", f"{column.column!r} more than once")
            if column.column in words:
                left_out[name] = _left_out(path, column.column, table[column.column], *words[column.column])
            raw[name] = (table[asked.signals["time"].column], table[column.column])
    else:
        raise InputError(
            path,
            "file name",
            "a name that ends in .csv, .parquet or .mcap (save a spreadsheet as CSV)",
            repr(path.name),
        )
    series = {
        name: _converted(path, name, asked.signals, *pair, first_row=first_row, own=suffix == ".mcap")
        for name, pair in raw.items()
        if name != "time"
    }
    return series, left_out


def _left_out(path: Path, column: str, values: np.ndarray, count: int, row: int, text: str) -> str:
    """Cells of a column that are words, in words. Raises ``InputError`` where they are many."""
    first = f"the first {text[:40]!r} in row {row}"
    cells = count + int(np.count_nonzero(np.isfinite(values)))
    if count > _WORDS_SHARE * cells:
        raise InputError(
            path, f"column {column!r}", "numbers", f"{count} of {cells} cells that are not numbers, {first}"
        )
    return f"{count} of {cells} cells of column {column!r} are not numbers, {first}"


def _converted(
    path: Path,
    name: str,
    columns: dict[str, _Column],
    time: np.ndarray,
    value: np.ndarray,
    *,
    first_row: int,
    own: bool,
) -> _Series:
    """A signal in the log's unit, checked; rows that hold no number are left out."""
    column, signal = columns[name], _SIGNALS[name]
    clock = 1.0 if own else _factor(columns["time"], "time")
    numbers = (np.asarray(value, np.float64) * column.scale + column.offset) * _UNITS[signal.kind][column.unit]
    time_s = np.asarray(time, np.float64) * clock
    if not own:
        time_s = time_s * columns["time"].scale + columns["time"].offset
    known = np.isfinite(numbers) & np.isfinite(time_s)
    rows, time_s, numbers = np.flatnonzero(known) + first_row, time_s[known], numbers[known]
    if len(numbers) < _LEAST_ROWS:
        raise InputError(path, f"column {column.column!r}", f"{_LEAST_ROWS} numbers or more", str(len(numbers)))
    wrong = np.flatnonzero(np.diff(time_s) <= 0.0)
    if len(wrong):
        row = int(wrong[0]) + 1
        found = f"{time_s[row]:.6f} s after {time_s[row - 1]:.6f} s in row {rows[row]}"
        raise InputError(path, f"time of {column.column!r}", "increasing times", found)
    if not own and time_s[-1] - time_s[0] < _LEAST_S:
        expected = f"{_LEAST_S:g} s or more once converted (is the unit {columns['time'].unit}?)"
        raise InputError(path, f"column {columns['time'].column!r}", expected, f"{time_s[-1] - time_s[0]:g} s")
    outside = np.flatnonzero((numbers < signal.low) | (numbers > signal.high))
    if len(outside):
        row = int(outside[0])
        expected = f"{name} from {signal.low:g} to {signal.high:g} once converted (is the unit {column.unit}?)"
        raise InputError(path, f"column {column.column!r}", expected, f"{numbers[row]:g} in row {rows[row]}")
    return _Series(time_s, numbers)


def _factor(column: _Column, kind: str) -> float:
    return _UNITS[kind][column.unit]


def _read_csv(path: Path) -> _Table:
    try:
        with path.open(newline="", encoding="utf-8-sig") as stream:
            first = stream.readline()
            separator = separator_of(first)
            stream.seek(0)
            rows = list(csv.reader(stream, delimiter=separator))
    except UnicodeDecodeError as error:
        found = f"the byte {error.object[error.start]:#04x}: save the table as CSV in UTF-8"
        raise InputError(path, "file", "a CSV file in UTF-8", found) from None
    except (OSError, csv.Error) as error:
        found = error.strerror if isinstance(error, OSError) and error.strerror else str(error)
        raise InputError(path, "file", "a readable CSV file", found) from None
    if len(rows) < 2:
        raise InputError(path, "rows", "a header and numbers", "a header only" if rows else "none")
    header = [name.strip() for name in rows[0]]
    if all(number_of(name, separator) is not None for name in header):
        raise InputError(path, "row 1", "the names of the columns", "numbers")
    columns = np.full((len(header), len(rows) - 1), np.nan)
    words: dict[str, tuple[int, int, str]] = {}
    for number, row in enumerate(rows[1:]):
        if not row:
            continue
        if len(row) < len(header) or any(row[len(header) :]):
            hint = " (decimal commas? separate the columns by semicolons)" if len(row) > len(header) else ""
            raise InputError(path, f"row {number + 2}", f"{len(header)} columns", f"{len(row)}{hint}")
        for column, (name, text) in enumerate(zip(header, row, strict=False)):
            if text.strip().lower() in _EMPTY:
                continue
            value = number_of(text, separator)
            if value is None:
                # It is reported or refused when its column is read.
                count, at, word = words.get(name, (0, number + 2, text.strip()))
                words[name] = (count + 1, at, word)
            else:
                columns[column, number] = value
    repeated = frozenset(name for name in header if header.count(name) > 1)
    return _Table(dict(zip(header, columns, strict=True)), 2, words, repeated)


def separator_of(header: str) -> str:
    """Separator of a table's columns, from its header line."""
    return next((each for each in (";", "\t") if each in header), ",")


def number_of(text: str, separator: str) -> float | None:
    """The number of a cell, with a decimal comma where it does not separate columns; ``None`` if it is none."""
    plain = text.replace(",", ".") if separator != "," and "." not in text else text
    try:
        # Python's digit groups (1_000) are no numbers of a table.
        value = math.inf if "_" in plain else float(plain)
    except ValueError:
        return None
    return value if math.isfinite(value) else None


def _read_parquet(path: Path) -> _Table:
    try:
        from pyarrow import ArrowException, parquet
    except ImportError:
        raise InputError(path, "package", "pyarrow (pip install lgprjax[signals])", "none") from None
    try:
        table = parquet.read_table(path)
    except (OSError, ArrowException) as error:
        raise InputError(path, "file", "a readable Parquet file", str(error).splitlines()[0]) from None
    found = {}
    for name in table.column_names:
        values = table[name].to_numpy()
        if np.issubdtype(values.dtype, np.datetime64):
            # Times of a calendar, as seconds since the first: float64 of nanoseconds since 1970 are too coarse.
            values = (values - values[0]) / np.timedelta64(1, "s")
        if np.issubdtype(values.dtype, np.number) or values.dtype == bool:
            found[name] = values.astype(np.float64)
    return _Table(found, 1, {}, frozenset())


def _read_mcap(path: Path, asked: _SignalMap, map_file: Path) -> dict[str, tuple[np.ndarray, np.ndarray]]:
    wanted: dict[str, list[tuple[str, str]]] = {}
    for name, column in asked.signals.items():
        topic, colon, member = column.column.partition(":")
        if name == "time" or not colon or not topic.startswith("/"):
            expected = "/topic:member.of.message (messages have their own times)"
            raise TableKey(map_file, f"signals.{name}.column").refuse(expected, repr(column.column))
        wanted.setdefault(topic, []).append((name, member))
    rows: dict[str, list[tuple[int, float]]] = {name: [] for name in asked.signals}
    seen: set[str] = set()
    for message in McapRecording(path).messages():
        if message.topic not in wanted:
            continue
        stamp = message.values.get("header.stamp.sec")
        at_ns = message.log_ns if stamp is None else int(stamp) * 10**9 + int(message.values["header.stamp.nanosec"])
        for name, member in wanted[message.topic]:
            seen.add(name)
            if member not in message.values:
                expected = f"one of {', '.join(message.values)}"[:300]
                raise InputError(path, f"{message.topic}:{member}", expected, "none")
            rows[name].append((at_ns, float(np.asarray(message.values[member]).reshape(-1)[0])))
    for name in asked.signals:
        if name not in seen:
            raise InputError(path, asked.signals[name].column, "messages on this topic", "none")
    first = min(held[0][0] for held in rows.values())
    return {
        name: (np.array([1e-9 * (at - first) for at, _ in held]), np.array([value for _, value in held]))
        for name, held in rows.items()
    }


def _as_log(
    path: Path, asked: _SignalMap, map_file: Path, series: dict[str, _Series], left_out: dict[str, str]
) -> tuple[VehicleLog, dict[str, str]]:
    first = min(float(one.time_s[0]) for one in series.values())
    series = {name: one._replace(time_s=one.time_s - first) for name, one in series.items()}
    assumed: dict[str, str] = {}
    odometry = _odometry(path, map_file, series)
    navigation = _navigation(path, map_file, asked, series, odometry, assumed, left_out)
    clock = _clock(series)
    signals: dict[str, np.ndarray] = {"time_s": clock}
    for name, signal in _SIGNALS.items():
        if signal.place is None or name not in series:
            continue
        one = series[name]
        held = np.interp(clock, one.time_s, one.value)
        if name in ("steering_command", "mode", "encoder"):
            held = one.value[np.clip(np.searchsorted(one.time_s, clock + 1e-9, side="right") - 1, 0, None)]
        signals[signal.place] = (
            held.astype(np.int8) if name == "mode" else np.round(held) if name == "encoder" else held
        )
    log = VehicleLog(
        name=asked.name or path.stem,
        t0_utc=asked.t0_utc,
        navigation=navigation,
        odometry=odometry,
        truth=None,
        vehicle=signals,
        serial_number=asked.serial_number,
        provenance={
            "program": f"lgprjax {__version__}",
            "made_by": "lgprjax import signals",
            "input": path.name,
            "columns": {name: [one.column, one.unit] for name, one in asked.signals.items()},
            **({"assumed": assumed} if assumed else {}),
        },
    )
    return log, assumed


def _clock(series: dict[str, _Series]) -> Float[np.ndarray, " record"]:
    """Times of the fastest signal of the vehicle, as far as all of these reach."""
    own = [one for name, one in series.items() if _SIGNALS[name].place is not None] or list(series.values())
    fastest = min(own, key=lambda one: float(np.median(np.diff(one.time_s)))).time_s
    first, last = max(one.time_s[0] for one in own), min(one.time_s[-1] for one in own)
    return np.asarray(fastest[(fastest >= first) & (fastest <= last)])


def _odometry(path: Path, map_file: Path, series: dict[str, _Series]) -> OdometryTrack:
    if "travel" in series:
        return OdometryTrack(*series["travel"])
    if "speed" not in series:
        raise TableKey(map_file, "signals").refuse("travel or speed", f"neither, for {path.name}")
    time_s, speed = series["speed"]
    gap = np.flatnonzero(np.diff(time_s) > _GAP_S)
    if len(gap):
        found = f"none from {time_s[gap[0]]:.2f} s to {time_s[gap[0] + 1]:.2f} s"
        raise InputError(path, "speed", f"speeds no more than {_GAP_S:g} s apart, or a signal travel", found)
    way = np.append(0.0, np.cumsum(0.5 * (speed[1:] + speed[:-1]) * np.diff(time_s)))
    return OdometryTrack(time_s, way)


def _navigation(
    path: Path,
    map_file: Path,
    asked: _SignalMap,
    series: dict[str, _Series],
    odometry: OdometryTrack,
    assumed: dict[str, str],
    left_out: dict[str, str],
) -> NavigationTrack:
    """Poses of the rear axle; without positions reckoned from speed and yaw rate, which the log then says."""
    on_earth, in_plane = ({*pair} <= set(series) for pair in (("latitude", "longitude"), ("east", "north")))
    if asked.utm_zone is not None and (on_earth or not in_plane):
        expected = "signals east and north, and no latitude and longitude"
        raise TableKey(map_file, "utm_zone").refuse(expected, f"{asked.utm_zone!r} without use")
    if on_earth:
        time_s = series["latitude"].time_s
        latitude, longitude = series["latitude"].value, _turning_at(series["longitude"], time_s, 360.0)
        kept, longitude, counts = plausible_positions(latitude, longitude, reach_in_time_m(time_s))
        if counts:
            left_out["latitude, longitude"] = left_out_in_words(counts, len(time_s))
        if np.count_nonzero(kept) < _LEAST_ROWS:
            expected = f"{_LEAST_ROWS} plausible ones or more"
            raise InputError(path, "positions", expected, left_out["latitude, longitude"])
        time_s, latitude, longitude = time_s[kept], latitude[kept], longitude[kept]
    elif in_plane:
        time_s = series["east"].time_s
        east, north = series["east"].value, _at(series["north"], time_s)
        kept = plausible_places(east, north, reach_in_time_m(time_s))
        if not kept.all():
            left_out["east, north"] = left_out_in_words({ASTRAY: int(np.sum(~kept))}, len(kept))
        time_s, east, north = time_s[kept], east[kept], north[kept]
        latitude, longitude = _from_plane(path, map_file, asked, east, north, assumed)
    elif "yaw_rate" in series:
        time_s = series["yaw_rate"].time_s
        way = np.interp(time_s, odometry.time_s, odometry.distance_m)
        yaw = np.append(
            0.0, np.cumsum(0.5 * np.diff(time_s) * (series["yaw_rate"].value[1:] + series["yaw_rate"].value[:-1]))
        )
        step, middle = np.diff(way), 0.5 * (yaw[1:] + yaw[:-1])
        x, y = (np.append(0.0, np.cumsum(step * part)) for part in (np.cos(middle), np.sin(middle)))
        latitude, longitude, _ = LocalFrame(0.0, 0.0, 0.0).to_geodetic(x, y, np.zeros_like(yaw))
        assumed["positions"] = "reckoned from speed and yaw rate, with its bias"
        assumed["place on the earth"] = "latitude 0, longitude 0"
        series = {**series, "yaw": _Series(time_s, yaw)}
    else:
        expected = "latitude and longitude, east and north, or yaw_rate to reckon by"
        raise TableKey(map_file, "signals").refuse(expected, f"none of them, for {path.name}")
    frame = LocalFrame(float(latitude[0]), float(longitude[0]), 0.0)
    if "heading" in series:
        heading = _turning_at(series["heading"], time_s, 360.0)
    elif "yaw" in series:
        heading = frame.heading_of_yaw(_turning_at(series["yaw"], time_s, 2.0 * np.pi), longitude)
    else:
        east, north, _ = frame.to_local(latitude, longitude, np.zeros_like(latitude))
        heading = frame.heading_of_yaw(np.unwrap(np.arctan2(np.gradient(north), np.gradient(east))), longitude)
        assumed["heading"] = "along the path"
    height = _at(series["height"], time_s) if "height" in series else np.zeros(len(time_s))
    if "height" not in series:
        assumed["height"] = "0 m"
    sigma, heading_sigma = (
        _sigma_at(name, series, time_s, assumed, left_out) for name in ("position_sigma", "heading_sigma")
    )
    return NavigationTrack(
        time_s=time_s,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        heading_deg=np.mod(heading, 360.0),
        roll_deg=np.zeros(len(time_s)),
        sigma_east_m=sigma,
        sigma_north_m=sigma,
        sigma_heading_deg=heading_sigma,
    )


def _sigma_at(
    name: str,
    series: dict[str, _Series],
    time_s: Float[np.ndarray, " row"],
    assumed: dict[str, str],
    left_out: dict[str, str],
) -> Float[np.ndarray, " row"] | None:
    """A sigma at some times, from the rows that state one: zero means unknown."""
    if name not in series:
        return None
    known = np.isfinite(known_sigma(series[name].value))
    if not known.all():
        left_out[name] = f"{np.count_nonzero(~known)} of {len(known)} rows state a sigma of 0, which means unknown"
    if not known.any():
        assumed[name.replace("_", " ")] = "not recorded"
        return None
    return _at(_Series(*(part[known] for part in series[name])), time_s)


def _at(one: _Series, time_s: Float[np.ndarray, " row"]) -> Float[np.ndarray, " row"]:
    return np.asarray(np.interp(time_s, one.time_s, one.value))


def _turning_at(one: _Series, time_s: Float[np.ndarray, " row"], period: float) -> Float[np.ndarray, " row"]:
    """An angle at some times, unwrapped where its values step from one end of their range to the other."""
    return np.asarray(np.interp(time_s, one.time_s, np.unwrap(one.value, period=period)))


def _from_plane(
    path: Path, map_file: Path, asked: _SignalMap, east_m: np.ndarray, north_m: np.ndarray, assumed: dict[str, str]
) -> tuple[np.ndarray, np.ndarray]:
    if asked.utm_zone is None:
        far_m = float(max(np.abs(east_m).max(), np.abs(north_m).max()))
        if far_m > _SITE_M:
            expected = f"a zone such as 33N, or east and north within {_SITE_M / 1e3:g} km of the site's origin"
            raise TableKey(map_file, "utm_zone").refuse(expected, f"none, and {far_m:.0f} m in {path.name}")
        assumed["place on the earth"] = "latitude 0, longitude 0: east and north are local metres"
        latitude, longitude, _ = LocalFrame(0.0, 0.0, 0.0).to_geodetic(east_m, north_m, np.zeros_like(east_m))
        return latitude, longitude
    zone = asked.utm_zone.strip().upper()
    number, band = zone[:-1], zone[-1:]
    if not (number.isdigit() and 1 <= int(number) <= 60 and band in "NS"):
        raise TableKey(map_file, "utm_zone").refuse("a zone such as 33N", repr(asked.utm_zone))
    code = (32600 if band == "N" else 32700) + int(number)
    check_utm(path, "east and north", east_m, north_m)
    longitude, latitude = Transformer.from_crs(code, 4326, always_xy=True).transform(east_m, north_m)
    return np.asarray(latitude), np.asarray(longitude)
