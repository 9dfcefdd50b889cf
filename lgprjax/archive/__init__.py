"""Drive logs in, products out: databases built, drives registered against them."""

from lgprjax.archive.examples import FixExample, Strips, example_scan, fix_example
from lgprjax.archive.map_building import build_map, file_hash
from lgprjax.archive.registering import RegisteredDrive, recording_of, register_log, write_registered
from lgprjax.archive.tracks import DriveTrack, poses_of, track_of_drive

__all__ = [
    "DriveTrack",
    "FixExample",
    "RegisteredDrive",
    "Strips",
    "build_map",
    "example_scan",
    "file_hash",
    "fix_example",
    "poses_of",
    "recording_of",
    "register_log",
    "track_of_drive",
    "write_registered",
]
