"""A vehicle and its kit before the control loop of a commanded manoeuvre: frames of its lines in, its commands out.

Vehicle, box and receiver are the tests' own: a few lines each, so that anything can be made to fail.
"""

import json
import math
import struct
import zlib
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from pyubx2 import GET, UBXMessage

from lgprjax.autopilot import Mode
from lgprjax.autopilot.monitors import Watch
from lgprjax.run_records import PLAN, Record, RecordKind, Source
from lgprjax.runtime.config import CalibrationTable, PortsTable, PortTable, RuntimeConfig
from lgprjax.runtime.control.core import ControlCore, load_vehicle
from lgprjax.runtime.control.manoeuvre import ManoeuvreKind
from lgprjax.wire import Sender, decode
from pedalled_plant import PedalledPlant, PlantNumbers

TICK_S, TICK_NS = 0.02, 20_000_000
ROOT = Path(__file__).resolve().parents[2]
BUTTONS = {"override": 1 | 2, "estop": 4, "steering": 8, "plus": 16, "minus": 32}
"""Bits of the controller's status that change when a button is pressed."""
AT_REST = 2
SERVO_RADPS, SERVO_LAG_S = 0.5, 0.15
STRAIGHT_V, V_PER_RAD, COUNTS_PER_RAD = 2.4296, 1.99974, 11997.17


class Told(NamedTuple):
    """A tick: what the loop told the box, and the truth after it."""

    time_s: float
    mode: Mode
    front_rad: float
    throttle: float
    brake: float
    engage: int
    watch: Watch
    speed_mps: float
    way_m: float
    angle_rad: float
    proven: bool
    runs: int


def config_of(commands: str, **table: Any) -> RuntimeConfig:
    """The run of a commanded manoeuvre of the made-up vehicle."""
    ports = PortsTable(**{name: PortTable(url="/dev/null") for name in ("drive_by_wire", "controller", "gnss")})
    step = CalibrationTable.model_validate({"step": commands, "commands": commands, **table})
    return RuntimeConfig(
        file=ROOT / "onboard" / "x.run.toml", name=commands, mode="calibrate", vehicle="made_up.vehicle.toml",
        ports=ports, calibration=step,
    )  # fmt: skip


