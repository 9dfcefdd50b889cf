"""Outputs are there whole or not at all: existing files, missing folders, full disks, errors on the way."""

import errno
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from formats.samples import make_description, write_drive
from lgprjax.formats import DriveLog, DriveWriter, atomic_output
from refusals import refused

_FULL_DISK = """
import json, os, resource, sys
from pathlib import Path
import numpy as np
sys.path.insert(0, sys.argv[2])
from formats.samples import make_description
from lgprjax.errors import InputError
from lgprjax.formats import DriveWriter
folder = Path(sys.argv[1])
rng = np.random.default_rng(0)
for limit in map(int, sys.argv[3:]):
    resource.setrlimit(resource.RLIMIT_FSIZE, (limit, resource.RLIM_INFINITY))
    appended = 0
    try:
        description = make_description(channels=11, samples=369)
        with DriveWriter.create(folder / "a.drive.h5", description, channels=11, dtype=np.uint8) as writer:
            for start in range(0, 4000, 500):
                writer.append(np.arange(start, start + 500) / 126, rng.integers(0, 256, (500, 11, 369), dtype=np.uint8))
                appended += 1
    except InputError as error:
        print(json.dumps([error.file, error.place, error.found, appended, os.listdir(folder)]))
"""


def test_a_full_disk_is_one_refusal_and_leaves_nothing(tmp_path: Path) -> None:
    """Full in the header, in the first chunk, and in a later one. HDF5 alone would print pages and crash at the end."""
    tests = Path(__file__).parents[1]
    limits = {9_000: 0, 600_000: 0, 9_000_000: 4}
    done = subprocess.run(
        [sys.executable, "-c", _FULL_DISK, str(tmp_path), str(tests), *map(str, limits)],
        capture_output=True,
        text=True,
        check=False,
        cwd=tests.parent,
    )
    assert (done.returncode, done.stderr) == (0, "")
    told = [json.loads(line) for line in done.stdout.splitlines()]
    full = [str(tmp_path / "a.drive.h5"), "output", os.strerror(errno.EFBIG)]
    assert told == [[*full, appended, []] for appended in limits.values()]


def test_a_full_disk_that_shows_only_on_closing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = DriveWriter.create(tmp_path / "a.drive.h5", make_description(), channels=3, dtype=np.uint8)

    def refuse(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    writer.append(np.arange(3.0), np.zeros((3, 3, 8), np.uint8))
    monkeypatch.setattr(os, "pwrite", refuse)
    with refused("output", found=os.strerror(errno.ENOSPC)), writer:
        pass
    assert list(tmp_path.iterdir()) == []


def test_an_existing_output_needs_force(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    before = path.read_bytes()
    with refused("output", "--force", file=path):
        write_drive(path)
    assert path.read_bytes() == before
    writer = DriveWriter.create(path, make_description(), channels=3, dtype=np.uint8, force=True)
    writer.append(np.arange(9.0), np.zeros((9, 3, 8), np.uint8))
    with pytest.raises(RuntimeError, match="stop"), writer:
        raise RuntimeError("stop")
    assert path.read_bytes() == before
    with DriveWriter.create(path, make_description(), channels=3, dtype=np.uint8, force=True) as writer:
        writer.append(np.arange(9.0), np.zeros((9, 3, 8), np.uint8))
    with DriveLog.open(path) as log:
        assert log.scans == 9
    assert list(tmp_path.iterdir()) == [path]


def test_an_output_appears_only_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with atomic_output(path) as temporary:
        temporary.write_text("half")
        assert temporary.parent == tmp_path
        assert temporary.name == f".a.txt.partial-{os.getpid()}"
        assert not path.exists()
    assert path.read_text() == "half"
    assert list(tmp_path.iterdir()) == [path]


def test_folders_that_are_none_or_cannot_be_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    with refused("output", file=tmp_path), atomic_output(tmp_path, True):
        pass
    with refused("output"), atomic_output(tmp_path / "no" / "a.txt"):
        pass
    # Errors of other files pass through.
    with pytest.raises(FileNotFoundError), atomic_output(tmp_path / "a.txt"):
        (tmp_path / "input").read_text()
    assert list(tmp_path.iterdir()) == []

    def refuse(self: Path, *_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))

    monkeypatch.setattr(Path, "open", refuse)
    with refused("output", found=os.strerror(errno.EACCES)):
        DriveWriter.create(tmp_path / "a.drive.h5", make_description(), channels=3, dtype=np.uint8)
