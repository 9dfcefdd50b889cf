"""All simulated devices of a counter-steered vehicle: bytes and time in, frames out."""

import json
import threading
from collections import deque
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np
from pydantic import BaseModel, ConfigDict, Field, ValidationError

from lgprjax.errors import InputError
from lgprjax.scene.vehicle_drive import TrueVehicle
from lgprjax.simulation.devices.boxes import (
    OVERRIDE_FIRST,
    OVERRIDE_SECOND,
    ControllerBox,
    DeviceSender,
    DriveBox,
    buttons_of,
)
from lgprjax.simulation.devices.faults import (
    FAULT_LASTS_S,
    FAULTS,
    READY_MODE,
    Moment,
    RunningFaults,
    Schedule,
    ScriptItem,
    check_choice,
    read_items,
)
from lgprjax.simulation.devices.sensors import (
    ATTITUDE_LATENCY_NS,
    INS_PERIOD_S,
    LINES,
    POSITION_LATENCY_NS,
    WEEK_S,
    GnssClock,
    Lines,
    RadarBox,
    RadarState,
    RecordedScan,
    Sensing,
    attitude_messages,
    position_message,
)
from lgprjax.simulation.devices.vehicle import BUTTONS, SCRIPT, SCRIPT_LASTS_S, Body, Driver, DriverInput, Moved, Truth
from lgprjax.simulation.devices.world import CourseWorld, Sample, Trajectory
from lgprjax.wire import Sender, Value, decode

# What a run of the devices is asked for: SPEC.json.


class StageSpec(BaseModel):
    """A run of the devices. Paths are as the program's working folder has them.

    Attributes:
        seed, length_m, scan_share: of the course, see ``OffRoad``.
        weather: of the day.
        drive_seed: of the day and of all errors.
        map: the course's map, whose frame poses are in.
        ports: where the devices' addresses are written to.
        truth: where the truth is written to at the end.
        script: what the driver does.
        faults: what goes wrong.
        start_m: way along the baseline at which the vehicle stands.
        rate: world's seconds in one of the computer's.
    """

    model_config = ConfigDict(extra="forbid", frozen=True)

    seed: int
    length_m: float = Field(gt=0.0)
    scan_share: Literal[1, 2, 3, 4, 5, 6] = 1
    weather: Literal["clear", "snow", "rain", "frost", "years", "repaired"] = "clear"
    drive_seed: int
    map: str
    ports: str
    truth: str
    script: list[dict[str, Any]] = []
    faults: list[dict[str, Any]] = []
    start_m: float = Field(default=2.0, ge=0.0)
    rate: float = Field(default=1.0, gt=0.0, le=10.0)


def read_spec(path: Path) -> StageSpec:
    """A spec from its file.

    Raises:
        InputError: it is missing, no JSON, or a key is unknown, missing or not as expected.
    """
    try:
        return StageSpec.model_validate(json.loads(path.read_text(encoding="utf-8")))
    except OSError as error:
        raise InputError(path, "file", "a readable file", error.strerror or str(error)) from None
    except ValidationError as error:
        first = error.errors()[0]
        place = ".".join(str(part) for part in first["loc"])
        raise InputError(path, place, first["msg"], repr(first["input"])[:60]) from None
    except ValueError as error:
        raise InputError(path, "file", "JSON", str(error)) from None


# Something that falls due again and again.

_LATEST_NS = 100_000_000
"""What fell due longer ago is left out, as a device has no queue."""


class Ticker:
    """Moments at an even distance.

    Args:
        first_ns, period_ns: of them.
    """

    def __init__(self, first_ns: int, period_ns: int) -> None:
        self._next_ns, self._period_ns = first_ns, period_ns

    def due(self, now_ns: int) -> list[int]:
        """Those that have come since the last call."""
        times = []
        while self._next_ns <= now_ns:
            if now_ns - self._next_ns <= _LATEST_NS:
                times.append(self._next_ns)
            self._next_ns += self._period_ns
        return times


# A fault: somebody else commands the drive-by-wire box too.

_WANTS: dict[str, Value] = {"front_rad": 0.35, "throttle": 0.5, "brake": 0.0, "engage": 3}
_SPEED_ENGAGED, _SECOND_TTL_MS = 4, 200


_INS_NS = round(1e9 * INS_PERIOD_S)


