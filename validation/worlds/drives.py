"""Drive logs of a world: the map's passes and the days' live drives, with what their sensors say of the motion."""

from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from jaxtyping import Float
from pyproj import Transformer

from lgprjax.formats import DriveDescription, DriveWriter, NavigationTrack, OdometryTrack, TraceRecording
from lgprjax.radar import ArrayGeometry
from validation.worlds.course import Centreline, Motion, antenna_offsets, centreline_of, drive_along, wander
from validation.worlds.days import Recording, record, weather_of
from validation.worlds.ground import Ground, make_ground, weave_m
from validation.worlds.parameters import World

DAYS = ("clear", "clear_beside", "snow", "rain", "gps_jump", "gps_jump_chords", "impostor", "lookalike")
JUMP_M, JUMP_LENGTH_M = 1.5, 8.0
_JUMP_BIAS_M = 0.3
_NAVIGATION_HZ, _TRUTH_HZ, _ODOMETER_HZ = 10.0, 100.0, 50.0
_COUNT_M = 0.005
_LABEL_HEADING_DEG = 0.1
_PASS_ENDS_M = 1.0
_LIVE_ENDS_M = 1.5
_LIVE_DATE = 20  # of the month: after all passes


class Errors(NamedTuple):
    """What navigation says too much, on the motion's clock: east, north, heading."""

    east_m: Float[np.ndarray, " time"]
    north_m: Float[np.ndarray, " time"]
    yaw: Float[np.ndarray, " time"]


class Drive(NamedTuple):
    """A drive that was written.

    Attributes:
        path: the log.
        motion: true.
        label_error_m: east and north error of the place that navigation gives the array's centre, at every scan.
        recording: as stored, without its traces.
    """

    path: Path
    motion: Motion
    label_error_m: Float[np.ndarray, "scan 2"]
    recording: Recording


def days_of(world: World) -> tuple[str, ...]:
    """The days that a world has: all, and a look-alike where its row tells of one."""
    return DAYS if world.lookalike_m else DAYS[:-1]


def ground_of(world: World, line: Centreline, day: str) -> Ground:
    """The ground that a day's drive passes over: the world's own, another of the same kind, or a periodic one."""
    if day == "lookalike":
        return make_ground(world, line, 2, world.lookalike_m, world.lookalike_memory)
    return make_ground(world, line, 1 if day == "impostor" else 0)


def write_passes(world: World, ground: Ground, folder: Path) -> list[Drive]:
    """The drives that the map is made of, side by side, on clear days of their own."""
    line = centreline_of(world)
    offsets = world.pass_spacing_m * (np.arange(world.passes) - 0.5 * (world.passes - 1))
    drives = []
    for number, left_m in enumerate(offsets):
        rng = np.random.default_rng([world.seed, 4, number])
        ends = (-_PASS_ENDS_M, world.route_m + _PASS_ENDS_M)
        motion = drive_along(world, line, rng, left_m, 0.4 * weave_m(world), *ends)
        recording = record(world, ground, motion, weather_of(world, "clear"), rng)
        errors = _label_errors(world, motion, rng)
        sigmas = (world.label_sigma_m, _LABEL_HEADING_DEG)
        odometer = _odometer(motion, 1.0)
        name = f"pass{number:02d}"
        drives.append(_written(world, motion, recording, errors, sigmas, odometer, folder, name, number))
    return drives


