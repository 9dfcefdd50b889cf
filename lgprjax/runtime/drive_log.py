"""A run as a drive log.

Poses of a run on a map are those fused during it; of a run that only recorded they are smoothed from its messages.
"""

import math
from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.batch import options_as_provenance
from lgprjax.batch.recover import RecordedTracks, RunDrive, write_run_drive
from lgprjax.batch.vehicles import filter_model_of
from lgprjax.errors import InputError
from lgprjax.formats import MapFile, NavigationTrack, OdometryTrack, VehicleFile, read_vehicle
from lgprjax.formats.run_log import RunReading, read_run_record
from lgprjax.frames import LocalFrame, body_to_local
from lgprjax.navigation import (
    FilterModel,
    FilterState,
    GnssObservation,
    HeadingObservation,
    MotionInput,
    Observations,
    OdometerObservation,
    default_model,
    default_rules,
    init_filter,
    no_observations,
    smooth_estimates,
    step_filter,
)
from lgprjax.run_records import Record, RecordKind, Source
from lgprjax.runtime.cart import smoothed_parts
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.senses import GnssSenses, LocalAttitude, LocalPosition, Senses
from lgprjax.vehicle import VehiclePose

_SIGMA_HEIGHT, _SIGMA_ROLL_DEG = 2.0, 0.2
"""Of heights in sigmas of positions, and of roll: no message states them."""
_UNSURE_RAD = math.radians(5.0)
"""A heading whose receiver states more is none."""
_MOVING_MPS = 0.1
_PIECE, _AHEAD = 8_192, 2_048
"""Ticks that are smoothed at once, and those after them that are looked at as well: 164 s and 41 s."""
_EVERY = 5
"""Of the ticks, one in so many becomes a pose: ten a second."""
_GYRO_SHARE = 0.95
_SIDE_NOISE = 0.1
"""Random walk across the body axis, m/√s, of a vehicle whose steering is not known yet."""
_LONGEST_STEP_S = 0.5


class _Poses(NamedTuple):
    """Poses of the body origin with their times by the monotonic clock; angles in radians."""

    time_ns: Int[np.ndarray, " pose"]
    x_m: Float[np.ndarray, " pose"]
    y_m: Float[np.ndarray, " pose"]
    yaw_rad: Float[np.ndarray, " pose"]
    sigma_m: Float[np.ndarray, " pose"]
    sigma_yaw_rad: Float[np.ndarray, " pose"]


def drive_of_run(
    reading: RunReading,
    config: RuntimeConfig,
    output: Path,
    *,
    map_file: Path | None = None,
    vehicle_file: Path | None = None,
    force: bool = False,
) -> RunDrive:
    """Write a run as a drive log.

    Args:
        reading: of the run.
        config: of the run.
        output: ``X.drive.h5``.
        map_file, vehicle_file: where they have moved.
        force: replace an output that exists.

    Raises:
        InputError: as ``write_run_drive``; or a file of the run cannot be used.
    """
    if vehicle_file is None and config.vehicle:
        vehicle_file = config.path(config.vehicle)
    vehicle = None if vehicle_file is None else read_vehicle(vehicle_file)
    sigma_m = config.sensors.gnss_sigma_m
    if config.mode == "record":
        return write_run_drive(
            reading,
            output,
            source=recorded_tracks(reading, config, vehicle),
            vehicle=vehicle,
            position_sigma_m=sigma_m,
            force=force,
        )
    from lgprjax.runtime.registration.search import options_of  # only these runs need the search, which takes seconds

    with MapFile.open(map_file or config.path(config.map)) as source:
        return write_run_drive(
            reading,
            output,
            source=source,
            vehicle=vehicle,
            position_sigma_m=sigma_m,
            registration=options_as_provenance(options_of(config)),
            force=force,
        )


