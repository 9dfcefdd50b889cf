"""Folders that are made once a session and read by every worker."""

import fcntl
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest


def shared_folder(factory: pytest.TempPathFactory, name: str, make: Callable[[Path], object]) -> Path:
    """Folder that the first worker to ask for it fills; the others wait for it. Its files are not to be changed.

    Args:
        factory: of the session.
        name: unique in the suite.
        make: fills the empty folder.
    """
    base = factory.getbasetemp()
    # Each worker of a parallel run has a folder of its own in the run's.
    run = base.parent if base.name.startswith("popen-") else base
    folder = run / "shared" / name
    folder.parent.mkdir(exist_ok=True)
    with (run / "shared" / f"{name}.lock").open("w") as lock:
        fcntl.flock(lock, fcntl.LOCK_EX)
        made = run / "shared" / f"{name}.made"
        if not made.exists():
            # Left by a worker that failed to make it.
            shutil.rmtree(folder, ignore_errors=True)
            folder.mkdir()
            make(folder)
            made.touch()
    return folder
