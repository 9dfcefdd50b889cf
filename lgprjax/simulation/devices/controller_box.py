"""The operator's controller: buttons to the host, a light back."""

import struct

from lgprjax.simulation.devices.wire_ends import Acceptance, FrameReader, Kind, Sender, Verdict

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

    def __init__(self, sender: Sender) -> None:
        self._sender = sender
        self._reader, self._rules = FrameReader(), Acceptance()
        self._mode = 0
        self._lit, self._told_ns = False, -_LIGHT_LASTS_NS

    def receive(self, data: bytes, now_ns: int) -> None:
        """Bytes that came over the line."""
        for frame in self._reader.feed(data):
            if frame is None or self._rules.judge(frame, now_ns) is not Verdict.TAKEN:
                continue
            self._mode = frame.mode
            if frame.kind == Kind.CONTROLLER_LIGHT:
                self._lit, self._told_ns = frame.payload == b"\x01", now_ns

    def lit(self, now_ns: int) -> bool:
        """Whether the light is on; it goes out when nobody feeds it."""
        return self._lit and now_ns - self._told_ns <= _LIGHT_LASTS_NS

    def status(self, due_ns: int, buttons: int) -> bytes:
        """The status frame of a moment."""
        return self._sender.frame(Kind.CONTROLLER_STATUS, struct.pack("<H", buttons), due_ns, self._mode)
