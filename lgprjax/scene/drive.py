"""A synthetic drive: the truth, the sensors' readings, and the recording, traces or sweeps."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import partial
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Complex, Float, Int, PRNGKeyArray, UInt8

from lgprjax.radar.array import ArrayGeometry, uniform_array
from lgprjax.scene.day import Conditions, Day, ground_on
from lgprjax.scene.ground import Ground
from lgprjax.scene.motion import (
    DrivePlan,
    antennas_on_road,
    ground_up_at,
    place_antennas,
    plan_motion,
    poses_at,
    scan_times,
)
from lgprjax.scene.propagation import (
    LIGHT_M_PER_NS,
    TRENCHES,
    GroundSlice,
    RadarConfig,
    band_spectrum,
    count_stones,
    count_utilities,
    slice_ground,
    sweep_matrix,
    trace_matrix,
)
from lgprjax.scene.render import (
    COUPLING_NS,
    HARDWARE_SEED,
    ReceiverConfig,
    ReceiverFaults,
    Response,
    ScanErrors,
    convolve_echoes,
    draw_response,
    draw_scan_errors,
    kept_scans,
    received_echoes,
    record_scans,
)
from lgprjax.scene.road import Road
from lgprjax.scene.sensors import NavigationErrors, OdometerTrack, PoseTrack, observe_drive

# A stepped-frequency receiver: sweeps of every channel and the calibration channel, and start-of-day recordings.
#
# The measurement at a frequency f is g A(f) R(f) E(f) + noise: E is the field at the antennas, R the channel, A the
# common path (synthesiser, amplifiers, cables), g the drift of the scan. The calibration channel sees g A(f) a
# exp(-2 pi i f tau), through an attenuator a and a cable tau: dividing by it leaves E, R and a known delay.

_AVERAGED = 256  # scans averaged by the start-of-day recordings
_PLATE_M = 0.5  # from the antennas to the metal plate


@dataclass(frozen=True)
class SweepPlan:
    """Frequencies, converter and calibration path of a stepped-frequency receiver.

    Attributes:
        first_mhz, step_mhz, steps: first frequency, step and number of frequencies. 1 / step is the unambiguous travel
            time.
        adc_bits, full_scale_field: resolution and range of the quadrature receiver; stronger fields are clipped.
        calibration_gain, calibration_delay_ns: gain and delay of the path through the attenuator, as strong as the
            converter allows: noise of the calibration channel is noise of every channel, in proportion to the coupling.
        ripple: rms of the common path's response over frequency, in nepers and radians.
    """

    first_mhz: float = 100.0
    step_mhz: float = 5.0
    steps: int = 61
    adc_bits: int = 14
    full_scale_field: float = 3.0
    calibration_gain: float = 1.5
    calibration_delay_ns: float = 6.0
    ripple: float = 0.15

    @property
    def step(self) -> float:
        """One count of the converter, as a field."""
        return float(2.0 * self.full_scale_field / 2**self.adc_bits)

    @property
    def frequency_mhz(self) -> Float[np.ndarray, " frequency"]:
        """Frequency of each step, MHz."""
        return np.asarray(self.first_mhz + self.step_mhz * np.arange(self.steps))


class StartOfDay(NamedTuple):
    """Recordings before the drive: empty space, and a metal plate under the array, each with its calibration sweep."""

    empty: Complex[np.ndarray, "channel frequency"]
    empty_calibration: Complex[np.ndarray, " frequency"]
    plate: Complex[np.ndarray, "channel frequency"]
    plate_calibration: Complex[np.ndarray, " frequency"]


def common_path(plan: SweepPlan) -> Complex[np.ndarray, " frequency"]:
    """The path that all channels and the calibration channel share; it belongs to the hardware."""
    rng = np.random.default_rng([HARDWARE_SEED, 1])
    turns = np.outer(np.linspace(0, 1, plan.steps), np.arange(1, 5))
    wave = np.cos(2 * np.pi * (turns + rng.uniform(size=(2, 1, 4)))) @ rng.normal(size=4) * plan.ripple / 2
    cable_ns = 11.0
    return np.asarray(np.exp(wave[0] + 1j * wave[1] - 2e-3j * np.pi * plan.frequency_mhz * cable_ns))


def calibration_path(plan: SweepPlan) -> Complex[np.ndarray, " frequency"]:
    """The calibration channel's own part."""
    delay = np.exp(-2e-3j * np.pi * plan.frequency_mhz * plan.calibration_delay_ns)
    return np.asarray(plan.calibration_gain * delay)


