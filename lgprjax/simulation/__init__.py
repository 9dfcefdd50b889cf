"""Synthetic sites as drive logs: the scene driven, recorded and written like any other drive."""

from lgprjax.simulation.drives import describe_drive, write_drive, write_drives
from lgprjax.simulation.site import demo_site

__all__ = ["demo_site", "describe_drive", "write_drive", "write_drives"]
