"""The log of a receiver on a hand cart as a run of a field: bytes in, smoothed moments out."""

from collections.abc import Iterator
from datetime import UTC, datetime, timedelta
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
from lgprjax.batch.vehicles import tool_of
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import read_run, read_vehicle
from lgprjax.navigation import GnssObservation, SmoothedCart, cart_model, cart_rules, smooth_cart
from lgprjax.run_records import COVER, RecordKind, Source, ToolBits
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.senses import GnssSenses, LocalPosition
from lgprjax.runtime.gnss import Accuracy, GnssParser, GnssPosition, Quality, read_gnss
from lgprjax.runtime.replay import starts_of_run
from lgprjax.worked.plans import PlanFile
from lgprjax.worked.record import NOT_MEASURED, CoverRun

_STEP_S = 0.1
_PIECE = 16_384
"""Ticks that are smoothed at once, some 27 minutes: one compiled size serves every log."""
_SILENT_S = 30.0
"""A longer silence parts a log: the cart's heading is known anew after it, and no ticks are made for it."""
_FIXED_SIGMA_M = 0.02
_DAY_S = 86_400.0


class _Heard(NamedTuple):
    """A position with the newest date before it, and whether its own message has one."""

    clock: datetime | None
    dated: bool
    position: GnssPosition
    sigma_m: float


class CartFixes(NamedTuple):
    """Positions of an antenna, in the order of their times, which rise.

    Attributes:
        utc_ns: of measurement.
        latitude_deg, longitude_deg, height_m: WGS-84.
        sigma_m: an axis.
        quality: as ``Quality``.
    """

    utc_ns: Int[np.ndarray, " fix"]
    latitude_deg: Float[np.ndarray, " fix"]
    longitude_deg: Float[np.ndarray, " fix"]
    height_m: Float[np.ndarray, " fix"]
    sigma_m: Float[np.ndarray, " fix"]
    quality: Int[np.ndarray, " fix"]


def read_cart_fixes(path: str | Path) -> CartFixes:
    """Positions of a receiver's log: NMEA (GGA, GST, and RMC or ZDA for the date) or UBX (NAV-PVT).

    A fixed position without a stated accuracy has 2 cm, any other one without is left out.

    Raises:
        InputError: unreadable, no position, or no date.
    """
    file = Path(path)
    try:
        data = file.read_bytes()
    except OSError as error:
        raise InputError(file, "file", "a GNSS receiver log", str(error.strerror or error)) from None
    heard: list[_Heard] = []
    clock: datetime | None = None
    told: Accuracy | None = None
    for message in GnssParser().feed(data):
        if not isinstance(message, bytes):
            continue
        clock = _clock(message) or clock
        sample = read_gnss(message)
        if sample is None:
            continue
        if sample.accuracy is not None:
            told = sample.accuracy
            if heard and heard[-1].position.tow_s == told.tow_s:
                heard[-1] = heard[-1]._replace(sigma_m=told.sigma_m)
        position = sample.position
        if position is not None and position.quality is not Quality.NONE:
            sigma_m = position.sigma_m
            # Some receivers send the accuracy of a position before it.
            if not np.isfinite(sigma_m) and told is not None and told.tow_s == position.tow_s:
                sigma_m = told.sigma_m
            heard.append(_Heard(clock, message[:1] == b"\xb5", position, sigma_m))
    if heard and clock is None:
        raise InputError(file, "date", "RMC or ZDA sentences, or NAV-PVT, to date the positions", "none")
    # Positions before the first date are of the same day, or of the evening before.
    first = next((each.clock for each in heard if each.clock is not None), clock)
    found = [(_utc_s(each, first), each.position, each.sigma_m) for each in heard if first is not None]
    kept, last_s = [], -np.inf
    for utc_s, position, stated in found:
        fixed = position.quality is Quality.FIXED
        sigma_m = stated if np.isfinite(stated) else _FIXED_SIGMA_M if fixed else np.nan
        if utc_s > last_s and np.isfinite(sigma_m):
            last_s = utc_s
            place = (position.latitude_deg, position.longitude_deg, position.height_m)
            kept.append((utc_s, *place, max(sigma_m, 0.001), int(position.quality)))
    if not kept:
        raise InputError(file, "positions", "GGA sentences or NAV-PVT with a position", "none")
    utc, latitude, longitude, height, sigma, quality = np.array(kept, np.float64).T
    return CartFixes(np.rint(utc * 1e9).astype(np.int64), latitude, longitude, height, sigma, quality.astype(np.int64))


