"""The ring: against a list, over its end, full, spoilt, and with either side killed at any moment."""

import mmap
import struct
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st

from lgprjax.runtime.ring import Ring
from validation.loops.ring_ends import check_killed_reader, check_killed_writer, environment

_HEAD, _PLACE = 64, 8


def test_what_is_put_is_taken(tmp_path: Path) -> None:
    ring = Ring.create(tmp_path / "r", 1000)
    assert ring.take() == []
    assert ring.latest() is None
    assert all(ring.put(message) for message in (b"one", b"", b"three"))
    assert ring.waiting == 3 * _PLACE + 8
    assert ring.take() == [b"one", b"", b"three"]
    assert ring.waiting == 0
    assert ring.put(b"four")
    assert ring.put(b"five")
    assert ring.latest() == b"five"
    assert ring.latest() is None


@settings(max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
@given(
    size=st.integers(24, 200),
    steps=st.lists(st.one_of(st.binary(max_size=60), st.integers(0, 80)), max_size=60),
    anew=st.booleans(),
)
def test_against_a_list(tmp_path: Path, size: int, steps: list[bytes | int], anew: bool) -> None:
    """Bytes are put, a number takes about as many; ``anew`` opens both ends again before each step."""
    path = Path(tempfile.mkdtemp(dir=tmp_path)) / "r"
    writer = reader = Ring.create(path, size)
    held: list[bytes] = []
    lost = 0
    for step in steps:
        if anew:
            writer, reader = Ring(path), Ring(path)
        if isinstance(step, bytes):
            room = size - sum(_PLACE + len(message) for message in held)
            fits = _PLACE + len(step) <= room
            assert writer.put(step) is fits
            held += [step] if fits else []
            lost += not fits
        else:
            due, taken = 0, 0
            while due < len(held) and taken < step:
                taken += len(held[due])
                due += 1
            assert reader.take(step) == held[:due]
            held = held[due:]
        assert reader.lost == lost
        assert writer.waiting == sum(_PLACE + len(message) for message in held)
    assert reader.take() == held


def test_full_is_counted_and_goes_on(tmp_path: Path) -> None:
    ring = Ring.create(tmp_path / "r", 100)
    assert ring.put(bytes(42))
    assert ring.put(bytes(42))
    assert not ring.put(b"")
    assert not ring.put(bytes(200))
    assert ring.lost == 2
    assert len(ring.take()) == 2
    assert ring.put(bytes(92))
    assert ring.take() == [bytes(92)]


def test_what_is_not_released_stays(tmp_path: Path) -> None:
    ring = Ring.create(tmp_path / "r", 1000)
    for message in (b"a", b"bb", b"ccc"):
        ring.put(message)
    first = ring.peek(3)
    assert [message for _, message in first.messages] == [b"a", b"bb"]
    assert [end for end, _ in first.messages] == [9, 19]
    assert first.end == 19
    assert len(Ring(tmp_path / "r").peek().messages) == 3
    ring.release(first.messages[0][0])
    assert ring.take() == [b"bb", b"ccc"]
    # Positions of another ring, or of long ago, release nothing.
    ring.put(b"d")
    ring.release(5)
    ring.release(10_000)
    assert ring.take() == [b"d"]


@pytest.mark.parametrize("at", [0, 4, 8])
def test_spoilt_bytes_are_never_taken(tmp_path: Path, at: int) -> None:
    ring = Ring.create(tmp_path / "r", 1000)
    for message in (b"good", b"spoilt", b"after"):
        ring.put(message)
    place = _HEAD + _PLACE + 4
    with (tmp_path / "r").open("r+b") as file, mmap.mmap(file.fileno(), 0) as held:
        held[place + at] ^= 0x40
    found: list[bytes] = []
    for _ in range(6):
        found += ring.take()
    # A spoilt length may take the rest with it; what is taken is whole.
    assert found == ([b"good"] if at < 4 else [b"good", b"after"])
    assert ring.damaged >= 1
    assert ring.put(b"next")
    assert ring.take() == [b"next"]


def test_zeros_are_no_message(tmp_path: Path) -> None:
    ring = Ring.create(tmp_path / "r", 100)
    with (tmp_path / "r").open("r+b") as file, mmap.mmap(file.fileno(), 0) as held:
        held[16:24] = struct.pack("<Q", 40)
    assert not any(ring.take() for _ in range(20))
    assert ring.waiting == 0


def test_a_late_byte_is_waited_for(tmp_path: Path) -> None:
    ring = Ring.create(tmp_path / "r", 1000)
    ring.put(b"late")
    with (tmp_path / "r").open("r+b") as file, mmap.mmap(file.fileno(), 0) as held:
        held[_HEAD + _PLACE] ^= 0xFF
        assert ring.take() == []
        held[_HEAD + _PLACE] ^= 0xFF
    assert ring.take() == [b"late"]
    assert ring.damaged == 0


def test_made_by_two_at_once_it_is_one(tmp_path: Path) -> None:
    made = "import sys; from lgprjax.runtime.ring import Ring; Ring.create(sys.argv[1], 4000).put(b'x')"
    both = [subprocess.Popen([sys.executable, "-c", made, str(tmp_path / "r")], env=environment()) for _ in range(2)]
    assert [process.wait(20) for process in both] == [0] * 2
    assert len(list(tmp_path.iterdir())) == 1
    # They write over each other: but into one ring.
    assert b"x" in Ring(tmp_path / "r").take()


def test_another_file_is_refused(tmp_path: Path) -> None:
    (tmp_path / "r").write_bytes(bytes(500))
    with pytest.raises(ValueError, match="ring"):
        Ring(tmp_path / "r")


def test_the_writer_and_the_reader_killed_at_any_moment(tmp_path: Path) -> None:
    """Longer: ``validation/loops/test_killed.py``."""
    check_killed_writer(tmp_path / "w", 3)
    check_killed_reader(tmp_path / "r", 3)