def recorded_tracks(reading: RunReading, config: RuntimeConfig, vehicle: VehicleFile | None) -> RecordedTracks:
    """Poses of the body origin ten times per second, and the travel along them.

    With a gyro and headings of the receiver, positions, headings, turn rates and odometry go through the navigation
    filter of the vehicle and its smoother (``navigation.filter_drive``, ``smooth_estimates``). Without them the
    positions alone are smoothed from both ends, as of a cart (``navigation.smooth_cart``).

    Args:
        reading: of the run.
        config: of the run.
        vehicle: for the place of the antenna; ``None``: the antenna is the body origin.

    Raises:
        InputError: the run has no clock, fewer than two positions, or too little motion to know a heading.
    """
    if reading.clock is None:
        raise InputError(reading.folder, "segments", "a complete segment header, or run.json", "neither")
    sensed = _Sensed.of(reading, config)
    table = None if vehicle is None else vehicle.navigation
    lever = (0.0, 0.0) if table is None else (table.gnss_x_m or 0.0, table.gnss_y_m or 0.0)
    origin = "GNSS/INS and odometry, filtered and smoothed backward"
    poses = _by_filter(sensed, vehicle, lever)
    if poses is None:
        poses = _by_positions(sensed, lever)
        origin = "positions of the receiver smoothed from both ends, headings from them"
    if len(poses.time_ns) < 2:
        expected = "headings and turn rates, or some metres driven straight, from which the heading follows"
        raise InputError(reading.folder, "GNSS messages", expected, f"{len(sensed.places)} positions without heading")
    origin += "; height of the antenna; sigma of height and roll assumed"
    if vehicle is None:
        origin += "; no vehicle file: body origin and array at the antenna"
    tracks, radar = _tracks(sensed, poses, reading.clock[1], origin), config.radar
    frequency_hz = None if radar.centre_frequency_mhz is None else 1e6 * radar.centre_frequency_mhz
    return tracks._replace(channel_pitch_m=radar.channel_pitch_m, centre_frequency_hz=frequency_hz)


class _Sensed(NamedTuple):
    """What the lines said: positions and attitudes, and the inputs of the filter in each tick of the run.

    Attributes:
        frame: anchored at the first position.
        places: rising times; attitudes: likewise.
        tick_ns: of each tick.
        numbers: of each tick: length, yaw rate, then value, variance, age and validity of position (two values),
            heading and odometer.
    """

    frame: LocalFrame
    places: list[LocalPosition]
    attitudes: list[LocalAttitude]
    tick_ns: Int[np.ndarray, " tick"]
    numbers: Float[np.ndarray, "tick 14"]

    @classmethod
    def of(cls, reading: RunReading, config: RuntimeConfig) -> "_Sensed":
        frame = _frame_of(reading, config)
        senses = Senses(frame, config.sensors)
        places: list[LocalPosition] = []
        attitudes: list[LocalAttitude] = []
        times, rows = [], []
        heading_rad2 = math.radians(config.sensors.heading_sigma_deg) ** 2
        odometer_m2ps2 = config.sensors.odometer_sigma_mps**2
        for record in _records(reading):
            if record.kind is RecordKind.PORT_IN and record.source in (Source.GNSS, Source.DRIVE_BY_WIRE):
                senses.take(record)
            elif record.kind is RecordKind.TICK:
                tick, now_ns = senses.end_tick(record.mono_ns), record.mono_ns
                place, turned, mps = tick.place, tick.attitude, tick.odometer_mps
                fix, heading = (0.0, 0.0, 1.0, 0.0, 0.0), (0.0, 1.0, 0.0, 0.0)
                if place is not None and (not places or place.time_ns > places[-1].time_ns):
                    places.append(place)
                    fix = (place.x_m, place.y_m, place.reported_m**2, (now_ns - place.time_ns) / 1e9, 1.0)
                if turned is not None and not turned.sigma_yaw_rad > _UNSURE_RAD:
                    attitudes.append(turned)
                    heading = (turned.yaw_rad, heading_rad2, (now_ns - turned.time_ns) / 1e9, 1.0)
                odometer = (mps, odometer_m2ps2, 1.0) if math.isfinite(mps) else (0.0, 1.0, 0.0)
                times.append(now_ns)
                rows.append((tick.step_s, tick.yaw_rate_radps, *fix, *heading, *odometer))
        if len(places) < 2:
            raise InputError(reading.folder, "GNSS messages", "at least two positions", str(len(places)))
        return cls(frame, places, attitudes, np.array(times, np.int64), np.array(rows, np.float64))


