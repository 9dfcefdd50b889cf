"""The simulated boxes: drive-by-wire, skid-steer drive and operator's controller, each with its own defaults."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator, Mapping
from typing import NamedTuple

from lgprjax.wire import Frame, FrameParser, FrameVerdict, Receiver, RefusedBytes, Sender, Value

# A device's end of its line.


class DeviceSender(Sender):
    """Numbers and stamps a device's frames.

    Args:
        session: session number of this start.
        epoch_us: reading of the device's clock at time 0 of the world, µs.

    Attributes:
        stuck: fault: the counter repeats.
    """

    def __init__(self, session: int, epoch_us: int) -> None:
        super().__init__(session)
        self._epoch_ns = 1000 * epoch_us
        self.stuck = False

    def frame(self, name: str, fields: Mapping[str, Value], *, mode: int, mono_ns: int, ttl_ms: int = 0) -> bytes:
        """Bytes of the next frame; ``mono_ns`` is a time of the world's clock."""
        number = self._sequence
        raw = super().frame(name, fields, mode=mode, mono_ns=self._epoch_ns + mono_ns, ttl_ms=ttl_ms)
        if self.stuck:
            self._sequence = number
        return raw


class HostListener:
    """Frames of the host that a device accepts on one line.

    Args:
        line: name of the line.

    Attributes:
        mode: mode in the host's last frame.
    """

    def __init__(self, line: str) -> None:
        self.mode = 0
        self._parser, self._rules = FrameParser(), Receiver(line, "host")

    def feed(self, data: bytes, now_ns: int) -> Iterator[Frame]:
        """Accepted frames in the data."""
        for frame in self._parser.feed(data):
            if isinstance(frame, Frame) and self._rules.accept(frame, now_ns) is FrameVerdict.ACCEPTED:
                self.mode = frame.mode
                yield frame

    def reconnect(self) -> None:
        """Start a new connection; a partial frame of the old one is dropped."""
        self._parser = FrameParser()


# Common behaviour of drive-by-wire boxes on their line: judging frames, expiry of commands, defaults.

POWER_CUT = 4
DEFAULTS, BAD_FRAMES, SECOND_SENDER, BUS_OFF, NO_POWER = 1, 2, 4, 64, 256
_BAD_IN_A_ROW = 3
_SECOND_SHOWN_NS = 1_000_000_000
_LEAST_SUPPLY_V = 10.0


class HostedBox(ABC):
    """Common logic of the boxes; times are arguments in nanoseconds of the world's clock.

    Attributes:
        mode: mode in the host's last frame.
        mode_since_ns: time since which the host is in this mode.
        held: bits of the functions held engaged.
        refused: number of frames refused since start.
        bus_off: fault: no frames are received.
    """

    def __init__(self, sender: DeviceSender) -> None:
        self.mode, self.mode_since_ns = 0, 0
        self.held, self.refused = 0, 0
        self.bus_off = False
        self._sender = sender
        self._parser, self._rules = FrameParser(), Receiver("drive_by_wire", "host")
        self._sequence = 0
        self._ends_ns: int | None = None
        self._default, self._armed = True, False
        self._bad_in_a_row, self._three_bad = 0, False
        self._second_ns: int | None = None
        self._supply_v = 24.0

    def receive(self, data: bytes, now_ns: int) -> None:
        """Process bytes from the line."""
        self.take(self._parser.feed(data), now_ns)

    def take(self, frames: Iterable[Frame | RefusedBytes], now_ns: int) -> None:
        """Process received frames and invalid bytes."""
        self._let_time_pass(now_ns)
        for frame in frames:
            if isinstance(frame, RefusedBytes) or self.bus_off:
                self._refuse()
                continue
            verdict = self._rules.accept(frame, now_ns)
            if verdict is FrameVerdict.SECOND_SENDER:
                self._second_ns = now_ns
            if verdict is not FrameVerdict.ACCEPTED:
                self._refuse()
                continue
            self._bad_in_a_row = 0
            if frame.mode != self.mode:
                self.mode, self.mode_since_ns = frame.mode, now_ns
            self._hear(frame, now_ns)

    @abstractmethod
    def _hear(self, frame: Frame, now_ns: int) -> None:
        """A frame that was taken."""

    def _engage(self, frame: Frame, engage: int, known: int, now_ns: int) -> None:
        """Bits engaged by a command; ``known`` are those of the box."""
        self._sequence = frame.sequence
        self._ends_ns = now_ns + 1_000_000 * frame.ttl_ms if frame.ttl_ms else None
        if engage & POWER_CUT:
            self._fall(cut=True)
            self.held = POWER_CUT
        elif engage == 0:
            # Leaving takes two commands: this one lets go of everything, a later one may engage.
            self._default, self._three_bad, self._armed = False, False, True
            self.held = 0
            self._let_go()
        elif self._armed:
            self.held = engage & known

    @abstractmethod
    def _let_go(self) -> None:
        """The host has released everything."""

    def _fall(self, *, cut: bool = False) -> None:
        """Change to the default state; ``cut``: whether the power is cut."""
        del cut  # further effects of a cut are specific to a box
        self._default, self._armed, self.held = True, False, self.held & POWER_CUT

    def _refuse(self) -> None:
        self.refused += 1
        self._bad_in_a_row += 1
        if self._bad_in_a_row >= _BAD_IN_A_ROW:
            self._three_bad = True
            self._fall()

    def _let_time_pass(self, now_ns: int) -> None:
        if self.bus_off or (self._ends_ns is not None and now_ns > self._ends_ns):
            self._fall()

    def _status(self, name: str, due_ns: int, state: int, measured: Mapping[str, Value]) -> bytes:
        """The status frame of a moment."""
        fields = {
            "command_sequence": self._sequence,
            "engaged": self.held,
            "state": state,
            "refused": self.refused & 0xFFFF,
            **measured,
        }
        return self._sender.frame(name, fields, mode=self.mode, mono_ns=due_ns)

    def _line_state(self, now_ns: int) -> int:
        """Bits of ``state`` that all boxes have."""
        second = self._second_ns is not None and now_ns - self._second_ns < _SECOND_SHOWN_NS
        bits = {
            DEFAULTS: self._default,
            BAD_FRAMES: self._three_bad,
            SECOND_SENDER: second,
            BUS_OFF: self.bus_off,
            NO_POWER: self._supply_v < _LEAST_SUPPLY_V,
        }
        return sum(bit for bit, on in bits.items() if on)


