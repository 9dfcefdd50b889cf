"""Closed-loop drives for studies, from logs and recorded runs: resampled signals, smoothed poses, autopilot engaged."""

from pathlib import Path as FilePath
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from lgprjax.autopilot.modes import ENGAGED
from lgprjax.errors import InputError
from lgprjax.formats import VehicleFile, VehicleLog, require_serial_number
from lgprjax.formats.run_log import RunReading, read_run, read_run_record
from lgprjax.frames import LocalFrame
from lgprjax.navigation import (
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    MotionInput,
    Observations,
    OdometerObservation,
    default_rules,
    smooth_estimates,
)
from lgprjax.recordings.run_signals import RowGatherer, signals_of_run
from lgprjax.recordings.vehicles import filter_model_of
from lgprjax.registration import Code
from lgprjax.run_records import FIX, RecordKind
from lgprjax.tuning.loop import LANES, PADDING, STEP_S, LoopLogs
from lgprjax.tuning.navigation import NavigationDrives, filter_drives
from lgprjax.tuning.studies.logs import Task, fixes_beside, require_fixes
from lgprjax.tuning.studies.navigation import TickedDrive, stack_drives, tick_drive
from lgprjax.vehicle import Servo, VehiclePose, torque_share

TICK_S = 0.1
_ODOMETER_SIGMA_M = 0.002
_GAP_S = 0.25
_UNDER_WAY_S = 0.2
"""Longest effect of unrecorded commands, before a log or in a gap of it, s. Steering delays are shorter."""


class LoopDrive(NamedTuple):
    """Signals of a drive for the studies of the steering loop, at the times of the vehicle's records.

    Attributes:
        path: path of the drive log or run folder.
        time_s: record times, s.
        command_rad, front_rad, rear_rad: commanded angle, and measured front and rear angles; NaN where unrecorded.
        supply_v: servo supply voltage; NaN where unrecorded.
        speed_mps: speed by odometry.
        yaw_rate_radps: yaw rate by gyro; NaN without a gyro.
        engaged: whether the autopilot steered.
        commanded: whether commands reached the servo; in logs without this record, wherever a command exists.
        offset_m: lateral offset from the path as the controller used it; NaN without a path.
        ticked: input of the smoother; ``None`` without fixes.
    """

    path: FilePath
    time_s: Float[np.ndarray, " record"]
    command_rad: Float[np.ndarray, " record"]
    front_rad: Float[np.ndarray, " record"]
    rear_rad: Float[np.ndarray, " record"]
    supply_v: Float[np.ndarray, " record"]
    speed_mps: Float[np.ndarray, " record"]
    yaw_rate_radps: Float[np.ndarray, " record"]
    engaged: Bool[np.ndarray, " record"]
    commanded: Bool[np.ndarray, " record"]
    offset_m: Float[np.ndarray, " record"]
    ticked: TickedDrive | None


class SmoothedDrive(NamedTuple):
    """Poses of a drive by its fixes, smoothed forward and backward, in level metres from its first position.

    Attributes:
        time_s: tick times, s.
        x_m, y_m, yaw_rad: pose of the rear axle.
        sigma_m: standard deviation of the position across the body.
        speed_mps, yaw_rate_radps: speed and yaw rate of the body.
        fixes: number of fixes used.
    """

    time_s: Float[np.ndarray, " tick"]
    x_m: Float[np.ndarray, " tick"]
    y_m: Float[np.ndarray, " tick"]
    yaw_rad: Float[np.ndarray, " tick"]
    sigma_m: Float[np.ndarray, " tick"]
    speed_mps: Float[np.ndarray, " tick"]
    yaw_rate_radps: Float[np.ndarray, " tick"]
    fixes: int


def is_run(path: FilePath) -> bool:
    """Whether a log is the folder of a recorded run."""
    return path.is_dir()