def _records(reading: RunReading) -> Iterator[Record]:
    for _, data in reading:
        record = read_run_record(data)
        if record is not None:
            yield record


def _frame_of(reading: RunReading, config: RuntimeConfig) -> LocalFrame:
    """A frame at the first position.

    Raises:
        InputError: there is none.
    """
    senses = GnssSenses(None, config.sensors)
    for record in _records(reading):
        if (record.kind, record.source) == (RecordKind.PORT_IN, Source.GNSS):
            senses.take(record)
            if senses.frame is not None:
                return senses.frame
    raise InputError(reading.folder, "GNSS messages", "at least two positions", "none")


def _by_filter(sensed: _Sensed, vehicle: VehicleFile | None, lever: tuple[float, float]) -> _Poses | None:
    """Smoothed by the vehicle's filter; ``None`` where the receiver has no gyro or no headings."""
    numbers = sensed.numbers
    known = np.flatnonzero((numbers[:, _AT_FIX] > 0.5) & (numbers[:, _AT_HEADING] > 0.5))
    first = int(known[0]) if len(known) else len(numbers)
    used, times = numbers[first:].copy(), sensed.tick_ns[first:]
    gyro = np.isfinite(used[:, 1])
    if not len(used) or np.mean(gyro) < _GYRO_SHARE:
        return None
    used[:, 1] = np.interp(np.arange(len(used)), np.flatnonzero(gyro), used[gyro, 1])
    # Across a pause of the control process the filter would run on; it is short, or the drive ends there.
    used[:, 0] = np.minimum(used[:, 0], _LONGEST_STEP_S)
    model = _model_of(vehicle, lever)
    x, y = body_to_local(used[:1, 2], used[:1, 3], used[:1, 7], -lever[0], -lever[1])
    pose = VehiclePose(*(jnp.float32(float(value)) for value in (x[0], y[0], used[0, 7])))
    state = init_filter(model, pose, jnp.float32(0.0))
    parts: list[_Poses] = []
    for begin in range(0, len(used), _PIECE):
        part = used[begin : begin + _PIECE + _AHEAD].astype(np.float32)
        # Ticks of no length, in which nothing is observed, change nothing.
        padded = np.zeros((_PIECE + _AHEAD, part.shape[1]), np.float32)
        padded[: len(part)] = part
        smoothed, state = _smoothed(model, state, jnp.asarray(padded))
        kept = min(_PIECE, len(part))
        mean, variance = (np.asarray(values, np.float64)[:kept:_EVERY] for values in smoothed)
        sigma = np.sqrt(0.5 * (variance[:, 0] + variance[:, 1]))
        columns = (times[begin : begin + kept : _EVERY], *mean[:, :3].T, sigma, np.sqrt(variance[:, 2]))
        parts.append(_Poses(*columns))
    return _Poses(*(np.concatenate(values) for values in zip(*parts, strict=True)))


_AT_FIX, _AT_HEADING = 6, 10
"""Columns of ``_Sensed.numbers`` that say whether there is one."""


def _model_of(vehicle: VehicleFile | None, lever: tuple[float, float]) -> FilterModel:
    """The vehicle's filter, as far as the file describes it."""
    known = vehicle is not None and vehicle.chassis.wheelbase_m is not None and vehicle.steering_kind == "counter_steer"
    if vehicle is not None and known and (vehicle.rear_map or vehicle.steering.rear_ratio is not None):
        return filter_model_of(vehicle)
    model = default_model(zero_slip_m=0.0, gnss_x_m=lever[0], gnss_y_m=lever[1], array_x_m=0.0, array_y_m=0.0)
    return model._replace(side_noise=jnp.float32(_SIDE_NOISE))


