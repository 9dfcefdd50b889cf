"""Either end of a ring in a process that is killed at any moment."""

import os
import random
import signal
import struct
import subprocess
import sys
import time
from pathlib import Path

from lgprjax.runtime.ring import Ring

_WRITE = """
import sys
from lgprjax.runtime.ring import Ring
ring, number = Ring(sys.argv[1]), int(sys.argv[2])
while True:
    # A ring that is full would lose: the writer of this test waits.
    while ring.waiting > 40_000:
        pass
    ring.put(number.to_bytes(8, "little") + bytes([number % 251]) * (number % 700))
    number += 1
"""
_READ = """
import sys
from lgprjax.runtime.ring import Ring
ring = Ring(sys.argv[1])
while True:
    waiting = ring.peek(2000)
    for _, message in waiting.messages:
        sys.stdout.buffer.write(message[:8])
    sys.stdout.buffer.flush()
    ring.release(waiting.end)
"""


def check_killed_writer(path: Path, kills: int) -> None:
    """Nothing of what a writer put before it was killed is lost, damaged or twice."""
    ring = Ring.create(path, 50_000)
    rng = random.Random(5)
    seen = 0
    for _ in range(kills):
        writer = subprocess.Popen([sys.executable, "-c", _WRITE, str(ring.path), str(seen)], env=environment())
        until_s = time.monotonic() + 10.0
        # From the first message on, so that each kill falls into its work.
        while not ring.waiting and time.monotonic() < until_s:
            pass
        until_s = time.monotonic() + rng.uniform(0.0, 0.05)
        while time.monotonic() < until_s or not ring.waiting:
            seen = _follow(ring.take(), seen)
        writer.send_signal(signal.SIGKILL)
        writer.wait()
        seen = _follow(ring.take(), seen)
        assert ring.waiting == 0
    assert seen > 40 * kills
    assert ring.damaged == ring.lost == 0


def check_killed_reader(path: Path, kills: int) -> None:
    """What a reader had not let go of comes again; nothing is left out."""
    ring = Ring.create(path, 50_000)
    rng = random.Random(6)
    put, got = 0, 0
    for _ in range(kills):
        reader = subprocess.Popen(
            [sys.executable, "-c", _READ, str(ring.path)], env=environment(), stdout=subprocess.PIPE
        )
        until_s = time.monotonic() + 10.0
        while ring.waiting > 20_000 and time.monotonic() < until_s:
            pass
        until_s = time.monotonic() + rng.uniform(0.1, 0.3)
        while time.monotonic() < until_s:
            if ring.waiting < 40_000:
                assert ring.put(put.to_bytes(8, "little") + bytes(put % 700))
                put += 1
        reader.send_signal(signal.SIGKILL)
        told, _ = reader.communicate()
        numbers = [number for (number,) in struct.iter_unpack("<Q", told[: len(told) // 8 * 8])]
        if numbers:
            assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
            # What it had read but not released comes again; nothing is left out.
            assert numbers[0] <= got
            got = max(got, numbers[-1] + 1)
    rest = [int.from_bytes(message[:8], "little") for message in ring.take()]
    assert rest == list(range(put - len(rest), put))
    assert not rest or rest[0] <= got
    assert got > 50 * kills


def _follow(messages: list[bytes], seen: int) -> int:
    for message in messages:
        number = int.from_bytes(message[:8], "little")
        assert number == seen
        assert message[8:] == bytes([number % 251]) * (number % 700)
        seen += 1
    return seen


def environment() -> dict[str, str]:
    """A program started with it finds what this one found."""
    return {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