def standing_echoes(
    plan: SweepPlan, response: Response, in_view: Literal["empty", "plate"]
) -> Complex[np.ndarray, "channel frequency"]:
    """Response of a stationary array to empty space, or to a metal plate under it."""
    f = plan.frequency_mhz * 1e-3
    own = response.gain[:, None] * np.exp(-2j * np.pi * np.outer(response.delay_ns, f))
    coupling = response.coupling @ np.exp(-2j * np.pi * np.outer(np.asarray(COUPLING_NS), f))
    mirror = -0.5 / _PLATE_M * np.exp(-2j * np.pi * f * 2 * _PLATE_M / LIGHT_M_PER_NS)
    return np.asarray(own * (coupling + (mirror[None] if in_view == "plate" else 0.0)))


def start_of_day(plan: SweepPlan, radar: RadarConfig, response: Response, noise_field: float, seed: int) -> StartOfDay:
    """The look-up in empty space and the plate under the array, each the mean of many scans."""
    rng = np.random.default_rng([seed, 10])
    common, calibration = common_path(plan), calibration_path(plan)
    sigma = _noise_per_step(plan, radar, noise_field) / np.sqrt(_AVERAGED)

    def noisy(sweep: Complex[np.ndarray, "..."]) -> Complex[np.ndarray, "..."]:
        drift = 1 + 0.02 * rng.normal()  # the receiver is not as warm as it will be
        noise = rng.normal(size=(2, *sweep.shape)) * sigma * np.sqrt(0.5)
        return np.asarray(drift * common * sweep + noise[0] + 1j * noise[1])

    def pair(in_view: Literal["empty", "plate"]) -> tuple[np.ndarray, np.ndarray]:
        together = noisy(np.concatenate([standing_echoes(plan, response, in_view), calibration[None]]))
        return together[:-1].astype(np.complex64), together[-1].astype(np.complex64)

    return StartOfDay(*pair("empty"), *pair("plate"))


@partial(jax.jit, static_argnames=("radar", "plan"))
def record_sweeps(
    key: PRNGKeyArray,
    first_scan: Int[Array, ""],
    ground: GroundSlice,
    antenna_m: Float[Array, "scan channel 3"],
    response: Response,
    errors: ScanErrors,
    noise_field: Float[Array, ""],
    matrix: Float[Array, "bin recorded"],
    *,
    radar: RadarConfig,
    plan: SweepPlan,
) -> tuple[Complex[Array, "scan channel frequency"], Complex[Array, "scan frequency"]]:
    """Records a block of scans; arguments as of ``record_scans``, the matrix from ``sweep_matrix``."""
    scans, channels, _ = antenna_m.shape
    echoes = received_echoes(ground, antenna_m.reshape(-1, 3), response, radar=radar)
    halves = convolve_echoes(echoes, matrix).reshape(scans, channels, 2, plan.steps)
    heard = jax.lax.complex(halves[:, :, 0], halves[:, :, 1])
    received: tuple[Array, Array] = receive_sweeps(
        key, first_scan, heard, response, errors, noise_field, radar=radar, plan=plan
    )
    return received


