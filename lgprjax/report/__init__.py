"""Pictures, tables and the HTML page that show what a registration did. NumPy in, files out."""

from lgprjax.report.codes import draw_codes
from lgprjax.report.html import ReportFigure, ReportTable, Section, drive_section, overview_table, write_report
from lgprjax.report.map_strips import BaselineStrip, MapStrips, draw_map_strips
from lgprjax.report.match import draw_match
from lgprjax.report.results import CODES, CorrelationSurface, DriveResult, MatchExample, TrackErrors, track_errors
from lgprjax.report.summary import WRONG_M, DriveSummary, summarise
from lgprjax.report.surface import draw_surface
from lgprjax.report.table import summary_table
from lgprjax.report.trajectory import draw_trajectory

__all__ = [
    "CODES",
    "WRONG_M",
    "BaselineStrip",
    "CorrelationSurface",
    "DriveResult",
    "DriveSummary",
    "MapStrips",
    "MatchExample",
    "ReportFigure",
    "ReportTable",
    "Section",
    "TrackErrors",
    "draw_codes",
    "draw_map_strips",
    "draw_match",
    "draw_surface",
    "draw_trajectory",
    "drive_section",
    "overview_table",
    "summarise",
    "summary_table",
    "track_errors",
    "write_report",
]
