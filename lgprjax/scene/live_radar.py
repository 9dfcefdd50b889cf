"""A radar on a vehicle whose path is not known beforehand: recordings of a few scans at a time at its pose."""

from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Complex64, Float, UInt8

from lgprjax.radar.array import ArrayGeometry
from lgprjax.scene.day import Day, ground_on
from lgprjax.scene.drive import (
    STONE_STEP,
    UTILITY_STEP,
    StartOfDay,
    SweepPlan,
    check_inside,
    receive_sweeps,
    record_sweeps,
    soil_of,
    standing_echoes,
    start_of_day,
)
from lgprjax.scene.ground import Ground
from lgprjax.scene.motion import DrivePlan, place_antennas
from lgprjax.scene.propagation import (
    RadarConfig,
    count_stones,
    count_utilities,
    slice_ground,
    sweep_matrix,
    trace_matrix,
)
from lgprjax.scene.render import (
    ReceiverConfig,
    ReceiverFaults,
    ScanErrors,
    draw_response,
    draw_scan_errors,
    kept_scans,
    record_scans,
)
from lgprjax.scene.road import Road, Waves, draw_waves, local_to_road, roughness_value, wave_value

_ALONG_M = 3.0  # largest extent of a block of scans and its array along the road, without the aperture


class Springs(NamedTuple):
    """Motion of the body on its springs along the road: height and roll."""

    height: Waves
    roll: Waves


class LiveScan(NamedTuple):
    """A block as recorded.

    Attributes:
        recorded: traces as bytes, 128 for silence; or sweeps, the calibration channel as the last row.
        received: scans that came through.
        roll_rad: true roll of the body at each scan's own time.
    """

    recorded: UInt8[np.ndarray, "scan channel sample"] | Complex64[np.ndarray, "scan row frequency"]
    received: Bool[np.ndarray, " scan"]
    roll_rad: Float[np.ndarray, " scan"]


def draw_springs(plan: DrivePlan, seed: int) -> Springs:
    """Springs of a drive, with the plan's amplitudes."""
    rng = np.random.default_rng([seed, 12])
    return Springs(
        draw_waves(rng, plan.height_sigma_m, plan.bounce_wavelength_m),
        draw_waves(rng, plan.roll_sigma_rad, plan.bounce_wavelength_m),
    )