def read_cart_run(path: str | Path, vehicle_file: str | Path, plan: PlanFile) -> CoverRun:
    """A cart's log as a run by a plan, smoothed from both ends.

    Every moment of which the heading is known counts: nobody measured whether the tool worked.

    Args:
        path: of the receiver's log.
        vehicle_file: of the cart: where its antenna and its tool are.
        plan: of the field.

    Raises:
        InputError: as ``read_cart_fixes``, or the cart's tool is not the plan's.
    """
    file = Path(path)
    vehicle = read_vehicle(vehicle_file)
    if tool_of(vehicle, vehicle_file) != plan.plan.tool:
        raise InputError(vehicle_file, "tool", f"the tool of {plan.path.name}, {plan.plan.tool}", "another tool")
    fixes = read_cart_fixes(file)
    east, north, _ = plan.plan.frame.to_local(fixes.latitude_deg, fixes.longitude_deg, fixes.height_m)
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
        },
        plan_sha256=plan.sha256,
        folder=file.parent,
    )


def smooth_cart_run(run: CoverRun) -> CoverRun:
    """A recorded run of a hand cart with its positions smoothed from both ends, once more from the receiver's bytes.

    Args:
        run: from ``read_cover_run``.

    Raises:
        InputError: the recording, or the vehicle file that it was made with, cannot be used.
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
    """Poses of a part of a log at even times, padded to a piece.

    Attributes:
        utc_ns: end of each tick, by the clock of the fixes.
        quality: of the newest position.
        smoothed: poses of the reference point.
    """

    utc_ns: Int[np.ndarray, " tick"]
    quality: Int[np.ndarray, " tick"]
    smoothed: SmoothedCart

    @property
    def ticks(self) -> int:
        """Ticks without the padding."""
        return len(self.utc_ns)


def smoothed_parts(
    utc_ns: Int[np.ndarray, " fix"],
    east_m: Float[np.ndarray, " fix"],
    north_m: Float[np.ndarray, " fix"],
    sigma_m: Float[np.ndarray, " fix"],
    quality: Int[np.ndarray, " fix"],
    lever: tuple[float, float],
) -> Iterator[SmoothedPart]:
    """Positions of an antenna smoothed from both ends, in parts between long silences.

    Args:
        utc_ns: of the positions, rising, by any clock; quality: see ``Quality``.
        east_m, north_m: positions; sigma_m: of an axis.
        lever: forward and left place of the antenna in the body, metres.
    """
    model = cart_model(gnss_x_m=lever[0], gnss_y_m=lever[1])
    smooth = jax.jit(lambda piece: smooth_cart(model, cart_rules(), _STEP_S, piece))
    for part in _parts(utc_ns):
        ticks = _ticks(utc_ns, east_m, north_m, sigma_m, quality, part)
        yield SmoothedPart(ticks.utc_ns, ticks.quality, jax.tree.map(np.asarray, smooth(ticks.observed)))


class _Ticks(NamedTuple):
    """Of a part: when each ends, quality of the newest position, and what is heard in it, padded to a piece."""

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


def _clock(message: bytes) -> datetime | None:
    """Date and time of a message that has both."""
    try:
        if message[3:6] in (b"RMC", b"ZDA") and message[:1] == b"$":
            read: Any = NMEAReader.parse(message)
            date = read.date if message[3:6] == b"RMC" else datetime(read.year, read.month, read.day, tzinfo=UTC)
            return datetime(
                date.year, date.month, date.day, read.time.hour, read.time.minute, read.time.second, tzinfo=UTC
            )
        if message[:4] == b"\xb5\x62\x01\x07":
            told: Any = UBXReader.parse(message)
            if told.validDate and told.validTime:
                whole = datetime(told.year, told.month, told.day, told.hour, told.min, min(told.second, 59), tzinfo=UTC)
                return whole + timedelta(seconds=told.nano * 1e-9)
    # The libraries raise any error of their conversions; a message that they cannot read is ignored.
    except Exception:
        return None
    return None


def _utc_s(heard: _Heard, first: datetime) -> float:
    """NAV-PVT is its own clock; a sentence has the time of day alone."""
    clock = heard.clock or first
    return clock.timestamp() if heard.dated else _near_s(clock, heard.position.tow_s)


def _near_s(clock: datetime, day_s: float) -> float:
    """The time of day nearest to a clock."""
    midnight = clock.replace(hour=0, minute=0, second=0, microsecond=0).timestamp()
    return midnight + day_s + _DAY_S * round((clock.timestamp() - midnight - day_s) / _DAY_S)
