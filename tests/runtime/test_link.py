"""Which frames of a line are acted upon: each rule of ``data_schema/wire.toml``, and clocks that run apart."""

import json
import random
from itertools import pairwise

import pytest

from lgprjax.wire import Frame, FrameVerdict, Receiver, Sender, decode, draw_session
from runtime.line_vectors import PATH

_MS = 1_000_000


def _status(session: int, sequence: int, stamp_ms: float, ttl_ms: int = 100, name: str = "controller_status") -> Frame:
    return Frame(name, 0, 0, session, sequence, round(stamp_ms * 1000), ttl_ms, {"buttons": 2}, b"")


class _Line:
    """A receiver of a controller's frames, told the times in ms."""

    def __init__(self) -> None:
        self.receiver = Receiver("controller")

    def came(self, at_ms: float, session: int, sequence: int, stamp_ms: float, ttl_ms: int = 100) -> FrameVerdict:
        return self.receiver.accept(_status(session, sequence, stamp_ms, ttl_ms), round(at_ms * _MS))


def test_published_conversation() -> None:
    conversation = json.loads(PATH.read_text(encoding="utf-8"))["conversation"]
    receiver = Receiver(conversation["line"])
    for number, step in enumerate(conversation["steps"]):
        verdict = receiver.accept(decode(bytes.fromhex(step["hex"])), step["arrival_us"] * 1000)
        assert verdict.name.lower() == step["verdict"], number
    assert receiver.missed == conversation["missed"]
    assert receiver.counts.total() == len(conversation["steps"])
    assert {step["verdict"] for step in conversation["steps"]} == {verdict.name.lower() for verdict in FrameVerdict}


def test_sequence_wraps_and_half_of_it_is_the_past() -> None:
    line = _Line()
    assert line.came(0, 5, 2**32 - 2, 0) is FrameVerdict.ACCEPTED
    assert line.came(10, 5, 1, 10) is FrameVerdict.ACCEPTED
    assert line.receiver.missed == 2
    assert line.came(20, 5, 2**32 - 1, 20) is FrameVerdict.REPEATED
    assert line.came(30, 5, 1 + 2**31, 30) is FrameVerdict.REPEATED
    assert line.came(40, 5, 2**31, 40) is FrameVerdict.ACCEPTED


def test_sessions_are_remembered_up_to_sixteen() -> None:
    line = _Line()
    for session in range(1, 18):
        assert line.came(1000.0 * session, session, 0, 0) is FrameVerdict.ACCEPTED
    assert line.came(18_000, 2, 1, 1000) is FrameVerdict.REMEMBERED_SESSION
    assert line.came(18_010, 1, 1, 1000) is FrameVerdict.ACCEPTED  # the seventeenth last: forgotten


def test_frames_held_up_are_stale_however_long_the_line_was_silent() -> None:
    line = _Line()
    for tick in range(50):
        line.came(20.0 * tick + 3, 7, tick, 20.0 * tick)
    # The line hangs for ten seconds, then all of it comes at once.
    verdicts = [line.came(11_000, 7, tick, 20.0 * tick) for tick in range(50, 550)]
    assert verdicts == [FrameVerdict.STALE] * 495 + [FrameVerdict.ACCEPTED] * 5
    assert line.came(11_001, 7, 300, 6000.0) is FrameVerdict.REPEATED
    assert line.came(11_020, 7, 550, 11_000, 0) is FrameVerdict.ACCEPTED


@pytest.mark.parametrize("ahead_ms", [60.0, 1e9])
def test_one_stamp_from_the_future_spoils_nothing(ahead_ms: float) -> None:
    line = _Line()
    for tick in range(200):
        future = tick % 50 == 30
        verdict = line.came(20.0 * tick, 7, tick, 20.0 * tick + ahead_ms * future)
        assert verdict is (FrameVerdict.FROM_FUTURE if future else FrameVerdict.ACCEPTED)


def test_a_clock_set_ahead_is_taken_after_a_silence() -> None:
    line = _Line()
    for tick in range(50):
        line.came(20.0 * tick, 7, tick, 20.0 * tick)
    verdicts = [line.came(20.0 * tick, 7, tick, 20.0 * tick + 3.6e6) for tick in range(50, 100)]
    taken = verdicts.index(FrameVerdict.ACCEPTED)
    assert taken == 10  # silent_ms over 20 ms
    assert set(verdicts[taken:]) == {FrameVerdict.ACCEPTED}
    # Stamps that only claim to be ahead, each by another leap, are never taken.
    leaps = [line.came(20.0 * tick, 7, tick, 20.0 * tick + 4e6 + 100.0 * tick) for tick in range(100, 150)]
    assert set(leaps) == {FrameVerdict.FROM_FUTURE}


def test_a_clock_set_back_is_stale_until_the_sender_starts_anew() -> None:
    line = _Line()
    line.came(5000, 7, 0, 5000)
    assert {line.came(5000 + 20.0 * tick, 7, tick, 20.0 * tick) for tick in range(1, 100)} == {FrameVerdict.STALE}
    assert line.came(7000, 9, 0, 2000) is FrameVerdict.ACCEPTED


@pytest.mark.parametrize("drift", [-1e-4, 1e-4])
def test_clocks_may_drift_for_an_hour(drift: float) -> None:
    random_ms = random.Random(3)
    line = _Line()
    stale = 0
    for tick in range(3600 * 2):
        sent = 500.0 * tick
        stale += line.came(sent + random_ms.expovariate(0.2), 7, tick, sent * (1 + drift)) is not FrameVerdict.ACCEPTED
    assert stale == 0
    # The measure of age has not grown blunt: a frame 160 ms late on top of the usual few is found.
    late = 3600 * 1000.0
    assert line.came(late + 165, 7, 60_000, late * (1 + drift)) is FrameVerdict.STALE


def test_wrong_line_or_wrong_end() -> None:
    receiver = Receiver("drive_by_wire", "host")
    assert receiver.accept(_status(7, 0, 0, name="drive_command"), 0) is FrameVerdict.ACCEPTED
    for name in ("drive_status", "controller_light", "radar_command"):
        assert receiver.accept(_status(7, 1, 20, name=name), 20 * _MS) is FrameVerdict.WRONG_LINE
    assert receiver.last_accepted_ns == 0


def test_a_sender_numbers_and_stamps() -> None:
    sender = Sender(77)
    frames = [
        decode(sender.frame("drive_test", {"test": 1}, mode=tick, mono_ns=tick * 20 * _MS + 999, ttl_ms=200))
        for tick in range(3)
    ]
    assert [frame.sequence for frame in frames] == [0, 1, 2]
    assert [(frame.session, frame.stamp_us, frame.ttl_ms, frame.mode) for frame in frames] == [
        (77, tick * 20_000, 200, tick) for tick in range(3)
    ]
    with pytest.raises(ValueError, match="test"):
        sender.frame("drive_test", {"test": 256}, mode=0, mono_ns=0)
    assert decode(sender.frame("drive_test", {"test": 1}, mode=0, mono_ns=0)).sequence == 3
    sender._sequence = 2**32 - 1
    last, first = (decode(sender.frame("drive_test", {"test": 1}, mode=0, mono_ns=0)) for _ in range(2))
    assert (last.sequence, first.sequence) == (2**32 - 1, 0)


def test_sessions_are_drawn_anew() -> None:
    drawn = [draw_session() for _ in range(1000)]
    assert all(0 < session < 2**32 for session in drawn)
    assert all(left != right for left, right in pairwise(sorted(drawn)))
