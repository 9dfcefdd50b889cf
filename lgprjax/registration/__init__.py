"""Correlation, search and judgement: one scan, a window of scans, a whole drive."""

from lgprjax.registration.batches import to_tile
from lgprjax.registration.calibration import Outcomes, calibrate, joined, outcomes_of, squared_errors
from lgprjax.registration.columns import ArrayColumns, make_columns
from lgprjax.registration.correlation import OFF_MAP_SCORE, Score, Template, score_poses
from lgprjax.registration.drive import (
    BLOCK_SCANS,
    DriveFixes,
    LiveBlock,
    ground_map_for,
    live_chain,
    probe_strengths,
    register_drive,
)
from lgprjax.registration.finish import Region, Rules, rules_of
from lgprjax.registration.fix import WRONG_M, Code, Fix, sigmas_along_cross
from lgprjax.registration.integrity import Thresholds, default_thresholds
from lgprjax.registration.live import LiveChain, Operators, Track, templates_of
from lgprjax.registration.match import Ends, MatchSpec, ScanSet, match_scans
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.policy import LADDER
from lgprjax.registration.prepared import Aspect, PreparedGround, PreparedTile
from lgprjax.registration.search import Problem, SearchSpec, register_batch, search_spec_for
from lgprjax.registration.survey import SurfacePicture, ground_under, rival_of, survey_surface
from lgprjax.registration.swarm_finish import SwarmView, watch_finish
from lgprjax.registration.tracking import TrackedFixes, Tracker, track_drive, warm_up
from lgprjax.registration.tracking_ground import tracking_ground

__all__ = [
    "BLOCK_SCANS",
    "LADDER",
    "OFF_MAP_SCORE",
    "WRONG_M",
    "ArrayColumns",
    "Aspect",
    "Code",
    "DriveFixes",
    "Ends",
    "Fix",
    "LiveBlock",
    "LiveChain",
    "MatchSpec",
    "Operators",
    "Outcomes",
    "PreparedGround",
    "PreparedTile",
    "Problem",
    "Region",
    "RegisterOptions",
    "Rules",
    "ScanSet",
    "Score",
    "SearchSpec",
    "SurfacePicture",
    "SwarmView",
    "Template",
    "Thresholds",
    "Track",
    "TrackedFixes",
    "Tracker",
    "calibrate",
    "default_thresholds",
    "ground_map_for",
    "ground_under",
    "joined",
    "live_chain",
    "make_columns",
    "match_scans",
    "outcomes_of",
    "probe_strengths",
    "register_batch",
    "register_drive",
    "rival_of",
    "rules_of",
    "score_poses",
    "search_spec_for",
    "sigmas_along_cross",
    "squared_errors",
    "survey_surface",
    "templates_of",
    "to_tile",
    "track_drive",
    "tracking_ground",
    "warm_up",
    "watch_finish",
]
