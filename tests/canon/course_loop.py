"""The runtime's control loop against the simulated devices in lock step: every byte of the lines, no real time.

Ports, supervisor and recorder are left out; parsers, receivers and the control loop are the vehicle's own. Fixes are
drawn about the truth, or come from the registration process's own search of rendered scans.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from lgprjax.autopilot import Mode
from lgprjax.registration import Code
from lgprjax.run_records import FIX, PLAN, Record, RecordKind, Source
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.core import AnyLoaded, ControlCore
from lgprjax.runtime.control.counter_steer import CounterSteer
from lgprjax.runtime.gnss import GnssParser
from lgprjax.simulation.devices.course_stage import CourseSpec, CourseStage
from lgprjax.simulation.devices.vehicle import GNSS_SLOW_M
from lgprjax.simulation.devices.world import CourseWorld
from lgprjax.wire import FrameParser, FrameVerdict, Receiver, RefusedBytes

BEGIN_NS = 7_000_000_000_000
TICK_NS = 20_000_000
_STEP_NS = 2_000_000
_FIX_LATE_NS = 25_000_000
_LINES = {"drive_by_wire": Source.DRIVE_BY_WIRE, "controller": Source.CONTROLLER, "gnss": Source.GNSS}

DRIVE: list[dict[str, Any]] = [
    {"at_s": 0.2, "do": "drive", "speed_mps": 2.0},
    {"at_way_m": 6.0, "do": "press", "button": "steering", "for_s": 0.3},
    {"after": {"mode": 3, "for_s": 1.0}, "do": "press", "button": "plus", "for_s": 0.3},
]
"""The operator drives on, engages steering, locks the speed."""


class OnboardLoop:
    """A vehicle, its devices and its control loop.

    Args:
        world: the course.
        config, loaded: of the run.
        script, faults: see ``simulation.devices``.
        fixes: none where there is no registration.
        fix_wrong, fix_lost: by the time, how far east and north a fix is wrong, and whether there is none.
        manoeuvre: see ``CourseSpec``.
        fix_match: correlation of every match, and its probability of being false; beyond the risk it is no fix.
        gnss_slow_m, vehicle: of the devices, see ``CourseSpec``.

    Attributes:
        rows: PLAN of every tick; times_ns: of them.
        events: of the control loop: time and JSON.
        commands: payload fields of every drive_command: front, throttle, brake, engage.
        stage: the devices.
    """

    def __init__(
        self,
        world: CourseWorld,
        config: RuntimeConfig,
        loaded: AnyLoaded,
        script: list[dict[str, Any]],
        faults: list[dict[str, Any]],
        *,
        fixes: bool = True,
        fix_wrong: Callable[[float], tuple[float, float]] = lambda _: (0.0, 0.0),
        fix_lost: Callable[[float], bool] = lambda _: False,
        fix_match: tuple[float, float] = (0.8, 1e-9),
        seed: int = 1,
        gnss_slow_m: float = GNSS_SLOW_M,
        vehicle: dict[str, float] | None = None,
        manoeuvre: dict[str, Any] | None = None,
    ) -> None:
        spec = CourseSpec(
            seed=2, length_m=world.laid.spec.length_m, drive_seed=seed, map="", ports="", truth="", script=script,
            faults=faults, gnss_slow_m=gnss_slow_m, vehicle=vehicle or {}, manoeuvre=manoeuvre or {},
        )  # fmt: skip
        self.stage = CourseStage(spec, world, Path("spec.json"), BEGIN_NS)
        self.core = ControlCore(config, loaded, session=77, after_death=False)
        self._fixes, self._wrong, self._lost, self._match = fixes, fix_wrong, fix_lost, fix_match
        self._risk = config.registration.risk
        self._rng = np.random.default_rng([seed, 5])
        self._slow = np.zeros(2)
        self._parsers = {line: FrameParser() for line in ("drive_by_wire", "controller")}
        self._receivers = {line: Receiver(line) for line in ("drive_by_wire", "controller")}
        self._gnss = GnssParser()
        self._came: list[Record] = []
        self._pending: list[tuple[int, Record]] = []
        self._now_ns, self._due_ns, self.tick = BEGIN_NS, BEGIN_NS, 0
        self._scan = 0
        self.rows: list[np.void] = []
        self.times_ns: list[int] = []
        self.events: list[tuple[float, str]] = []
        self.notes: list[tuple[float, bytes]] = []
        self.held_up: list[tuple[float, float]] = []
        self.tell({"ready": "recorder"})
        if config.ports.radar is not None:
            self.tell({"ready": "registration"})

    def tell(self, note: dict[str, Any]) -> None:
        """What the supervisor says of a process, now."""
        import json

        self._came.append(Record(RecordKind.EVENT, Source.SUPERVISOR, 0, self._now_ns, json.dumps(note).encode()))

    @property
    def kind(self) -> CounterSteer:
        """The vehicle in the control loop."""
        kind = self.core.kind
        assert isinstance(kind, CounterSteer)
        return kind

    @property
    def time_s(self) -> float:
        """Since the beginning."""
        return (self._now_ns - BEGIN_NS) / 1e9

    @property
    def mode(self) -> Mode:
        """As driven."""
        return self.core.modes.mode

    def run(self, seconds: float, until: Callable[["OnboardLoop"], bool] = lambda _: False) -> bool:
        """Let time pass; whether ``until`` came true before its end."""
        end_ns = self._now_ns + round(seconds * 1e9)
        while self._now_ns < end_ns:
            self._now_ns += _STEP_NS
            self._step()
            if until(self):
                return True
        return False

    def _step(self) -> None:
        now_ns, stage = self._now_ns, self.stage
        while stage.next_ns <= now_ns:
            stage.tick()
        for line, data in stage.emit(now_ns):
            if line == "gnss":
                found: list[Any] = [each for each in self._gnss.feed(data) if isinstance(each, bytes)]
            elif line in self._parsers:
                frames = [each for each in self._parsers[line].feed(data) if not isinstance(each, RefusedBytes)]
                receiver = self._receivers[line]
                found = [frame.raw for frame in frames if receiver.accept(frame, now_ns) is FrameVerdict.ACCEPTED]
            else:
                continue
            self._came += [Record(RecordKind.PORT_IN, _LINES[line], 0, now_ns, raw) for raw in found]
        if now_ns < self._due_ns or any(begin <= self.time_s < end for begin, end in self.held_up):
            return
        self._due_ns = max(self._due_ns + TICK_NS, now_ns + TICK_NS // 2)
        self.tick += 1
        if self._fixes:
            self._draw_fix()
        due = [record for time_ns, record in self._pending if time_ns <= now_ns]
        self._pending = [each for each in self._pending if each[0] > now_ns]
        came, self._came = [*self._came, *due], []
        for record in self.core.step(self.tick, now_ns, came):
            if record.kind is RecordKind.PORT_OUT:
                line = "drive_by_wire" if record.source is Source.DRIVE_BY_WIRE else "controller"
                stage.receive(line, record.payload, now_ns + 1_000_000)
            elif record.kind is RecordKind.PLAN:
                self.rows.append(np.frombuffer(record.payload, PLAN)[0])
                self.times_ns.append(now_ns)
            elif record.kind is RecordKind.EVENT:
                self.events.append((self.time_s, record.payload.decode()))

    def _draw_fix(self) -> None:
        """A fix of the scan at this tick: 2 cm that neighbours share over 4 m, 1 cm of its own."""
        sample = self.stage._known.at(self._now_ns)
        way = abs(sample.speed_mps) * 0.02
        keep = np.exp(-way / 4.0)
        self._slow = keep * self._slow + np.sqrt(1.0 - keep**2) * 0.02 * self._rng.normal(size=2)
        if self._lost(self.time_s):
            return
        row = np.zeros((), FIX)
        cos, sin = np.cos(sample.yaw_rad), np.sin(sample.yaw_rad)
        off = self._slow + 0.01 * self._rng.normal(size=2) + np.array(self._wrong(self.time_s))
        lead = self.stage.world.laid.spec.array_x_m
        self._scan += 1
        correlation, p_false = self._match
        code = Code.OK if p_false <= self._risk else Code.LOW_CORRELATION
        row["scan_ns"], row["scan"], row["code"] = self._now_ns, self._scan, int(code)
        row["correlation"] = row["strength"] = correlation
        row["p_false"] = p_false
        yaw = sample.yaw_rad + 0.004 * self._rng.normal()
        row["pose"] = (sample.x_m + cos * lead + off[0], sample.y_m + sin * lead + off[1], 0.3, yaw, 0.0)
        row["covariance"] = np.diag([0.01**2, 0.01**2, 0.01**2, 0.004**2, 0.01**2])
        fix = Record(RecordKind.FIX, Source.REGISTRATION, 0, self._now_ns + _FIX_LATE_NS, row.tobytes())
        self._pending.append((self._now_ns + _FIX_LATE_NS, fix))
