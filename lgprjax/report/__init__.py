"""Pictures, tables and the HTML page that show what a registration did. NumPy in, files out."""

from lgprjax.report.archive_drives import ArchiveDrives, draw_archive_drives
from lgprjax.report.archive_page import ArchivePage, write_archive_page
from lgprjax.report.archive_places import ArchivePlaces, draw_archive_places
from lgprjax.report.codes import draw_codes
from lgprjax.report.confidence import StatedErrors, draw_confidence, stated_errors
from lgprjax.report.coverage_channels import CoverChannelsPicture, draw_cover_channels
from lgprjax.report.coverage_map import CoverPicture, draw_coverage
from lgprjax.report.coverage_page import CoveragePage, write_coverage_page
from lgprjax.report.declines import DECLINES, Decline, declines_table, main_decline
from lgprjax.report.driven_course import DrivenResult, draw_driven_course
from lgprjax.report.encoder_fit import EncoderPicture, draw_encoder_fit
from lgprjax.report.fitted_curve import Curve, Points, draw_fitted_curve
from lgprjax.report.html import ReportFigure, ReportTable, Section, drive_section, overview_table, write_report
from lgprjax.report.look_ahead_surface import LookAheadSweep, draw_look_ahead
from lgprjax.report.map_passes import MapPasses, draw_passes
from lgprjax.report.map_slices import MapSlices, MapStations, draw_map_slices, slice_map
from lgprjax.report.map_strips import BaselineStrip, MapStrips, draw_map_strips
from lgprjax.report.match import draw_match
from lgprjax.report.palm_tree import Branch, draw_palm_tree
from lgprjax.report.radargram import (
    LinePlan,
    LineView,
    counted_columns,
    draw_line,
    draw_radargram,
    even_columns,
    radargram_of,
)
from lgprjax.report.results import CODES, CorrelationSurface, DriveResult, MatchExample, TrackErrors, track_errors
from lgprjax.report.servo_steps import ServoResponse, draw_servo_steps
from lgprjax.report.summary import WRONG_M, DriveSummary, summarise
from lgprjax.report.surface import draw_surface
from lgprjax.report.swarm import SwarmPicture, draw_swarm
from lgprjax.report.table import summary_table
from lgprjax.report.timing import StageTimes, TimingPicture, draw_timing
from lgprjax.report.trajectory import draw_trajectory
from lgprjax.report.zoom_page import write_line_page, write_map_page

__all__ = [
    "CODES",
    "DECLINES",
    "WRONG_M",
    "ArchiveDrives",
    "ArchivePage",
    "ArchivePlaces",
    "BaselineStrip",
    "Branch",
    "CorrelationSurface",
    "CoverChannelsPicture",
    "CoverPicture",
    "CoveragePage",
    "Curve",
    "Decline",
    "DriveResult",
    "DriveSummary",
    "DrivenResult",
    "EncoderPicture",
    "LinePlan",
    "LineView",
    "LookAheadSweep",
    "MapPasses",
    "MapSlices",
    "MapStations",
    "MapStrips",
    "MatchExample",
    "Points",
    "ReportFigure",
    "ReportTable",
    "Section",
    "ServoResponse",
    "StageTimes",
    "StatedErrors",
    "SwarmPicture",
    "TimingPicture",
    "TrackErrors",
    "counted_columns",
    "declines_table",
    "draw_archive_drives",
    "draw_archive_places",
    "draw_codes",
    "draw_confidence",
    "draw_cover_channels",
    "draw_coverage",
    "draw_driven_course",
    "draw_encoder_fit",
    "draw_fitted_curve",
    "draw_line",
    "draw_look_ahead",
    "draw_map_slices",
    "draw_map_strips",
    "draw_match",
    "draw_palm_tree",
    "draw_passes",
    "draw_radargram",
    "draw_servo_steps",
    "draw_surface",
    "draw_swarm",
    "draw_timing",
    "draw_trajectory",
    "drive_section",
    "even_columns",
    "main_decline",
    "overview_table",
    "radargram_of",
    "slice_map",
    "stated_errors",
    "summarise",
    "summary_table",
    "track_errors",
    "write_archive_page",
    "write_coverage_page",
    "write_line_page",
    "write_map_page",
    "write_report",
]
