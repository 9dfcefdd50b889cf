"""What a job of an archive run is, and what it is named by: everything that its result depends on."""

import hashlib
import json
from dataclasses import asdict
from pathlib import Path
from typing import NamedTuple

from lgprjax import __version__
from lgprjax.registration import RegisterOptions


class FileStamp(NamedTuple):
    """What changes when a file is written anew: size, and time of the last change in nanoseconds."""

    size: int
    changed_ns: int


class ArchiveRun(NamedTuple):
    """What all jobs of a run have in common.

    Attributes:
        map_path: the database; absolute.
        map_sha256: of its file, and ``map_stamp`` when that was taken.
        options: the search.
        folder: of the results; absolute.
        threads: each worker is held to.
    """

    map_path: Path
    map_sha256: str
    map_stamp: FileStamp
    options: RegisterOptions
    folder: Path
    threads: int


class Job(NamedTuple):
    """One drive to be registered.

    Attributes:
        name: of the drive, and of its outputs.
        drive: its log; absolute.
        drive_sha256: of the log.
        key: of the job, see ``key_of_job``.
    """

    name: str
    drive: Path
    drive_sha256: str
    key: str


def stamp_of(path: Path) -> FileStamp:
    """Stamp of a file as it is now."""
    found = path.stat()
    return FileStamp(found.st_size, found.st_mtime_ns)


def settings_of(options: RegisterOptions) -> dict[str, object]:
    """The search as plain numbers, ready for JSON."""
    settings: dict[str, object] = asdict(options)
    own = options.own_thresholds
    settings["own_thresholds"] = None if own is None else {name: float(value) for name, value in own._asdict().items()}
    return settings


def key_of_job(drive_sha256: str, map_sha256: str, settings: dict[str, object]) -> str:
    """SHA-256 of what a job's result depends on; the order of the settings does not matter."""
    told = {"drive": drive_sha256, "map": map_sha256, "settings": settings, "version": __version__}
    return hashlib.sha256(json.dumps(told, sort_keys=True).encode()).hexdigest()
