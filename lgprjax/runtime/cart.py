"""The log of a receiver on a hand cart as a run of a field: bytes in, smoothed moments out."""

import re
from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
from functools import reduce
from operator import xor
from pathlib import Path
from typing import Any, NamedTuple
from uuid import NAMESPACE_URL, uuid5

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, Int
from pynmeagps import NMEAReader
from pyubx2 import UBXReader

from lgprjax.autopilot import Mode
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import read_run, read_vehicle
from lgprjax.formats.plausible import (
    DatedClock,
    date_by_majority,
    left_out_in_words,
    plausible_positions,
    reach_in_time_m,
)
from lgprjax.navigation import GnssObservation, SmoothedCart, cart_model, cart_rules, smooth_cart
from lgprjax.recordings.vehicles import tool_of
from lgprjax.run_records import COVER, RecordKind, Source, ToolBits
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.senses import GnssSenses, LocalPosition
from lgprjax.runtime.gnss import Accuracy, GnssParser, GnssPosition, Quality, read_gnss
from lgprjax.runtime.replay import starts_of_run
from lgprjax.wire import RefusalReason
from lgprjax.worked.plans import PlanFile
from lgprjax.worked.record import NOT_MEASURED, CoverRun

_STEP_S = 0.1
_PIECE = 16_384
"""Ticks that are smoothed at once, some 27 minutes: one compiled size serves every log."""
_SILENT_S = 30.0
"""Longest gap within a part of a log; after a longer one the heading is found again, and the gap has no ticks."""
_FIXED_SIGMA_M = 0.02
_LEAST_SIGMA_M = 0.001
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_FIRST_YEAR = 1999
"""Receivers without a date count from January 1980, those after 1,024 weeks without their era from August 1999."""


class _Heard(NamedTuple):
    """A message of the log with a time of day, and the position that it has."""

    day_s: float
    day: int | None
    position: GnssPosition | None
    sigma_m: float


class CartFixes(NamedTuple):
    """Positions of an antenna, with rising times.

    Attributes:
        utc_ns: UTC of measurement, ns.
        latitude_deg, longitude_deg, height_m: WGS-84 position; the height is NaN if the receiver states none.
        sigma_m: standard deviation per axis.
        quality: values of ``Quality``.
        notes: records left out or distrusted, with reasons, one line each.
    """

    utc_ns: Int[np.ndarray, " fix"]
    latitude_deg: Float[np.ndarray, " fix"]
    longitude_deg: Float[np.ndarray, " fix"]
    height_m: Float[np.ndarray, " fix"]
    sigma_m: Float[np.ndarray, " fix"]
    quality: Int[np.ndarray, " fix"]
    notes: tuple[str, ...]


