"""Drive logs in, products out: databases built, drives registered against them."""

from lgprjax.archive.accuracy import DriveAccuracy, Labels, RelativeError, accuracy_of, labels_of, relative_error
from lgprjax.archive.archive_folder import JobPlan, claimed, drive_name, note_failure, outputs_of, plan_jobs
from lgprjax.archive.calibrating import Trials, thresholds_from, try_drives
from lgprjax.archive.chance_cache import chance_of
from lgprjax.archive.cover_figures import CoverFigures, LayerFigures, cover_figures
from lgprjax.archive.cover_layers import cover_layers
from lgprjax.archive.cover_plans import PlanFile, PlanOptions, make_cover_plan, open_cover_plan, save_cover_plan
from lgprjax.archive.cover_record import record_cover
from lgprjax.archive.cover_runs import CoverRun, read_cover_run
from lgprjax.archive.drive_health import DriveHealth, drive_health
from lgprjax.archive.examples import FixExample, Strips, example_scan, fix_example
from lgprjax.archive.held_ground import HeldGround, lattice_points
from lgprjax.archive.job_key import ArchiveRun, FileStamp, Job, key_of_job, settings_of, stamp_of
from lgprjax.archive.job_record import (
    CELL_M,
    CellTally,
    DriveFigures,
    JobCost,
    JobRecord,
    jobs_folder,
    read_record,
    read_records,
    write_record,
)
from lgprjax.archive.map_assumptions import away_in_words, distance_to_map_m, is_place_assumed, map_assumed_in_words
from lgprjax.archive.map_building import MEASURING, build_map
from lgprjax.archive.map_findings import MapFinding, RouteInterval
from lgprjax.archive.map_health import MapHealth, verify_map
from lgprjax.archive.map_survey import places_of
from lgprjax.archive.map_update import UPDATE_PASSES, update_map
from lgprjax.archive.recordings import SweepDrive, TraceDrive, recording_of
from lgprjax.archive.registering import RegisteredDrive, register_log, write_registered
from lgprjax.archive.results_index import (
    ArchiveSums,
    BadPlace,
    WorkerShare,
    cell_sums,
    records_of,
    shares_of,
    summed,
    sums_of,
    worst_places,
    write_table,
)
from lgprjax.archive.routes import (
    Route,
    lay_route,
    open_route,
    require_map,
    route_named,
    routes_of,
    stretch_of,
    waypoints_of,
)
from lgprjax.archive.run_drives import RunDrive, write_run_drive
from lgprjax.archive.scheduler_jobs import run_on_scheduler
from lgprjax.archive.skid_vehicles import SkidVehicle, carrot_of, pattern_settings_of, skid_setup_of, tool_of
from lgprjax.archive.tracks import DriveTrack, poses_of, track_of_drive
from lgprjax.archive.update_record import DriveUpdate, UpdatedMap
from lgprjax.archive.vehicle_signals import signals_of
from lgprjax.archive.vehicles import chassis_of, filter_model_of, pedals_of, servo_of
from lgprjax.archive.verdicts import HealthFigure, Stretch, Verdict
from lgprjax.archive.worker_pool import JobOutcome, WorkerPool

__all__ = [
    "CELL_M",
    "MEASURING",
    "UPDATE_PASSES",
    "ArchiveRun",
    "ArchiveSums",
    "BadPlace",
    "CellTally",
    "CoverFigures",
    "CoverRun",
    "DriveAccuracy",
    "DriveFigures",
    "DriveHealth",
    "DriveTrack",
    "DriveUpdate",
    "FileStamp",
    "FixExample",
    "HealthFigure",
    "HeldGround",
    "Job",
    "JobCost",
    "JobOutcome",
    "JobPlan",
    "JobRecord",
    "Labels",
    "LayerFigures",
    "MapFinding",
    "MapHealth",
    "PlanFile",
    "PlanOptions",
    "RegisteredDrive",
    "RelativeError",
    "Route",
    "RouteInterval",
    "RunDrive",
    "SkidVehicle",
    "Stretch",
    "Strips",
    "SweepDrive",
    "TraceDrive",
    "Trials",
    "UpdatedMap",
    "Verdict",
    "WorkerPool",
    "WorkerShare",
    "accuracy_of",
    "away_in_words",
    "build_map",
    "carrot_of",
    "cell_sums",
    "chance_of",
    "chassis_of",
    "claimed",
    "cover_figures",
    "cover_layers",
    "distance_to_map_m",
    "drive_health",
    "drive_name",
    "example_scan",
    "filter_model_of",
    "fix_example",
    "is_place_assumed",
    "jobs_folder",
    "key_of_job",
    "labels_of",
    "lattice_points",
    "lay_route",
    "make_cover_plan",
    "map_assumed_in_words",
    "note_failure",
    "open_cover_plan",
    "open_route",
    "outputs_of",
    "pattern_settings_of",
    "pedals_of",
    "places_of",
    "plan_jobs",
    "poses_of",
    "read_cover_run",
    "read_record",
    "read_records",
    "record_cover",
    "recording_of",
    "records_of",
    "register_log",
    "relative_error",
    "require_map",
    "route_named",
    "routes_of",
    "run_on_scheduler",
    "save_cover_plan",
    "servo_of",
    "settings_of",
    "shares_of",
    "signals_of",
    "skid_setup_of",
    "stamp_of",
    "stretch_of",
    "summed",
    "sums_of",
    "thresholds_from",
    "tool_of",
    "track_of_drive",
    "try_drives",
    "update_map",
    "verify_map",
    "waypoints_of",
    "worst_places",
    "write_record",
    "write_registered",
    "write_run_drive",
    "write_table",
]
