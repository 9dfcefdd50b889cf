"""A fault: somebody else commands the drive-by-wire box too."""

import struct

from lgprjax.simulation.devices.wire_ends import Frame, Kind

_WANTS = struct.pack("<fffB", 0.35, 0.5, 0.0, 3)
_SPEED_ENGAGED = 4


class SecondMaster:
    """Sends sound commands of a session of its own."""

    def __init__(self, session: int) -> None:
        self._session, self._sequence = session, 0

    def command(self, now_ns: int) -> Frame:
        """Its next command: full engagement, wheels to the left, throttle."""
        self._sequence += 1
        return Frame(Kind.DRIVE_COMMAND, _SPEED_ENGAGED, self._session, self._sequence, now_ns // 1000, 200, _WANTS)
