"""A synthetic drive: the truth, what the sensors say of it, and the recording, block by block."""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Complex, Float, UInt8

from lgprjax.radar.array import ArrayGeometry, uniform_array
from lgprjax.scene.day import Conditions, Day, ground_on
from lgprjax.scene.ground import Ground
from lgprjax.scene.hardware import Faults, Response, ScanErrors, draw_response, draw_scan_errors, kept_scans
from lgprjax.scene.motion import (
    DrivePlan,
    antennas_on_road,
    ground_up_at,
    place_antennas,
    plan_motion,
    poses_at,
    scan_times,
)
from lgprjax.scene.propagation import RadarConfig, sweep_matrix, trace_matrix
from lgprjax.scene.receiver import ReceiverConfig, record_scans
from lgprjax.scene.road import Road
from lgprjax.scene.sensors import NavigationErrors, OdometerTrack, PoseTrack, observe_drive
from lgprjax.scene.slices import GroundSlice, count_stones, count_utilities, slice_ground
from lgprjax.scene.sweeps import SweepPlan, record_sweeps

BLOCK_SCANS = 64
STONE_STEP = 256  # slices grow in these steps, so that drives of one speed share one compiled program
UTILITY_STEP = 4

_Block = tuple[jax.Array, jax.Array, GroundSlice, jax.Array, Response, ScanErrors, jax.Array]


class SimulatedDrive(NamedTuple):
    """One drive over a ground on one day.

    Attributes:
        scan_time_s: each recorded scan's own time since the drive's start; channel i is taken time_offset_s[i] later.
        pose: true (east_m, north_m, height_m, yaw_rad, roll_rad) of the body origin at each scan's own time;
            its height is that above the vehicle's place at rest.
        ground_up_m: true height of the ground below the body origin, above the road's start.
        antenna_m: true (east_m, north_m, height) of each channel at its own instant.
        road_antenna_m: the same in the road frame: (along, cross, height above the ground).
        odometer, navigation: what the vehicle's own sensors say; navigation_up_m: the ground below, at its times.
        ground: with the day's clutter in it; conditions, response, errors: the day's, for whoever checks.
    """

    scan_time_s: Float[np.ndarray, " scan"]
    pose: Float[np.ndarray, "scan 5"]
    ground_up_m: Float[np.ndarray, " scan"]
    antenna_m: Float[np.ndarray, "scan channel 3"]
    road_antenna_m: Float[np.ndarray, "scan channel 3"]
    odometer: OdometerTrack
    navigation: PoseTrack
    navigation_up_m: Float[np.ndarray, " time"]
    array: ArrayGeometry
    day: Day
    seed: int
    ground: Ground
    conditions: Conditions
    response: Response
    errors: ScanErrors
    radar: RadarConfig
    receiver: ReceiverConfig


def default_array() -> ArrayGeometry:
    """Eleven channels 12.7 cm apart, 3 m ahead of the rear axle, 30 cm up, one scan in 1/126 s."""
    return uniform_array(11, 0.127, x_m=3.0, height_m=0.3, scan_period_s=1 / 126)


def simulate_drive(
    ground: Ground,
    plan: DrivePlan,
    day: Day,
    seed: int,
    *,
    road: Road | None = None,
    array: ArrayGeometry | None = None,
    errors: NavigationErrors | None = None,
    faults: Faults | None = None,
    radar: RadarConfig | None = None,
    receiver: ReceiverConfig | None = None,
) -> SimulatedDrive:
    """Everything of a drive but its recording, which ``iterate_traces`` or ``iterate_sweeps`` makes when asked.

    Args:
        day: what the ground and the radar are like that day; its seed draws clutter, response and velocity.
        seed: of the driving (wander, bounce), the navigation's errors and the faults; with the day's, of the noise.

    Raises:
        ValueError: a plan that cannot be driven, or an antenna that would hear beyond the corridor's edge.
    """
    array = default_array() if array is None else array
    radar = RadarConfig(height_m=array.height_m) if radar is None else radar
    faults = Faults() if faults is None else faults
    motion = plan_motion(plan, seed, road)
    time_s = scan_times(motion)
    drawn = draw_scan_errors(faults, len(time_s), radar.band_mhz, seed)
    kept = kept_scans(faults, len(time_s), seed)
    time_s = time_s[kept]
    on_road = antennas_on_road(motion, time_s, array)
    check_inside(ground, on_road, radar)
    odometer, navigation = observe_drive(motion, NavigationErrors() if errors is None else errors, seed)
    that_day, conditions = ground_on(ground, day)
    return SimulatedDrive(
        scan_time_s=time_s,
        pose=poses_at(motion, time_s),
        ground_up_m=ground_up_at(motion, time_s),
        antenna_m=place_antennas(poses_at(motion, time_s[:, None] + array.time_offset_s[None]), array),
        road_antenna_m=on_road,
        odometer=odometer,
        navigation=navigation,
        navigation_up_m=ground_up_at(motion, navigation.time_s),
        array=array,
        day=day,
        seed=seed,
        ground=that_day,
        conditions=conditions,
        response=draw_response(day, array.x_m.size, faults),
        errors=ScanErrors(*(e[kept] for e in drawn)),
        radar=radar,
        receiver=ReceiverConfig() if receiver is None else receiver,
    )