class Tick(NamedTuple):
    """A tick whose scans are to be rendered: its number, its begin, and the truth at its ends."""

    number: int
    begin_ns: int
    before: Sample
    after: Sample


class Stage:
    """The devices and their world. Times are nanoseconds of the world's clock, passed in.

    ``latest_s`` says how late a scan, or a status, was sent at the worst.

    ``tick`` and ``render`` belong to one thread, ``receive`` and ``emit`` may belong to another.

    Args:
        spec: what is asked for.
        world: its course.
        file: where it was read, for messages.
        begin_ns: when the world begins.

    Raises:
        InputError: the spec's script or faults cannot be used.
    """

    def __init__(self, spec: StageSpec, world: CourseWorld, file: Path, begin_ns: int) -> None:
        seed = spec.drive_seed
        rng = np.random.default_rng([seed, 53])
        true = TrueVehicle(array_x_m=world.laid.spec.array_x_m)
        assert isinstance(true.rear, float)
        self.world, self.begin_ns = world, begin_ns
        self.faults = RunningFaults()
        self._script, self._wrong, rolls_over_s = _read_schedules(spec, file)
        self._body = Body(true, world, world.start(spec.start_m), self.faults, seed)
        self._sensing = Sensing(true, self._body.vehicle.sensors, world, self.faults, seed)
        self._driver = Driver(true, world.laid.spec.array_x_m, world.baseline_m)
        self.truth = Truth(true.rear, world.laid.spec.array_x_m, world.baseline_m)
        self._senders = {
            line: DeviceSender(int(rng.integers(1, 1 << 32)), int(rng.integers(1, 1 << 40))) for line in LINES
        }
        self.drive_box = DriveBox(self._senders["drive_by_wire"])
        self.controller = ControllerBox(self._senders["controller"])
        self.radar = RadarBox(self._senders["radar"], world.radar, len(world.laid.array.x_m), world.scan_period_s)
        self._second = Sender(int(rng.integers(1, 1 << 32)))
        self._lines = Lines(self.faults, seed)
        self._clock_s = 2400.0 * WEEK_S + float(rng.uniform(0.1, 0.8)) * WEEK_S - 1e-9 * begin_ns
        if rolls_over_s is not None:
            self._clock_s = 2401.0 * WEEK_S - rolls_over_s - 1e-9 * begin_ns
        self._clock = GnssClock(self._clock_s)
        self._hands = DriverInput(0.0, 0.0, 0.0, foot_on_brake=False, torque_nm=0.0, buttons=frozenset())
        self._ticks = 0
        self.latest_s = dict.fromkeys(("scan", "status"), 0.0)
        self._tick_ns = 1e9 * world.tick_s
        self._ready_ns: int | None = None
        self._positions: deque[tuple[int, Moved]] = deque(maxlen=64)
        self._known = Trajectory()
        self._known.add(begin_ns, self._body.sample)
        self._lock = threading.Lock()
        self._drive, self._buttons, self._ins, self._health, self._described, self._foreign = (
            Ticker(begin_ns, period_ns)
            for period_ns in (10_000_000, 20_000_000, _INS_NS, 100_000_000, 1_000_000_000, 20_000_000)
        )

    @property
    def next_ns(self) -> int:
        """When the next tick begins."""
        return self.begin_ns + round(self._ticks * self._tick_ns)

    def tick(self) -> Tick:
        """Move the vehicle by a tick, under what the host said until its begin."""
        number, begin_ns = self._ticks, self.next_ns
        self._ticks += 1
        before = self._body.sample
        with self._lock:
            if self._ready_ns is None and self.drive_box.mode == READY_MODE:
                self._ready_ns = begin_ns
            moment = self._moment(begin_ns, before)
            self.faults.run(self._wrong.step(moment))
            self.drive_box.bus_off = self.faults.has("bus_off")
            self._clock.offset_s = self._clock_s + self.faults.number("time_step", "s", 0.0)
            self.drive_box.sense(begin_ns, before.speed_mps, before.brake, before.supply_v)
            orders = self.drive_box.orders(begin_ns)
            command, held = self.drive_box.command, self.drive_box.held
            running = self._script.step(moment)
            self._hands = self._driver.step(
                running, before.x_m, before.y_m, before.yaw_rad, before.speed_mps, has_pedals=not orders.pedals
            )
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
        """Leave a tick's scans out, and say how many they are."""
        self.put_scans(tick, [None] * self.world.scans_a_tick)
        return self.world.scans_a_tick

    def renew(self) -> None:
        """Another host has connected to the radar."""
        self.radar.forget_line()

    def warm(self) -> None:
        """Have the radar scan: what renders is compiled then, too."""
        self.radar.state = RadarState.SCANNING

    def receive(self, line: str, data: bytes, now_ns: int) -> None:
        """The host's bytes on a line."""
        with self._lock:
            told = self._lines.into(line, data)
            if line == "drive_by_wire":
                self.drive_box.receive(told, now_ns)
            elif line == "controller":
                self.controller.receive(told, now_ns)
            elif line == "radar":
                self.radar.receive(told, now_ns)

    def emit(self, now_ns: int) -> list[tuple[str, bytes]]:
        """What the devices send by now: (line, whole messages)."""
        with self._lock:
            for line, sender in self._senders.items():
                sender.stuck = self._lines.repeats(line)
            told: list[tuple[str, bytes]] = []
            for due_ns in self._foreign.due(now_ns):
                if self.faults.has("second_master"):
                    frame = self._second.frame(
                        "drive_command", _WANTS, mode=_SPEED_ENGAGED, mono_ns=due_ns, ttl_ms=_SECOND_TTL_MS
                    )
                    self.drive_box.take([decode(frame)], now_ns)
            # What is not known yet is not told: a world that is late tells it late, and never wrong.
            for due_ns in self._drive.due(min(now_ns, self._known.known_ns)):
                self._note("status", now_ns - due_ns)
                measured = self._sensing.measured(self._known.at(due_ns), self._hands)
                told.append(("drive_by_wire", self.drive_box.status(due_ns, measured)))
            told += [
                ("controller", self.controller.status(due_ns, self._pressed())) for due_ns in self._buttons.due(now_ns)
            ]
            told += [("gnss", data) for data in self._navigation(now_ns)]
            told += [("radar", self.radar.description(due_ns)) for due_ns in self._described.due(now_ns)]
            self.radar.errors = int(self.faults.number("radar_errors", "bits", 0.0))
            told += [("radar", self.radar.health(due_ns)) for due_ns in self._health.due(now_ns)]
            slow_ns = round(1e9 * self.faults.number("radar_slow", "s", 0.0))
            for due_ns, frame in self.radar.due(now_ns, slow_ns):
                self._note("scan", now_ns - due_ns)
                told.append(("radar", frame))
            sent = ((line, self._lines.out(line, data)) for line, data in told)
            return [(line, data) for line, data in sent if data]

    def _note(self, what: str, late_ns: int) -> None:
        self.latest_s[what] = max(self.latest_s[what], 1e-9 * late_ns)

    def _moment(self, now_ns: int, sample: Sample) -> Moment:
        box = self.drive_box
        since = None if self._ready_ns is None else 1e-9 * (now_ns - self._ready_ns)
        return Moment(1e-9 * now_ns, since, sample.travel_m, box.mode, 1e-9 * (now_ns - box.mode_since_ns))

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

    def _pressed(self) -> int:
        pressed = set(self._hands.buttons)
        pressed |= {"override"} if self.faults.has("override_stuck") else set()
        pressed |= {"estop"} if self.faults.has("estop_held") else set()
        bits = buttons_of(pressed)
        return bits & ~(OVERRIDE_FIRST | OVERRIDE_SECOND) if self.faults.has("override_wire_cut") else bits


def _read_schedules(spec: StageSpec, file: Path) -> tuple[Schedule, Schedule, float | None]:
    """Script, faults, and when GNSS weeks roll over, s after the world's begin."""
    script = read_items(file, "script", spec.script, key="do", known=SCRIPT, lasts_s=SCRIPT_LASTS_S)
    wrong = read_items(file, "faults", spec.faults, key="kind", known=FAULTS, lasts_s=FAULT_LASTS_S)
    check_choice(file, "script", script, "button", BUTTONS)
    check_choice(file, "faults", wrong, "line", LINES)
    rolls: list[ScriptItem] = [item for item in wrong if item.name == "week_rollover"]
    if rolls and rolls[0].at_s is None:
        raise InputError(file, "faults", "week_rollover with at_s", "another beginning")
    return Schedule(script), Schedule(wrong), rolls[0].at_s if rolls else None
