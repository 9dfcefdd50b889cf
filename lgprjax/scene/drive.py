"""A synthetic drive: the truth, what the sensors say of it, and the recorded traces, block by block."""

from collections.abc import Iterator
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Float, UInt8

from lgprjax.radar.array import ArrayGeometry, uniform_array
from lgprjax.scene.ground import Ground, add_stones, count_stones, draw_stones, slice_ground
from lgprjax.scene.motion import DrivePlan, place_antennas, plan_motion, poses_at, scan_times
from lgprjax.scene.receiver import Day, ReceiverConfig, Response, draw_response, record_scans
from lgprjax.scene.render import RadarConfig
from lgprjax.scene.sensors import NavigationErrors, OdometerTrack, PoseTrack, observe_drive

BLOCK_SCANS = 64
STONE_STEP = 256  # slices grow in these steps, so that drives of one speed share one compiled program


class SimulatedDrive(NamedTuple):
    """One drive over a ground on one day.

    Attributes:
        scan_time_s: each scan's own time since the drive's start; channel i is taken time_offset_s[i] later.
        pose: true (east_m, north_m, height_m, yaw_rad, roll_rad) of the body origin at each scan's own time;
            its height is that above the vehicle's place at rest.
        antenna_m: true (east_m, north_m, height above the ground) of each channel at its own instant.
        odometer, navigation: what the vehicle's own sensors say.
        ground: with the day's clutter in it; response, velocity_factor: the day's errors, for whoever checks.
    """

    scan_time_s: Float[np.ndarray, " scan"]
    pose: Float[np.ndarray, "scan 5"]
    antenna_m: Float[np.ndarray, "scan channel 3"]
    odometer: OdometerTrack
    navigation: PoseTrack
    array: ArrayGeometry
    day: Day
    seed: int
    ground: Ground
    response: Response
    velocity_factor: float
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
    array: ArrayGeometry | None = None,
    errors: NavigationErrors | None = None,
    radar: RadarConfig | None = None,
    receiver: ReceiverConfig | None = None,
) -> SimulatedDrive:
    """Everything of a drive but its traces, which ``iterate_traces`` renders when asked.

    Args:
        day: what the ground and the radar are like that day; its seed draws clutter, response and velocity.
        seed: of the driving (wander, bounce) and the navigation's errors; with the day's, of the noise.

    Raises:
        ValueError: a plan that cannot be driven, or an antenna that would hear beyond the corridor's edge.
    """
    array = default_array() if array is None else array
    radar = RadarConfig() if radar is None else radar
    motion = plan_motion(plan, seed)
    time_s = scan_times(motion)
    antenna_m = place_antennas(poses_at(motion, time_s[:, None] + array.time_offset_s[None]), array)
    _check_inside(ground, antenna_m, radar)
    odometer, navigation = observe_drive(motion, NavigationErrors() if errors is None else errors, seed)
    return SimulatedDrive(
        scan_time_s=time_s,
        pose=poses_at(motion, time_s),
        antenna_m=antenna_m,
        odometer=odometer,
        navigation=navigation,
        array=array,
        day=day,
        seed=seed,
        ground=_scatter_clutter(ground, day),
        response=draw_response(day, array.x_m.size),
        velocity_factor=_draw_velocity(day),
        radar=radar,
        receiver=ReceiverConfig(height_m=array.height_m) if receiver is None else receiver,
    )


def iterate_traces(drive: SimulatedDrive, chunk_scans: int = 512) -> Iterator[UInt8[np.ndarray, "scan channel sample"]]:
    """The recording in chunks of ``chunk_scans`` scans (the last may be shorter).

    Scans are rendered in fixed blocks counted from the drive's start: one compiled program serves the drive,
    and the size of the chunks never changes the bytes.

    Raises:
        ValueError: ``chunk_scans`` is less than 1.
    """
    if chunk_scans < 1:
        raise ValueError(f"chunk_scans must be at least 1, not {chunk_scans}")
    waiting: list[UInt8[np.ndarray, "scan channel sample"]] = []
    held = 0
    for block in _render_blocks(drive):
        waiting.append(block)
        held += len(block)
        if held >= chunk_scans:
            scans = np.concatenate(waiting)
            whole = held // chunk_scans * chunk_scans
            for first in range(0, whole, chunk_scans):
                yield scans[first : first + chunk_scans]
            waiting, held = [scans[whole:]], held - whole
    if held:
        yield np.concatenate(waiting)


def render_drive(drive: SimulatedDrive) -> UInt8[np.ndarray, "scan channel sample"]:
    """The whole recording at once (4 kB a scan)."""
    return np.concatenate(list(_render_blocks(drive)))


def _render_blocks(drive: SimulatedDrive) -> Iterator[UInt8[np.ndarray, "scan channel sample"]]:
    scans = len(drive.scan_time_s)
    blocks = -(-scans // BLOCK_SCANS)
    # The last block is filled up with its last scan; what it renders is dropped.
    index = np.minimum(np.arange(blocks * BLOCK_SCANS), scans - 1)
    antenna_m = drive.antenna_m[index].reshape(blocks, BLOCK_SCANS, -1, 3)
    reach = drive.radar.aperture_m
    from_m, to_m = antenna_m[..., 0].min(axis=(1, 2)) - reach, antenna_m[..., 0].max(axis=(1, 2)) + reach
    stones = -(-max(count_stones(drive.ground, from_m, to_m), 1) // STONE_STEP) * STONE_STEP
    key = jax.random.fold_in(jax.random.key(drive.day.seed), drive.seed)
    for block in range(blocks):
        origin = antenna_m[block].reshape(-1, 3).mean(axis=0) * [1.0, 1.0, 0.0]
        recorded = record_scans(
            key,
            jnp.asarray(block * BLOCK_SCANS, jnp.int32),
            slice_ground(
                drive.ground,
                from_m[block],
                to_m[block],
                stones=stones,
                origin_m=(origin[0], origin[1]),
                velocity_factor=drive.velocity_factor,
            ),
            jnp.asarray(antenna_m[block] - origin, jnp.float32),
            drive.response,
            jnp.asarray(drive.day.noise_field, jnp.float32),
            radar=drive.radar,
            receiver=drive.receiver,
        )
        yield np.asarray(recorded)[: min(BLOCK_SCANS, scans - block * BLOCK_SCANS)]


def _scatter_clutter(ground: Ground, day: Day) -> Ground:
    if day.clutter_per_m2 <= 0:
        return ground
    clutter = draw_stones(
        np.random.default_rng([day.seed, 4]),
        ground.config,
        per_m2=day.clutter_per_m2,
        depth_m=day.clutter_depth_m,
        strength_m=day.clutter_strength_m,
    )
    return add_stones(ground, *clutter)


def _draw_velocity(day: Day) -> float:
    normal = float(np.random.default_rng([day.seed, 5]).normal())
    return day.velocity_factor * (1 + day.velocity_spread * normal)


def _check_inside(ground: Ground, antenna_m: Float[np.ndarray, "scan channel 3"], radar: RadarConfig) -> None:
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