@jax.jit
def _smoothed(
    model: FilterModel, state: FilterState, numbers: Float[Array, "tick 14"]
) -> tuple[tuple[Float[Array, "tick state"], Float[Array, "tick state"]], FilterState]:
    """Means and variances of a piece and what comes after it, and the filter's state after the piece."""
    step, rate, x, y, variance, age, fixed, yaw, yaw2, yaw_age, turned, mps, mps2, rolled = numbers.T
    motions = MotionInput(rate, step)
    empty = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (len(step), *leaf.shape)), no_observations())
    eye = jnp.eye(2, dtype=jnp.float32)[None]
    observations = empty._replace(
        gnss=GnssObservation(x, y, variance[:, None, None] * eye, age, fixed > 0.5),
        heading=HeadingObservation(yaw, yaw2, yaw_age, turned > 0.5),
        odometer=OdometerObservation(mps, mps2, rolled > 0.5),
    )

    def forward(
        state: FilterState, tick: tuple[MotionInput, Observations]
    ) -> tuple[FilterState, tuple[FilterState, Bool[Array, ""]]]:
        after, info = step_filter(model, default_rules(), state, *tick)
        return after, (after, jnp.any(info.reacquired))

    states, restarted = jax.lax.scan(forward, state, (motions, observations))[1]
    found = smooth_estimates(model, states.estimate, motions, restarted)
    variances = jnp.diagonal(found.covariance, axis1=-2, axis2=-1)
    return (found.mean, variances), jax.tree.map(lambda leaf: leaf[_PIECE - 1], states)


def _by_positions(sensed: _Sensed, lever: tuple[float, float]) -> _Poses:
    """From the positions alone."""
    places = sensed.places
    time_ns = np.array([place.time_ns for place in places], np.int64)
    x, y, sigma = (np.array(values) for values in zip(*((p.x_m, p.y_m, p.reported_m) for p in places), strict=True))
    quality = np.array([int(place.quality) for place in places])
    parts: list[_Poses] = []
    for part in smoothed_parts(time_ns, x, y, sigma, quality, lever):
        known, pose = part.smoothed.known[: part.ticks], part.smoothed.pose[: part.ticks]
        covariance = part.smoothed.covariance[: part.ticks]
        own = np.sqrt(0.5 * (covariance[:, 0, 0] + covariance[:, 1, 1]))
        columns = (part.utc_ns, *pose.T, own, np.sqrt(covariance[:, 2, 2]))
        parts.append(_Poses(*(np.asarray(values)[known] for values in columns)))
    return _Poses(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _tracks(sensed: _Sensed, poses: _Poses, mono_ns: int, origin: str) -> RecordedTracks:
    time_s = 1e-9 * (poses.time_ns - mono_ns).astype(np.float64)
    x, y, yaw = (np.asarray(values, np.float64) for values in (poses.x_m, poses.y_m, poses.yaw_rad))
    placed_s = 1e-9 * (np.array([place.time_ns for place in sensed.places], np.int64) - mono_ns)
    up = np.interp(time_s, placed_s, [place.up_m for place in sensed.places])
    roll = np.zeros(len(time_s))
    if sensed.attitudes:
        turned_s = 1e-9 * (np.array([each.time_ns for each in sensed.attitudes], np.int64) - mono_ns)
        roll = np.interp(time_s, turned_s, [each.roll_rad for each in sensed.attitudes])
    latitude, longitude, height = sensed.frame.to_geodetic(x, y, up)
    sigma_m = np.asarray(poses.sigma_m, np.float64)
    navigation = NavigationTrack(
        time_s=time_s,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        heading_deg=sensed.frame.heading_of_yaw(yaw, longitude),
        roll_deg=np.degrees(roll),
        sigma_east_m=sigma_m,
        sigma_north_m=sigma_m,
        sigma_height_m=_SIGMA_HEIGHT * sigma_m,
        sigma_heading_deg=np.degrees(np.asarray(poses.sigma_yaw_rad, np.float64)),
        sigma_roll_deg=np.full(len(time_s), _SIGMA_ROLL_DEG),
    )
    # Signed by the heading: travel falls in reverse. Noise at standstill is no travel.
    ahead = np.cos(yaw) * np.diff(x, prepend=x[0]) + np.sin(yaw) * np.diff(y, prepend=y[0])
    moves = np.abs(ahead) > _MOVING_MPS * np.diff(time_s, prepend=time_s[0])
    return RecordedTracks(navigation, OdometryTrack(time_s, np.cumsum(np.where(moves, ahead, 0.0))), origin)