def loop_drive(task: Task, path: FilePath, *, fixes: bool) -> LoopDrive:
    """Read a drive log or a recorded run.

    Args:
        task: task of the study.
        path: path of ``X.drive.h5``, or of the folder of a run.
        fixes: whether fixes are required; those of ``X.drive.h5`` are in ``X.fixes.h5`` in the same folder.

    Raises:
        InputError: the log cannot be read, belongs to another vehicle, or holds no vehicle signals.
    """
    if is_run(path):
        return _of_run(task.vehicle, task.study.vehicle, path)
    log = VehicleLog.open(path)
    require_serial_number(task.vehicle, task.study.vehicle, log.serial_number, path, "/vehicle@serial_number")
    if log.vehicle is None:
        raise InputError(path, "/vehicle", "vehicle signals", "none")
    ticked = None
    if fixes or fixes_beside(path).is_file():
        ticked = tick_drive(log, path, require_fixes(path), tick_s=TICK_S, odometer_sigma_m=_ODOMETER_SIGMA_M)
    return _of_log(task.vehicle, path, log, ticked)


def _of_log(vehicle: VehicleFile, path: FilePath, log: VehicleLog, ticked: TickedDrive | None) -> LoopDrive:
    assert log.vehicle is not None
    time_s = np.asarray(log.vehicle["time_s"], np.float64)
    none = np.full(len(time_s), np.nan)

    def signal(name: str) -> np.ndarray:
        return np.asarray((log.vehicle or {}).get(name, none), np.float64)

    front = signal("wheel_angle_rad")
    if vehicle.wheel_map is not None and "steering_potentiometer_v" in log.vehicle:
        held = vehicle.wheel_map
        knots = held.first_v + held.step_v * np.arange(len(held.front_rad))
        front = np.interp(signal("steering_potentiometer_v"), knots, held.front_rad, left=np.nan, right=np.nan)
    command, engaged, offset = signal("steering_command_rad"), np.zeros(len(time_s), bool), none
    commanded = np.isfinite(command)
    if "mode" in log.vehicle:
        engaged = np.isin(np.asarray(log.vehicle["mode"]), [int(mode) for mode in ENGAGED])
        commanded &= engaged
    if log.plan is not None:
        at = np.asarray(log.plan["time_s"], np.float64)
        off = np.asarray(log.plan["cross_track_m"], np.float64)
        offset = np.interp(time_s, at, off, left=np.nan, right=np.nan)
    speed = speed_of(log.odometry.time_s, log.odometry.distance_m, time_s)
    return LoopDrive(
        path=path,
        time_s=time_s,
        command_rad=command,
        front_rad=front,
        rear_rad=signal("rear_wheel_angle_rad"),
        supply_v=signal("supply_v"),
        speed_mps=speed,
        yaw_rate_radps=signal("yaw_rate_radps"),
        engaged=engaged,
        commanded=commanded,
        offset_m=offset,
        ticked=ticked,
    )


def speed_of(
    known_s: Float[np.ndarray, " known"], travel_m: Float[np.ndarray, " known"], time_s: Float[np.ndarray, " record"]
) -> Float[np.ndarray, " record"]:
    """Speed from the travelled distance over 0.4 s around each record, m/s."""
    ahead, behind = (np.clip(time_s + step, known_s[0], known_s[-1]) for step in (0.2, -0.2))
    way = np.interp(ahead, known_s, travel_m) - np.interp(behind, known_s, travel_m)
    return np.asarray(way / np.maximum(ahead - behind, 1e-3))


