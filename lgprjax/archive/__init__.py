"""Drive logs in, products out: databases built, drives registered against them."""

from lgprjax.archive.accuracy import DriveAccuracy, Labels, accuracy_of, labels_of
from lgprjax.archive.calibrating import Trials, thresholds_from, try_drives
from lgprjax.archive.drive_health import DriveHealth, drive_health
from lgprjax.archive.examples import FixExample, Strips, example_scan, fix_example
from lgprjax.archive.map_building import build_map, file_hash
from lgprjax.archive.map_findings import MapFinding, RouteInterval
from lgprjax.archive.map_health import MapHealth, verify_map
from lgprjax.archive.map_survey import places_of
from lgprjax.archive.recordings import SweepDrive, TraceDrive, recording_of
from lgprjax.archive.registering import RegisteredDrive, passes_over, register_log, write_registered
from lgprjax.archive.tracks import DriveTrack, poses_of, track_of_drive
from lgprjax.archive.vehicle_signals import signals_of
from lgprjax.archive.vehicles import chassis_of, servo_of
from lgprjax.archive.verdicts import HealthFigure, Stretch, Verdict

__all__ = [
    "DriveAccuracy",
    "DriveHealth",
    "DriveTrack",
    "FixExample",
    "HealthFigure",
    "Labels",
    "MapFinding",
    "MapHealth",
    "RegisteredDrive",
    "RouteInterval",
    "Stretch",
    "Strips",
    "SweepDrive",
    "TraceDrive",
    "Trials",
    "Verdict",
    "accuracy_of",
    "build_map",
    "chassis_of",
    "drive_health",
    "example_scan",
    "file_hash",
    "fix_example",
    "labels_of",
    "passes_over",
    "places_of",
    "poses_of",
    "recording_of",
    "register_log",
    "servo_of",
    "signals_of",
    "thresholds_from",
    "track_of_drive",
    "try_drives",
    "verify_map",
    "write_registered",
]
