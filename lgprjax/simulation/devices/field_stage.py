"""The devices of a skid-steer vehicle in a field: bytes and time go in, frames come out; the vehicle moves between."""

import math
import threading
from collections import deque
from pathlib import Path
from typing import NamedTuple

import numpy as np

from lgprjax.frames import LocalFrame
from lgprjax.simulation.devices.beat import Beat
from lgprjax.simulation.devices.controller_box import OVERRIDE_FIRST, OVERRIDE_SECOND, ControllerBox, buttons_of
from lgprjax.simulation.devices.faults import FAULT_LASTS_S, Faults
from lgprjax.simulation.devices.field_faults import FIELD_FAULTS, FIELD_LINES
from lgprjax.simulation.devices.field_spec import FieldSpec
from lgprjax.simulation.devices.field_truth import FieldTruth
from lgprjax.simulation.devices.flail import TICK_S, Flail, FlailMoved
from lgprjax.simulation.devices.flail_tool import ToolState, step_tool
from lgprjax.simulation.devices.gnss_box import (
    WEEK_S,
    Attitude,
    GnssClock,
    Position,
    attitude_messages,
    position_message,
)
from lgprjax.simulation.devices.lines import Lines
from lgprjax.simulation.devices.schedule import READY_MODE, Moment, Schedule, check_choice, read_items
from lgprjax.simulation.devices.skid_box import SkidActing, SkidBox, SkidMeasured
from lgprjax.simulation.devices.teleoperator import (
    FIELD_BUTTONS,
    FIELD_SCRIPT,
    SCRIPT_LASTS_S,
    RemoteHands,
    Teleoperator,
)
from lgprjax.simulation.devices.wire_ends import Sender

_TICK_NS = round(1e9 * TICK_S)
_SUPPLY_V, _FLOAT_M = 24.0, 0.4


class FieldTick(NamedTuple):
    """A tick that was made: its number."""

    number: int


