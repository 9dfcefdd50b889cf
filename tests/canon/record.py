"""A first drive by hand on a short course, recorded without a map in lock step."""

from pathlib import Path
from typing import NamedTuple

from canon.commands import succeed
from cli.processes import ROOT, quick


class Recorded(NamedTuple):
    """A run that only recorded: its folder, its drive log, and what the command said."""

    folder: Path
    drive: Path
    said: str


def write_record(folder: Path, *changes: tuple[str, str]) -> Path:
    """The example, on a short course with a sixth of the scans."""
    text = (ROOT / "onboard" / "record.run.toml").read_text(encoding="utf-8")
    vehicle = f'"{ROOT / "onboard" / "record.vehicle.toml"}"'
    for old, new in (
        ("length_m = 120.0", "length_m = 60.0\nscan_share = 6"),
        ('"record.vehicle.toml"', vehicle),
        *changes,
    ):
        assert old in text, old
        text = text.replace(old, new)
    return quick(text, folder / "record.run.toml")


def record(folder: Path, seconds: float, *changes: tuple[str, str]) -> Recorded:
    """A run of so many simulated seconds, in a folder that is made."""
    folder.mkdir(exist_ok=True)
    said = succeed("run", write_record(folder, *changes), "--simulate", "--lockstep", "--for-s", seconds)
    (made,) = (folder / "runs").iterdir()
    return Recorded(made, made / "record.drive.h5", said)
