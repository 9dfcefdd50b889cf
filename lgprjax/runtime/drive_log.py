"""A run as a drive log.

Poses of a run on a map are those fused during it; of a run that only recorded they are smoothed from its messages.
"""

import json
import math
from collections.abc import Iterator
from pathlib import Path
from typing import Any, NamedTuple, TypeAlias

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.batch import options_as_provenance
from lgprjax.errors import InputError
from lgprjax.formats import MapFile, NavigationTrack, OdometryTrack, VehicleFile, read_vehicle
from lgprjax.formats.plausible import plausible_positions, reach_in_time_m
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
from lgprjax.recordings.recover import RecordedTracks, RunDrive, write_run_drive
from lgprjax.recordings.vehicles import filter_model_of
from lgprjax.run_records import Record, RecordKind, Source
from lgprjax.runtime.cart import smoothed_parts
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.senses import LocalAttitude, LocalPosition, Senses
from lgprjax.runtime.control.setup import TICK_S
from lgprjax.runtime.gnss import is_position, read_gnss
from lgprjax.vehicle import VehiclePose

_SIGMA_HEIGHT, _SIGMA_ROLL_DEG = 2.0, 0.2
"""Standard deviations of heights, in sigmas of positions, and of roll, which no message states."""
_UNSURE_RAD = math.radians(5.0)
"""A heading of which the receiver states a larger sigma is not used."""
_MOVING_MPS = 0.1
_HEADING_NS = 300_000_000
"""Largest gap between headings that are interpolated at a position between them, ns."""
_PIECE, _AHEAD = 8_192, 2_048
"""Ticks smoothed at once, and following ticks used as well: 164 s and 41 s."""
_EVERY = 5
"""Ticks per pose, which gives ten poses per second."""
_SIDE_NOISE = 0.5
"""Random walk across the body axis, m/√s, of a vehicle whose steering is not known yet."""
_LONGEST_STEP_S = 0.5
"""A longer pause or silence of the gyro parts a drive: its turn is not known."""


Column: TypeAlias = Any
"""Numbers of ticks: of NumPy on the host, traced in the compiled smoother."""


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
    calibration: Path | None = None,
    force: bool = False,
) -> RunDrive:
    """Write a run as a drive log.

    Args:
        reading: reading of the run.
        config: configuration of the run.
        output: path of ``X.drive.h5``.
        map_file, vehicle_file: present paths, if the files have moved.
        calibration: calibration of the radar, in place of that of the configuration.
        force: whether to replace an existing output.

    Raises:
        InputError: as ``write_run_drive``; or a file of the run cannot be used.
    """
    if vehicle_file is None and config.vehicle:
        vehicle_file = config.path(config.vehicle)
    vehicle = None if vehicle_file is None else read_vehicle(vehicle_file)
    sigma_m = config.sensors.gnss_sigma_m
    if calibration is None and config.radar.calibration is not None:
        calibration = config.path(config.radar.calibration)
    if not config.map:
        measured = config.mode == "calibrate"
        return write_run_drive(
            reading,
            output,
            source=measured_tracks(reading, config, vehicle) if measured else recorded_tracks(reading, config, vehicle),
            vehicle=vehicle,
            position_sigma_m=sigma_m,
            calibration=calibration,
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
            calibration=calibration,
            registration=options_as_provenance(options_of(config)),
            force=force,
        )