class FieldStage:
    """The devices and their world. Times are nanoseconds of the world's clock, passed in.

    ``tick`` belongs to one thread, ``receive`` and ``emit`` may belong to another.

    Args:
        spec: what is asked for.
        file: where it was read, for messages.
        begin_ns: when the world begins.

    Attributes:
        latest_s: how late a status was sent at the worst.

    Raises:
        InputError: the spec's script or faults cannot be used.
    """

    def __init__(self, spec: FieldSpec, file: Path, begin_ns: int) -> None:
        rng = np.random.default_rng([spec.seed, 53])
        self.begin_ns, self.faults, self.truth = begin_ns, Faults(), FieldTruth()
        script = read_items(file, "script", spec.script, key="do", known=FIELD_SCRIPT, lasts_s=SCRIPT_LASTS_S)
        wrong = read_items(file, "faults", spec.faults, key="kind", known=FIELD_FAULTS, lasts_s=FAULT_LASTS_S)
        check_choice(file, "script", script, "button", FIELD_BUTTONS)
        check_choice(file, "faults", wrong, "line", FIELD_LINES)
        self._script, self._wrong = Schedule(script), Schedule(wrong)
        self._frame = LocalFrame(*spec.anchor)
        self._flail = Flail(
            track_m=spec.track_m,
            gnss_x_m=spec.gnss_x_m,
            gnss_y_m=spec.gnss_y_m,
            threshold_mps=spec.threshold_mps,
            start=spec.start,
            wheel_scale=spec.wheel_scale,
            seed=spec.seed,
        )
        self.moved = FlailMoved(*spec.start, *[0.0] * (len(FlailMoved._fields) - 3))
        self.tool, self.operator = ToolState(), Teleoperator()
        self._senders = {
            line: Sender(int(rng.integers(1, 1 << 32)), int(rng.integers(1, 1 << 40))) for line in FIELD_LINES
        }
        self.drive_box = SkidBox(self._senders["drive_by_wire"])
        self.controller = ControllerBox(self._senders["controller"])
        self._lines = Lines(self.faults, spec.seed)
        self._clock = GnssClock((2400.0 + float(rng.uniform(0.1, 0.8))) * WEEK_S - 1e-9 * begin_ns)
        self._hands = RemoteHands(SkidActing(0.0, 0.0, None), frozenset())
        self._ins_yaw = float(rng.uniform(-math.pi, math.pi))
        self._left_m = self._right_m = 0.0
        self._travel_m, self._ticks = 0.0, 0
        self._ready_ns: int | None = None
        self.latest_s = {"status": 0.0}
        self._waiting: deque[tuple[str, int, bytes]] = deque(maxlen=64)
        self._buttons = Beat(begin_ns, 20_000_000)
        self._lock = threading.Lock()

    @property
    def next_ns(self) -> int:
        """When the next tick begins."""
        return self.begin_ns + self._ticks * _TICK_NS

    def tick(self) -> FieldTick:
        """Move the vehicle by a tick, under what the host said until its begin."""
        begin_ns, before = self.next_ns, self.moved
        self._ticks += 1
        with self._lock:
            box = self.drive_box
            if self._ready_ns is None and box.mode == READY_MODE:
                self._ready_ns = begin_ns
            moment = self._moment(begin_ns)
            self.faults.run(self._wrong.step(moment))
            box.bus_off = self.faults.has("bus_off")
            self._hands = self.operator.step(self._script.step(moment), before.x_m, before.y_m, before.yaw_rad, TICK_S)
            supply_v = self.faults.number("supply_sag", "v", _SUPPLY_V)
            acting = box.acting(begin_ns, self._hands.remote, supply_v)
            command, held = box.command, box.held
        self.moved = moved = self._flail.step(acting.left_mps, acting.right_mps)
        self.tool = step_tool(self.tool, acting.tool_m, self.faults, TICK_S)
        self._travel_m += abs(moved.speed_mps) * TICK_S
        on = not self.faults.has("gnss_off")
        self.truth.add(self.next_ns, moved, self.tool, command, held, gnss_on=on)
        with self._lock:
            self._sense(moved, supply_v, gnss_on=on)
        return FieldTick(self._ticks - 1)

    def render(self, tick: FieldTick) -> None:
        """There is no radar."""

    def skip(self, tick: FieldTick) -> int:
        """There are no scans to be left out."""
        del tick
        return 0

    def renew(self) -> None:
        """Nobody listens on the radar's line."""

    def warm(self) -> None:
        """A tick compiles all there is."""

    def receive(self, line: str, data: bytes, now_ns: int) -> None:
        """The host's bytes on a line."""
        with self._lock:
            told = self._lines.into(line, data)
            if line == "drive_by_wire":
                self.drive_box.receive(told, now_ns)
            elif line == "controller":
                self.controller.receive(told, now_ns)

    def emit(self, now_ns: int) -> list[tuple[str, bytes]]:
        """What the devices send by now: (line, whole messages)."""
        with self._lock:
            for line, sender in self._senders.items():
                sender.stuck = self._lines.repeats(line)
            told: list[tuple[str, bytes]] = []
            # What is not known yet is not told: a world that is late tells it late, and never wrong.
            while self._waiting and self._waiting[0][1] <= now_ns:
                line, due_ns, data = self._waiting.popleft()
                if line == "drive_by_wire":
                    self.latest_s["status"] = max(self.latest_s["status"], 1e-9 * (now_ns - due_ns))
                told.append((line, data))
            told += [
                ("controller", self.controller.status(due_ns, self._pressed())) for due_ns in self._buttons.due(now_ns)
            ]
            sent = ((line, self._lines.out(line, data)) for line, data in told)
            return [(line, data) for line, data in sent if data]

    def _sense(self, moved: FlailMoved, supply_v: float, *, gnss_on: bool) -> None:
        """What the devices say at a tick's end."""
        end_ns = self.next_ns
        left_mps = 0.0 if self.faults.has("left_dead") else moved.left_mps
        right_mps = 0.0 if self.faults.has("right_dead") else moved.right_mps
        self._left_m += left_mps * TICK_S
        self._right_m += right_mps * TICK_S
        tool = self.tool
        measured = SkidMeasured(
            left_mps, right_mps, self._left_m, self._right_m, tool.turns, tool.rpm, tool.depth_m, supply_v
        )
        self._waiting.append(("drive_by_wire", end_ns, self.drive_box.status(end_ns, measured)))
        if moved.turn_valid > 0.5:
            self._ins_yaw += moved.turn_rad
            if not self.faults.has("ins_off"):
                self._waiting.append(("gnss", end_ns, attitude_messages(self._clock, end_ns, self._attitude(moved))))
        if moved.gnss_valid > 0.5 and gnss_on:
            measured_ns = end_ns - round(1e9 * moved.gnss_age_s)
            self._waiting.append(("gnss", end_ns, position_message(self._clock, measured_ns, self._position(moved))))

    def _attitude(self, moved: FlailMoved) -> Attitude:
        return Attitude(
            0.0,
            self._heading_deg(self._ins_yaw),
            moved.turn_rad / moved.span_s,
            0.0,
            moved.speed_mps,
            not self.faults.has("ins_nan"),
        )

    def _position(self, moved: FlailMoved) -> Position:
        loose = self.faults.has("gnss_float")
        jump = self.faults.pair("gnss_jump", "m")
        east, north = moved.gnss_east_m + jump[0], moved.gnss_north_m + jump[1]
        latitude, longitude, height = self._frame.to_geodetic(np.array([east]), np.array([north]), np.zeros(1))
        return Position(
            float(latitude[0]),
            float(longitude[0]),
            float(height[0]),
            abs(moved.speed_mps),
            self._heading_deg(moved.yaw_rad),
            _FLOAT_M if loose else moved.gnss_sigma_m,
            1 if loose else 2,
        )

    def _heading_deg(self, yaw_rad: float) -> float:
        return float(self._frame.heading_of_yaw(np.array([yaw_rad]), np.array([self._frame.longitude_deg]))[0])

    def _moment(self, now_ns: int) -> Moment:
        box = self.drive_box
        since = None if self._ready_ns is None else 1e-9 * (now_ns - self._ready_ns)
        mode_for_s = 1e-9 * (now_ns - box.mode_since_ns)
        return Moment(1e-9 * now_ns, since, self._travel_m, box.mode, mode_for_s, self.operator.arrivals)

    def _pressed(self) -> int:
        pressed: set[str] = set(self._hands.buttons)
        pressed |= {"override"} if self.faults.has("override_stuck") else set()
        pressed |= {"estop"} if self.faults.has("estop_held") else set()
        bits = buttons_of(pressed)
        return bits & ~(OVERRIDE_FIRST | OVERRIDE_SECOND) if self.faults.has("override_wire_cut") else bits
