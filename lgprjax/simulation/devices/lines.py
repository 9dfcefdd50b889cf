"""The lines between devices and host, with what goes wrong on them."""

import numpy as np

from lgprjax.simulation.devices.faults import Faults

LINES = ("drive_by_wire", "controller", "gnss", "radar")


class Lines:
    """What the lines make of bytes.

    Args:
        faults: that run.
        seed: of the damage.
    """

    def __init__(self, faults: Faults, seed: int) -> None:
        self._faults = faults
        self._rng = np.random.default_rng([seed, 52])
        self._repeated: dict[str, bytes] = {}

    def out(self, line: str, data: bytes) -> bytes:
        """A device's bytes as they reach the host; nothing where the line is silent."""
        if self._faults.on_line("line_silent", line):
            return b""
        return self._damaged(line, data)

    def into(self, line: str, data: bytes) -> bytes:
        """The host's bytes as they reach a device; of a line that repeats, the first ones again and again."""
        if self._faults.on_line("line_silent", line):
            return b""
        if self._faults.on_line("line_repeat", line):
            data = self._repeated.setdefault(line, data)
        else:
            self._repeated.pop(line, None)
        return self._damaged(line, data)

    def repeats(self, line: str) -> bool:
        """Whether the counter of a line's frames is stuck."""
        return self._faults.on_line("line_repeat", line)

    def _damaged(self, line: str, data: bytes) -> bytes:
        if not self._faults.on_line("line_corrupt", line) or not data:
            return data
        changed = bytearray(data)
        changed[int(self._rng.integers(len(changed)))] ^= int(self._rng.integers(1, 256))
        return bytes(changed)