def read_cart_fixes(path: str | Path) -> CartFixes:
    """Positions of a receiver's log: NMEA (GGA, GST, and RMC or ZDA for the date) or UBX (NAV-PVT), also mixed.

    A fixed position without a stated accuracy has 2 cm, any other one without is left out. So are positions that are
    not plausible (``formats.plausible``). Positions are dated by most of the log. In a log without any checksum
    sentences are read without.

    Raises:
        InputError: unreadable, no position, or no date.
    """
    file = Path(path)
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InputError(file, "file", "a GNSS receiver log", str(error.strerror or error)) from None
    bare = not _CHECKED.search(data) and bool(_BARE.search(data))
    heard, refused = _heard(_BARE.sub(_with_checksum, data) if bare else data)
    fixes = [each for each in heard if each.position is not None]
    found = f"none ({len(heard)} messages with a time, {refused} damaged)"
    if not fixes:
        raise InputError(file, "positions", "GGA sentences or NAV-PVT with a position", found)
    clock = date_by_majority(np.array([each.day_s for each in heard]), [each.day for each in heard])
    if np.isnan(clock.time_s[0]):
        raise InputError(file, "date", "RMC or ZDA sentences, or NAV-PVT, to date the positions", "none")
    notes = [f"{refused} damaged messages left out"] if refused else []
    notes += ["no sentence has a checksum: damage within them is not noticed"] if bare else []
    notes += _date_notes(clock)
    low = sum(each.position is not None and np.isnan(each.position.height_m) for each in fixes)
    notes += [f"{low} positions have no geoid separation: their height is unknown"] if low else []
    utc_s = np.array([at for at, each in zip(clock.time_s, heard, strict=True) if each.position is not None])
    table = np.array([_row(each) for each in fixes])
    # Sessions of a log are sorted; a clock that is set back makes times repeat, of which the first count.
    order = np.argsort(_begin_s(utc_s), kind="stable")
    utc_s, table = utc_s[order], table[order]
    rises = utc_s > np.maximum.accumulate(np.concatenate([[-np.inf], utc_s[:-1]]))
    stated = np.isfinite(table[:, 3])
    use = rises & stated
    judged = plausible_positions(table[use, 0], table[use, 1], reach_in_time_m(utc_s[use]), table[use, 3])
    others = {
        "with a repeated or earlier time": int(np.sum(~rises)),
        "without an accuracy": int(np.sum(rises & ~stated)),
    }
    left_out = {reason: count for reason, count in others.items() if count} | judged.left_out
    if left_out:
        notes.append(left_out_in_words(left_out, len(fixes)))
    if not judged.kept.any():
        raise InputError(file, "positions", "plausible positions with an accuracy", f"none: {notes[-1]}")
    latitude, longitude, height, sigma, quality = table[use][judged.kept].T
    utc_ns = np.rint(utc_s[use][judged.kept] * 1e9).astype(np.int64)
    return CartFixes(
        utc_ns=utc_ns,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        sigma_m=sigma,
        quality=quality.astype(np.int64),
        notes=tuple(notes),
    )


_CHECKED = re.compile(rb"\$[A-Z]{5},[ -#%-)+-~]{6,250}\*[0-9A-Fa-f]{2}")
_BARE = re.compile(rb"\$([A-Z]{5},[ -#%-)+-~]{6,250})(?=[\r\n]|\Z)")


def _with_checksum(sentence: re.Match[bytes]) -> bytes:
    return b"$%b*%02X" % (sentence[1], reduce(xor, sentence[1], 0))


def _heard(data: bytes) -> tuple[list[_Heard], int]:
    """Messages with a time of day, in the order of the log, and the number of damaged ones."""
    heard: list[_Heard] = []
    told: Accuracy | None = None
    parser = GnssParser()
    for message in (*parser.feed(data), *parser.finish()):
        if not isinstance(message, bytes):
            continue
        clock, sample = _clock(message), read_gnss(message)
        if sample is not None and sample.accuracy is not None:
            told = sample.accuracy
            newest = next((i for i in range(len(heard) - 1, max(-1, len(heard) - 4), -1) if heard[i].position), None)
            if newest is not None and heard[newest].position.tow_s == told.tow_s:  # type: ignore[union-attr]  # chosen for its position
                heard[newest] = heard[newest]._replace(sigma_m=told.sigma_m)
        position = None if sample is None else sample.position
        if position is not None and position.quality is Quality.NONE:
            position = None
        if position is not None and clock is None and message[:1] == b"$":
            clock = (position.tow_s, None)
        if clock is None:
            continue
        sigma_m = np.nan if position is None else position.sigma_m
        # Some receivers send the accuracy of a position before it.
        if position is not None and not np.isfinite(sigma_m) and told is not None and told.tow_s == position.tow_s:
            sigma_m = told.sigma_m
        heard.append(_Heard(*clock, position, sigma_m))
    return heard, sum(parser.counts[reason] for reason in (RefusalReason.CRC, RefusalReason.CUT, RefusalReason.LENGTH))


