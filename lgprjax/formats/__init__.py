"""Files: drive log, subsurface database, fixes, vehicle file; readers of vendor formats."""

from lgprjax.formats.assumed import assumed_in_words, assumed_of
from lgprjax.formats.atomic import atomic_output
from lgprjax.formats.check import check_file
from lgprjax.formats.cmu_gpr import import_cmu
from lgprjax.formats.cover_plan import CoverPlan, cover_plan_findings, read_cover_plan, write_cover_plan
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
from lgprjax.formats.field_file import FieldPlaces, read_field
from lgprjax.formats.findings import Finding
from lgprjax.formats.fixes import read_fix_poses, read_fixes, write_fixes
from lgprjax.formats.frames_of_drives import DriveFrames, read_drive_frames, read_fixes_frame
from lgprjax.formats.geo_layers import GeoLayer, write_geojson, write_geopackage, write_kml
from lgprjax.formats.gprmax import import_gprmax, read_gprmax
from lgprjax.formats.grounded import import_grounded
from lgprjax.formats.hdf5_output import create_store
from lgprjax.formats.iprb import read_iprb, read_iprb_array
from lgprjax.formats.line_findings import found_time_zero
from lgprjax.formats.mala import read_mala
from lgprjax.formats.map_code import MAP_PRECISIONS, MapPrecision
from lgprjax.formats.map_copy import copy_stations
from lgprjax.formats.map_file import MapFile
from lgprjax.formats.map_history import MapHistory
from lgprjax.formats.map_lock import locked_map, scratch_folder
from lgprjax.formats.map_writer import MapWriter
from lgprjax.formats.mcap_export import ExportedDrive, export_mcap
from lgprjax.formats.mcap_heard import McapTopics
from lgprjax.formats.mcap_import import ImportedRecording, import_mcap
from lgprjax.formats.mcap_scans import UniformArray
from lgprjax.formats.mcap_tracks import McapAssumed
from lgprjax.formats.profile import Profile, TraceCoordinates
from lgprjax.formats.route_file import RouteFile, read_route, route_findings, write_route
from lgprjax.formats.run_log import RunReading, RunSummary, read_run
from lgprjax.formats.schema import Schema, load_schema
from lgprjax.formats.segy import read_segy
from lgprjax.formats.segy_drive import import_segy
from lgprjax.formats.side_files import find_side_files, read_side_file
from lgprjax.formats.side_positions import SidePositions, TracePlaces, places_of_traces
from lgprjax.formats.stored_chance import CHANCE_METHOD, chance_as_text, chance_of_text
from lgprjax.formats.study_file import Study, read_study
from lgprjax.formats.survey_track import Place
from lgprjax.formats.surveys import Survey, import_iprb, import_lines, read_profile
from lgprjax.formats.thresholds_file import read_thresholds, write_thresholds
from lgprjax.formats.turning_points import write_turning_points
from lgprjax.formats.vehicle_file import read_vehicle, require_serial_number, write_vehicle
from lgprjax.formats.vehicle_log import VehicleLog, write_vehicle_log
from lgprjax.formats.vehicle_model import Found, RearMap, VehicleFile, WheelMap, with_values
from lgprjax.formats.waypoints import Waypoints, write_waypoints
from lgprjax.formats.worked_file import read_worked, write_worked
from lgprjax.formats.worked_record import WorkedRecord, stop_words

__all__ = [
    "CHANCE_METHOD",
    "MAP_PRECISIONS",
    "CoverPlan",
    "DriveDescription",
    "DriveFrames",
    "DriveLog",
    "DriveWriter",
    "ExportedDrive",
    "FieldPlaces",
    "Finding",
    "Found",
    "GeoLayer",
    "ImportedRecording",
    "MapFile",
    "MapHistory",
    "MapPrecision",
    "MapWriter",
    "McapAssumed",
    "McapTopics",
    "NavigationTrack",
    "OdometryTrack",
    "Place",
    "Profile",
    "RearMap",
    "RouteFile",
    "RunReading",
    "RunSummary",
    "Schema",
    "SidePositions",
    "Study",
    "Survey",
    "SweepRecording",
    "TraceCoordinates",
    "TracePlaces",
    "TraceRecording",
    "UniformArray",
    "VehicleFile",
    "VehicleLog",
    "Waypoints",
    "WheelMap",
    "WorkedRecord",
    "assumed_in_words",
    "assumed_of",
    "atomic_output",
    "chance_as_text",
    "chance_of_text",
    "check_file",
    "copy_stations",
    "cover_plan_findings",
    "create_store",
    "export_mcap",
    "find_side_files",
    "found_time_zero",
    "import_cmu",
    "import_gprmax",
    "import_grounded",
    "import_iprb",
    "import_lines",
    "import_mcap",
    "import_segy",
    "load_schema",
    "locked_map",
    "places_of_traces",
    "read_cover_plan",
    "read_drive_frames",
    "read_dt1",
    "read_dzt",
    "read_field",
    "read_fix_poses",
    "read_fixes",
    "read_fixes_frame",
    "read_gprmax",
    "read_iprb",
    "read_iprb_array",
    "read_mala",
    "read_profile",
    "read_route",
    "read_run",
    "read_segy",
    "read_side_file",
    "read_study",
    "read_thresholds",
    "read_vehicle",
    "read_worked",
    "require_serial_number",
    "route_findings",
    "scratch_folder",
    "stop_words",
    "with_values",
    "write_cover_plan",
    "write_fixes",
    "write_geojson",
    "write_geopackage",
    "write_kml",
    "write_route",
    "write_thresholds",
    "write_turning_points",
    "write_vehicle",
    "write_vehicle_log",
    "write_waypoints",
    "write_worked",
]