@partial(jax.jit, static_argnames=("radar", "plan"))
def receive_sweeps(
    key: PRNGKeyArray,
    first_scan: Int[Array, ""],
    heard: Complex[Array, "scan channel frequency"],
    response: Response,
    errors: ScanErrors,
    noise_field: Float[Array, ""],
    *,
    radar: RadarConfig,
    plan: SweepPlan,
) -> tuple[Complex[Array, "scan channel frequency"], Complex[Array, "scan frequency"]]:
    """Sweeps of the channels and of the calibration channel, as the receiver records what the channels receive."""
    scans, channels, _ = heard.shape
    through = jnp.broadcast_to(jnp.asarray(calibration_path(plan), jnp.complex64), (scans, 1, plan.steps))
    echoes_pair = jnp.concatenate([heard, through], axis=1)
    drift = jax.lax.complex(errors.gain * jnp.cos(errors.phase_rad), errors.gain * jnp.sin(errors.phase_rad))
    sweep = echoes_pair * drift[:, None, None] * jnp.asarray(common_path(plan), jnp.complex64)[None, None]

    keys = jax.vmap(jax.random.fold_in, (None, 0))(key, first_scan + jnp.arange(scans, dtype=jnp.int32))
    white = jax.vmap(lambda k: jax.random.normal(k, (2, channels + 1, plan.steps), jnp.float32))(keys)
    sigma = noise_field * _noise_per_step(plan, radar, 1.0) * np.sqrt(0.5)
    sweep += jax.lax.complex(white[:, 0] * sigma, white[:, 1] * sigma)

    # A transmitter in the band is received in its frequency step; without an antenna it is not.
    phase = jax.vmap(lambda k: jax.random.uniform(jax.random.fold_in(k, 1), (channels + 1,)))(keys)
    away = jnp.abs(jnp.asarray(plan.frequency_mhz, jnp.float32)[None, :] - errors.interference_mhz[:, None])
    share = jnp.clip(1.0 - away / plan.step_mhz, 0.0, 1.0) * errors.interference[:, None] * plan.steps
    connected = jnp.append(jnp.asarray(response.gain) != 0, False).astype(jnp.complex64)
    turn = jax.lax.complex(jnp.cos(2 * jnp.pi * phase), jnp.sin(2 * jnp.pi * phase)) * connected[None, :]
    sweep += share.astype(jnp.complex64)[:, None, :] * turn[..., None]

    step = plan.step

    def digitise(x: Float[Array, "..."]) -> Float[Array, "..."]:
        return jnp.clip(jnp.round(x / step) * step, -plan.full_scale_field, plan.full_scale_field - step)

    sweep = jax.lax.complex(digitise(sweep.real), digitise(sweep.imag))
    return sweep[:, :-1], sweep[:, -1]


def _noise_per_step(plan: SweepPlan, radar: RadarConfig, noise_field: float) -> float:
    """Rms of the complex noise of a step that makes ``noise_field`` in a time trace with the radar's spectrum."""
    spectrum = band_spectrum(radar, plan.frequency_mhz)
    return float(noise_field * np.sqrt(2.0) * spectrum.sum() / np.linalg.norm(spectrum))


BLOCK_SCANS = 64
STONE_STEP = 256  # slices grow in these steps, so that drives of one speed share one compiled program
UTILITY_STEP = 4

_Block = tuple[jax.Array, jax.Array, GroundSlice, jax.Array, Response, ScanErrors, jax.Array]