def write_live(world: World, ground: Ground, day: str, folder: Path) -> Drive:
    """The live drive of a day, each with its own bounce, noise and errors; an impostor's poses are the clear day's.

    ``clear_beside`` goes as far to the other side of the route's middle as all others go to theirs.
    """
    line = centreline_of(world)
    place = np.random.default_rng([world.seed, 5])
    # Between the map's lines, in the middle third of what is mapped.
    lines = max(round(world.half_width_m / (3.0 * world.pass_spacing_m)), 0) if world.channels < 6 else 0
    nearest = (place.integers(-lines, lines + 1) + place.uniform(0.3, 0.7)) * world.pitch_m
    left_m = nearest if world.channels < 6 else place.uniform(-0.4, 0.4) * world.pass_spacing_m
    left_m = -left_m if day == "clear_beside" else left_m
    own = DAYS.index("clear" if day == "impostor" else day)
    rng = np.random.default_rng([world.seed, 6, own])
    motion = drive_along(world, line, rng, left_m, weave_m(world), _LIVE_ENDS_M, world.route_m - _LIVE_ENDS_M)
    recording = record(world, ground, motion, weather_of(world, day), rng)
    errors = _live_errors(world, motion, day, rng)
    jumps = day.startswith("gps_jump")
    sigma_m = (_JUMP_BIAS_M if jumps else world.gnss_sigma_m) if world.gnss_stated else None
    odometer = _odometer(motion, 1.0 + world.odometer_scale)
    if day == "gps_jump_chords":
        odometer = _chords(motion, errors)
    sigmas = (sigma_m, world.heading_deg)
    return _written(world, motion, recording, errors, sigmas, odometer, folder, day, _LIVE_DATE + own)


def _label_errors(world: World, motion: Motion, rng: np.random.Generator) -> Errors:
    """Slow, as a survey's are: alike over some ten metres."""
    steps = _clock_steps(motion, 10.0)
    east, north, yaw = (wander(rng, len(motion.time_s), steps) for _ in range(3))
    return Errors(world.label_sigma_m * east, world.label_sigma_m * north, np.radians(_LABEL_HEADING_DEG) * yaw)


def _live_errors(world: World, motion: Motion, day: str, rng: np.random.Generator) -> Errors:
    """A bias, a slow wander and a few millimetres of noise; on days of jumps a small bias, and a stretch far off."""
    bias = np.array([world.gnss_east_m, world.gnss_north_m])
    jump = np.zeros(len(motion.time_s))
    if day.startswith("gps_jump"):
        bias *= min(1.0, _JUMP_BIAS_M / max(float(np.hypot(*bias)), 1e-9))
        middle = 0.5 * world.route_m
        jump = np.where(np.abs(motion.at_m - middle) < 0.5 * JUMP_LENGTH_M, JUMP_M, 0.0)
    steps = _clock_steps(motion, 15.0)
    off = [
        bias[axis] + world.gnss_wander_m * wander(rng, len(jump), steps) + 0.005 * rng.standard_normal(len(jump)) + jump
        for axis in range(2)
    ]
    return Errors(off[0], off[1], np.radians(world.heading_deg) * wander(rng, len(jump), steps))


def _clock_steps(motion: Motion, metres: float) -> float:
    return metres / float(motion.at_m[-1] - motion.at_m[0]) * len(motion.time_s)


def _odometer(motion: Motion, scale: float) -> OdometryTrack:
    """Wheel pulses: travel in whole counts."""
    time_s = np.arange(0.0, motion.time_s[-1], 1.0 / _ODOMETER_HZ)
    travel = np.interp(time_s, motion.time_s, motion.travel_m)
    return OdometryTrack(time_s, np.floor(travel * scale / _COUNT_M) * _COUNT_M)


def _chords(motion: Motion, errors: Errors) -> OdometryTrack:
    """Travel of a vehicle without an odometer: the length of the line through its GNSS positions."""
    time_s = np.arange(0.0, motion.time_s[-1], 1.0 / _NAVIGATION_HZ)
    east = np.interp(time_s, motion.time_s, motion.east_m + errors.east_m)
    north = np.interp(time_s, motion.time_s, motion.north_m + errors.north_m)
    return OdometryTrack(time_s, np.concatenate([[0.0], np.cumsum(np.hypot(np.diff(east), np.diff(north)))]))


