"""The simulated devices of a counter-steered vehicle with a radar on a course."""

from collections import deque
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import Field

from lgprjax.config import TableKey
from lgprjax.simulation.devices.boxes import DriveBox
from lgprjax.simulation.devices.faults import FAULTS
from lgprjax.simulation.devices.sensors import (
    ATTITUDE_LATENCY_NS,
    INS_PERIOD_S,
    LINES,
    POSITION_LATENCY_NS,
    RadarBox,
    RadarState,
    RecordedScan,
    Sensing,
    SweepForm,
    attitude_messages,
    position_message,
)
from lgprjax.simulation.devices.stage import Stage, StageKind, StageSpec, Ticker
from lgprjax.simulation.devices.vehicle import (
    BUTTONS,
    GNSS_SLOW_M,
    SCRIPT,
    SCRIPT_LASTS_S,
    Body,
    Driver,
    DriverInput,
    HandDriver,
    Moved,
    Truth,
)
from lgprjax.simulation.devices.world import GAIN_DRIFT, CourseWorld, Sample, Trajectory
from lgprjax.simulation.vehicle_plans import MANOEUVRES, stand_still, true_vehicle
from lgprjax.wire import Sender, Value, decode

# Specification of a run of the devices on a course.


class CourseSpec(StageSpec):
    """Specification of a run of the devices on a course; see ``StageSpec``.

    Attributes:
        seed, length_m, scan_share: parameters of the course, see ``OffRoad``.
        weather: weather of the day.
        drive_seed: seed of the day and of all errors.
        recording: kind of the radar's data: finished traces, or stepped-frequency sweeps.
        gain_drift: drift of the receiver's gain, see ``CourseWorld``.
        in_view: view of a radar that records sweeps: the ground, empty space, or a metal plate.
        gnss_slow_m: standard deviation per axis of the slow position error in the map's frame.
        map: path of the course's map, which gives the frame of poses; "": the site's own frame.
        host: task of the host: drive, record, or record without a radar; times of the script count from its start.
        start_m: start position of the vehicle along the baseline.
        vehicle: numbers of ``TrueVehicle`` that differ from its defaults.
        manoeuvre: kind (or "stand") and numbers of a calibration manoeuvre driven by hand on level ground, see
            ``MANOEUVRES`` of ``vehicle_plans``; empty: the course is driven.
    """

    seed: int
    length_m: float = Field(gt=0.0)
    scan_share: Literal[1, 2, 3, 4, 5, 6] = 1
    weather: Literal["clear", "snow", "rain", "frost", "years", "repaired"] = "clear"
    drive_seed: int
    recording: Literal["traces", "sweeps"] = "traces"
    gain_drift: float = Field(default=GAIN_DRIFT, ge=-0.9, le=10.0)
    in_view: Literal["ground", "empty", "plate"] = "ground"
    gnss_slow_m: float = Field(default=GNSS_SLOW_M, ge=0.0, le=10.0)
    map: str = ""
    host: Literal["drive", "record", "record_without_radar"] = "drive"
    start_m: float = Field(default=2.0, ge=0.0)
    vehicle: dict[str, Any] = Field(default_factory=dict)
    manoeuvre: dict[str, Any] = Field(default_factory=dict)


# A fault: another source commands the drive-by-wire box too.

_WANTS: dict[str, Value] = {"front_rad": 0.35, "throttle": 0.5, "brake": 0.0, "engage": 3}
_SPEED_ENGAGED, _SECOND_TTL_MS = 4, 200


_INS_NS = round(1e9 * INS_PERIOD_S)


class Tick(NamedTuple):
    """A tick whose scans are to be rendered: its number, its begin, and the truth at its ends."""

    number: int
    begin_ns: int
    before: Sample
    after: Sample


_KIND = StageKind(LINES, SCRIPT, SCRIPT_LASTS_S, BUTTONS, FAULTS)