def recorded_tracks(reading: RunReading, config: RuntimeConfig, vehicle: VehicleFile | None) -> RecordedTracks:
    """Poses of the body origin ten times per second, and the travel along them.

    With a gyro and headings of the receiver, positions, headings, turn rates and odometry go through the navigation
    filter of the vehicle and its smoother (``navigation.step_filter``, ``smooth_estimates``). Without them the
    positions alone are smoothed, as for a cart (``navigation.smooth_cart``).

    Args:
        reading: reading of the run.
        config: configuration of the run.
        vehicle: vehicle with the position of the antenna; ``None``: the antenna is the body origin.

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
    origin += f"; {sensed.left_out}" if sensed.left_out else ""
    if vehicle is None:
        origin += "; no vehicle file: body origin and array at the antenna"
    tracks, radar = _tracks(sensed, poses, reading.clock[1], origin), config.radar
    frequency_hz = None if radar.centre_frequency_mhz is None else 1e6 * radar.centre_frequency_mhz
    return tracks._replace(
        channel_pitch_m=radar.channel_pitch_m, centre_frequency_hz=frequency_hz, frame=_frame_of_plan(reading)
    )


def measured_tracks(reading: RunReading, config: RuntimeConfig, vehicle: VehicleFile | None) -> RecordedTracks:
    """Poses of the body origin at the receiver's own positions, not smoothed, with the stated errors.

    Fits of a calibration weigh measurements by their errors, and errors of smoothed poses are correlated.

    Args:
        reading: reading of the run.
        config: configuration of the run.
        vehicle: vehicle with the position of the antenna.

    Raises:
        InputError: the run has no clock, or fewer than two positions with a heading.
    """
    if reading.clock is None:
        raise InputError(reading.folder, "segments", "a complete segment header, or run.json", "neither")
    sensed = _Sensed.of(reading, config)
    table = None if vehicle is None else vehicle.navigation
    sensors, lever = config.sensors, (0.0, 0.0) if table is None else (table.gnss_x_m or 0.0, table.gnss_y_m or 0.0)
    placed_ns = np.array([place.time_ns for place in sensed.places], np.int64)
    turned_ns = np.array([each.time_ns for each in sensed.attitudes], np.int64)
    yaw, near = np.zeros(len(placed_ns)), np.zeros(len(placed_ns), bool)
    if len(turned_ns) > 1:
        yaw = np.interp(placed_ns, turned_ns, np.unwrap([each.yaw_rad for each in sensed.attitudes]))
        after = np.clip(np.searchsorted(turned_ns, placed_ns), 1, len(turned_ns) - 1)
        near = (
            (np.diff(turned_ns)[after - 1] < _HEADING_NS) & (placed_ns >= turned_ns[0]) & (placed_ns <= turned_ns[-1])
        )
    if near.sum() < 2:
        expected = "two positions or more with headings of the receiver"
        raise InputError(reading.folder, "GNSS messages", expected, f"{near.sum()} of {len(placed_ns)}")
    x, y, sigma = (
        np.array([value for value, kept in zip(values, near, strict=True) if kept])
        for values in zip(*((place.x_m, place.y_m, place.reported_m) for place in sensed.places), strict=True)
    )
    x, y = body_to_local(x, y, yaw[near], -lever[0], -lever[1])
    sigma_yaw = math.radians(math.hypot(sensors.heading_sigma_deg, sensors.heading_slow_deg))
    poses = _Poses(placed_ns[near], x, y, yaw[near], sigma, np.full(len(x), sigma_yaw))
    return _tracks(sensed, poses, reading.clock[1], "positions and headings of the receiver, not smoothed")


class _Ticks(NamedTuple):
    """Inputs of the filter over ticks. Flags are 0 or 1; the yaw rate is NaN while the gyro is silent."""

    step_s: Column
    yaw_rate_radps: Column
    fix: Column
    x_m: Column
    y_m: Column
    fix_m2: Column
    fix_age_s: Column
    heading: Column
    yaw_rad: Column
    yaw_rad2: Column
    yaw_age_s: Column
    odometer: Column
    speed_mps: Column
    speed_m2ps2: Column

    def part(self, chosen: slice) -> "_Ticks":
        """Some of the ticks."""
        return _Ticks(*(values[chosen] for values in self))


class _Sensed(NamedTuple):
    """Data of the lines: positions and attitudes, both with rising times, and the inputs of each tick.

    Attributes:
        frame: frame anchored at the first plausible position.
        left_out: description of the positions left out.
        places, attitudes: positions and attitudes of the receiver.
        tick_ns: start time of each tick, ns.
        ticks: inputs of each tick.
    """

    frame: LocalFrame
    left_out: str
    places: list[LocalPosition]
    attitudes: list[LocalAttitude]
    tick_ns: Int[np.ndarray, " tick"]
    ticks: _Ticks

    @classmethod
    def of(cls, reading: RunReading, config: RuntimeConfig) -> "_Sensed":
        (frame, implausible, left_out), sensors = _frame_of(reading), config.sensors
        senses = Senses(frame, sensors)
        places: list[LocalPosition] = []
        attitudes: list[LocalAttitude] = []
        times: list[int] = []
        rows: list[tuple[float, ...]] = []
        white_rad2 = math.radians(sensors.heading_sigma_deg) ** 2
        least_rad2 = math.radians(sensors.heading_slow_deg) ** 2

        def end_tick(now_ns: int) -> None:
            tick = senses.end_tick(now_ns)
            place, turned, mps = tick.place, tick.attitude, tick.odometer_mps
            fix, heading = (0.0, 0.0, 0.0, 1.0, 0.0), (0.0, 0.0, 1.0, 0.0)
            if place is not None and (not places or place.time_ns > places[-1].time_ns):
                places.append(place)
                fix = (1.0, place.x_m, place.y_m, place.reported_m**2, (now_ns - place.time_ns) / 1e9)
            if turned is not None and not turned.sigma_yaw_rad > _UNSURE_RAD:
                attitudes.append(turned)
                stated = turned.sigma_yaw_rad if math.isfinite(turned.sigma_yaw_rad) else 0.0
                # A slow error is the same in every message: as in the vehicle's own filter it counts as white noise of
                # the same weight over its correlation time.
                slow_rad2 = 2.0 * sensors.heading_slow_s / TICK_S * max(least_rad2, stated**2 - white_rad2)
                heading = (1.0, turned.yaw_rad, white_rad2 + slow_rad2, (now_ns - turned.time_ns) / 1e9)
            known = math.isfinite(mps)
            odometer = (1.0, mps, sensors.odometer_sigma_mps**2) if known else (0.0, 0.0, 1.0)
            times.append(now_ns)
            rows.append((tick.step_s, tick.yaw_rate_radps, *fix, *heading, *odometer))

        begun_ns: int | None = None
        for number, record in enumerate(_records(reading)):
            if number in implausible:
                continue
            if record.kind is RecordKind.PORT_IN and record.source in (Source.GNSS, Source.DRIVE_BY_WIRE):
                senses.take(record)
            elif record.kind is RecordKind.TICK:
                # The messages of a tick follow it in the recording.
                if begun_ns is not None:
                    end_tick(begun_ns)
                begun_ns = record.mono_ns
        if begun_ns is not None:
            end_tick(begun_ns)
        if len(places) < 2:
            raise InputError(reading.folder, "GNSS messages", "at least two positions", str(len(places)))
        ticks = _Ticks(*np.array(rows, np.float64).T)
        return cls(frame, left_out, places, attitudes, np.array(times, np.int64), ticks)


def _records(reading: RunReading) -> Iterator[Record]:
    for _, data in reading:
        record = read_run_record(data)
        if record is not None:
            yield record


def _frame_of_plan(reading: RunReading) -> LocalFrame | None:
    """The frame that the run was driven in; ``None`` of one that only recorded."""
    for record in _records(reading):
        if record.kind is RecordKind.HEADER and record.source is Source.CONTROL:
            anchor = json.loads(record.payload).get("frame")
            return None if anchor is None else LocalFrame(*anchor)
    return None


def _frame_of(reading: RunReading) -> tuple[LocalFrame, set[int], str]:
    """Frame at the first plausible position, numbers of the records with implausible ones, and their description.

    Raises:
        InputError: there is no plausible position.
    """
    found: list[tuple[int, float, float, float, float]] = []
    for number, record in enumerate(_records(reading)):
        if (record.kind, record.source) == (RecordKind.PORT_IN, Source.GNSS) and is_position(record.payload):
            sample = read_gnss(record.payload)
            position = None if sample is None else sample.position
            if position is not None and math.isfinite(position.height_m):
                place = (position.latitude_deg, position.longitude_deg, position.height_m)
                found.append((number, 1e-9 * record.mono_ns, *place))
    numbers, time_s, latitude, longitude, height = np.array(found).reshape(-1, 5).T
    judged = plausible_positions(latitude, longitude, reach_in_time_m(time_s))
    if not judged.kept.any():
        raise InputError(reading.folder, "GNSS messages", "at least two positions", judged.in_words() or "none")
    first = int(np.argmax(judged.kept))
    frame = LocalFrame(float(latitude[first]), float(longitude[first]), float(height[first]))
    return frame, {int(each) for each in numbers[~judged.kept]}, judged.in_words()


def _by_filter(sensed: _Sensed, vehicle: VehicleFile | None, lever: tuple[float, float]) -> _Poses | None:
    """Smoothed by the vehicle's filter, stretch by stretch; ``None`` where the receiver has no gyro or no headings."""
    model = _model_of(vehicle, lever)
    stretches = [(sensed.ticks.part(part), sensed.tick_ns[part]) for part in _stretches(sensed.ticks)]
    found = [_filtered(ticks, tick_ns, model, lever) for ticks, tick_ns in stretches]
    parts = [poses for poses in found if poses is not None]
    return _Poses(*(np.concatenate(values) for values in zip(*parts, strict=True))) if parts else None


