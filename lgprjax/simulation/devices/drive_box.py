"""The drive-by-wire box: takes commands, holds its defaults by itself, says how the vehicle stands."""

import struct
from collections.abc import Iterable
from typing import NamedTuple

from lgprjax.simulation.devices.wire_ends import Acceptance, Frame, FrameReader, Kind, Sender, Verdict

STEERING, PEDALS, POWER_CUT = 1, 2, 4
DEFAULTS, BAD_FRAMES, SECOND_SENDER, SERVO_FAULT, THROTTLE_FAULT, BRAKE_FAULT, BUS_OFF, BRAKE_TESTED, NO_POWER = (
    1 << bit for bit in range(9)
)
DEFAULT_BRAKE = 0.5
_COMMAND = struct.Struct("<fffB")
_STATUS = struct.Struct("<IBHHfiffBffdf")
_BAD_IN_A_ROW = 3
_ROLLS_MPS = 0.05
_SECOND_SHOWN_NS = 1_000_000_000
_TEST_NS, _TEST_BRAKE, _TEST_LEAST = 1_000_000_000, 0.5, 0.35


class Command(NamedTuple):
    """A ``drive_command``: angle of the front wheels (rad), pedals 0 to 1, and what to engage (bits)."""

    front_rad: float = 0.0
    throttle: float = 0.0
    brake: float = 0.0
    engage: int = 0


class Orders(NamedTuple):
    """What the box makes its actuators do.

    Attributes:
        steering: its servo has torque and turns the wheels to ``front_rad``.
        pedals: it holds the pedals at ``throttle``; without it the throttle is the operator's.
        brake: at least this much is braked.
        cut: the engine has no power.
    """

    steering: bool
    pedals: bool
    front_rad: float
    throttle: float
    brake: float
    cut: bool = False


class Measured(NamedTuple):
    """What the box's sensors show; units as in ``drive_status``."""

    potentiometer_v: float
    encoder_counts: int
    supply_v: float
    torque_nm: float
    foot_on_brake: bool
    throttle: float
    brake: float
    odometer_m: float
    speed_mps: float