class CourseStage(Stage[DriveBox, Tick]):
    """A counter-steered vehicle with a radar on a course; see ``Stage``.

    Args:
        spec: specification of the run.
        world: world of the course.
        file: file of the specification, for messages.
        begin_ns: start time of the world.

    Raises:
        InputError: the spec's script or faults cannot be used.
    """

    truth: Truth

    def __init__(self, spec: CourseSpec, world: CourseWorld, file: Path, begin_ns: int) -> None:
        seed = spec.drive_seed
        super().__init__(_KIND, spec, file, begin_ns, tick_ns=1e9 * world.tick_s, box=DriveBox, seed=seed)
        true = true_vehicle(spec.vehicle, TableKey(file, "vehicle"), world.laid.spec.array_x_m)
        self.world, self._host = world, spec.host
        self._body = Body(true, world, world.start(spec.start_m), self.faults, seed, spec.gnss_slow_m)
        self._sensing = Sensing(true, self._body.vehicle.sensors, world, self.faults, seed)
        self._driver: Driver | HandDriver = Driver(true, world.laid.spec.array_x_m, world.baseline_m)
        if spec.manoeuvre:
            numbers = {name: value for name, value in spec.manoeuvre.items() if name != "kind"}
            known = MANOEUVRES.get(spec.manoeuvre["kind"])
            made = stand_still() if known is None else known.make(true, numbers)
            self._driver = HandDriver(true, made, world.tick_s)
        self.truth = Truth(true, world.laid.spec.array_x_m, world.baseline_m)
        channels, sweeps, form = len(world.laid.array.x_m), world.laid.spec.sweeps, None
        if sweeps is not None:
            assert world.lookup is not None
            form = SweepForm(sweeps, world.lookup)
        self.radar = RadarBox(self._senders["radar"], world.radar, channels, world.scan_period_s, form)
        self._second = Sender(int(self._rng.integers(1, 1 << 32)))
        self._hands = DriverInput(
            front_rad=0.0, throttle=0.0, brake=0.0, foot_on_brake=False, torque_nm=0.0, buttons=frozenset()
        )
        self.latest_s["scan"] = 0.0
        self._positions: deque[tuple[int, Moved]] = deque(maxlen=64)
        self._known = Trajectory()
        self._known.add(begin_ns, self._body.sample)
        self._drive, self._ins, self._health, self._described, self._foreign = (
            Ticker(begin_ns, period_ns) for period_ns in (10_000_000, _INS_NS, 100_000_000, 1_000_000_000, 20_000_000)
        )

    @property
    def finished(self) -> bool:
        """Whether the driver has driven a manoeuvre to its end."""
        return isinstance(self._driver, HandDriver) and self._driver.finished

    def tick(self) -> Tick:
        """Move the vehicle by a tick, with the host's messages up to its start."""
        number, begin_ns = self._ticks, self.next_ns
        before = self._body.sample
        with self._lock:
            running = self._begin_tick(before.travel_m)
            self.drive_box.sense(begin_ns, before.speed_mps, before.brake, before.supply_v)
            orders = self.drive_box.orders(begin_ns)
            command, held = self.drive_box.command, self.drive_box.held
            self._hands = self._driver.step(running, before, orders)
        turned = self._body.step(orders, self._hands)
        with self._lock:
            self._known.add(self.next_ns, turned.sample)
            if turned.moved.gnss_valid:
                self._positions.append((self.next_ns, turned.moved))
        self.truth.add(self.next_ns, turned.sample, turned.acting, command, held)
        return Tick(number, begin_ns, before, turned.sample)

    def render(self, tick: Tick) -> None:
        """Record the scans of a tick, where the radar scans."""
        if self.radar.state is not RadarState.SCANNING or self.faults.has("radar_missing"):
            return
        before, after = (np.array(sample[:3]) for sample in (tick.before, tick.after))
        number = tick.number * self.world.scans_a_tick
        shift_m = self.faults.pair("radar_wrong_place", "m")
        scans = self.world.record(number, before, after, tick.before.along_m, shift_m)
        self.put_scans(tick, [None if data is None else self._sensing.scan(data) for data in scans])

    def put_scans(self, tick: Tick, scans: list[np.ndarray | None]) -> None:
        """Give the radar a tick's scans; ``None`` for those that were lost."""
        first = tick.number * self.world.scans_a_tick
        period_ns = 1e9 * self.world.scan_period_s
        rows = [RecordedScan(first + at, tick.begin_ns + round(at * period_ns), data) for at, data in enumerate(scans)]
        with self._lock:
            self.radar.put(rows)

    def skip(self, tick: Tick) -> int:
        """Leave out a tick's scans, and return their number."""
        self.put_scans(tick, [None] * self.world.scans_a_tick)
        return self.world.scans_a_tick

    def renew(self) -> None:
        """Another host has connected to the radar."""
        self.radar.forget_line()

    def warm(self) -> None:
        """Have the radar scan: what renders is compiled then, too."""
        self.radar.state = RadarState.SCANNING

    @property
    def _host_ready(self) -> bool:
        if self._host == "drive":
            return super()._host_ready
        return self._host == "record_without_radar" or self.radar.state is RadarState.SCANNING

    @property
    def _buttons_held(self) -> frozenset[str]:
        return self._hands.buttons

    def _deliver(self, line: str, data: bytes, now_ns: int) -> None:
        if line == "radar":
            self.radar.receive(data, now_ns)
        else:
            super()._deliver(line, data, now_ns)

    def _due(self, now_ns: int) -> list[tuple[str, bytes]]:
        told: list[tuple[str, bytes]] = []
        for due_ns in self._foreign.due(now_ns):
            if self.faults.has("second_master"):
                frame = self._second.frame(
                    "drive_command", _WANTS, mode=_SPEED_ENGAGED, mono_ns=due_ns, ttl_ms=_SECOND_TTL_MS
                )
                self.drive_box.take([decode(frame)], now_ns)
        # Unknown data are not sent yet: a late world sends late, never wrong data.
        for due_ns in self._drive.due(min(now_ns, self._known.known_ns)):
            self._note("status", now_ns - due_ns)
            measured = self._sensing.measured(self._known.at(due_ns), self._hands)
            told.append(("drive_by_wire", self.drive_box.status(due_ns, measured)))
        told += [("gnss", data) for data in self._navigation(now_ns)]
        for due_ns in self._described.due(now_ns):
            told += [("radar", frame) for frame in self.radar.descriptions(due_ns)]
        self.radar.errors = int(self.faults.number("radar_errors", "bits", 0.0))
        told += [("radar", self.radar.health(due_ns)) for due_ns in self._health.due(now_ns)]
        slow_ns = round(1e9 * self.faults.number("radar_slow", "s", 0.0))
        for due_ns, frame in self.radar.due(now_ns, slow_ns):
            self._note("scan", now_ns - due_ns)
            told.append(("radar", frame))
        return told

    def _navigation(self, now_ns: int) -> list[bytes]:
        told = []
        while self._positions and self._positions[0][0] + POSITION_LATENCY_NS <= now_ns:
            time_ns, moved = self._positions.popleft()
            fix = self._sensing.position(moved)
            if not self.faults.has("gnss_off"):
                told.append(position_message(self._clock, time_ns, fix))
        for time_ns in self._ins.due(min(now_ns - ATTITUDE_LATENCY_NS, self._known.known_ns)):
            attitude = self._sensing.attitude(self._known.at(time_ns - _INS_NS), self._known.at(time_ns))
            if not self.faults.has("ins_off"):
                told.append(attitude_messages(self._clock, time_ns, attitude))
        return told
