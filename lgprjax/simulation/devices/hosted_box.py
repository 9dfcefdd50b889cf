"""What every drive-by-wire box does with its line: frames judged, commands that end, defaults taken by itself."""

from abc import ABC, abstractmethod
from collections.abc import Iterable

from lgprjax.simulation.devices.wire_ends import Acceptance, Frame, FrameReader, Sender, Verdict

POWER_CUT = 4
DEFAULTS, BAD_FRAMES, SECOND_SENDER, BUS_OFF, NO_POWER = 1, 2, 4, 64, 256
_BAD_IN_A_ROW = 3
_SECOND_SHOWN_NS = 1_000_000_000
_LEAST_SUPPLY_V = 10.0


class HostedBox(ABC):
    """The logic that boxes share; times are nanoseconds of the world's clock, passed in.

    Attributes:
        mode: that the host was in when it last was heard; ``mode_since_ns`` since when.
        held: what is held engaged, bits.
        refused: frames refused since start.
        bus_off: a fault: nothing is heard.
    """

    def __init__(self, sender: Sender) -> None:
        self.mode, self.mode_since_ns = 0, 0
        self.held, self.refused = 0, 0
        self.bus_off = False
        self._sender = sender
        self._reader, self._rules = FrameReader(), Acceptance()
        self._sequence = 0
        self._ends_ns: int | None = None
        self._default, self._armed = True, False
        self._bad_in_a_row, self._three_bad = 0, False
        self._second_ns: int | None = None
        self._supply_v = 24.0

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
            self._hear(frame, now_ns)

    @abstractmethod
    def _hear(self, frame: Frame, now_ns: int) -> None:
        """A frame that was taken."""

    def _engage(self, frame: Frame, engage: int, known: int, now_ns: int) -> None:
        """What a command holds engaged; ``known`` are the bits that the box has."""
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
        """The host has let go of everything."""

    def _fall(self, *, cut: bool = False) -> None:
        """To the defaults; ``cut``: with the power cut."""
        del cut  # what a cut does beside is a box's own
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
