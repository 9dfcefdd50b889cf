"""Short drives of the canonical site, registered by one worker once a session; outputs compared byte by byte."""

from pathlib import Path
from typing import NamedTuple

import h5py
import pytest

from benchmarks.archive import cut_drive
from canon.shared import shared_folder
from canon.site import Site
from lgprjax.batch import outputs_of
from lgprjax.cli import main
from lgprjax.files import file_hash
from lgprjax.formats import DriveLog

DRIVES, SCANS = 6, 96


class Short(NamedTuple):
    """A map, short drives on it, and the folder in which one worker registered them."""

    map: Path
    drives: list[Path]
    one: Path


def status_of(*arguments: object) -> int:
    with pytest.raises(SystemExit) as stopped:
        main([str(each) for each in arguments])
    assert isinstance(stopped.value.code, int)
    return stopped.value.code


def register(map_path: Path, drives: list[Path], folder: Path, *options: object) -> int:
    return status_of("register", map_path, *drives, "-o", folder, "--threads", 1, *options)


def hashes(folder: Path, drives: list[Path]) -> dict[str, str]:
    names = [path.name.removesuffix(".drive.h5") for path in drives]
    return {output: file_hash(folder / output) for name in names for output in outputs_of(name)}


def assert_same(folder: Path, short: Short) -> None:
    """The same bytes in every output; a file that differs is told by its columns."""
    ours, theirs = hashes(folder, short.drives), hashes(short.one, short.drives)
    for name in sorted(ours):
        if ours[name] != theirs[name] and name.endswith(".h5"):
            with h5py.File(folder / name) as a, h5py.File(short.one / name) as b:
                print(name, {column: (a[column][()], b[column][()]) for column in a if unlike(a[column], b[column])})
    assert ours == theirs


def unlike(a: h5py.Dataset, b: h5py.Dataset) -> bool:
    return bool(a[()].tobytes() != b[()].tobytes())


def make_short(site: Site, factory: pytest.TempPathFactory) -> Short:
    """Cut the drives from the live one, and register them."""

    def make(folder: Path) -> None:
        with DriveLog.open(site.logs["live"]) as log:
            for number, path in enumerate(drives_in(folder)):
                start = number * (log.scans - SCANS) // DRIVES
                cut_drive(log, start, start + SCANS, path)
        assert register(site.map, drives_in(folder), folder / "one", "--workers", 1) == 0

    folder = shared_folder(factory, "short_drives", make)
    return Short(site.map, drives_in(folder), folder / "one")


def drives_in(folder: Path) -> list[Path]:
    return [folder / f"short_{number:02d}.drive.h5" for number in range(DRIVES)]
