"""Simulated drives of one vehicle as drive logs without radar, from a drives file; with fixes where requested."""

from collections.abc import Callable, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pandas as pd
from jaxtyping import Float

from lgprjax import __version__
from lgprjax.autopilot.modes import Mode
from lgprjax.errors import InputError
from lgprjax.formats import (
    DriveDescription,
    DriveWriter,
    NavigationTrack,
    OdometryTrack,
    TraceRecording,
    VehicleLog,
    read_vehicle,
    write_fixes,
    write_vehicle_log,
)
from lgprjax.frames import LocalFrame
from lgprjax.radar import uniform_array
from lgprjax.recordings.vehicles import array_of_vehicle
from lgprjax.scene.day import WEATHER
from lgprjax.scene.drive import default_array
from lgprjax.scene.ground import GroundConfig, make_ground
from lgprjax.scene.live_radar import LiveRadar, draw_springs
from lgprjax.scene.motion import DrivePlan
from lgprjax.scene.road import RoadConfig, make_road
from lgprjax.scene.vehicle_drive import (
    DriveTruth,
    VehicleDrive,
    VehicleFixes,
    draw_vehicle_fixes,
    read_yaw_rate,
    simulate_vehicle_drive,
)
from lgprjax.simulation.sites import derive_seed
from lgprjax.simulation.vehicle_plans import DrivenCourse, PlannedVehicleDrive, VehiclePlan
from lgprjax.tuning.tracking import beside_path
from lgprjax.vehicle.path import SPACING_M


def _plan_of(course: DrivenCourse, truth: DriveTruth, frame: LocalFrame) -> dict[str, np.ndarray]:
    """The plan of a drive along a course, ten times per second, by its true places."""
    every = slice(None, None, 10)
    time_s, east, north, yaw = (part[every] for part in (truth.time_s, truth.east_m, truth.north_m, truth.yaw_rad))
    beside = beside_path(
        course.path,
        time_s=time_s,
        x_m=east,
        y_m=north,
        yaw_rad=yaw,
        sigma_m=np.zeros(len(time_s)),
        anchor_m=course.anchor_m,
        speed_mps=truth.speed_mps[every],
        answer_radpm=np.zeros(len(time_s)),
        engaged=course.mode[every] == int(Mode.SPEED),
    )
    offset = np.full(len(time_s), np.nan)
    offset[np.searchsorted(time_s, beside.time_s)] = np.where(beside.engaged, beside.offset_m, np.nan)
    latitude, longitude, _ = frame.to_geodetic(east, north, np.zeros_like(east))
    return {
        "time_s": time_s,
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "heading_deg": frame.heading_of_yaw(yaw, longitude),
        "speed_mps": truth.speed_mps[every],
        "wanted_mps": course.wanted_mps[every],
        "cross_track_m": offset,
    }


# Fixes for a simulated vehicle's log: files like those of registration, drawn from an error model of fixes.

# Stretches without fixes in the error model: the ground is poor there.
_NO_FIX = "low_correlation"


def fixes_paths(folder: Path, name: str) -> tuple[Path, Path]:
    """The CSV and the HDF5 file of a drive's fixes."""
    return folder / f"{name}.fixes.csv", folder / f"{name}.fixes.h5"


