"""The drive-by-wire box: takes commands, holds its defaults by itself, says how the vehicle stands."""

import struct
from typing import NamedTuple

from lgprjax.simulation.devices.hosted_box import POWER_CUT, HostedBox
from lgprjax.simulation.devices.wire_ends import Frame, Kind, Sender

STEERING, PEDALS = 1, 2
SERVO_FAULT, THROTTLE_FAULT, BRAKE_FAULT, BRAKE_TESTED = 8, 16, 32, 128
DEFAULT_BRAKE = 0.5
_COMMAND = struct.Struct("<fffB")
_STATUS = struct.Struct("<IBHHfiffBffdf")
_ROLLS_MPS = 0.05
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


class DriveBox(HostedBox):
    """The box's logic; see ``HostedBox``.

    Attributes:
        command: the last one taken.
    """

    def __init__(self, sender: Sender) -> None:
        super().__init__(sender)
        self.command = Command()
        self._brakes, self._had_pedals = False, False
        self._test_since_ns: int | None = None
        self._tested = 0
        self._speed_mps, self._pressure = 0.0, 0.0

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
            self._line_state(due_ns) | self._tested,
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

    def _hear(self, frame: Frame, now_ns: int) -> None:
        if frame.kind == Kind.DRIVE_COMMAND:
            self.command = Command(*_COMMAND.unpack(frame.payload))
            self._engage(frame, self.command.engage, STEERING | PEDALS, now_ns)
            if self.held & (STEERING | PEDALS):
                self._test_since_ns = None
        elif frame.kind == Kind.DRIVE_TEST and frame.payload == b"\x01":
            self._begin_test(now_ns)

    def _let_go(self) -> None:
        self._brakes, self._had_pedals = False, False

    def _fall(self, *, cut: bool = False) -> None:
        # That pedals were engaged is kept: a silent line then brakes.
        if not self._default:
            self._had_pedals = bool(self.held & PEDALS)
        super()._fall(cut=cut)
        self._brakes = self._brakes or cut
        self._test_since_ns = None

    def _let_time_pass(self, now_ns: int) -> None:
        super()._let_time_pass(now_ns)
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