def _of_run(vehicle: VehicleFile, vehicle_path: FilePath, folder: FilePath) -> LoopDrive:
    """A recorded run, read from its records of box, priors, fixes and plans."""
    reading = read_run(folder)
    signals, fixes = signals_of_run(reading), _fixes_of(reading)
    for place, rows in (("prior", signals.prior), ("drive_status", signals.box), ("plan", signals.plan)):
        if len(rows) < 2:
            raise InputError(folder, "segments", f"at least two complete records of {place}", str(len(rows)))
    if not len(fixes):
        raise InputError(folder, "segments", "fixes from the registration", "none")
    zero_ns = int(signals.prior_ns[0])

    def seconds(times: np.ndarray) -> np.ndarray:
        return np.asarray(1e-9 * (times - zero_ns).astype(np.float64))

    at, plan_s = signals.box_ns, seconds(signals.plan_ns)
    time_s = seconds(at)
    held = signals.plan[np.clip(np.searchsorted(signals.plan_ns, at, side="right") - 1, 0, None)]
    engaged = np.isin(held["mode"], [int(mode) for mode in ENGAGED])
    none = np.full(len(time_s), np.nan)
    del vehicle, vehicle_path
    return LoopDrive(
        path=folder,
        time_s=time_s,
        command_rad=held["command"][:, 0].astype(np.float64),
        front_rad=held["front_rad"].astype(np.float64),
        rear_rad=none,
        supply_v=signals.box["supply_v"].astype(np.float64),
        speed_mps=speed_of(time_s, signals.travel_m, time_s),
        yaw_rate_radps=np.interp(at, signals.prior_ns, signals.prior["yaw_rate_radps"]),
        engaged=engaged,
        commanded=engaged,
        offset_m=np.interp(time_s, plan_s, signals.plan["cross_track_m"].astype(np.float64), left=np.nan, right=np.nan),
        ticked=_ticked_run(signals.prior, seconds(signals.prior_ns), time_s, signals.travel_m, fixes, zero_ns),
    )


def _fixes_of(reading: RunReading) -> np.ndarray:
    """Rows of the run's accepted fixes; records of older runs have no ``p_false`` column."""
    gathered = RowGatherer(FIX)
    for _, data in reading:
        record = read_run_record(data)
        if record is not None and record.kind is RecordKind.FIX:
            gathered.add(record.mono_ns, record.payload.ljust(FIX.itemsize, b"\0"))
    rows = gathered.rows
    good = rows["code"] == int(Code.OK)
    good &= np.isfinite(rows["covariance"]).all(axis=(1, 2)) & np.isfinite(rows["pose"]).all(axis=1)
    return np.asarray(rows[good])


def _ticked_run(
    prior: np.ndarray,
    prior_s: np.ndarray,
    box_s: np.ndarray,
    travel_m: np.ndarray,
    fixes: np.ndarray,
    zero_ns: int,
) -> TickedDrive:
    """A run on ticks: gyro, odometer, headings and fixes; its GNSS is in the priors already and is left out."""
    first, last = max(prior_s[0], box_s[0]), min(prior_s[-1], box_s[-1])
    count = max(int((last - first) / TICK_S), 1)
    edges = first + TICK_S * np.arange(count + 1)
    pose = prior["pose"].astype(np.float64)
    origin = pose[0, :2]
    yaw = np.interp(edges[1:], prior_s, np.unwrap(pose[:, 2]))
    sigma = np.interp(edges[1:], prior_s, np.maximum(prior["sigma_yaw_rad"], 1e-3))
    rate = np.interp(0.5 * (edges[1:] + edges[:-1]), prior_s, prior["yaw_rate_radps"])
    speed = np.diff(np.interp(edges, box_s, travel_m)) / TICK_S
    fix_s = 1e-9 * (fixes["scan_ns"].astype(np.int64) - zero_ns).astype(np.float64)
    tick = np.searchsorted(edges, fix_s, side="left") - 1
    inside = np.flatnonzero((tick >= 0) & (tick < count))
    values, spread = np.zeros((count, 3)), np.tile(np.eye(3), (count, 1, 1))
    age, valid = np.zeros(count), np.zeros(count, bool)
    for row in inside:
        at = tick[row]
        values[at] = fixes["pose"][row][[0, 1, 3]] - np.array([*origin, 0.0])
        spread[at] = fixes["covariance"][row][np.ix_([0, 1, 3], [0, 1, 3])]
        age[at], valid[at] = max(edges[at + 1] - fix_s[row], 0.0), True
    start = np.array([*np.array([np.interp(first, prior_s, pose[:, k]) for k in (0, 1)]) - origin, 0.0])
    start[2] = np.interp(first, prior_s, np.unwrap(pose[:, 2]))

    def single(array: np.ndarray) -> jax.Array:
        return jnp.asarray(array, jnp.float32)

    no = jnp.zeros(count, bool)
    zero, yes = jnp.zeros(count), jnp.ones(count, bool)
    observations = Observations(
        GnssObservation(zero, zero, single(np.tile(np.eye(2), (count, 1, 1))), zero, no),
        # Ten a second of a heading that wanders for seconds: each counts for a tenth.
        HeadingObservation(single(yaw), single(10.0 * sigma**2), zero, yes),
        OdometerObservation(single(speed), single(np.full(count, 2.0 * (_ODOMETER_SIGMA_M / TICK_S) ** 2)), yes),
        LgprObservation(
            single(values[:, 0]),
            single(values[:, 1]),
            single(values[:, 2]),
            single(spread),
            single(age),
            jnp.asarray(valid),
        ),
    )
    drive = NavigationDrives(
        VehiclePose(*(jnp.float32(v) for v in start)),
        jnp.float32(speed[0]),
        MotionInput(single(rate), single(np.full(count, TICK_S))),
        observations,
    )
    return TickedDrive(edges[1:], drive, np.where(valid, 0.0, np.nan), None)