class SimulatedDrive(NamedTuple):
    """A drive over a ground on one day.

    Attributes:
        scan_time_s: time of each recorded scan since the drive's start; channel i is recorded time_offset_s[i] later.
        pose: true (east_m, north_m, height_m, yaw_rad, roll_rad) of the body origin at each scan time;
            the height is relative to the vehicle at rest.
        ground_up_m: true height of the ground below the body origin, above the road's start.
        antenna_m: true (east_m, north_m, height) of each channel at its own instant.
        road_antenna_m: antenna positions in the road frame: (along, cross, height above the ground).
        odometer, navigation: readings of the vehicle's own sensors.
        navigation_up_m: true height of the ground below at the times of ``navigation``.
        navigation_springs_m: true height of the body relative to rest at the times of ``navigation``.
        ground: ground including the day's clutter.
        conditions, response, errors: the day's conditions, channel response and scan errors, for checks.
    """

    scan_time_s: Float[np.ndarray, " scan"]
    pose: Float[np.ndarray, "scan 5"]
    ground_up_m: Float[np.ndarray, " scan"]
    antenna_m: Float[np.ndarray, "scan channel 3"]
    road_antenna_m: Float[np.ndarray, "scan channel 3"]
    odometer: OdometerTrack
    navigation: PoseTrack
    navigation_up_m: Float[np.ndarray, " time"]
    navigation_springs_m: Float[np.ndarray, " time"]
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
    faults: ReceiverFaults | None = None,
    radar: RadarConfig | None = None,
    receiver: ReceiverConfig | None = None,
) -> SimulatedDrive:
    """Simulate a drive without its recording, which ``iterate_traces`` or ``iterate_sweeps`` generates on demand.

    Args:
        day: conditions of ground and radar on the day; its seed draws clutter, response and velocity.
        seed: seed of the driving (wander, bounce), the navigation errors and the faults; together with the day's seed,
            of the noise.

    Raises:
        ValueError: the plan cannot be driven, an antenna's aperture extends beyond the corridor's edge, or more
            trenches are next to each other than a slice of the ground holds.
    """
    array = default_array() if array is None else array
    radar = RadarConfig(height_m=array.height_m) if radar is None else radar
    faults = ReceiverFaults() if faults is None else faults
    motion = plan_motion(plan, seed, road)
    time_s = scan_times(motion)
    drawn = draw_scan_errors(faults, len(time_s), radar.band_mhz, seed)
    kept = kept_scans(faults, len(time_s), seed)
    time_s = time_s[kept]
    on_road = antennas_on_road(motion, time_s, array)
    check_inside(ground, on_road, radar)
    odometer, navigation = observe_drive(motion, NavigationErrors() if errors is None else errors, seed)
    that_day, conditions = ground_on(ground, day)
    _check_trenches(conditions, on_road, radar)
    return SimulatedDrive(
        scan_time_s=time_s,
        pose=poses_at(motion, time_s),
        ground_up_m=ground_up_at(motion, time_s),
        antenna_m=place_antennas(poses_at(motion, time_s[:, None] + array.time_offset_s[None]), array),
        road_antenna_m=on_road,
        odometer=odometer,
        navigation=navigation,
        navigation_up_m=ground_up_at(motion, navigation.time_s),
        navigation_springs_m=poses_at(motion, navigation.time_s)[:, 2],
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
    """Properties of a day's ground for a recorder's matrix."""
    config = ground.config
    return {
        "velocity_m_per_ns": config.velocity_m_per_ns * conditions.velocity_factor,
        "attenuation_per_m": config.attenuation_per_m * conditions.attenuation_factor,
        "dispersive_share": config.dispersive_share,
    }


def _blocks(drive: SimulatedDrive) -> Iterator[_Block]:
    """Inputs of the recorders, ``BLOCK_SCANS`` scans at a time; the last block is padded with its last scan."""
    index, from_m, to_m = _windows(drive.road_antenna_m, drive.radar)
    antenna_m = drive.road_antenna_m[index]
    stones = -(-max(count_stones(drive.ground, from_m, to_m), 1) // STONE_STEP) * STONE_STEP
    utilities = -(-max(count_utilities(drive.ground, from_m, to_m), 1) // UTILITY_STEP) * UTILITY_STEP
    key = jax.random.fold_in(jax.random.key(drive.day.seed), drive.seed)
    noise_field = jnp.asarray(drive.day.noise_field, jnp.float32)
    for block in range(len(index)):
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


def _windows(
    antenna_m: Float[np.ndarray, "scan channel 3"], radar: RadarConfig
) -> tuple[Int[np.ndarray, "block member"], Float[np.ndarray, " block"], Float[np.ndarray, " block"]]:
    """Scan numbers of each block, and start and end of its aperture along the road, m."""
    scans = len(antenna_m)
    blocks = -(-scans // BLOCK_SCANS)
    index = np.minimum(np.arange(blocks * BLOCK_SCANS), scans - 1).reshape(blocks, BLOCK_SCANS)
    along_m, reach = antenna_m[index, :, 0], radar.aperture_m
    return index, along_m.min(axis=(1, 2)) - reach, along_m.max(axis=(1, 2)) + reach


def _check_trenches(conditions: Conditions, antenna_m: Float[np.ndarray, "scan channel 3"], radar: RadarConfig) -> None:
    """Raises ``ValueError`` if more trenches are within a block's aperture than a slice holds."""
    _, from_m, to_m = _windows(antenna_m, radar)
    begin_m, end_m = conditions.trenches[:, 0], conditions.trenches[:, 1]
    heard = np.sum((end_m >= from_m[:, None]) & (begin_m <= to_m[:, None]), axis=1)
    if heard.max(initial=0) > TRENCHES:
        at = int(np.argmax(heard))
        raise ValueError(f"{heard[at]} trenches from {from_m[at]:.1f} to {to_m[at]:.1f} m, more than {TRENCHES}")


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
    """Raises ``ValueError`` if an antenna's aperture extends beyond the corridor's edge."""
    config, reach = ground.config, radar.aperture_m
    low, high = antenna_m[..., 0].min() - reach, antenna_m[..., 0].max() + reach
    if low < -config.margin_m or high > config.length_m + config.margin_m:
        raise ValueError(
            f"the drive needs ground at [{low:.1f}, {high:.1f}] m along the road, "
            f"the ground ends at [{-config.margin_m:.1f}, {config.length_m + config.margin_m:.1f}]"
        )
    aside = float(np.abs(antenna_m[..., 1]).max()) + reach
    if aside > config.half_width_m:
        raise ValueError(
            f"the drive needs {aside:.2f} m of ground to the side, the ground ends at {config.half_width_m:.2f}"
        )