STEERING_ENGAGED, PEDALS = 1, 2
SERVO_FAULT, THROTTLE_FAULT, BRAKE_FAULT, BRAKE_TESTED = 8, 16, 32, 128
DEFAULT_BRAKE = 0.5
_ROLLS_MPS = 0.05
_TEST_NS, _TEST_BRAKE, _TEST_LEAST = 1_000_000_000, 0.5, 0.35


class DriveCommandMessage(NamedTuple):
    """A ``drive_command``: angle of the front wheels (rad), pedals 0 to 1, and what to engage (bits)."""

    front_rad: float = 0.0
    throttle: float = 0.0
    brake: float = 0.0
    engage: int = 0


class ActuatorOrders(NamedTuple):
    """Commands of the box to its actuators.

    Attributes:
        steering: whether the servo has torque and turns the wheels to ``front_rad``.
        pedals: whether the box holds the throttle at ``throttle``; otherwise the operator controls it.
        brake: least brake command.
        cut: whether the engine's power is cut.
    """

    steering: bool
    pedals: bool
    front_rad: float
    throttle: float
    brake: float
    cut: bool = False


class Measured(NamedTuple):
    """Readings of the box's sensors; units as in ``drive_status``."""

    potentiometer_v: float
    encoder_counts: int
    supply_v: float
    torque_nm: float
    pedals: bool
    throttle: float
    brake: float
    odometer_m: float
    speed_mps: float


class DriveBox(HostedBox):
    """The box's logic; see ``HostedBox``.

    Attributes:
        command: the last one taken.
    """

    def __init__(self, sender: DeviceSender) -> None:
        super().__init__(sender)
        self.command = DriveCommandMessage()
        self._brakes, self._had_pedals = False, False
        self._test_since_ns: int | None = None
        self._tested = 0
        self._speed_mps, self._pressure = 0.0, 0.0

    def sense(self, now_ns: int, speed_mps: float, pressure: float, supply_v: float) -> None:
        """The box's own measurements: speed by the wheels, brake pressure as a command, supply."""
        self._speed_mps, self._pressure, self._supply_v = speed_mps, pressure, supply_v
        self._let_time_pass(now_ns)

    def orders(self, now_ns: int) -> ActuatorOrders:
        """Present orders to its actuators."""
        self._let_time_pass(now_ns)
        told = self.command
        if self._default:
            brake = DEFAULT_BRAKE if self._brakes else 0.0
            return ActuatorOrders(False, self._brakes, 0.0, 0.0, brake, cut=bool(self.held & POWER_CUT))
        if self._test_since_ns is not None:
            return ActuatorOrders(False, True, 0.0, 0.0, _TEST_BRAKE)
        pedals = bool(self.held & PEDALS)
        throttle, brake = (told.throttle, told.brake) if pedals else (0.0, 0.0)
        return ActuatorOrders(bool(self.held & STEERING_ENGAGED), pedals, told.front_rad, throttle, brake)

    def status(self, due_ns: int, measured: Measured) -> bytes:
        """The status frame of a moment."""
        return self._status("drive_status", due_ns, self._line_state(due_ns) | self._tested, measured._asdict())

    def _hear(self, frame: Frame, now_ns: int) -> None:
        if frame.name == "drive_command":
            self.command = DriveCommandMessage._make(frame.fields.values())
            self._engage(frame, self.command.engage, STEERING_ENGAGED | PEDALS, now_ns)
            if self.held & (STEERING_ENGAGED | PEDALS):
                self._test_since_ns = None
        elif frame.name == "drive_test" and frame.fields["test"] == 1:
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
        # A host repeats its command: the running test continues.
        running = self._test_since_ns is not None
        if not running and self.held == 0 and not self._default and abs(self._speed_mps) <= _ROLLS_MPS:
            self._test_since_ns, self._tested = now_ns, 0