class DriveBox:
    """The box's logic; times are nanoseconds of the world's clock, passed in.

    Attributes:
        mode: that the host was in when it last was heard; ``mode_since_ns`` since when.
        command: the last one taken.
        held: what is held engaged, bits.
        refused: frames refused since start.
    """

    def __init__(self, sender: Sender) -> None:
        self.mode, self.mode_since_ns = 0, 0
        self.command, self.held, self.refused = Command(), 0, 0
        self.bus_off = False
        self._sender = sender
        self._reader, self._rules = FrameReader(), Acceptance()
        self._sequence = 0
        self._ends_ns: int | None = None
        self._default, self._armed, self._brakes = True, False, False
        self._had_pedals = False
        self._bad_in_a_row, self._three_bad = 0, False
        self._second_ns: int | None = None
        self._test_since_ns: int | None = None
        self._tested = 0
        self._speed_mps, self._pressure, self._supply_v = 0.0, 0.0, 24.0

    def receive(self, data: bytes, now_ns: int) -> None:
        """Bytes that came over the line."""
        self.take(self._reader.feed(data), now_ns)

    def take(self, frames: Iterable[Frame | None], now_ns: int) -> None:
        """Frames that came, ``None`` for damaged ones."""
        self._let_time_pass(now_ns)
        for frame in frames:
            if frame is None or self.bus_off:
                self._refuse()
                continue
            verdict = self._rules.judge(frame, now_ns)
            if verdict is Verdict.SECOND_SENDER:
                self._second_ns = now_ns
            if verdict is not Verdict.TAKEN:
                self._refuse()
                continue
            self._bad_in_a_row = 0
            if frame.mode != self.mode:
                self.mode, self.mode_since_ns = frame.mode, now_ns
            if frame.kind == Kind.DRIVE_COMMAND:
                self._obey(frame, now_ns)
            elif frame.kind == Kind.DRIVE_TEST and frame.payload == b"\x01":
                self._begin_test(now_ns)

    def sense(self, now_ns: int, speed_mps: float, pressure: float, supply_v: float) -> None:
        """What the box watches for itself: speed by the wheels, brake pressure as a command, supply."""
        self._speed_mps, self._pressure, self._supply_v = speed_mps, pressure, supply_v
        self._let_time_pass(now_ns)

    def orders(self, now_ns: int) -> Orders:
        """What it makes its actuators do now."""
        self._let_time_pass(now_ns)
        told = self.command
        if self._default:
            brake = DEFAULT_BRAKE if self._brakes else 0.0
            return Orders(False, self._brakes, 0.0, 0.0, brake, cut=bool(self.held & POWER_CUT))
        if self._test_since_ns is not None:
            return Orders(False, True, 0.0, 0.0, _TEST_BRAKE)
        pedals = bool(self.held & PEDALS)
        throttle, brake = (told.throttle, told.brake) if pedals else (0.0, 0.0)
        return Orders(bool(self.held & STEERING), pedals, told.front_rad, throttle, brake)

    def status(self, due_ns: int, measured: Measured) -> bytes:
        """The status frame of a moment."""
        payload = _STATUS.pack(
            self._sequence,
            self.held,
            self._state(due_ns),
            self.refused & 0xFFFF,
            measured.potentiometer_v,
            measured.encoder_counts,
            measured.supply_v,
            measured.torque_nm,
            int(measured.foot_on_brake),
            measured.throttle,
            measured.brake,
            measured.odometer_m,
            measured.speed_mps,
        )
        return self._sender.frame(Kind.DRIVE_STATUS, payload, due_ns, self.mode)

    def _obey(self, frame: Frame, now_ns: int) -> None:
        told = Command(*_COMMAND.unpack(frame.payload))
        self.command, self._sequence = told, frame.sequence
        self._ends_ns = now_ns + 1_000_000 * frame.ttl_ms if frame.ttl_ms else None
        if told.engage & POWER_CUT:
            self._fall(brakes=True)
            self.held = POWER_CUT
        elif told.engage == 0:
            # Leaving takes two commands: this one lets go of everything, a later one may engage.
            self._default, self._brakes, self._three_bad, self._armed = False, False, False, True
            self.held, self._had_pedals = 0, False
        elif self._armed:
            self.held = told.engage & (STEERING | PEDALS)
            self._test_since_ns = None

    def _refuse(self) -> None:
        self.refused += 1
        self._bad_in_a_row += 1
        if self._bad_in_a_row >= _BAD_IN_A_ROW:
            self._three_bad = True
            self._fall()

    def _fall(self, *, brakes: bool = False) -> None:
        """To the defaults. That pedals were engaged is kept: a silent line then brakes."""
        if not self._default:
            self._had_pedals = bool(self.held & PEDALS)
        self._default, self._armed, self.held = True, False, self.held & POWER_CUT
        self._brakes = self._brakes or brakes
        self._test_since_ns = None

    def _let_time_pass(self, now_ns: int) -> None:
        if self.bus_off or (self._ends_ns is not None and now_ns > self._ends_ns):
            self._fall()
        silent = self.bus_off or self._rules.silent(now_ns)
        if self._default and silent and self._had_pedals and abs(self._speed_mps) > _ROLLS_MPS:
            self._brakes, self._had_pedals = True, False
        if self._test_since_ns is not None:
            if abs(self._speed_mps) > _ROLLS_MPS:
                self._test_since_ns = None
            elif now_ns - self._test_since_ns >= _TEST_NS:
                self._tested = BRAKE_TESTED if self._pressure >= _TEST_LEAST else BRAKE_FAULT
                self._test_since_ns = None

    def _begin_test(self, now_ns: int) -> None:
        if self.held == 0 and not self._default and abs(self._speed_mps) <= _ROLLS_MPS:
            self._test_since_ns, self._tested = now_ns, 0

    def _state(self, now_ns: int) -> int:
        second = self._second_ns is not None and now_ns - self._second_ns < _SECOND_SHOWN_NS
        bits = {
            DEFAULTS: self._default,
            BAD_FRAMES: self._three_bad,
            SECOND_SENDER: second,
            BUS_OFF: self.bus_off,
            NO_POWER: self._supply_v < 10.0,
        }
        return self._tested | sum(bit for bit, on in bits.items() if on)
