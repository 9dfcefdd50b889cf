"""Frames, garbage and lies over each kind of line: nothing wrong is ever acted upon, and no memory is kept.

A million bytes a line: ``validation/damage/test_lines.py``.
"""

import random
import tracemalloc

import pytest

from lgprjax.wire import Frame, FrameParser, Receiver
from validation.damage.line_storm import MS, Piece, Stream, check_gnss, check_line


@pytest.mark.parametrize("line", ["radar", "drive_by_wire", "controller"])
def test_nothing_wrong_is_acted_upon(line: str) -> None:
    check_line(line, 200_000)


def test_gnss_messages_with_a_wrong_checksum_are_never_read() -> None:
    check_gnss(100_000)


def test_random_bytes_alone_are_never_acted_upon() -> None:
    chosen = random.Random(0)
    parser, receiver = FrameParser(), Receiver("radar")
    frames = [item for _ in range(200) for item in parser.feed(chosen.randbytes(1000)) if isinstance(item, Frame)]
    assert frames == []
    assert receiver.counts.total() == 0


def test_memory_stays_flat() -> None:
    pieces = Stream("drive_by_wire", seed=12).pieces(60_000)
    parser, receiver = FrameParser(), Receiver("drive_by_wire")

    def run(part: list[Piece]) -> None:
        for at_ms, data, _ in part:
            for item in parser.feed(data):
                if isinstance(item, Frame):
                    receiver.accept(item, at_ms * MS)

    run(pieces[: len(pieces) // 4])
    tracemalloc.start()
    try:
        run(pieces[len(pieces) // 4 :])
        held, peak = tracemalloc.get_traced_memory()
    finally:
        tracemalloc.stop()
    assert held < 60_000
    assert peak < 200_000
