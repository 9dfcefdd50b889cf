"""What the devices' sensors show of the truth: their noise, and their faults."""

import numpy as np
from jaxtyping import UInt8

from lgprjax.scene import LiveSensors
from lgprjax.scene.vehicle_drive import TrueVehicle
from lgprjax.simulation.devices.course_world import CourseWorld
from lgprjax.simulation.devices.drive_box import Measured
from lgprjax.simulation.devices.driver import Hands
from lgprjax.simulation.devices.faults import Faults
from lgprjax.simulation.devices.gnss_box import Attitude, Position
from lgprjax.simulation.devices.trajectory import Sample
from lgprjax.simulation.devices.vehicle import GNSS_X_M, Moved

INS_PERIOD_S = 0.02
_POTENTIOMETER_SIGMA_V, _TORQUE_SIGMA_NM, _PEDAL_SIGMA, _SUPPLY_SIGMA_V = 0.002, 0.15, 0.002, 0.02
_OPEN_V, _SHORT_V = 5.5, 0.0
_SHOWN_SIGMA_M = {2: 0.014, 1: 0.4, 0: 2.5}
_EXTRA = {1: (0.3, 20.0), 0: (1.5, 60.0)}
"""Sigma (m) and time constant (s) of what float and single solutions are wrong by beside the rest."""


class Sensing:
    """Sensors of the vehicle.

    Args:
        true: the vehicle.
        sensors: what navigation's are like.
        world: that it is in.
        faults: that run.
        seed: of the noise.
    """

    def __init__(self, true: TrueVehicle, sensors: LiveSensors, world: CourseWorld, faults: Faults, seed: int) -> None:
        self._true, self._world, self._faults = true, world, faults
        self._rng = np.random.default_rng([seed, 51])
        self._zero_counts = int(self._rng.integers(-100_000, 100_000))
        self._rate_sigma = float(sensors.yaw_rate_noise) / INS_PERIOD_S**0.5
        self._heading_sigma_rad = float(sensors.heading_sigma_rad)
        self._odometer_sigma_mps = float(sensors.odometer_mps)
        self._gnss_period_s = int(sensors.gnss_ticks) * world.tick_s
        self._extra_m = np.zeros(2)

    def measured(self, sample: Sample, hands: Hands) -> Measured:
        """What the drive-by-wire box's sensors show."""
        faults, noise = self._faults, self._rng.normal(size=6)
        straight_v, (per_rad_v,) = self._true.potentiometer_straight_v, self._true.potentiometer_per_rad_v
        volts = straight_v + per_rad_v * sample.front_rad + _POTENTIOMETER_SIGMA_V * noise[0]
        volts = faults.hold("potentiometer_stuck", volts)
        volts = _OPEN_V if faults.has("potentiometer_open") else volts
        volts = _SHORT_V if faults.has("potentiometer_short") else volts
        counts = self._zero_counts + self._true.encoder_counts_per_rad * sample.motor_rad
        gain = sample.odometer_gain
        return Measured(
            float(volts),
            round(counts + faults.number("encoder_offset", "counts", 0.0)),
            sample.supply_v + _SUPPLY_SIGMA_V * noise[1],
            hands.torque_nm + _TORQUE_SIGMA_NM * noise[2],
            hands.foot_on_brake,
            float(np.clip(sample.throttle + _PEDAL_SIGMA * noise[3], 0.0, 1.0)),
            float(np.clip(sample.brake + _PEDAL_SIGMA * noise[4], 0.0, 1.0)),
            sample.odometer_m,
            gain * sample.speed_mps + (self._odometer_sigma_mps * noise[5] if gain and sample.speed_mps else 0.0),
        )

    def attitude(self, before: Sample, after: Sample) -> Attitude:
        """What the INS says after one of its periods."""
        faults, noise = self._faults, self._rng.normal(size=2)
        rate = (after.yaw_rad - before.yaw_rad) / INS_PERIOD_S
        rate += after.rate_bias_radps + self._rate_sigma * noise[0] + faults.number("ins_bias", "radps", 0.0)
        yaw = after.yaw_rad + after.heading_slow_rad + self._heading_sigma_rad * noise[1]
        yaw += faults.number("ins_bias", "rad", 0.0) + (np.pi if faults.has("heading_reversed") else 0.0)
        told = Attitude(
            after.roll_rad,
            self._world.heading_deg(yaw, after.x_m),
            rate,
            (after.speed_mps - before.speed_mps) / INS_PERIOD_S,
            after.speed_mps,
            not faults.has("ins_nan"),
        )
        return faults.hold("ins_stuck", told)

    def position(self, moved: Moved) -> Position:
        """What the receiver says of its antenna."""
        faults, noise = self._faults, self._rng.normal(size=2)
        solution = 0 if faults.has("gnss_single") else 1 if faults.has("gnss_float") else 2
        if solution in _EXTRA:
            sigma_m, constant_s = _EXTRA[solution]
            keep = np.exp(-self._gnss_period_s / constant_s)
            self._extra_m = keep * self._extra_m + np.sqrt(1.0 - keep**2) * sigma_m * noise
        else:
            self._extra_m = np.zeros(2)
        east, north = np.array([moved.gnss_east_m, moved.gnss_north_m]) + self._extra_m + faults.pair("gnss_jump", "m")
        latitude, longitude, height = self._world.geodetic(float(east), float(north), moved.along_m + GNSS_X_M)
        told = Position(
            latitude,
            longitude,
            height,
            abs(moved.speed_mps),
            self._world.heading_deg(moved.yaw_rad, moved.x_m),
            _SHOWN_SIGMA_M[solution],
            solution,
        )
        return faults.hold("gnss_stuck", told)

    def scan(self, data: UInt8[np.ndarray, "channel sample"]) -> UInt8[np.ndarray, "channel sample"]:
        """What the radar gives of a scan."""
        if self._faults.has("radar_garbage"):
            return self._rng.integers(0, 256, data.shape, dtype=np.uint8)
        share = self._faults.number("radar_faded", "share", 1.0)
        if share == 1.0:
            return data
        signal = data.astype(np.float64) - 128.0
        # The receiver's gain follows: what is lost of the signal comes back as noise.
        noise = np.sqrt(max(1.0 - share**2, 0.0)) * signal.std() * self._rng.normal(size=data.shape)
        return np.asarray(np.clip(np.round(128.0 + share * signal + noise), 0.0, 255.0), np.uint8)