def write_vehicle_fixes(
    folder: Path,
    name: str,
    fixes: VehicleFixes,
    frame: LocalFrame,
    *,
    t0_utc: str,
    provenance: dict[str, object],
    force: bool = False,
) -> None:
    """Write the fixes of a drive; all channels of the array are over the map.

    Args:
        folder, name: folder and name of the drive's log.
        fixes: fixes from ``draw_vehicle_fixes``.
        frame: frame of the drive, which is used as the map's frame.
        t0_utc: start time of the log, UTC.
        provenance: provenance added to the program's.
        force: whether to replace existing files.

    Raises:
        InputError: an output exists (without ``force``) or cannot be written.
    """
    east, north, height, yaw, roll = fixes.pose.T
    latitude, longitude, height = frame.to_geodetic(east, north, height)
    scans = fixes.time_s.size

    def where_found(value: float) -> np.ndarray:
        return np.where(fixes.found, value, np.nan)

    columns = {
        "scan": np.arange(scans),
        "time_s": fixes.time_s,
        "latitude_deg": latitude,
        "longitude_deg": longitude,
        "height_m": height,
        "heading_deg": frame.heading_of_yaw(yaw, longitude),
        "roll_deg": np.degrees(roll),
        "sigma_along_m": where_found(fixes.sigma_m[0]),
        "sigma_cross_m": where_found(fixes.sigma_m[1]),
        "correlation": where_found(fixes.strength),
        "margin": np.full(scans, np.nan),
        "overlap_channels": np.where(fixes.found, default_array().x_m.size, 0),
        "code": np.where(fixes.found, "ok", _NO_FIX),
        "p_false": np.where(fixes.found, fixes.p_false, 1.0),
    }
    attributes = {
        "name": name,
        "map": "none: fixes from an error model",
        "t0_utc": t0_utc,
        "anchor_latitude_deg": frame.latitude_deg,
        "anchor_longitude_deg": frame.longitude_deg,
        "anchor_height_m": frame.height_m,
        "provenance": {"program": f"lgprjax {__version__}", "synthetic": True, **provenance},
    }
    write_fixes(
        *fixes_paths(folder, name),
        pd.DataFrame(columns),
        attributes=attributes,
        pose_m=fixes.pose,
        covariance=fixes.covariance.astype(np.float32),
        force=force,
    )


_T0_UTC = "2026-01-01T00:00:00+00:00"
# A level site and no roll: calibrations use neither.
_SIGMA_HEIGHT_M, _SIGMA_ROLL_DEG = 0.05, 0.1
_TRUTH_EVERY = 10

_SIGNALS = {
    "steering_command_rad": "command_rad",
    "wheel_angle_rad": "front_rad",
    "rear_wheel_angle_rad": "rear_rad",
    "steering_potentiometer_v": "potentiometer_v",
    "encoder_counts": "encoder_counts",
    "supply_v": "supply_v",
    "throttle": "throttle",
    "brake": "brake",
}


def vehicle_log_of(
    name: str,
    drive: VehicleDrive,
    frame: LocalFrame,
    *,
    yaw_rate_radps: Float[np.ndarray, " record"] | None = None,
    serial_number: str | None = None,
    provenance: dict[str, object] | None = None,
) -> VehicleLog:
    """Log of a simulated drive, including its truth.

    The navigation has a record wherever there is a position; the heading of the records between is left out, because
    positions and headings share one clock in a log.

    Args:
        name: name of the drive.
        drive: drive from ``simulate_vehicle_drive``.
        frame: local frame at the start of the drive.
        yaw_rate_radps: yaw rate by gyro at the records; ``None`` for a vehicle without a gyro.
        serial_number: serial number of the vehicle.
        provenance: provenance added to the program's.
    """
    signals, truth = drive.signals, drive.truth
    fixed = np.isfinite(signals.east_m) & np.isfinite(signals.north_m) & np.isfinite(signals.yaw_rad)
    poses = (signals.time_s, signals.east_m, signals.north_m, signals.yaw_rad)
    navigation = _track(frame, *(values[fixed] for values in poses))
    sigma_m, none = signals.sigma_position_m[fixed], np.zeros(int(fixed.sum()))
    navigation = replace(
        navigation,
        sigma_east_m=sigma_m,
        sigma_north_m=sigma_m,
        sigma_height_m=none + _SIGMA_HEIGHT_M,
        sigma_heading_deg=np.degrees(signals.sigma_yaw_rad[fixed]),
        sigma_roll_deg=none + _SIGMA_ROLL_DEG,
    )
    every = slice(None, None, _TRUTH_EVERY)
    true_track = _track(frame, *(values[every] for values in truth[:4]))
    held = {logged: getattr(signals, own) for logged, own in _SIGNALS.items() if getattr(signals, own) is not None}
    if yaw_rate_radps is not None:
        held["yaw_rate_radps"] = yaw_rate_radps
    return VehicleLog(
        name=name,
        t0_utc=_T0_UTC,
        navigation=navigation,
        odometry=OdometryTrack(signals.time_s, signals.travel_m),
        truth=true_track,
        vehicle={"time_s": signals.time_s, **held},
        serial_number=serial_number,
        provenance={"program": f"lgprjax {__version__}", "synthetic": True, **(provenance or {})},
    )


