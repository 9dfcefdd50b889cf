"""The simulated radar, receiver and chassis sensors: truth with noise and faults."""

import datetime
from collections import deque
from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import Complex64, Shaped, UInt8
from pyubx2 import GET, UBXMessage

from lgprjax.scene import LiveSensors, SweepPlan
from lgprjax.scene.propagation import RadarConfig
from lgprjax.scene.vehicle_drive import TrueVehicle
from lgprjax.simulation.devices.boxes import DeviceSender, HostListener, Measured
from lgprjax.simulation.devices.faults import RunningFaults
from lgprjax.simulation.devices.vehicle import GNSS_X_M, DriverInput, Moved
from lgprjax.simulation.devices.world import CourseWorld, Sample
from lgprjax.vehicle.kinematics import straight_slope
from lgprjax.vehicle.sensors import Potentiometer, read_potentiometer
from lgprjax.wire import Frame, Value

# A u-blox receiver with INS: NAV-PVT, NAV-ATT and ESF-INS, built by pyubx2.

WEEK_S = 604_800
POSITION_LATENCY_NS, ATTITUDE_LATENCY_NS = 30_000_000, 5_000_000
"""Latency from a measurement to the sending of its message."""
_EPOCH = datetime.datetime(1980, 1, 6)  # GPS time is no zone's
_LEAP_S = 18.0


class GnssFix(NamedTuple):
    """A fix: WGS-84 of the antenna, speed over ground, and how good; solution: 2 fixed, 1 float, 0 single."""

    latitude_deg: float
    longitude_deg: float
    height_m: float
    speed_mps: float
    course_deg: float
    sigma_m: float
    solution: int


class InsReading(NamedTuple):
    """Reading of the INS: roll (right side down), compass heading, yaw rate counter-clockwise, acceleration forward.

    ``valid``: else the fields are marked as not to be used.
    """

    roll_rad: float
    heading_deg: float
    yaw_rate_radps: float
    acceleration_mps2: float
    speed_mps: float
    valid: bool


class GnssClock:
    """GNSS time as the receiver shows it.

    Args:
        offset_s: GNSS time since its epoch, s, when the world's clock shows 0.
    """

    def __init__(self, offset_s: float) -> None:
        self.offset_s = offset_s

    def time_s(self, now_ns: int) -> float:
        """GNSS time since its epoch."""
        return self.offset_s + 1e-9 * now_ns

    def itow_ms(self, now_ns: int) -> int:
        """Time of week."""
        return round(1e3 * self.time_s(now_ns)) % (1000 * WEEK_S)


def position_message(clock: GnssClock, time_ns: int, fix: GnssFix) -> bytes:
    """NAV-PVT of a moment of the world's clock."""
    moment = _EPOCH + datetime.timedelta(seconds=clock.time_s(time_ns) - _LEAP_S)
    sigma_mm = round(1e3 * fix.sigma_m)
    # pyubx2 takes degrees where UBX scales them; every other field in UBX's own units.
    message = UBXMessage(
        "NAV",
        "NAV-PVT",
        GET,
        iTOW=clock.itow_ms(time_ns),
        year=moment.year,
        month=moment.month,
        day=moment.day,
        hour=moment.hour,
        min=moment.minute,
        second=moment.second,
        validDate=1,
        validTime=1,
        fullyResolved=1,
        nano=1000 * moment.microsecond,
        fixType=3,
        gnssFixOk=1,
        diffSoln=int(fix.solution > 0),
        carrSoln=fix.solution,
        numSV=18,
        lon=fix.longitude_deg,
        lat=fix.latitude_deg,
        height=round(1e3 * fix.height_m),
        hMSL=round(1e3 * fix.height_m),
        hAcc=sigma_mm,
        vAcc=2 * sigma_mm,
        gSpeed=round(1e3 * fix.speed_mps),
        headMot=fix.course_deg,
        sAcc=50,
        headAcc=2.0,
    )
    return bytes(message.serialize())