def _date_notes(clock: DatedClock) -> list[str]:
    """Description of distrusted dates."""
    begin = datetime.fromtimestamp(float(clock.time_s[0]), UTC)
    notes = []
    for day, count in sorted(clock.other_dates.items()):
        date = (_EPOCH + timedelta(days=day)).date().isoformat()
        notes.append(f"{count} messages have the date {date}, unlike the rest of the log: the time of day was kept")
    if begin.year < _FIRST_YEAR:
        notes.append(f"the log begins in {begin.year}: the receiver's date was not set")
    return notes


def _row(each: _Heard) -> tuple[float, ...]:
    """Position, sigma and quality; a fixed position without stated accuracy has a sigma of 2 cm."""
    position = each.position
    assert position is not None
    fixed = position.quality is Quality.FIXED
    sigma_m = each.sigma_m if np.isfinite(each.sigma_m) else _FIXED_SIGMA_M if fixed else np.nan
    place = (position.latitude_deg, position.longitude_deg, position.height_m)
    return (*place, max(sigma_m, _LEAST_SIGMA_M), float(position.quality))


def _begin_s(utc_s: Float[np.ndarray, " fix"]) -> Float[np.ndarray, " fix"]:
    """Time at which each position's session begins: sessions are parted by silences, or by another day."""
    begins = np.concatenate([[True], np.abs(np.diff(utc_s)) > _SILENT_S])
    return np.asarray(utc_s[begins][np.cumsum(begins) - 1])


def read_cart_run(path: str | Path, vehicle_file: str | Path, plan: PlanFile) -> CoverRun:
    """Read a cart's log as a run of a plan, with poses smoothed forward and backward.

    Every moment with a known heading counts, because the operation of the tool was not measured.

    Args:
        path: path of the receiver's log.
        vehicle_file: path of the cart's vehicle file, with the positions of antenna and tool.
        plan: plan of the field.

    Raises:
        InputError: as ``read_cart_fixes``, or the cart's tool is not the plan's.
    """
    file = Path(path)
    vehicle = read_vehicle(vehicle_file)
    if tool_of(vehicle, vehicle_file) != plan.plan.tool:
        raise InputError(vehicle_file, "tool", f"the tool of {plan.path.name}, {plan.plan.tool}", "another tool")
    fixes = read_cart_fixes(file)
    frame = plan.plan.frame
    height_m = np.where(np.isfinite(fixes.height_m), fixes.height_m, frame.height_m)
    east, north, _ = frame.to_local(fixes.latitude_deg, fixes.longitude_deg, height_m)
    lever = (vehicle.navigation.gnss_x_m or 0.0, vehicle.navigation.gnss_y_m or 0.0)
    utc_ns, rows = _moments(fixes.utc_ns, east, north, fixes.sigma_m, fixes.quality, lever)
    digest = file_hash(file)
    return CoverRun(
        name=file.name,
        utc_ns=utc_ns,
        rows=rows,
        events=(),
        provenance={
            "run": str(uuid5(NAMESPACE_URL, digest)),
            "folder": file.name,
            "complete": True,
            "segments": [{"file": file.name, "sha256": digest}],
            "poses": "from GNSS only, smoothed forward and backward",
            "tool": NOT_MEASURED,
            "notes": list(fixes.notes),
        },
        plan_sha256=plan.sha256,
        folder=file.parent,
    )