def write_vehicle_logs(
    plan: VehiclePlan,
    folder: Path,
    *,
    only: Sequence[str] = (),
    force: bool = False,
    progress: Callable[[int], None] = lambda _: None,
) -> dict[str, Path]:
    """Simulate the drives of a plan, write each to ``NAME.drive.h5`` in a new folder, and return the paths by name.

    Drives with fixes also have ``NAME.fixes.csv`` and ``NAME.fixes.h5`` in the folder.

    Args:
        only: names of the drives to simulate; empty: all drives.
        progress: function called with 1 for each drive written.

    Raises:
        InputError: the plan has no drive of a name; an output exists (without ``force``; checked before any work) or
            cannot be written.
    """
    drives = {drive.name: drive for drive in plan.drives}
    for name in only:
        if name not in drives:
            raise InputError(plan.file, "--only", f"drives among {', '.join(drives)}", name)
    if folder.exists() and not folder.is_dir():
        raise InputError(folder, "output", "a folder", "a file")
    paths = {name: folder / f"{name}.drive.h5" for name in drives if not only or name in only}
    fixes = [path for name in paths if drives[name].fix_errors for path in fixes_paths(folder, name)]
    for path in (*paths.values(), *fixes):
        if path.exists() and not force:
            raise InputError(path, "output", "a new file, or --force", "an existing file")
    folder.mkdir(parents=True, exist_ok=True)
    for name, path in paths.items():
        drive = drives[name]
        _write_drive(plan, drive, path, force)
        progress(1)
    return paths


def _write_drive(plan: VehiclePlan, drive: PlannedVehicleDrive, path: Path, force: bool) -> None:
    simulated = simulate_vehicle_drive(plan.vehicle, drive.manoeuvre, drive.sensors, drive.seed)
    frame = plan.frame
    if drive.course is not None and drive.radar is not None:
        # A drive begins at the origin of its own metres, beside the course; over ground the course stays where it is.
        place = (part.item() for part in frame.to_geodetic(np.zeros(1), np.array([drive.course.offset_m]), np.zeros(1)))
        frame = LocalFrame(*place)
    origin = {"drives": plan.file.name, "seed": drive.seed, "true_vehicle": asdict(plan.vehicle)}
    log = vehicle_log_of(
        drive.name,
        simulated,
        frame,
        yaw_rate_radps=read_yaw_rate(simulated.truth, drive.sensors, drive.seed),
        serial_number=plan.serial_number,
        provenance=origin,
    )
    if drive.course is not None and log.vehicle is not None:
        at = np.clip(np.searchsorted(simulated.truth.time_s, simulated.signals.time_s), 0, len(drive.course.mode) - 1)
        signals = {**log.vehicle, "mode": drive.course.mode[at].astype(np.int8)}
        log = replace(log, vehicle=signals, plan=_plan_of(drive.course, simulated.truth, frame))
    if drive.course is not None and drive.radar is not None:
        _write_scans(plan, drive, simulated.truth, log, path, force)
        return
    write_vehicle_log(path, log, force=force)
    if drive.fix_errors is None:
        return
    fixes = draw_vehicle_fixes(
        simulated.truth,
        drive.fix_errors,
        array_x_m=plan.vehicle.array_x_m,
        rate_hz=drive.sensors.fix_hz,
        seed=drive.seed,
    )
    origin["fixes"] = f"drawn from the error model of a {drive.fixes} day, without ground or radar"
    write_vehicle_fixes(path.parent, drive.name, fixes, plan.frame, t0_utc=_T0_UTC, provenance=origin, force=force)


# Radar scans of a drive along a course: the ground lies along it.

_PITCH_M, _SCAN_HZ, _BLOCK_SCANS = 0.127, 31.5, 8
"""Spacing of the channels; every fourth scan of a radar of 126 Hz; scans rendered together, within 3 m."""
_BEYOND_M, _HALF_WIDTH_M, _GROUND_M = 20.0, 5.0, 1000.0
"""Ground beyond both ends of the course, to its sides, and in one piece: the same under a course that is longer."""
_BODY = DrivePlan(start_m=0.0, stop_m=1.0, height_sigma_m=0.015, roll_sigma_rad=float(np.radians(0.8)))
"""Motion of a vehicle on its springs, as off road."""