def attitude_messages(clock: GnssClock, time_ns: int, attitude: InsReading) -> bytes:
    """NAV-ATT and ESF-INS of a moment of the world's clock; UBX's body axes are x forward, y right, z down."""
    itow_ms = clock.itow_ms(time_ns)
    valid = int(attitude.valid)
    degree = 57.29577951308232
    told = UBXMessage(
        "NAV",
        "NAV-ATT",
        GET,
        iTOW=itow_ms,
        version=0,
        roll=degree * attitude.roll_rad if valid else 0.0,
        heading=attitude.heading_deg if valid else 0.0,
        # UBX value for unknown: half a turn.
        accRoll=0.1 if valid else 180.0,
        accPitch=0.1 if valid else 180.0,
        accHeading=0.13 if valid else 180.0,
    )
    rates = UBXMessage(
        "ESF",
        "ESF-INS",
        GET,
        version=1,
        xAngRateValid=0,
        yAngRateValid=0,
        zAngRateValid=valid,
        xAccelValid=valid,
        yAccelValid=valid,
        zAccelValid=0,
        iTOW=itow_ms,
        zAngRate=-degree * attitude.yaw_rate_radps if valid else 0.0,
        xAccel=attitude.acceleration_mps2 if valid else 0.0,
        yAccel=-attitude.speed_mps * attitude.yaw_rate_radps if valid else 0.0,
    )
    return bytes(told.serialize() + rates.serialize())


INS_PERIOD_S = 0.02
_POTENTIOMETER_SIGMA_V, _TORQUE_SIGMA_NM, _PEDAL_SIGMA, _SUPPLY_SIGMA_V = 0.002, 0.15, 0.002, 0.02
_OPEN_V, _SHORT_V = 5.5, 0.0
_SHOWN_SIGMA_M = {2: 0.014, 1: 0.4, 0: 2.5}
_EXTRA = {1: (0.3, 20.0), 0: (1.5, 60.0)}
"""Sigma (m) and time constant (s) of the additional error of float and single solutions."""