def smooth_cart_run(run: CoverRun) -> CoverRun:
    """A recorded run of a hand cart with its positions read again from the receiver's bytes and smoothed.

    Args:
        run: run from ``read_cover_run``.

    Raises:
        InputError: the recording, or its vehicle file, cannot be used.
    """
    clock, known = read_run(run.folder).clock, run.without_plan
    assert clock is not None  # as the run could be read
    assert known is not None
    places: dict[int, LocalPosition] = {}
    lever = (0.0, 0.0)
    for header, ticks in starts_of_run(run.folder):
        config = read_config(run.folder / "config.toml")
        config = config.model_copy(update={"file": Path(header["config"])})
        path, digest = config.path(config.vehicle), known.vehicle["sha256"]
        if file_hash(path) != digest:
            raise InputError(path, "file", f"the file used in the run, {digest[:12]}...", "a changed file")
        at = read_vehicle(path).navigation
        lever = (at.gnss_x_m or 0.0, at.gnss_y_m or 0.0)
        senses = GnssSenses(known.frame, config.sensors)
        for tick in ticks:
            for record in tick.came:
                if record.source is Source.GNSS and record.kind is RecordKind.PORT_IN:
                    senses.take(record)
            place = senses.end_tick().place
            if place is not None:
                places[place.time_ns] = place
    if not places:
        return run
    times_ns = np.array(sorted(places))
    found = [places[int(at)] for at in times_ns]
    east, north, sigma = np.array([(each.x_m, each.y_m, each.reported_m) for each in found]).T
    quality = np.array([int(each.quality) for each in found])
    utc_ns, rows = _moments(times_ns + clock[0] - clock[1], east, north, sigma, quality, lever)
    provenance = {**run.provenance, "poses": "from GNSS only, smoothed forward and backward"}
    return run._replace(utc_ns=utc_ns, rows=rows, provenance=provenance)


def _moments(
    utc_ns: Int[np.ndarray, " fix"],
    east_m: Float[np.ndarray, " fix"],
    north_m: Float[np.ndarray, " fix"],
    sigma_m: Float[np.ndarray, " fix"],
    quality: Int[np.ndarray, " fix"],
    lever: tuple[float, float],
) -> tuple[Int[np.ndarray, " moment"], np.ndarray]:
    """Times and ``COVER`` rows of ``smoothed_parts``."""
    parts = list(smoothed_parts(utc_ns, east_m, north_m, sigma_m, quality, lever))
    return np.concatenate([part.utc_ns for part in parts]), np.concatenate([_rows(part) for part in parts])


class SmoothedPart(NamedTuple):
    """Poses of a part of a log at even times, padded to a piece of fixed length.

    Attributes:
        utc_ns: end of each tick on the clock of the fixes, ns.
        quality: quality of the newest position.
        smoothed: poses of the reference point.
    """

    utc_ns: Int[np.ndarray, " tick"]
    quality: Int[np.ndarray, " tick"]
    smoothed: SmoothedCart

    @property
    def ticks(self) -> int:
        """Number of ticks without the padding."""
        return len(self.utc_ns)


def smoothed_parts(
    utc_ns: Int[np.ndarray, " fix"],
    east_m: Float[np.ndarray, " fix"],
    north_m: Float[np.ndarray, " fix"],
    sigma_m: Float[np.ndarray, " fix"],
    quality: Int[np.ndarray, " fix"],
    lever: tuple[float, float],
) -> Iterator[SmoothedPart]:
    """Positions of an antenna smoothed forward and backward, in parts between long gaps.

    Args:
        utc_ns: times of the positions, rising, on any clock, ns.
        east_m, north_m: positions.
        sigma_m: standard deviation per axis.
        quality: see ``Quality``.
        lever: position of the antenna in the body, forward and left, metres.
    """
    model = cart_model(gnss_x_m=lever[0], gnss_y_m=lever[1])
    smooth = jax.jit(lambda piece: smooth_cart(model, cart_rules(), _STEP_S, piece))
    for part in _parts(utc_ns):
        ticks = _ticks(utc_ns, east_m, north_m, sigma_m, quality, part)
        yield SmoothedPart(ticks.utc_ns, ticks.quality, jax.tree.map(np.asarray, smooth(ticks.observed)))


class _Ticks(NamedTuple):
    """Ticks of a part: end times, quality of the newest position, and observations, padded to a piece."""

    utc_ns: Int[np.ndarray, " tick"]
    quality: Int[np.ndarray, " tick"]
    observed: GnssObservation