class LiveRadar:
    """Radar of one drive; its errors are those of a ``SimulatedDrive`` of as many scans.

    Args:
        ground, day, road: ground, conditions of the day, and road.
        array: antenna array of the vehicle.
        springs: motion of the vehicle on its springs.
        scans: largest number of scans; drifts run over them.
        seed: seed of the faults; together with the day's seed, of the noise.
        sweeps: sweep plan of a stepped-frequency radar; ``None`` for a radar that records traces.
        in_view: view of an array that records sweeps: the ground, empty space, or a metal plate equally far from all
            channels.

    Attributes:
        start: recordings at the start of the day; ``None`` for a radar that records traces.

    Raises:
        ValueError: a scan is recorded beyond the end of the ground.
    """

    def __init__(
        self,
        ground: Ground,
        day: Day,
        road: Road,
        array: ArrayGeometry,
        springs: Springs,
        *,
        scans: int,
        seed: int,
        faults: ReceiverFaults | None = None,
        radar: RadarConfig | None = None,
        receiver: ReceiverConfig | None = None,
        sweeps: SweepPlan | None = None,
        in_view: Literal["ground", "empty", "plate"] = "ground",
    ) -> None:
        faults = ReceiverFaults() if faults is None else faults
        self.radar = RadarConfig(height_m=array.height_m) if radar is None else radar
        self._receiver = ReceiverConfig() if receiver is None else receiver
        self._road, self._array, self._springs = road, array, springs
        self._ground, self._conditions = ground_on(ground, day)
        self._response = draw_response(day, array.x_m.size, faults)
        self._errors = draw_scan_errors(faults, scans, self.radar.band_mhz, seed)
        self._received = np.isin(np.arange(scans), kept_scans(faults, scans, seed))
        self._key = jax.random.fold_in(jax.random.key(day.seed), seed)
        self._noise_field = jnp.asarray(day.noise_field, jnp.float32)
        self._sweeps = sweeps
        self.start: StartOfDay | None = None
        self._standing: Complex64[np.ndarray, "channel frequency"] | None = None
        if sweeps is not None and in_view != "ground":
            self._standing = standing_echoes(sweeps, self._response, in_view).astype(np.complex64)
        soil = soil_of(self._ground, self._conditions)
        if sweeps is None:
            self._matrix = jnp.asarray(trace_matrix(self.radar, **soil))
        else:
            self.start = start_of_day(sweeps, self.radar, self._response, day.noise_field, day.seed)
            self._matrix = jnp.asarray(sweep_matrix(self.radar, sweeps.frequency_mhz, **soil))
        config = self._ground.config
        # Any block's window is within one of these, so that one program serves the drive.
        reach = 2.0 * self.radar.aperture_m + _ALONG_M
        starts = np.arange(-config.margin_m - reach, config.length_m + config.margin_m, 0.5)
        ends = starts + reach + 0.5
        self._stones = -(-count_stones(self._ground, starts, ends) // STONE_STEP) * STONE_STEP
        self._utilities = -(-max(count_utilities(self._ground, starts, ends), 1) // UTILITY_STEP) * UTILITY_STEP

    def body_pose(
        self, place: Float[np.ndarray, "*time 3"], along_m: Float[np.ndarray, "*time"], direction: int
    ) -> Float[np.ndarray, "*time 5"]:
        """Pose including springs and the road's bank: east_m, north_m, height_m, yaw_rad, roll_rad."""
        roll = wave_value(self._springs.roll, along_m) + wave_value(self._road.bank_rad, along_m)
        height = wave_value(self._springs.height, along_m)
        return np.stack([place[..., 0], place[..., 1], height, place[..., 2], direction * roll], axis=-1)

    def record(
        self, first_scan: int, place: Float[np.ndarray, "scan channel 3"], along_m: float, direction: int = 1
    ) -> LiveScan:
        """Record consecutive scans; each number of scans is compiled separately.

        Args:
            first_scan: number of the first scan in the drive.
            place: east_m, north_m, yaw_rad of the rear axle at every channel's own instant.
            along_m: approximate position of the array along the road.
            direction: direction of the vehicle on the road, +1 or -1.
        """
        array, scans = self._array, len(place)
        guess = np.full(place.shape[:2], along_m)
        axle_along, _ = local_to_road(self._road, place[..., 0], place[..., 1], guess - direction * array.x_m[None])
        poses = self.body_pose(place, axle_along, direction)
        span = slice(first_scan, first_scan + scans)
        errors = ScanErrors(*(error[span] for error in self._errors))
        first, noise = jnp.asarray(first_scan, jnp.int32), self._noise_field
        if self._standing is not None and self._sweeps is not None:
            same = jnp.broadcast_to(self._standing, (scans, *self._standing.shape))
            rows = receive_sweeps(
                self._key, first, same, self._response, errors, noise, radar=self.radar, plan=self._sweeps
            )
            recorded = np.concatenate([np.asarray(rows[0]), np.asarray(rows[1])[:, None]], axis=1)
            return LiveScan(recorded, self._received[span], poses[:, 0, 4])
        antenna = place_antennas(poses, array)
        along, cross = local_to_road(self._road, antenna[..., 0], antenna[..., 1], guess)
        bank = direction * wave_value(self._road.bank_rad, axle_along)
        height = array.height_m + poses[..., 2] + array.y_m[None] * np.sin(poses[..., 4] - bank)
        on_road = np.stack([along, cross, height - roughness_value(self._road.roughness, along, cross)], axis=-1)
        reach = self.radar.aperture_m
        from_m, to_m = float(along.min()) - reach, float(along.max()) + reach
        check_inside(self._ground, on_road, self.radar)
        origin = on_road.reshape(-1, 3).mean(axis=0) * [1.0, 1.0, 0.0]
        piece = slice_ground(
            self._ground,
            from_m,
            to_m,
            stones=self._stones,
            utilities=self._utilities,
            origin_m=(origin[0], origin[1]),
            conditions=self._conditions,
        )
        heard = (
            self._key,
            first,
            piece,
            jnp.asarray(on_road - origin, jnp.float32),
            self._response,
            errors,
            noise,
            self._matrix,
        )
        if self._sweeps is None:
            recorded = np.asarray(record_scans(*heard, radar=self.radar, receiver=self._receiver))
        else:
            channels, calibration = record_sweeps(*heard, radar=self.radar, plan=self._sweeps)
            recorded = np.concatenate([np.asarray(channels), np.asarray(calibration)[:, None]], axis=1)
        return LiveScan(recorded, self._received[span], poses[:, 0, 4])