class Sensing:
    """Sensors of the vehicle.

    Args:
        true: true vehicle.
        sensors: properties of the navigation sensors.
        world: world of the vehicle.
        faults: running faults.
        seed: seed of the noise.
    """

    def __init__(
        self, true: TrueVehicle, sensors: LiveSensors, world: CourseWorld, faults: RunningFaults, seed: int
    ) -> None:
        self._true, self._world, self._faults = true, world, faults
        self._rng = np.random.default_rng([seed, 51])
        self._potentiometer = Potentiometer(
            true.potentiometer_straight_v, true.potentiometer_per_rad_v, 1.5 * true.largest_angle_rad
        )
        self._zero_counts = int(self._rng.integers(-100_000, 100_000))
        self._rate_sigma = float(sensors.yaw_rate_noise) / INS_PERIOD_S**0.5
        self._heading_sigma_rad = float(sensors.heading_sigma_rad)
        self._odometer_sigma_mps = float(sensors.odometer_mps)
        self._gnss_period_s = int(sensors.gnss_ticks) * world.tick_s
        self._extra_m = np.zeros(2)

    def measured(self, sample: Sample, hands: DriverInput) -> Measured:
        """Readings of the drive-by-wire box's sensors."""
        faults, noise = self._faults, self._rng.normal(size=6)
        volts = float(read_potentiometer(self._potentiometer, np.asarray(self._steering_rad(sample.front_rad))))
        volts += _POTENTIOMETER_SIGMA_V * noise[0]
        volts = faults.hold("potentiometer_stuck", volts)
        volts = _OPEN_V if faults.has("potentiometer_open") else volts
        volts = _SHORT_V if faults.has("potentiometer_short") else volts
        counts = self._zero_counts + self._true.encoder_counts_per_rad * self._steering_rad(sample.motor_rad)
        gain = sample.odometer_gain
        return Measured(
            potentiometer_v=float(volts),
            encoder_counts=round(counts + faults.number("encoder_offset", "counts", 0.0)),
            supply_v=sample.supply_v + _SUPPLY_SIGMA_V * noise[1],
            torque_nm=hands.torque_nm + _TORQUE_SIGMA_NM * noise[2],
            pedals=hands.foot_on_brake,
            throttle=float(np.clip(sample.throttle + _PEDAL_SIGMA * noise[3], 0.0, 1.0)),
            brake=float(np.clip(sample.brake + _PEDAL_SIGMA * noise[4], 0.0, 1.0)),
            odometer_m=sample.odometer_m,
            speed_mps=gain * sample.speed_mps
            + (self._odometer_sigma_mps * noise[5] if gain and sample.speed_mps else 0.0),
        )

    def _steering_rad(self, wheel_rad: float) -> float:
        """Angle of the steering shaft, scaled to the wheels', at a wheel angle."""
        linkage = self._true.linkage
        if linkage is None:
            return wheel_rad
        shaft = np.arcsin(linkage.arm_m / linkage.crank_m * np.sin(wheel_rad)) / linkage.gear
        return float(shaft * straight_slope(linkage))

    def attitude(self, before: Sample, after: Sample) -> InsReading:
        """Reading of the INS after one of its periods."""
        faults, noise = self._faults, self._rng.normal(size=2)
        rate = (after.yaw_rad - before.yaw_rad) / INS_PERIOD_S
        rate += after.rate_bias_radps + self._rate_sigma * noise[0] + faults.number("ins_bias", "radps", 0.0)
        yaw = after.yaw_rad + after.heading_slow_rad + self._heading_sigma_rad * noise[1]
        yaw += faults.number("ins_bias", "rad", 0.0) + (np.pi if faults.has("heading_reversed") else 0.0)
        told = InsReading(
            after.roll_rad,
            self._world.heading_deg(yaw, after.x_m),
            rate,
            (after.speed_mps - before.speed_mps) / INS_PERIOD_S,
            after.speed_mps,
            not faults.has("ins_nan"),
        )
        return faults.hold("ins_stuck", told)

    def position(self, moved: Moved) -> GnssFix:
        """Reading of the receiver for its antenna."""
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
        told = GnssFix(
            latitude_deg=latitude,
            longitude_deg=longitude,
            height_m=height,
            speed_mps=abs(moved.speed_mps),
            course_deg=self._world.heading_deg(moved.yaw_rad, moved.x_m),
            sigma_m=_SHOWN_SIGMA_M[solution],
            solution=solution,
        )
        return faults.hold("gnss_stuck", told)

    def scan(self, data: Shaped[np.ndarray, "row number"]) -> Shaped[np.ndarray, "row number"]:
        """The radar's data of a scan, see ``RecordedScan``."""
        if np.iscomplexobj(data):
            return self._sweeps(data)
        if self._faults.has("radar_garbage"):
            return self._rng.integers(0, 256, data.shape, dtype=np.uint8)
        share = self._faults.number("radar_faded", "share", 1.0)
        if share == 1.0:
            return data
        signal = data.astype(np.float64) - 128.0
        # The receiver's gain compensates: lost signal is replaced by noise.
        noise = np.sqrt(max(1.0 - share**2, 0.0)) * signal.std() * self._rng.normal(size=data.shape)
        return np.asarray(np.clip(np.round(128.0 + share * signal + noise), 0.0, 255.0), np.uint8)

    def _sweeps(self, data: Complex64[np.ndarray, "row frequency"]) -> Complex64[np.ndarray, "row frequency"]:
        """The same for sweeps; the path of the calibration channel, the last row, has no antenna that could fade."""
        if self._faults.has("radar_garbage"):
            return self._white(data.shape, float(np.abs(data).max()))
        share = self._faults.number("radar_faded", "share", 1.0)
        if share == 1.0:
            return data
        heard = data[:-1]
        noise = self._white(heard.shape, float(np.sqrt(max(1.0 - share**2, 0.0)) * heard.std()))
        return np.concatenate([np.float32(share) * heard + noise, data[-1:]])

    def _white(self, shape: tuple[int, ...], rms: float) -> Complex64[np.ndarray, "row frequency"]:
        parts = self._rng.normal(scale=rms * np.sqrt(0.5), size=(*shape, 2)).astype(np.float32)
        return parts.view(np.complex64)[..., 0]


# The radar's box: obeys start, stop, calibrate and look-up, describes itself, sends scans when they are due.

_TEMPERATURE_C = 34.0
_BUSY_NS = 1_000_000_000
"""Duration of calibration and of the look-up recording."""
PROCESSING_NS = 4_000_000
"""Time from a scan's end to its first byte."""


class RadarState(IntEnum):
    """State of the radar in ``radar_health``."""

    IDLE = 0
    SCANNING = 1
    CALIBRATING = 2
    LOOKING_UP = 3
    FAILED = 4


