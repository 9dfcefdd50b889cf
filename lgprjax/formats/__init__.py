"""File formats: drive log, subsurface database, fixes, vehicle file; readers of vendor formats."""

from lgprjax.formats.check import check_file
from lgprjax.formats.coverage_files import CoverPlan, cover_plan_findings, read_cover_plan, write_cover_plan
from lgprjax.formats.drive import (
    DriveDescription,
    DriveLog,
    DriveWriter,
    NavigationTrack,
    OdometryTrack,
    OnBoardSearch,
    SweepRecording,
    TraceRecording,
)
from lgprjax.formats.field_files import FieldPlaces, read_field
from lgprjax.formats.fixes import drive_hash_of, read_fix_poses, read_fixes, refuse_other_drive, write_fixes
from lgprjax.formats.line_findings import found_time_zero
from lgprjax.formats.line_positions import SidePositions, TracePlaces, find_side_files, places_of_traces, read_side_file
from lgprjax.formats.map_file import MapFile, MapHistory
from lgprjax.formats.map_layout import CHANCE_METHOD, MAP_PRECISIONS, MapPrecision, chance_as_text, chance_of_text
from lgprjax.formats.map_writer import MapWriter, copy_stations, locked_map, scratch_folder
from lgprjax.formats.mcap_export import MESSAGE_SUFFIXES, ExportedDrive, export_mcap
from lgprjax.formats.mcap_import import ImportedRecording, McapTopics, import_mcap
from lgprjax.formats.mcap_recording import UniformArray
from lgprjax.formats.mcap_tracks import McapAssumed
from lgprjax.formats.profile import Profile, TraceCoordinates, assumed_in_words, assumed_of
from lgprjax.formats.radar_calibration import SweepLayout, read_radar_calibration, write_radar_calibration
from lgprjax.formats.route_files import RouteFile, read_route, route_findings, write_route
from lgprjax.formats.run_log import RunReading, RunSummary, complex_rows, read_run
from lgprjax.formats.schema import Finding, Schema, load_schema
from lgprjax.formats.settings_files import Study, read_study, read_thresholds, write_thresholds
from lgprjax.formats.store import atomic_output, create_store
from lgprjax.formats.survey_track import SurveyOrigin
from lgprjax.formats.surveys import Survey, import_iprb, import_lines, read_profile
from lgprjax.formats.trajectory import TRAJECTORY_SUFFIXES, Trajectory, write_trajectory
from lgprjax.formats.vehicle import (
    ArrayTable,
    Found,
    RearMap,
    VehicleFile,
    WheelMap,
    flat_keys,
    read_vehicle,
    require_serial_number,
    with_values,
    write_vehicle,
)
from lgprjax.formats.vehicle_log import DriveFrames, VehicleLog, read_drive_frames, read_fixes_frame, write_vehicle_log
from lgprjax.formats.vendors.cmu_gpr import import_cmu
from lgprjax.formats.vendors.gprmax import import_gprmax, read_gprmax
from lgprjax.formats.vendors.grounded import import_grounded
from lgprjax.formats.vendors.line_files import read_dt1, read_dzt, read_iprb, read_iprb_array, read_mala
from lgprjax.formats.vendors.segy import import_segy, read_segy
from lgprjax.formats.waypoint_files import (
    Waypoints,
    WaypointTrack,
    read_waypoints,
    write_turning_points,
    write_waypoints,
)
from lgprjax.formats.worked import (
    GeoLayer,
    WorkedRecord,
    read_worked,
    stop_words,
    write_cells,
    write_geojson,
    write_geopackage,
    write_kml,
    write_shapefiles,
    write_worked,
)

__all__ = [
    "CHANCE_METHOD",
    "MAP_PRECISIONS",
    "MESSAGE_SUFFIXES",
    "TRAJECTORY_SUFFIXES",
    "ArrayTable",
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
    "OnBoardSearch",
    "Profile",
    "RearMap",
    "RouteFile",
    "RunReading",
    "RunSummary",
    "Schema",
    "SidePositions",
    "Study",
    "Survey",
    "SurveyOrigin",
    "SweepLayout",
    "SweepRecording",
    "TraceCoordinates",
    "TracePlaces",
    "TraceRecording",
    "Trajectory",
    "UniformArray",
    "VehicleFile",
    "VehicleLog",
    "WaypointTrack",
    "Waypoints",
    "WheelMap",
    "WorkedRecord",
    "assumed_in_words",
    "assumed_of",
    "atomic_output",
    "chance_as_text",
    "chance_of_text",
    "check_file",
    "complex_rows",
    "copy_stations",
    "cover_plan_findings",
    "create_store",
    "drive_hash_of",
    "export_mcap",
    "find_side_files",
    "flat_keys",
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
    "read_radar_calibration",
    "read_route",
    "read_run",
    "read_segy",
    "read_side_file",
    "read_study",
    "read_thresholds",
    "read_vehicle",
    "read_waypoints",
    "read_worked",
    "refuse_other_drive",
    "require_serial_number",
    "route_findings",
    "scratch_folder",
    "stop_words",
    "with_values",
    "write_cells",
    "write_cover_plan",
    "write_fixes",
    "write_geojson",
    "write_geopackage",
    "write_kml",
    "write_radar_calibration",
    "write_route",
    "write_shapefiles",
    "write_thresholds",
    "write_trajectory",
    "write_turning_points",
    "write_vehicle",
    "write_vehicle_log",
    "write_waypoints",
    "write_worked",
]