def iterate_traces(drive: SimulatedDrive, chunk_scans: int = 512) -> Iterator[UInt8[np.ndarray, "scan channel sample"]]:
    """The recording as time traces of one byte, in chunks of ``chunk_scans`` scans (the last may be shorter).

    Scans are rendered in fixed blocks counted from the drive's start: one compiled program serves the drive,
    and the size of the chunks never changes the bytes.

    Raises:
        ValueError: ``chunk_scans`` is less than 1.
    """
    matrix = jnp.asarray(trace_matrix(drive.radar, **soil_of(drive.ground, drive.conditions)))
    blocks = (
        (np.asarray(record_scans(*block, matrix, radar=drive.radar, receiver=drive.receiver)),)
        for block in _blocks(drive)
    )
    for (chunk,) in _chunks(blocks, len(drive.scan_time_s), chunk_scans):
        yield chunk


def iterate_sweeps(
    drive: SimulatedDrive, plan: SweepPlan, chunk_scans: int = 512
) -> Iterator[tuple[Complex[np.ndarray, "scan channel frequency"], Complex[np.ndarray, "scan frequency"]]]:
    """The recording as stepped-frequency sweeps, each with its calibration sweep; chunks as in ``iterate_traces``."""
    matrix = jnp.asarray(sweep_matrix(drive.radar, plan.frequency_mhz, **soil_of(drive.ground, drive.conditions)))
    recorded = (record_sweeps(*block, matrix, radar=drive.radar, plan=plan) for block in _blocks(drive))
    blocks = ((np.asarray(sweeps), np.asarray(calibration)) for sweeps, calibration in recorded)
    for pair in _chunks(blocks, len(drive.scan_time_s), chunk_scans):
        yield pair[0], pair[1]


def render_drive(drive: SimulatedDrive) -> UInt8[np.ndarray, "scan channel sample"]:
    """All traces at once (4 kB a scan)."""
    return np.concatenate(list(iterate_traces(drive)))


def soil_of(ground: Ground, conditions: Conditions) -> dict[str, float]:
    """What a recorder's matrix needs to know of a day's ground."""
    config = ground.config
    return {
        "velocity_m_per_ns": config.velocity_m_per_ns * conditions.velocity_factor,
        "attenuation_per_m": config.attenuation_per_m * conditions.attenuation_factor,
        "dispersive_share": config.dispersive_share,
    }


def _blocks(drive: SimulatedDrive) -> Iterator[_Block]:
    """What the recorders need, ``BLOCK_SCANS`` scans at a time; the last block is filled up with its last scan."""
    scans = len(drive.scan_time_s)
    blocks = -(-scans // BLOCK_SCANS)
    index = np.minimum(np.arange(blocks * BLOCK_SCANS), scans - 1).reshape(blocks, BLOCK_SCANS)
    antenna_m = drive.road_antenna_m[index]
    reach = drive.radar.aperture_m
    from_m, to_m = antenna_m[..., 0].min(axis=(1, 2)) - reach, antenna_m[..., 0].max(axis=(1, 2)) + reach
    stones = -(-max(count_stones(drive.ground, from_m, to_m), 1) // STONE_STEP) * STONE_STEP
    utilities = -(-max(count_utilities(drive.ground, from_m, to_m), 1) // UTILITY_STEP) * UTILITY_STEP
    key = jax.random.fold_in(jax.random.key(drive.day.seed), drive.seed)
    noise_field = jnp.asarray(drive.day.noise_field, jnp.float32)
    for block in range(blocks):
        origin = antenna_m[block].reshape(-1, 3).mean(axis=0) * [1.0, 1.0, 0.0]
        piece = slice_ground(
            drive.ground,
            from_m[block],
            to_m[block],
            stones=stones,
            utilities=utilities,
            origin_m=(origin[0], origin[1]),
            conditions=drive.conditions,
        )
        yield (
            key,
            jnp.asarray(block * BLOCK_SCANS, jnp.int32),
            piece,
            jnp.asarray(antenna_m[block] - origin, jnp.float32),
            drive.response,
            ScanErrors(*(e[index[block]] for e in drive.errors)),
            noise_field,
        )


def _chunks(blocks: Iterator[tuple[np.ndarray, ...]], scans: int, chunk_scans: int) -> Iterator[tuple[np.ndarray, ...]]:
    """Blocks of ``BLOCK_SCANS`` as chunks of another size, without what filled up the last block."""
    if chunk_scans < 1:
        raise ValueError(f"chunk_scans must be at least 1, not {chunk_scans}")
    waiting: list[tuple[np.ndarray, ...]] = []
    held, done = 0, 0
    for block in blocks:
        waiting.append(tuple(part[: scans - done] for part in block))
        held += len(waiting[-1][0])
        done += len(waiting[-1][0])
        if held >= chunk_scans:
            joined = tuple(np.concatenate(parts) for parts in zip(*waiting, strict=True))
            whole = held // chunk_scans * chunk_scans
            for first in range(0, whole, chunk_scans):
                yield tuple(part[first : first + chunk_scans] for part in joined)
            waiting, held = [tuple(part[whole:] for part in joined)], held - whole
    if held:
        yield tuple(np.concatenate(parts) for parts in zip(*waiting, strict=True))


def check_inside(ground: Ground, antenna_m: Float[np.ndarray, "scan channel 3"], radar: RadarConfig) -> None:
    """Raises ``ValueError`` where an antenna would hear beyond the corridor's edge."""
    config, reach = ground.config, radar.aperture_m
    low, high = antenna_m[..., 0].min() - reach, antenna_m[..., 0].max() + reach
    if low < -config.margin_m or high > config.length_m + config.margin_m:
        raise ValueError(
            f"the drive hears [{low:.1f}, {high:.1f}] m along the road, "
            f"the ground ends at [{-config.margin_m:.1f}, {config.length_m + config.margin_m:.1f}]"
        )
    aside = float(np.abs(antenna_m[..., 1]).max()) + reach
    if aside > config.half_width_m:
        raise ValueError(f"the drive hears {aside:.2f} m to the side, the ground ends at {config.half_width_m:.2f}")