def _stretches(ticks: _Ticks) -> Iterator[slice]:
    """Stretches of ticks between pauses of the control process and gaps of the gyro, in which the turn is unknown."""
    silent = ~np.isfinite(ticks.yaw_rate_radps)
    begins = np.flatnonzero(np.diff(silent, prepend=not silent[0]))
    dropped = np.zeros(len(silent), bool)
    for begin, end in zip(begins, [*begins[1:], len(silent)], strict=True):
        if silent[begin] and ticks.step_s[begin:end].sum() > _LONGEST_STEP_S:
            dropped[begin:end] = True
    breaks = dropped | (ticks.step_s > _LONGEST_STEP_S)
    edges = np.flatnonzero(breaks)
    for begin, end in zip([0, *edges + dropped[edges]], [*edges, len(silent)], strict=True):
        if end - begin > 1:
            yield slice(int(begin), int(end))


def _filtered(
    ticks: _Ticks, tick_ns: Int[np.ndarray, " tick"], model: FilterModel, lever: tuple[float, float]
) -> _Poses | None:
    """A stretch from the first position and heading on; ``None`` without them."""
    fixes, turns, rated = (np.flatnonzero(of) for of in (ticks.fix, ticks.heading, np.isfinite(ticks.yaw_rate_radps)))
    if not (len(fixes) and len(turns) and len(rated)):
        return None
    first = int(max(fixes[0], turns[0]))
    at_fix, at_turn = (int(each[each <= first][-1]) for each in (fixes, turns))
    yaw = ticks.yaw_rad[at_turn]
    at, turned = np.array([ticks.x_m[at_fix], ticks.y_m[at_fix]]), np.array([yaw])
    # From the antenna back to the body origin.
    x, y = body_to_local(at[:1], at[1:], turned, -lever[0], -lever[1])
    start = VehiclePose(*(jnp.float32(float(value)) for value in (x[0], y[0], yaw)))
    # A slow gyro is silent in some ticks.
    rate = np.interp(np.arange(len(tick_ns)), rated, ticks.yaw_rate_radps[rated])
    # The first tick of a stretch may end a pause.
    step_s = np.minimum(ticks.step_s, _LONGEST_STEP_S)
    used, times = ticks._replace(step_s=step_s, yaw_rate_radps=rate).part(slice(first, None)), tick_ns[first:]
    state = init_filter(model, start, jnp.float32(0.0))
    parts: list[_Poses] = []
    for begin in range(0, len(times), _PIECE):
        part = used.part(slice(begin, begin + _PIECE + _AHEAD))
        # Ticks of no length, in which nothing is observed, change nothing.
        missing = _PIECE + _AHEAD - len(part.step_s)
        padded = _Ticks(*(jnp.asarray(np.pad(values, (0, missing)), jnp.float32) for values in part))
        smoothed, state = _smoothed(model, state, padded)
        kept = min(_PIECE, len(times) - begin)
        mean, variance = (np.asarray(values, np.float64)[:kept:_EVERY] for values in smoothed)
        sigma = np.sqrt(0.5 * (variance[:, 0] + variance[:, 1]))
        columns = (times[begin : begin + kept : _EVERY], *mean[:, :3].T, sigma, np.sqrt(variance[:, 2]))
        parts.append(_Poses(*columns))
    return _Poses(*(np.concatenate(values) for values in zip(*parts, strict=True)))


