"""Synthetic sites as drive logs: the scene driven, recorded and written like any other drive."""

from lgprjax.simulation.drives import SITE_FRAME, describe_drive, describe_sweeps, write_drive, write_drives
from lgprjax.simulation.site_tables import ArrayConfig, Site, SiteDrive, SiteHeader, plan_drive, prepare_site
from lgprjax.simulation.sites import (
    PlannedDrive,
    PlannedSite,
    output_paths,
    plan_site,
    read_site,
    site_file,
    write_site,
)
from lgprjax.simulation.vehicle_logs import vehicle_log_of, write_vehicle_logs
from lgprjax.simulation.vehicle_plans import (
    PlannedVehicleDrive,
    VehiclePlan,
    is_vehicle_plan,
    read_vehicle_plan,
)

__all__ = [
    "SITE_FRAME",
    "ArrayConfig",
    "PlannedDrive",
    "PlannedSite",
    "PlannedVehicleDrive",
    "Site",
    "SiteDrive",
    "SiteHeader",
    "VehiclePlan",
    "describe_drive",
    "describe_sweeps",
    "is_vehicle_plan",
    "output_paths",
    "plan_drive",
    "plan_site",
    "prepare_site",
    "read_site",
    "read_vehicle_plan",
    "site_file",
    "vehicle_log_of",
    "write_drive",
    "write_drives",
    "write_site",
    "write_vehicle_logs",
]
