"""Synthetic sites as drive logs: the scene driven, recorded and written like any other drive."""

from lgprjax.simulation.drives import SITE_FRAME, describe_drive, write_drive, write_drives
from lgprjax.simulation.site import demo_site
from lgprjax.simulation.site_file import read_site
from lgprjax.simulation.site_plan import ArrayConfig, Site, SiteDrive, SiteHeader, plan_drive, prepare_site
from lgprjax.simulation.site_writing import PlannedDrive, PlannedSite, output_paths, plan_site, write_site
from lgprjax.simulation.sweep_recording import describe_sweeps

__all__ = [
    "SITE_FRAME",
    "ArrayConfig",
    "PlannedDrive",
    "PlannedSite",
    "Site",
    "SiteDrive",
    "SiteHeader",
    "demo_site",
    "describe_drive",
    "describe_sweeps",
    "output_paths",
    "plan_drive",
    "plan_site",
    "prepare_site",
    "read_site",
    "write_drive",
    "write_drives",
    "write_site",
]