def _write_scans(
    plan: VehiclePlan, drive: PlannedVehicleDrive, truth: DriveTruth, log: VehicleLog, path: Path, force: bool
) -> None:
    """Write a log with scans rendered at the true poses; drives of a file share the ground where courses agree."""
    course, day = drive.course, drive.radar
    assert course is not None
    assert day is not None
    assert plan.stated is not None
    bends = tuple((SPACING_M, float(curvature)) for curvature in course.curvature_radpm)
    pieces = np.ceil((len(bends) * SPACING_M + _BEYOND_M) / _GROUND_M)
    length_m, margin_m = float(pieces) * _GROUND_M, _BEYOND_M + course.anchor_m
    road = RoadConfig(length_m=length_m, margin_m=margin_m, arcs=bends, transition_m=2.0 * SPACING_M, min_radius_m=1.0)
    array = uniform_array(11, _PITCH_M, x_m=course.anchor_m, height_m=0.3, scan_period_s=1.0 / 126.0)
    time_s = np.arange(0.0, truth.time_s[-1] - 1.0 / _SCAN_HZ, 1.0 / _SCAN_HZ)
    time_s = time_s[: len(time_s) - len(time_s) % _BLOCK_SCANS]
    radar = LiveRadar(
        make_ground(
            derive_seed(plan.seed, "ground"),
            GroundConfig(length_m=length_m, margin_m=margin_m, half_width_m=_HALF_WIDTH_M),
        ),
        WEATHER[day](derive_seed(plan.seed, "day", drive.name)),
        make_road(0, road),
        array,
        draw_springs(_BODY, drive.seed),
        scans=len(time_s),
        seed=drive.seed,
    )
    known = radar.radar
    # The log says of the array what the crew knows.
    stated = array_of_vehicle(
        read_vehicle(plan.stated), plan.stated, channels=len(array.y_m), pitch_m=_PITCH_M, scan_period_s=1.0 / 126.0
    )
    description = DriveDescription(
        name=log.name,
        t0_utc=log.t0_utc,
        array=stated,
        recording=TraceRecording(
            sample_interval_ns=known.sample_step_ns,
            time_zero_ns=known.time_zero_ns,
            zero_level=128.0,
            centre_frequency_hz=0.5e6 * (known.band_mhz[0] + known.band_mhz[1]),
            samples=known.samples,
        ),
        navigation=log.navigation,
        odometry=log.odometry,
        truth=log.truth,
        vehicle=log.vehicle,
        provenance={**log.provenance, "day": day},
        serial_number=log.serial_number,
        plan=log.plan,
    )
    # The course's start, which is beside the array when the drive begins, is the road's.
    poses = (truth.east_m - course.anchor_m, truth.north_m + course.offset_m, truth.yaw_rad)
    instants = time_s[:, None] + array.time_offset_s[None]
    place = np.stack([np.interp(instants, truth.time_s, column) for column in poses], axis=-1)
    along_m = np.interp(time_s, truth.time_s, truth.travel_m)
    with DriveWriter.create(path, description, channels=len(array.y_m), dtype=np.uint8, force=force) as writer:
        for first in range(0, len(time_s), _BLOCK_SCANS):
            span = slice(first, first + _BLOCK_SCANS)
            try:
                scans = radar.record(first, place[span], float(along_m[first]))
            except ValueError as error:
                expected = f"a drive over the ground, {_HALF_WIDTH_M:g} m to each side of its course"
                raise InputError(plan.file, f"drive {drive.name}", expected, str(error)) from None
            writer.append(time_s[span][scans.received], scans.recorded[scans.received])


def _track(
    frame: LocalFrame, time_s: np.ndarray, east_m: np.ndarray, north_m: np.ndarray, yaw_rad: np.ndarray
) -> NavigationTrack:
    """Level poses of a local frame on the globe."""
    latitude, longitude, height = frame.to_geodetic(east_m, north_m, np.zeros_like(east_m))
    heading = frame.heading_of_yaw(yaw_rad, longitude)
    return NavigationTrack(
        time_s=time_s,
        latitude_deg=latitude,
        longitude_deg=longitude,
        height_m=height,
        heading_deg=heading,
        roll_deg=np.zeros_like(east_m),
    )