def _model_of(vehicle: VehicleFile | None, lever: tuple[float, float]) -> FilterModel:
    """The vehicle's filter, as far as the file describes it."""
    if vehicle is not None and vehicle.steering_kind == "counter_steer":
        lengths = (vehicle.chassis.wheelbase_m, vehicle.array.x_m)
        if None not in lengths and (vehicle.rear_map or vehicle.steering.rear_ratio is not None):
            return filter_model_of(vehicle)
    model = default_model(zero_slip_m=0.0, gnss_x_m=lever[0], gnss_y_m=lever[1], array_x_m=0.0, array_y_m=0.0)
    return model._replace(side_noise=jnp.float32(_SIDE_NOISE))


@jax.jit
def _smoothed(
    model: FilterModel, state: FilterState, ticks: _Ticks
) -> tuple[tuple[Float[Array, "tick state"], Float[Array, "tick state"]], FilterState]:
    """Means and variances of a piece and what comes after it, and the filter's state after the piece."""
    motions = MotionInput(ticks.yaw_rate_radps, ticks.step_s)
    count = len(ticks.step_s)
    empty = jax.tree.map(lambda leaf: jnp.broadcast_to(leaf, (count, *leaf.shape)), no_observations())
    white_m2 = ticks.fix_m2[:, None, None] * jnp.eye(2, dtype=jnp.float32)[None]
    observations = empty._replace(
        gnss=GnssObservation(ticks.x_m, ticks.y_m, white_m2, ticks.fix_age_s, ticks.fix > 0.5),
        heading=HeadingObservation(ticks.yaw_rad, ticks.yaw_rad2, ticks.yaw_age_s, ticks.heading > 0.5),
        odometer=OdometerObservation(ticks.speed_mps, ticks.speed_m2ps2, ticks.odometer > 0.5),
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
    """Poses from the positions alone."""
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
