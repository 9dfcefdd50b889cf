"""The drive-by-wire box of a skid-steer vehicle: by command, or by remote control while nothing is engaged."""

import struct
from typing import NamedTuple

from lgprjax.simulation.devices.hosted_box import POWER_CUT, HostedBox
from lgprjax.simulation.devices.wire_ends import Frame, Kind, Sender

DRIVE = 1
_COMMAND = struct.Struct("<ffBfB")
_STATUS = struct.Struct("<IBHHffddBfff")


class SkidCommand(NamedTuple):
    """A ``skid_command``: speeds of the tracks, the tool and its depth, and what to engage (bits)."""

    left_mps: float = 0.0
    right_mps: float = 0.0
    tool: int = 0
    depth_m: float = 0.0
    engage: int = 0


class SkidActing(NamedTuple):
    """What acts on the vehicle.

    Attributes:
        left_mps, right_mps: of the tracks.
        tool_m: depth that the tool is to turn at; ``None``: off and raised.
    """

    left_mps: float
    right_mps: float
    tool_m: float | None


class SkidMeasured(NamedTuple):
    """What the box's sensors show; units as in ``skid_status``."""

    left_mps: float
    right_mps: float
    left_m: float
    right_m: float
    turns: bool
    tool_rpm: float
    depth_m: float
    supply_v: float


class SkidBox(HostedBox):
    """The box's logic; see ``HostedBox``.

    Attributes:
        command: the last one taken.
    """

    def __init__(self, sender: Sender) -> None:
        super().__init__(sender)
        self.command = SkidCommand()

    def acting(self, now_ns: int, remote: SkidActing, supply_v: float) -> SkidActing:
        """What it makes its actuators do now.

        Args:
            now_ns: of the world's clock.
            remote: what the remote control asks for.
            supply_v: of the box.
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
        payload = _STATUS.pack(
            self._sequence,
            self.held,
            self._line_state(due_ns),
            self.refused & 0xFFFF,
            measured.left_mps,
            measured.right_mps,
            measured.left_m,
            measured.right_m,
            int(measured.turns),
            measured.tool_rpm,
            measured.depth_m,
            measured.supply_v,
        )
        return self._sender.frame(Kind.SKID_STATUS, payload, due_ns, self.mode)

    def _hear(self, frame: Frame, now_ns: int) -> None:
        if frame.kind == Kind.SKID_COMMAND:
            self.command = SkidCommand(*_COMMAND.unpack(frame.payload))
            self._engage(frame, self.command.engage, DRIVE, now_ns)

    def _let_go(self) -> None:
        """Nothing more: the remote control has the vehicle."""