# The drive-by-wire box of a skid-steer vehicle: by command, or by remote control while nothing is engaged.

DRIVE = 1


class SkidCommandMessage(NamedTuple):
    """A ``skid_command``: speeds of the tracks, the tool and its depth, and what to engage (bits)."""

    left_mps: float = 0.0
    right_mps: float = 0.0
    tool: int = 0
    depth_m: float = 0.0
    engage: int = 0


class SkidActing(NamedTuple):
    """Inputs acting on the vehicle.

    Attributes:
        left_mps, right_mps: commanded speeds of the tracks.
        tool_m: commanded depth of the running tool; ``None``: off and raised.
    """

    left_mps: float
    right_mps: float
    tool_m: float | None


class SkidMeasured(NamedTuple):
    """Readings of the box's sensors; units as in ``skid_status``."""

    left_mps: float
    right_mps: float
    left_m: float
    right_m: float
    tool: bool
    tool_rpm: float
    depth_m: float
    supply_v: float


class SkidBox(HostedBox):
    """The box's logic; see ``HostedBox``.

    Attributes:
        command: the last one taken.
    """

    def __init__(self, sender: DeviceSender) -> None:
        super().__init__(sender)
        self.command = SkidCommandMessage()

    def acting(self, now_ns: int, remote: SkidActing, supply_v: float) -> SkidActing:
        """Present commands to the actuators.

        Args:
            now_ns: time of the world's clock.
            remote: inputs of the remote control.
            supply_v: supply voltage of the box.
        """
        self._supply_v = supply_v
        self._let_time_pass(now_ns)
        if self.held & POWER_CUT:
            return SkidActing(0.0, 0.0, None)
        if not self.held & DRIVE:
            return remote
        told = self.command
        return SkidActing(told.left_mps, told.right_mps, told.depth_m if told.tool else None)

    def status(self, due_ns: int, measured: SkidMeasured) -> bytes:
        """The status frame of a moment."""
        return self._status("skid_status", due_ns, self._line_state(due_ns), measured._asdict())

    def _hear(self, frame: Frame, now_ns: int) -> None:
        if frame.name == "skid_command":
            self.command = SkidCommandMessage._make(frame.fields.values())
            self._engage(frame, self.command.engage, DRIVE, now_ns)

    def _let_go(self) -> None:
        """Release without further effect, because the remote control has the vehicle."""


# The operator's controller: buttons to the host, a light back.

OVERRIDE_FIRST, OVERRIDE_SECOND, ESTOP, STEERING, PLUS, MINUS, BRAKE_TAP, CORNER = (1 << bit for bit in range(8))
AT_REST = OVERRIDE_SECOND
_LIGHT_LASTS_NS = 500_000_000


def buttons_of(pressed: set[str]) -> int:
    """The status bits while some buttons are pressed: steering, plus, minus, override, estop, brake_tap, corner."""
    bits = AT_REST
    for name, bit in (("steering", STEERING), ("plus", PLUS), ("minus", MINUS), ("estop", ESTOP)):
        bits |= bit if name in pressed else 0
    bits |= BRAKE_TAP if "brake_tap" in pressed else 0
    bits |= CORNER if "corner" in pressed else 0
    return bits ^ (OVERRIDE_FIRST | OVERRIDE_SECOND) if "override" in pressed else bits


class ControllerBox:
    """The controller's logic; times are nanoseconds of the world's clock, passed in."""

    def __init__(self, sender: DeviceSender) -> None:
        self._sender, self._listener = sender, HostListener("controller")
        self._lit, self._told_ns = False, -_LIGHT_LASTS_NS

    def receive(self, data: bytes, now_ns: int) -> None:
        """Process bytes from the line."""
        for frame in self._listener.feed(data, now_ns):
            self._lit, self._told_ns = frame.fields["light"] == 1, now_ns

    def lit(self, now_ns: int) -> bool:
        """Whether the light is on; it goes out without fresh frames."""
        return self._lit and now_ns - self._told_ns <= _LIGHT_LASTS_NS

    def status(self, due_ns: int, buttons: int) -> bytes:
        """The status frame of a moment."""
        return self._sender.frame("controller_status", {"buttons": buttons}, mode=self._listener.mode, mono_ns=due_ns)