class CalibratedVehicle:
    """It stands, everything is sound, the operator's hands and feet are off; attributes make it otherwise.

    Attributes:
        plant: pedals and way; angle_rad: of the front wheels.
        told: every tick.
        pressed: buttons of the controller.
        torque_nm, foot, foot_throttle: of the operator; the foot brakes by itself.
        parked: by the lever, until the box has the pedals.
        shown: numbers of drive_status that are shown instead of the true ones.
        wheels_gain: of what odometer and speed show.
        gnss: positions come; gnss_m: their error; gnss_held: they repeat one place; gnss_sigma_m: as stated.
        box, controller: the lines are alive.
        servo: it follows; servo_radps: it turns by itself.
        potentiometer_v: where it is stuck; NaN for a sound one.
        throttle_stuck: at least so much of it acts; brake_lost: no pressure.
        state: bits of the box besides its passed braking test.
    """

    def __init__(self, commands: str, numbers: PlantNumbers | None = None, **table: Any) -> None:
        self.config = config_of(commands, **table)
        self.plant = PedalledPlant(PlantNumbers() if numbers is None else numbers)
        self.told: list[Told] = []
        self.events: list[dict[str, Any]] = []
        self.pressed: set[str] = set()
        self.torque_nm = self.foot_throttle = self.angle_rad = 0.0
        self.foot = False
        self.shown: dict[str, float] = {}
        self.wheels_gain = 1.0
        self.gnss, self.gnss_m, self.gnss_held, self.gnss_sigma_m = True, 0.0, math.nan, 0.014
        self.box = self.controller = self.servo = True
        self.servo_radps = self.throttle_stuck = self.odometer_m = 0.0
        self.potentiometer_v = math.nan
        self.brake_lost = False
        self.state = 128
        self.box_session = 1
        self._now_ns, self._tick = 10**12, 0
        self._held, self._taken, self._armed = 0, 0, False
        self._throttle = 0.0
        self.parked = False
        self._senders = {line: Sender(3) for line in ("drive_by_wire", "controller")}
        self._notes: list[dict[str, Any]] = []
        self.restart(after_death=False)

    def restart(self, *, after_death: bool) -> None:
        """A control process begins, or takes the place of one that died."""
        self.core = ControlCore(self.config, load_vehicle(self.config), session=77, after_death=after_death)
        self.tell({"ready": "recorder"}, {"ready": "display"})

    def restart_box(self) -> None:
        """The box begins anew, and counts from nothing."""
        self.box_session += 1
        self._senders["drive_by_wire"] = Sender(self.box_session + 10)
        self.odometer_m, self._held, self._taken, self._armed = 0.0, 0, 0, False

    def tell(self, *notes: dict[str, Any]) -> None:
        """Notes of the supervisor."""
        self._notes += notes

    @property
    def kind(self) -> ManoeuvreKind:
        """The manoeuvre in the control loop."""
        kind = self.core.kind
        assert isinstance(kind, ManoeuvreKind)
        return kind

    @property
    def last(self) -> Told:
        """The newest tick."""
        return self.told[-1]

    @property
    def time_s(self) -> float:
        """Since the beginning."""
        return self._tick * TICK_S

    def run(self, seconds: float) -> list[Told]:
        """Let time pass; its ticks."""
        first = len(self.told)
        for _ in range(round(seconds / TICK_S)):
            self._step()
        return self.told[first:]

    def until(self, holds: Any, seconds: float) -> list[Told]:
        """Let time pass until something holds of a tick, which it must within so long; the ticks."""
        first = len(self.told)
        while len(self.told) - first < seconds / TICK_S:
            self._step()
            if holds(self.last):
                return self.told[first:]
        raise AssertionError(f"not within {seconds} s: {self.last}, {self.events[-4:]}")

    def press(self, *buttons: str, seconds: float = 0.1) -> list[Told]:
        """Press and release; the ticks."""
        first = len(self.told)
        self.pressed |= set(buttons)
        self.run(seconds)
        self.pressed -= set(buttons)
        self.run(0.1)
        return self.told[first:]

    def ready(self) -> "CalibratedVehicle":
        """Until the checks have passed."""
        self.until(lambda told: told.mode is Mode.READY, 5.0)
        self.run(0.2)
        return self

    def engaged(self) -> "CalibratedVehicle":
        """Until the manoeuvre runs."""
        self.ready()
        assert self.press("steering")[-1].mode is Mode.STEERING, self.events[-3:]
        if self.kind.speed_control:
            self.run(0.5)
            assert self.press("plus")[-1].mode is Mode.SPEED, self.events[-3:]
        return self

    def _step(self) -> None:
        self._tick, self._now_ns = self._tick + 1, self._now_ns + TICK_NS
        command = self._control()
        front, throttle, brake, engage = (float(value) for value in command.values())
        if self.box:
            # It engages only after it has been told to release.
            self._armed |= engage == 0.0
            self._held = int(engage) if self._armed or int(engage) & 4 else 0
        self._move(front, throttle, brake)
        row = np.frombuffer(self._row, PLAN)[0]
        program = self.kind._pedals
        modes = (self.time_s, self.core.modes.mode, front, throttle, brake, int(engage), Watch(int(row["watch"])))
        truth = (self.plant.speed_mps, self.plant.way_m, self.angle_rad)
        self.told.append(Told(*modes, *truth, program.proven, program.runs))

    def _control(self) -> dict[str, Any]:
        came = [self._record(RecordKind.EVENT, Source.SUPERVISOR, json.dumps(note).encode()) for note in self._notes]
        self._notes = []
        if self.box:
            came.append(self._record(RecordKind.PORT_IN, Source.DRIVE_BY_WIRE, self._status()))
        if self.controller:
            buttons = AT_REST
            for name in self.pressed:
                buttons ^= BUTTONS[name]
            frame = self._senders["controller"].frame(
                "controller_status", {"buttons": buttons}, mode=0, mono_ns=self._now_ns
            )
            came.append(self._record(RecordKind.PORT_IN, Source.CONTROLLER, frame))
        if self.gnss and self._tick % 5 == 0:
            came.append(self._record(RecordKind.PORT_IN, Source.GNSS, self._position()))
        command: dict[str, Any] = {"front_rad": 0.0, "throttle": 0.0, "brake": 0.0, "engage": 0}
        for record in self.core.step(self._tick, self._now_ns, came):
            if record.kind is RecordKind.PORT_OUT and record.source is Source.DRIVE_BY_WIRE:
                sent = decode(record.payload)
                if sent.name == "drive_command":
                    command, self._taken = dict(sent.fields), sent.sequence
            elif record.kind is RecordKind.PLAN:
                self._row = record.payload
            elif record.kind is RecordKind.EVENT:
                self.events.append(json.loads(record.payload))
        return command

    def _move(self, front_rad: float, throttle: float, brake: float) -> None:
        pedals, cut = bool(self._held & 2), bool(self._held & 4)
        throttle = 0.0 if cut else max(throttle if pedals else self.foot_throttle, self.throttle_stuck)
        box = 0.5 if cut else brake if pedals else 0.0
        before_m = self.plant.way_m
        self.parked &= not pedals
        own = 0.5 if self.foot or self.parked else 0.0
        self.plant.step(throttle, max(0.0 if self.brake_lost else box, own), TICK_S)
        self._throttle = throttle
        self.odometer_m += self.wheels_gain * (self.plant.way_m - before_m)
        if self.servo_radps and self._held & 1:
            self.angle_rad += self.servo_radps * TICK_S
        elif self.servo and self._held & 1:
            turn = (front_rad - self.angle_rad) * (1.0 - math.exp(-TICK_S / SERVO_LAG_S))
            self.angle_rad += min(max(turn, -SERVO_RADPS * TICK_S), SERVO_RADPS * TICK_S)
        self.angle_rad = min(max(self.angle_rad, -0.52), 0.52)

    def _status(self) -> bytes:
        volts = STRAIGHT_V + V_PER_RAD * self.angle_rad
        fields = {
            "command_sequence": self._taken, "engaged": self._held, "state": self.state, "refused": 0,
            "potentiometer_v": volts if math.isnan(self.potentiometer_v) else self.potentiometer_v,
            "encoder_counts": round(1000 + COUNTS_PER_RAD * self.angle_rad), "supply_v": 24.0,
            "torque_nm": self.torque_nm, "pedals": int(self.foot), "throttle": self._throttle,
            "brake": self.plant.brake, "odometer_m": self.odometer_m,
            "speed_mps": self.wheels_gain * self.plant.speed_mps,
        }  # fmt: skip
        # A box may send numbers that are none: the sender of this package does not.
        zeros = dict.fromkeys(fields, 0)
        raw = self._senders["drive_by_wire"].frame("drive_status", zeros, mode=0, mono_ns=self._now_ns)
        payload = struct.pack("<IBHHfiffBffdf", *(fields | self.shown).values())
        return raw[:26] + payload + struct.pack("<I", zlib.crc32(raw[2:26] + payload))

    def _position(self) -> bytes:
        way_m = self.plant.way_m if math.isnan(self.gnss_held) else self.gnss_held
        message = UBXMessage(
            "NAV", "NAV-PVT", GET, iTOW=self._now_ns // 1_000_000, fixType=3, gnssFixOk=1, carrSoln=2,
            hAcc=round(1e3 * self.gnss_sigma_m), lat=42.0 + (way_m + self.gnss_m) / 111_074.0, lon=-71.0, height=10_000,
        )  # fmt: skip
        return bytes(message.serialize())

    def _record(self, kind: RecordKind, source: Source, payload: bytes) -> Record:
        return Record(kind, source, self._tick, self._now_ns, payload)