def _parts(utc_ns: Int[np.ndarray, " fix"]) -> Iterator[slice]:
    """Fixes without a long silence between them, and no longer than a piece."""
    begin = 0
    for each in range(1, len(utc_ns) + 1):
        ends = each == len(utc_ns) or utc_ns[each] - utc_ns[each - 1] > 1e9 * _SILENT_S
        if ends or utc_ns[each] - utc_ns[begin] >= 1e9 * _STEP_S * (_PIECE - 2):
            yield slice(begin, each)
            begin = each


def _ticks(
    times_ns: np.ndarray,
    east_m: np.ndarray,
    north_m: np.ndarray,
    sigma_m: np.ndarray,
    qualities: np.ndarray,
    part: slice,
) -> _Ticks:
    step_ns = round(1e9 * _STEP_S)
    utc_ns = times_ns[part]
    tick = -((utc_ns[0] - utc_ns) // step_ns)
    count = int(tick[-1]) + 1
    ends_ns = utc_ns[0] + step_ns * np.arange(count)
    values = np.full((_PIECE, 4), np.nan, np.float32)
    # Of several in one tick the newest stays.
    age_s = 1e-9 * (ends_ns[tick] - utc_ns)
    values[tick] = np.stack([east_m[part], north_m[part], sigma_m[part] ** 2, age_s], axis=1)
    x, y, variance, age = (jnp.asarray(each) for each in values.T)
    covariance = variance[:, None, None] * jnp.eye(2, dtype=jnp.float32)[None]
    observed = GnssObservation(x, y, covariance, age, jnp.isfinite(x))
    newest = np.maximum.accumulate(np.where(np.isfinite(values[:count, 0]), np.arange(count), 0))
    quality = np.zeros(count, np.int64)
    quality[tick] = qualities[part]
    present = np.arange(count) - newest < round(1.5 / _STEP_S)
    return _Ticks(ends_ns, np.where(present, quality[newest], 0), observed)


def _rows(part: SmoothedPart) -> np.ndarray:
    """``COVER`` rows."""
    found, count = part.smoothed, part.ticks
    pose, known = found.pose[:count], found.known[:count]
    rows = np.zeros(count, COVER)
    for column, name in enumerate(("x_m", "y_m", "yaw_rad")):
        rows[name] = pose[:, column]
    rows["covariance"] = found.covariance[:count]
    speed = np.zeros(count)
    speed[1:] = np.hypot(*np.diff(pose[:, :2], axis=0).T) / _STEP_S
    rows["speed_mps"] = np.where(known & np.roll(known, 1), speed, np.nan)
    for name in ("left_mps", "right_mps", "depth_m"):
        rows[name] = np.nan
    rows["tool"], rows["mode"], rows["line"] = np.where(known, ToolBits.COUNTS, 0), Mode.MANUAL, -1
    rows["gnss_quality"] = part.quality
    return rows


def _clock(message: bytes) -> tuple[float, int | None] | None:
    """Time of day, s, and number of the day since 1970, of a message that has its own; NAV-PVT may lack the date."""
    try:
        if message[3:6] in (b"RMC", b"ZDA") and message[:1] == b"$":
            read: Any = NMEAReader.parse(message)
            date = read.date if message[3:6] == b"RMC" else datetime(read.year, read.month, read.day, tzinfo=UTC)
            time = read.time
            day_s = 3600.0 * time.hour + 60.0 * time.minute + time.second + time.microsecond * 1e-6
        elif message[:4] == b"\xb5\x62\x01\x07":
            read = UBXReader.parse(message)
            if not read.validTime:
                return None
            day_s = 3600.0 * read.hour + 60.0 * read.min + read.second + read.nano * 1e-9
            if not read.validDate:
                return day_s, None
            date = datetime(read.year, read.month, read.day, tzinfo=UTC)
        else:
            return None
        return day_s, (datetime(date.year, date.month, date.day, tzinfo=UTC) - _EPOCH).days
    # The libraries raise any error of their conversions; a message that they cannot read is ignored.
    except Exception:
        return None