class RecordedScan(NamedTuple):
    """A scan of the world: its number there, when it began, and its traces as bytes, or its sweeps, the calibration
    channel last; ``None`` where it was lost.
    """

    number: int
    stamp_ns: int
    data: UInt8[np.ndarray, "channel sample"] | Complex64[np.ndarray, "row frequency"] | None


class SweepForm(NamedTuple):
    """Frequencies of a stepped-frequency radar, and its recording of empty space."""

    plan: SweepPlan
    lookup: Complex64[np.ndarray, "row frequency"]

    def scan(self, rows: Complex64[np.ndarray, "row frequency"]) -> dict[str, Value]:
        """Fields of radar_sweep: counts of a converter of up to 16 bits."""
        step = self.plan.step
        counts = np.round(_parts(rows) / step).clip(-(2**15), 2**15 - 1).astype("<i2")
        return {"rows": rows.shape[0], "steps": rows.shape[1], "width": 4, "scale": step, "data": counts.tobytes()}

    def description(self, channels: int, scan_period_us: int) -> dict[str, Value]:
        """Fields of radar_sweep_description."""
        plan = self.plan
        return {
            "channels": channels,
            "steps": plan.steps,
            "first_khz": round(1e3 * plan.first_mhz),
            "step_khz": round(1e3 * plan.step_mhz),
            "group_delay_ps": round(1e3 * plan.calibration_delay_ns),
            "scan_period_us": scan_period_us,
        }

    def empty(self) -> dict[str, Value]:
        """Fields of radar_lookup: means of many scans, finer than a count."""
        rows, data = self.lookup, _parts(self.lookup).astype("<f4")
        return {"rows": rows.shape[0], "steps": rows.shape[1], "width": 8, "scale": 1.0, "data": data.tobytes()}


def _parts(rows: Complex64[np.ndarray, "row frequency"]) -> Shaped[np.ndarray, "row frequency 2"]:
    return np.stack([rows.real, rows.imag], axis=-1)


