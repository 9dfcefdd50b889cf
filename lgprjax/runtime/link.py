"""One end of a line: which frames of the other end are acted upon, and this end's own numbering."""

import secrets
from collections import Counter, deque
from collections.abc import Mapping
from enum import IntEnum
from typing import NamedTuple

from lgprjax.runtime.stamps import LeastDelay
from lgprjax.runtime.wire import Frame, Value, encode
from lgprjax.runtime.wire_messages import MESSAGES, RULES

_SILENT_NS = RULES["silent_ms"] * 1_000_000
_FUTURE_NS = RULES["future_ms"] * 1_000_000
_U32 = 1 << 32


class Verdict(IntEnum):
    """What becomes of a frame; all but ``ACCEPTED`` say why it is not acted upon."""

    ACCEPTED = 0
    WRONG_LINE = 32
    """Its message does not come over this line, or not from that end."""
    NO_SESSION = 33
    """Its session is 0."""
    SECOND_SENDER = 34
    """Of another session, while the line is alive."""
    REMEMBERED_SESSION = 35
    """Of a session that has ended."""
    REPEATED = 36
    """Its sequence number is not a new one."""
    STALE = 37
    """It came later than its time to live allows."""
    FROM_FUTURE = 38
    """It bears a stamp that the sender's clock had not reached."""


class _Ahead(NamedTuple):
    """Frames from the future that came while nothing was accepted, and agree with each other."""

    difference_ns: int
    least_ns: int
    since_ns: int


class Receiver:
    """Judges the frames of one line by ``data_schema/wire.toml``. Time is passed in, so that a replay judges alike.

    Args:
        line: its name.
        sender: of which end the frames are expected.

    Attributes:
        counts: frames by verdict.
        missed: sequence numbers that never came.
        session: of the sender; 0 before the first frame.
        last_accepted_ns: arrival of the last accepted frame.
    """

    def __init__(self, line: str, sender: str = "device") -> None:
        self._names = {name for name, message in MESSAGES.items() if (message.line, message.sender) == (line, sender)}
        self._remembered: deque[int] = deque(maxlen=RULES["sessions_remembered"])
        self._least = LeastDelay(0, 0)  # of the session
        self._ahead: _Ahead | None = None
        self._sequence = 0
        self.counts: Counter[Verdict] = Counter()
        self.missed = 0
        self.session = 0
        self.last_accepted_ns = 0

    def accept(self, frame: Frame, arrival_ns: int) -> Verdict:
        """Whether the frame is acted upon. ``arrival_ns`` is the receiver's monotonic clock and must not fall."""
        verdict = self._judge(frame, arrival_ns)
        self.counts[verdict] += 1
        if verdict is Verdict.ACCEPTED:
            self.last_accepted_ns = arrival_ns
            self._ahead = None
        return verdict

    def _judge(self, frame: Frame, arrival_ns: int) -> Verdict:
        if frame.name not in self._names:
            return Verdict.WRONG_LINE
        if frame.session == 0:
            return Verdict.NO_SESSION
        if frame.session != self.session:
            return self._other_session(frame, arrival_ns)
        step = (frame.sequence - self._sequence) % _U32
        if not 0 < step < _U32 // 2:
            return Verdict.REPEATED
        self._sequence = frame.sequence
        self.missed += step - 1
        return self._age(frame, arrival_ns)

    def _other_session(self, frame: Frame, arrival_ns: int) -> Verdict:
        if self.session and arrival_ns - self.last_accepted_ns < _SILENT_NS:
            return Verdict.SECOND_SENDER
        if frame.session in self._remembered:
            return Verdict.REMEMBERED_SESSION
        self._remembered.append(frame.session)
        self.session = frame.session
        self._sequence = frame.sequence
        self._least = LeastDelay(arrival_ns - frame.stamp_us * 1000, arrival_ns)
        return Verdict.ACCEPTED

    def _age(self, frame: Frame, arrival_ns: int) -> Verdict:
        difference = arrival_ns - frame.stamp_us * 1000
        age = difference - self._least.at(arrival_ns)
        if frame.ttl_ms and age > frame.ttl_ms * 1_000_000:
            return Verdict.STALE
        if age < -_FUTURE_NS:
            if not self._set_ahead(difference, arrival_ns):
                return Verdict.FROM_FUTURE
        else:
            self._least.feed(difference, arrival_ns)
        return Verdict.ACCEPTED

    def _set_ahead(self, difference_ns: int, arrival_ns: int) -> bool:
        """Whether the sender's clock was set ahead: nothing else came for as long as makes a line silent."""
        ahead = self._ahead
        if ahead is None or abs(difference_ns - ahead.difference_ns) > _FUTURE_NS:
            self._ahead = _Ahead(difference_ns, difference_ns, arrival_ns)
            return False
        self._ahead = ahead._replace(least_ns=min(ahead.least_ns, difference_ns))
        if arrival_ns - ahead.since_ns < _SILENT_NS:
            return False
        self._least = LeastDelay(self._ahead.least_ns, arrival_ns)
        return True


def draw_session() -> int:
    """A session's number: random, not 0."""
    return secrets.randbelow(_U32 - 1) + 1


class Sender:
    """Numbers and stamps the frames of this end.

    Args:
        session: of this start of the program, ``draw_session``.
    """

    def __init__(self, session: int) -> None:
        self._session = session
        self._sequence = 0

    def frame(self, name: str, fields: Mapping[str, Value], *, mode: int, mono_ns: int, ttl_ms: int = 0) -> bytes:
        """The next frame; ``mono_ns`` is this computer's monotonic clock now.

        Raises:
            ValueError: by ``wire.encode``; no number is used up.
        """
        stamp_us = mono_ns // 1000
        raw = encode(
            name, fields, mode=mode, session=self._session, sequence=self._sequence, stamp_us=stamp_us, ttl_ms=ttl_ms
        )
        self._sequence = (self._sequence + 1) % _U32
        return raw
