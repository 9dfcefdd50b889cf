"""One writer at a time, in real processes; what killed ones leave is cleared away."""

import os
import signal
import subprocess
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import pytest

from lgprjax.formats import locked_map, scratch_folder
from refusals import refused

_HOLDER = """
import sys, time
from pathlib import Path
from lgprjax.formats import locked_map, scratch_folder
target = Path(sys.argv[1])
with locked_map(target):
    scratch_folder(target).mkdir()
    (scratch_folder(target) / "half.map.h5").write_bytes(b"half")
    print("held", flush=True)
    time.sleep(60)
"""


@contextmanager
def holder(target: Path) -> Iterator[subprocess.Popen[str]]:
    """A process that holds the lock on a map, its work half done."""
    root = Path(__file__).parents[2]
    process = subprocess.Popen(
        [sys.executable, "-c", _HOLDER, str(target)], stdout=subprocess.PIPE, text=True, cwd=root
    )
    try:
        assert process.stdout is not None
        assert process.stdout.readline() == "held\n"
        yield process
    finally:
        process.kill()
        process.communicate()


def test_a_second_writer_is_refused_and_a_killed_one_stands_in_nobodys_way(tmp_path: Path) -> None:
    target = tmp_path / "road.map.h5"
    target.write_bytes(b"old")
    with holder(target) as process:
        with refused("output", file=target, found=process.pid), locked_map(target):
            pass
        assert len(list(tmp_path.iterdir())) == 3  # the map, the lock, the parts: nothing of it was touched
        process.send_signal(signal.SIGKILL)
        process.wait()
        assert len(list(tmp_path.iterdir())) == 3
        with locked_map(target):
            assert sorted(path.name for path in tmp_path.iterdir()) == [".road.map.h5.lock", "road.map.h5"]
    assert list(tmp_path.iterdir()) == [target]
    assert target.read_bytes() == b"old"


def test_remains_of_others_stay(tmp_path: Path) -> None:
    """Parts of a live process, of another map, and what only looks like them."""
    target = tmp_path / "road.map.h5"
    gone = subprocess.Popen([sys.executable, "-c", ""])
    gone.wait()
    kept = [
        tmp_path / f".road.map.h5.partial-{os.getppid()}",
        tmp_path / f".other.map.h5.partial-{gone.pid}",
        tmp_path / ".road.map.h5.partial-x",
        tmp_path / f"road.map.h5.partial-{gone.pid}",
    ]
    for path in [*kept, tmp_path / f".road.map.h5.partial-{gone.pid}"]:
        path.write_bytes(b"")
    with locked_map(target):
        pass
    assert sorted(tmp_path.iterdir()) == sorted(kept)


def test_the_lock_is_let_go_of_whatever_happens(tmp_path: Path) -> None:
    target, other = tmp_path / "road.map.h5", tmp_path / "b.map.h5"
    with pytest.raises(RuntimeError, match="stop"), locked_map(target):
        raise RuntimeError("stop")
    assert list(tmp_path.iterdir()) == []
    with locked_map(target), refused("output", found=os.getpid()), locked_map(target):
        pass
    # Maps do not lock each other.
    with locked_map(target), locked_map(other):
        assert scratch_folder(target) != scratch_folder(other)
    with refused("output"), locked_map(tmp_path / "no" / "a.map.h5"):
        pass