class RadarBox:
    """Logic of the radar box; times are arguments in nanoseconds of the world's clock.

    Args:
        sender: sender of the box's frames.
        radar: time axis of the scans.
        channels: number of channels per scan.
        period_s: period of the scans.
        sweeps: form of a stepped-frequency radar's scans; ``None``: finished traces.
    """

    def __init__(
        self,
        sender: DeviceSender,
        radar: RadarConfig,
        channels: int,
        period_s: float,
        sweeps: SweepForm | None = None,
    ) -> None:
        self.state = RadarState.IDLE
        self.dropped, self.errors = 0, 0
        self._sender, self._radar, self._channels, self._period_s = sender, radar, channels, period_s
        self._sweeps = sweeps
        self._listener = HostListener("radar")
        self._begun_ns: int | None = None
        self._first: int | None = None
        self._every, self._base, self._next = 1, 0, 0
        self._busy_since_ns = 0
        self._waiting: deque[RecordedScan] = deque()

    def receive(self, data: bytes, now_ns: int) -> None:
        """Bytes that came over the line."""
        for frame in self._listener.feed(data, now_ns):
            if frame.name == "radar_command":
                self._obey(frame, now_ns)

    def forget_line(self) -> None:
        """Another host has connected."""
        self._listener.reconnect()

    def put(self, scans: list[RecordedScan]) -> None:
        """Scans of the world, in their order; those of before the start are left."""
        for scan in scans:
            if self.state is not RadarState.SCANNING or self._begun_ns is None or scan.stamp_ns < self._begun_ns:
                continue
            if self._first is None:
                self._first = scan.number
            count, between = divmod(scan.number - self._first, self._every)
            if between == 0:
                self._next = self._base + count + 1
                self._waiting.append(scan._replace(number=self._base + count))

    def due(self, now_ns: int, late_ns: int = 0) -> list[tuple[int, bytes]]:
        """Scan frames whose time has come, each with when it was due; ``late_ns`` later than a sound radar's."""
        self._let_time_pass(now_ns)
        frames = []
        wait_ns = round(1e9 * self._period_s) + PROCESSING_NS + late_ns
        while self._waiting and self._waiting[0].stamp_ns + wait_ns <= now_ns:
            scan = self._waiting.popleft()
            if scan.data is None:
                self.dropped += 1
                continue
            fields: dict[str, Value] = {"scan": scan.number, "valid": (1 << self._channels) - 1}
            if self._sweeps is None:
                channels, samples = scan.data.shape
                fields |= {"channels": channels, "samples": samples, "data": scan.data.tobytes()}
                frame = self._frame("radar_scan", fields, scan.stamp_ns)
            else:
                frame = self._frame("radar_sweep", {**fields, **self._sweeps.scan(scan.data)}, scan.stamp_ns)
            frames.append((scan.stamp_ns + wait_ns, frame))
        return frames

    def health(self, due_ns: int) -> bytes:
        """The health frame of a moment."""
        fields = {
            "state": int(self.state),
            "errors": self.errors,
            "temperature_c": _TEMPERATURE_C,
            "dropped": self.dropped,
        }
        return self._frame("radar_health", fields, due_ns)

    def descriptions(self, due_ns: int) -> list[bytes]:
        """The description of its scans; of sweeps, and their look-up."""
        radar, period_us = self._radar, round(1e6 * self._period_s * self._every)
        if self._sweeps is not None:
            described = self._frame(
                "radar_sweep_description", self._sweeps.description(self._channels, period_us), due_ns
            )
            return [described, self._frame("radar_lookup", self._sweeps.empty(), due_ns)]
        fields = {
            "channels": self._channels,
            "samples": radar.samples,
            "sample_interval_ps": round(1e3 * radar.sample_step_ns),
            "time_zero_ps": round(1e3 * radar.time_zero_ns),
            "zero_level": 128.0,
            "scan_period_us": period_us,
        }
        return [self._frame("radar_description", fields, due_ns)]

    def _frame(self, name: str, fields: Mapping[str, Value], stamp_ns: int) -> bytes:
        return self._sender.frame(name, fields, mode=self._listener.mode, mono_ns=stamp_ns)

    def _obey(self, frame: Frame, now_ns: int) -> None:
        action, period_us = frame.number("action"), frame.number("scan_period_us")
        if action == 0:
            self.state = RadarState.IDLE
            self._waiting.clear()
        elif action == 1:
            every = max(round(period_us / (1e6 * self._period_s)), 1)
            if self.state is not RadarState.SCANNING:
                self._begun_ns, self._first, self._base, self._next = now_ns, None, 0, 0
            elif every != self._every:
                # The start has been before: numbers go on from it at the other period.
                self._first, self._base = None, self._next
            self._every = every
            self.state = RadarState.SCANNING
        elif action in (2, 3) and self.state is RadarState.IDLE:
            self.state = RadarState.CALIBRATING if action == 2 else RadarState.LOOKING_UP
            self._busy_since_ns = now_ns

    def _let_time_pass(self, now_ns: int) -> None:
        busy = self.state in (RadarState.CALIBRATING, RadarState.LOOKING_UP)
        if busy and now_ns - self._busy_since_ns >= _BUSY_NS:
            self.state = RadarState.IDLE


# The lines between devices and host, with what goes wrong on them.

LINES = ("drive_by_wire", "controller", "gnss", "radar")


class Lines:
    """Effects of faulty lines on bytes.

    Args:
        faults: running faults.
        seed: seed of the damage.
    """

    def __init__(self, faults: RunningFaults, seed: int) -> None:
        self._faults = faults
        self._rng = np.random.default_rng([seed, 52])
        self._repeated: dict[str, bytes] = {}

    def out(self, line: str, data: bytes) -> bytes:
        """A device's bytes as they reach the host; empty if the line is silent."""
        if self._faults.on_line("line_silent", line):
            return b""
        return self._damaged(line, data)

    def into(self, line: str, data: bytes) -> bytes:
        """The host's bytes as they reach a device; a repeating line delivers its first bytes again and again."""
        if self._faults.on_line("line_silent", line):
            return b""
        if self._faults.on_line("line_repeat", line):
            data = self._repeated.setdefault(line, data)
        else:
            self._repeated.pop(line, None)
        return self._damaged(line, data)

    def repeats(self, line: str) -> bool:
        """Whether the counter of a line's frames is stuck."""
        return self._faults.on_line("line_repeat", line)

    def _damaged(self, line: str, data: bytes) -> bytes:
        if not self._faults.on_line("line_corrupt", line) or not data:
            return data
        changed = bytearray(data)
        changed[int(self._rng.integers(len(changed)))] ^= int(self._rng.integers(1, 256))
        return bytes(changed)