def smoothed(task: Task, drive: LoopDrive) -> SmoothedDrive:
    """Poses of a drive by the Rauch-Tung-Striebel smoother over its fixes.

    Raises:
        InputError: the vehicle file lacks a number of the filter's model.
    """
    assert drive.ticked is not None
    zero = jnp.float32(0.0)
    model = filter_model_of(task.vehicle, task.study.vehicle)._replace(gnss_x_m=zero, gnss_y_m=zero)
    padded = stack_drives([drive.ticked])
    estimates, info = jax.tree.map(lambda leaf: leaf[0], filter_drives(model, default_rules(), padded))
    lane = jax.tree.map(lambda leaf: leaf[0], padded)
    back = jax.jit(smooth_estimates)(model, estimates, lane.motions, info.reacquired.any(axis=-1))
    count = len(drive.ticked.time_s)
    mean, covariance = (np.asarray(part, np.float64)[:count] for part in back)
    yaw = np.unwrap(mean[:, 2])
    side = np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
    sigma = np.sqrt(np.maximum(np.einsum("tp,tpq,tq->t", side, covariance[:, :2, :2], side), 0.0))
    rate = np.gradient(yaw, drive.ticked.time_s)
    used = int(np.asarray(info.accepted)[:count, 3].sum())
    return SmoothedDrive(
        time_s=drive.ticked.time_s,
        x_m=mean[:, 0],
        y_m=mean[:, 1],
        yaw_rad=yaw,
        sigma_m=sigma,
        speed_mps=mean[:, 3],
        yaw_rate_radps=rate,
        fixes=used,
    )


