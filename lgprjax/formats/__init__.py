"""Files: drive log, subsurface database, fixes, vehicle file; readers of vendor formats."""

from lgprjax.formats.atomic import atomic_output
from lgprjax.formats.check import check_file
from lgprjax.formats.drive_description import (
    DriveDescription,
    NavigationTrack,
    OdometryTrack,
    SweepRecording,
    TraceRecording,
)
from lgprjax.formats.drive_log import DriveLog
from lgprjax.formats.drive_writer import DriveWriter
from lgprjax.formats.dt1 import read_dt1
from lgprjax.formats.dzt import read_dzt
from lgprjax.formats.findings import Finding
from lgprjax.formats.fixes import read_fix_poses, read_fixes, write_fixes
from lgprjax.formats.grounded import import_grounded
from lgprjax.formats.hdf5_output import create_store
from lgprjax.formats.mala import read_mala
from lgprjax.formats.map_file import MapFile, MapWriter
from lgprjax.formats.profile import Profile
from lgprjax.formats.schema import Schema, load_schema
from lgprjax.formats.surveys import import_lines, read_profile

__all__ = [
    "DriveDescription",
    "DriveLog",
    "DriveWriter",
    "Finding",
    "MapFile",
    "MapWriter",
    "NavigationTrack",
    "OdometryTrack",
    "Profile",
    "Schema",
    "SweepRecording",
    "TraceRecording",
    "atomic_output",
    "check_file",
    "create_store",
    "import_grounded",
    "import_lines",
    "load_schema",
    "read_dt1",
    "read_dzt",
    "read_fix_poses",
    "read_fixes",
    "read_mala",
    "read_profile",
    "write_fixes",
]