def _written(
    world: World,
    motion: Motion,
    recording: Recording,
    errors: Errors,
    sigmas: tuple[float | None, float],
    odometer: OdometryTrack,
    folder: Path,
    name: str,
    number: int,
) -> Drive:
    """Write a log: what GNSS/INS and the odometer say, the truth, and the traces."""
    x, y, delay = antenna_offsets(world)
    steady = np.random.default_rng([world.seed, 7, number])
    said = motion._replace(
        east_m=motion.east_m + errors.east_m,
        north_m=motion.north_m + errors.north_m,
        yaw=motion.yaw + errors.yaw,
        roll=motion.roll + np.radians(0.2) * wander(steady, len(motion.roll), 100.0),
    )
    navigation = _track(world, said, _NAVIGATION_HZ)
    size = len(navigation.time_s)
    position_m, heading_deg = sigmas
    stated = None if position_m is None else np.full(size, position_m)
    navigation = replace(
        navigation,
        sigma_east_m=stated,
        sigma_north_m=stated,
        sigma_height_m=np.full(size, 0.05),
        sigma_heading_deg=np.full(size, heading_deg),
        sigma_roll_deg=np.full(size, 0.2),
    )
    description = DriveDescription(
        name=name,
        t0_utc=f"2024-05-{1 + number:02d}T08:00:00Z",
        array=ArrayGeometry(x, y, delay, world.height_m),
        recording=TraceRecording(
            sample_interval_ns=world.sample_interval_ns,
            time_zero_ns=recording.time_zero_ns,
            zero_level=recording.zero_level,
            centre_frequency_hz=world.centre_mhz * 1e6,
            samples=world.samples,
        ),
        navigation=navigation,
        odometry=odometer,
        truth=_track(world, motion, _TRUTH_HZ),
        vehicle=None,
        provenance={"program": "validation/worlds", "world": world.number, "drive": name},
    )
    path = folder / f"{name}.drive.h5"
    kind = np.dtype(world.encoding)
    with DriveWriter.create(path, description, channels=world.channels, dtype=kind, force=True) as log:
        log.append(motion.scan_time_s, recording.traces)
    return Drive(path, motion, _at_array(world, motion, errors), recording._replace(traces=np.zeros(0)))


def _at_array(world: World, motion: Motion, errors: Errors) -> Float[np.ndarray, "scan 2"]:
    """Error of the place that navigation gives the array's centre: an error of heading swings it."""
    x, turned = world.antenna_x_m, motion.yaw + errors.yaw
    east = errors.east_m + x * (np.cos(turned) - np.cos(motion.yaw))
    north = errors.north_m + x * (np.sin(turned) - np.sin(motion.yaw))
    return np.stack([np.interp(motion.scan_time_s, motion.time_s, error) for error in (east, north)], axis=-1)


def _track(world: World, motion: Motion, rate_hz: float) -> NavigationTrack:
    """Poses at a rate, as latitude and longitude about the world's anchor.

    Over a route's length meridians converge by a thousandth of a degree at most, which is not told apart here.
    """
    time_s = np.arange(0.0, motion.time_s[-1], 1.0 / rate_hz)
    east, north, yaw, roll = (
        np.interp(time_s, motion.time_s, value) for value in (motion.east_m, motion.north_m, motion.yaw, motion.roll)
    )
    place = np.random.default_rng([world.seed, 8])
    latitude, longitude = place.uniform(-55.0, 62.0), place.uniform(-170.0, 170.0)
    frame = Transformer.from_pipeline(
        "+proj=pipeline +step +inv +proj=topocentric +ellps=WGS84 "
        f"+lon_0={longitude!r} +lat_0={latitude!r} +h_0=50.0 "
        "+step +inv +proj=cart +ellps=WGS84 +step +proj=unitconvert +xy_in=rad +xy_out=deg"
    )
    lon, lat, height = frame.transform(east, north, np.zeros_like(east))
    heading = np.mod(90.0 - np.degrees(yaw), 360.0)
    return NavigationTrack(time_s, np.asarray(lat), np.asarray(lon), np.asarray(height), heading, np.degrees(roll))