def loop_logs(drives: list[LoopDrive], servo: Servo) -> LoopLogs:
    """Drives on the steps of the loop's model, padded to one length.

    Args:
        drives: drives of one vehicle.
        servo: servo of the vehicle; its voltages give the torque at each supply voltage.
    """
    lanes = [_lane(drive, servo) for drive in drives]
    longest = max(len(lane[0]) for lane in lanes)
    steps = -(-longest // PADDING) * PADDING

    def padded(values: np.ndarray) -> np.ndarray:
        return np.pad(values, (0, steps - len(values)), mode="constant" if values.dtype == bool else "edge")

    columns = [np.stack([padded(column) for column in field]) for field in zip(*lanes, strict=True)]
    # Empty drives pad the batch; none of their steps counts.
    more = -len(lanes) % LANES
    columns = [np.concatenate([column, *[column[-1:]] * more]) for column in columns]
    for flag in columns[5:7]:
        flag[len(lanes) :] = False
    command, share, speed, front, rate = (jnp.asarray(column, jnp.float32) for column in columns[:5])
    front_used, yaw_used, placed = (jnp.asarray(flag) for flag in columns[5:])
    return LoopLogs(
        command_rad=command,
        share=share,
        speed_mps=speed,
        front_rad=front,
        yaw_rate_radps=rate,
        front_used=front_used,
        yaw_used=yaw_used,
        placed=placed,
    )


def _lane(drive: LoopDrive, servo: Servo) -> tuple[np.ndarray, ...]:
    """The fields of ``LoopLogs`` for one drive."""
    time_s = drive.time_s
    steps = max(int((time_s[-1] - time_s[0]) / STEP_S) + 1, 2)
    at_s = time_s[0] + STEP_S * np.arange(steps)
    held = np.clip(np.searchsorted(time_s, at_s + 1e-6, side="right") - 1, 0, len(time_s) - 1)
    nearest = np.clip(np.searchsorted(time_s, at_s), 1, len(time_s) - 1)
    nearest = np.where(at_s - time_s[nearest - 1] <= time_s[nearest] - at_s, nearest - 1, nearest)
    # A step has a record if one is nearer than half a step; slower logs leave steps without a record.
    own = np.abs(time_s[nearest] - at_s) <= 0.5 * STEP_S + 1e-6
    volts = np.where(np.isfinite(drive.supply_v), drive.supply_v, float(servo.nominal_v))
    share = np.asarray(torque_share(servo, jnp.asarray(volts, jnp.float32)), np.float64)
    # A command holds until the next one, unless the gap is too long.
    live = np.flatnonzero(drive.commanded & np.isfinite(drive.command_rad))
    last = np.searchsorted(time_s[live], at_s + 1e-6, side="right") - 1
    commanded = np.append(np.diff(time_s[live], append=np.inf), np.inf)[last] <= _GAP_S
    begins = commanded & ~np.append(False, commanded[:-1])
    known = np.ones(steps, bool)
    for first in np.flatnonzero(begins):
        record = live[last[first]]
        if record == 0 or time_s[record] - time_s[record - 1] > _GAP_S:
            known &= (at_s < at_s[first]) | (at_s > at_s[first] + _UNDER_WAY_S)
    moving = np.abs(drive.speed_mps) > 0.3
    usable = own & commanded & known
    return (
        np.append(drive.command_rad[live], 0.0)[last],
        np.maximum(share[held], 0.02),
        np.interp(at_s, time_s, drive.speed_mps),
        np.interp(at_s, time_s, _filled(drive.front_rad)),
        np.interp(at_s, time_s, _filled(drive.yaw_rate_radps)),
        usable & np.isfinite(drive.front_rad)[nearest],
        usable & np.isfinite(drive.yaw_rate_radps)[nearest] & moving[nearest],
        ~commanded | begins | (np.arange(steps) == 0),
    )


def _filled(values: np.ndarray) -> np.ndarray:
    known = np.isfinite(values)
    if not known.any():
        return np.zeros(len(values))
    index = np.arange(len(values))
    return np.asarray(np.interp(index, index[known], values[known]))


def local_track(log: VehicleLog, frame: LocalFrame) -> tuple[np.ndarray, np.ndarray]:
    """East and north of a log's navigation in a local frame, m."""
    track = log.navigation
    east, north, _ = frame.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
    return np.asarray(east), np.asarray(north)


def origin_of(path: FilePath) -> LocalFrame:
    """The local frame of ``tick_drive``: its origin is the log's first position within the time of all its sensors."""
    log = VehicleLog.open(path)
    track = log.navigation
    clocks = (track.time_s, log.odometry.time_s, (log.vehicle or {"time_s": track.time_s})["time_s"])
    begin = int(np.searchsorted(track.time_s, max(float(clock[0]) for clock in clocks)))
    begin = min(begin, len(track.time_s) - 1)
    return LocalFrame(*(float(v[begin]) for v in (track.latitude_deg, track.longitude_deg, track.height_m)))
