"""Outputs are there whole or not at all: existing files, missing folders, full disks, errors on the way."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from formats.samples import make_description, write_drive
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, DriveWriter, atomic_output

_FULL_DISK = """
import os, resource, sys
from pathlib import Path
import numpy as np
sys.path.insert(0, sys.argv[3])
from formats.samples import make_description
from lgprjax.errors import InputError
from lgprjax.formats import DriveWriter
limit, folder = int(sys.argv[1]), Path(sys.argv[2])
resource.setrlimit(resource.RLIMIT_FSIZE, (limit, limit))
rng = np.random.default_rng(0)
appended = 0
try:
    description = make_description(channels=11, samples=369)
    with DriveWriter.create(folder / "a.drive.h5", description, channels=11, dtype=np.uint8) as writer:
        for start in range(0, 4000, 500):
            writer.append(np.arange(start, start + 500) / 126, rng.integers(0, 256, (500, 11, 369), dtype=np.uint8))
            appended += 1
except InputError as error:
    print(error)
print("appended", appended, "left", os.listdir(folder))
"""


# Full in the header, in the first chunk, in a later one, and only when the file is closed.
@pytest.mark.parametrize(("limit", "appended"), [(9_000, "0"), (600_000, "0"), (9_000_000, "4")])
def test_full_disk_is_one_line_and_leaves_nothing(tmp_path: Path, limit: int, appended: str) -> None:
    tests = Path(__file__).parents[1]
    done = subprocess.run(
        [sys.executable, "-c", _FULL_DISK, str(limit), str(tmp_path), str(tests)],
        capture_output=True,
        text=True,
        check=False,
        cwd=tests.parent,
    )
    # HDF5 alone would print pages here and crash the process when it ends.
    assert (done.returncode, done.stderr) == (0, "")
    first, second = done.stdout.splitlines()
    assert first == f"{tmp_path}/a.drive.h5: output: expected a file that can be written, found File too large"
    assert second == f"appended {appended} left []"


def test_full_disk_that_shows_only_on_closing(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    writer = DriveWriter.create(tmp_path / "a.drive.h5", make_description(), channels=3, dtype=np.uint8)

    def refuse(*_: object) -> int:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    writer.append(np.arange(3.0), np.zeros((3, 3, 8), np.uint8))
    monkeypatch.setattr(os, "pwrite", refuse)
    with pytest.raises(InputError, match="found No space left on device"), writer:
        pass
    assert list(tmp_path.iterdir()) == []


def test_existing_output_needs_force(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    before = path.read_bytes()
    with pytest.raises(InputError, match="output: expected a new file, or --force, found one that exists"):
        write_drive(path)
    assert path.read_bytes() == before
    with DriveWriter.create(path, make_description(), channels=3, dtype=np.uint8, force=True) as writer:
        writer.append(np.arange(9.0), np.zeros((9, 3, 8), np.uint8))
    with DriveLog.open(path) as log:
        assert log.scans == 9
    assert list(tmp_path.iterdir()) == [path]


def test_forced_output_that_fails_keeps_the_old_file(tmp_path: Path) -> None:
    path = write_drive(tmp_path / "a.drive.h5")
    before = path.read_bytes()
    writer = DriveWriter.create(path, make_description(), channels=3, dtype=np.uint8, force=True)
    writer.append(np.arange(9.0), np.zeros((9, 3, 8), np.uint8))
    with pytest.raises(RuntimeError, match="stop"), writer:
        raise RuntimeError("stop")
    assert path.read_bytes() == before
    assert list(tmp_path.iterdir()) == [path]


def test_output_appears_only_at_the_end(tmp_path: Path) -> None:
    path = tmp_path / "a.txt"
    with atomic_output(path) as temporary:
        temporary.write_text("half")
        assert temporary.parent == tmp_path
        assert temporary.name == f".a.txt.partial-{os.getpid()}"
        assert not path.exists()
    assert path.read_text() == "half"
    assert list(tmp_path.iterdir()) == [path]


def test_folder_as_output_and_missing_folder(tmp_path: Path) -> None:
    with pytest.raises(InputError, match="output: expected a file name, found a folder"), atomic_output(tmp_path, True):
        pass
    with pytest.raises(InputError, match="expected a folder that exists"), atomic_output(tmp_path / "no" / "a.txt"):
        pass
    assert list(tmp_path.iterdir()) == []


def test_read_only_folder(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(self: Path, *_: object, **__: object) -> None:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(self))

    monkeypatch.setattr(Path, "open", refuse)
    with pytest.raises(InputError, match="expected a file that can be written, found Permission denied"):
        DriveWriter.create(tmp_path / "a.drive.h5", make_description(), channels=3, dtype=np.uint8)


def test_errors_of_other_files_pass_through(tmp_path: Path) -> None:
    with pytest.raises(FileNotFoundError), atomic_output(tmp_path / "a.txt"):
        (tmp_path / "input").read_text()
    assert list(tmp_path.iterdir()) == []
