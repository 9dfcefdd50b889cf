"""The radar's box: obeys start, stop, calibrate and look-up, describes itself, sends scans when they are due."""

import struct
from collections import deque
from enum import IntEnum
from typing import NamedTuple

import numpy as np
from jaxtyping import UInt8

from lgprjax.scene.propagation import RadarConfig
from lgprjax.simulation.devices.wire_ends import Acceptance, Frame, FrameReader, Kind, Sender, Verdict

_COMMAND = struct.Struct("<BI")
_SCAN = struct.Struct("<IHHI")
_HEALTH = struct.Struct("<BHfI")
_DESCRIPTION = struct.Struct("<HHIifI")
_TEMPERATURE_C = 34.0
_BUSY_NS = 1_000_000_000
"""That calibrating, and looking up, take."""
PROCESSING_NS = 4_000_000
"""From a scan's end to its first byte."""


class RadarState(IntEnum):
    """As in ``radar_health``."""

    IDLE = 0
    SCANNING = 1
    CALIBRATING = 2
    LOOKING_UP = 3
    FAILED = 4


class Recorded(NamedTuple):
    """A scan of the world: its number there, when it began, and its bytes; ``None`` where it was lost."""

    number: int
    stamp_ns: int
    data: UInt8[np.ndarray, "channel sample"] | None


class RadarBox:
    """The box's logic; times are nanoseconds of the world's clock, passed in.

    Args:
        sender: of its frames.
        radar: time axis of its scans.
        channels: of a scan.
        period_s: from scan to scan.
    """

    def __init__(self, sender: Sender, radar: RadarConfig, channels: int, period_s: float) -> None:
        self.state = RadarState.IDLE
        self.dropped, self.errors = 0, 0
        self._sender, self._radar, self._channels, self._period_s = sender, radar, channels, period_s
        self._reader, self._rules = FrameReader(), Acceptance()
        self._mode = 0
        self._begun_ns: int | None = None
        self._first: int | None = None
        self._every = 1
        self._busy_since_ns = 0
        self._waiting: deque[Recorded] = deque()

    def receive(self, data: bytes, now_ns: int) -> None:
        """Bytes that came over the line."""
        for frame in self._reader.feed(data):
            if frame is None or self._rules.judge(frame, now_ns) is not Verdict.TAKEN:
                continue
            self._mode = frame.mode
            if frame.kind == Kind.RADAR_COMMAND:
                self._obey(frame, now_ns)

    def forget_line(self) -> None:
        """The connection is another one: half a frame of the old one is nobody's."""
        self._reader = FrameReader()

    def put(self, scans: list[Recorded]) -> None:
        """Scans of the world, in their order; those of before the start are left."""
        for scan in scans:
            if self.state is not RadarState.SCANNING or self._begun_ns is None or scan.stamp_ns < self._begun_ns:
                continue
            if self._first is None:
                self._first = scan.number
            if (scan.number - self._first) % self._every == 0:
                self._waiting.append(scan)

    def due(self, now_ns: int, late_ns: int = 0) -> list[tuple[int, bytes]]:
        """Scan frames whose time has come, each with when it was due; ``late_ns`` later than a sound radar's."""
        self._let_time_pass(now_ns)
        frames = []
        wait_ns = round(1e9 * self._period_s) + PROCESSING_NS + late_ns
        while self._waiting and self._waiting[0].stamp_ns + wait_ns <= now_ns:
            scan = self._waiting.popleft()
            if scan.data is None or self._first is None:
                self.dropped += 1
                continue
            channels, samples = scan.data.shape
            number = (scan.number - self._first) // self._every
            head = _SCAN.pack(number, channels, samples, (1 << channels) - 1)
            frame = self._sender.frame(Kind.RADAR_SCAN, head + scan.data.tobytes(), scan.stamp_ns, self._mode)
            frames.append((scan.stamp_ns + wait_ns, frame))
        return frames

    def health(self, due_ns: int) -> bytes:
        """The health frame of a moment."""
        payload = _HEALTH.pack(self.state, self.errors, _TEMPERATURE_C, self.dropped)
        return self._sender.frame(Kind.RADAR_HEALTH, payload, due_ns, self._mode)

    def description(self, due_ns: int) -> bytes:
        """The description of its scans."""
        radar = self._radar
        payload = _DESCRIPTION.pack(
            self._channels,
            radar.samples,
            round(1e3 * radar.sample_step_ns),
            round(1e3 * radar.time_zero_ns),
            128.0,
            round(1e6 * self._period_s * self._every),
        )
        return self._sender.frame(Kind.RADAR_DESCRIPTION, payload, due_ns, self._mode)

    def _obey(self, frame: Frame, now_ns: int) -> None:
        action, period_us = _COMMAND.unpack(frame.payload)
        if action == 0:
            self.state = RadarState.IDLE
            self._waiting.clear()
        elif action == 1:
            if self.state is not RadarState.SCANNING:
                self._begun_ns, self._first = now_ns, None
            self._every = max(round(period_us / (1e6 * self._period_s)), 1)
            self.state = RadarState.SCANNING
        elif action in (2, 3) and self.state is RadarState.IDLE:
            self.state = RadarState.CALIBRATING if action == 2 else RadarState.LOOKING_UP
            self._busy_since_ns = now_ns

    def _let_time_pass(self, now_ns: int) -> None:
        busy = self.state in (RadarState.CALIBRATING, RadarState.LOOKING_UP)
        if busy and now_ns - self._busy_since_ns >= _BUSY_NS:
            self.state = RadarState.IDLE
