"""Drives and run folders as they were recorded: reading, health, recovery, accuracy."""

from lgprjax.recordings.drives import DriveTrack, SweepDrive, TraceDrive, poses_of, recording_of, track_of_drive
from lgprjax.recordings.health import DriveHealth, drive_health, has_radar, vehicle_health
from lgprjax.recordings.recover import RunDrive, write_run_drive
from lgprjax.recordings.trajectories import (
    Comparison,
    compare_fixes,
    frame_of_drive,
    trajectory_of_fixes,
    trajectory_of_track,
)
from lgprjax.recordings.vehicles import (
    SkidVehicle,
    array_of_vehicle,
    carrot_of,
    chassis_of,
    filter_model_of,
    of_channels,
    open_numbers,
    pattern_settings_of,
    pedals_of,
    require_drivable,
    servo_of,
    skid_setup_of,
    tool_of,
)
from lgprjax.recordings.verdicts import HealthFigure, Stretch, Verdict

__all__ = [
    "Comparison",
    "DriveHealth",
    "DriveTrack",
    "HealthFigure",
    "RunDrive",
    "SkidVehicle",
    "Stretch",
    "SweepDrive",
    "TraceDrive",
    "Verdict",
    "array_of_vehicle",
    "carrot_of",
    "chassis_of",
    "compare_fixes",
    "drive_health",
    "filter_model_of",
    "frame_of_drive",
    "has_radar",
    "of_channels",
    "open_numbers",
    "pattern_settings_of",
    "pedals_of",
    "poses_of",
    "recording_of",
    "require_drivable",
    "servo_of",
    "skid_setup_of",
    "tool_of",
    "track_of_drive",
    "trajectory_of_fixes",
    "trajectory_of_track",
    "vehicle_health",
    "write_run_drive",
]
