"""Correlation, search and judgement: one scan, a window of scans, a whole drive."""

from lgprjax.registration.calibration import Outcomes, calibrate, joined, outcomes_of, squared_errors
from lgprjax.registration.chance import (
    LADDER_M,
    LEAST_INDEPENDENT,
    PIECE_M,
    POOLED,
    Chance,
    fit_chance,
    ladder_of,
    least_z,
    p_foreign,
    p_rival,
    pooled_chance,
)
from lgprjax.registration.columns import ArrayColumns, make_columns
from lgprjax.registration.correlation import OFF_MAP_SCORE, Score, Template, score_poses
from lgprjax.registration.drive import (
    BLOCK_SCANS,
    DriveFixes,
    LiveBlock,
    Registration,
    ground_map_for,
    live_chain,
    register_drive,
)
from lgprjax.registration.evidence import EvidenceSearch
from lgprjax.registration.finish import Finished, Region, finish_best
from lgprjax.registration.fix import WRONG_M, Code, Fix, sigmas_along_cross
from lgprjax.registration.integrity import MIN_OVERLAP, Thresholds, thresholds_at
from lgprjax.registration.live import LiveChain, LiveScans, Operators, Track
from lgprjax.registration.options import RegisterOptions
from lgprjax.registration.prepared import Aspect, PreparedGround, PreparedTile
from lgprjax.registration.search import Problem, Rules, SearchSpec, register_batch, rules_of, search_spec_for
from lgprjax.registration.stops import Stops, stops_of, templates_of
from lgprjax.registration.survey import SurfacePicture, ground_under, rival_of, survey_surface
from lgprjax.registration.swarm_finish import SwarmView, watch_finish
from lgprjax.registration.tiles import to_tile

__all__ = [
    "BLOCK_SCANS",
    "LADDER_M",
    "LEAST_INDEPENDENT",
    "MIN_OVERLAP",
    "OFF_MAP_SCORE",
    "PIECE_M",
    "POOLED",
    "WRONG_M",
    "ArrayColumns",
    "Aspect",
    "Chance",
    "Code",
    "DriveFixes",
    "EvidenceSearch",
    "Finished",
    "Fix",
    "LiveBlock",
    "LiveChain",
    "LiveScans",
    "Operators",
    "Outcomes",
    "PreparedGround",
    "PreparedTile",
    "Problem",
    "Region",
    "RegisterOptions",
    "Registration",
    "Rules",
    "Score",
    "SearchSpec",
    "Stops",
    "SurfacePicture",
    "SwarmView",
    "Template",
    "Thresholds",
    "Track",
    "calibrate",
    "finish_best",
    "fit_chance",
    "ground_map_for",
    "ground_under",
    "joined",
    "ladder_of",
    "least_z",
    "live_chain",
    "make_columns",
    "outcomes_of",
    "p_foreign",
    "p_rival",
    "pooled_chance",
    "register_batch",
    "register_drive",
    "rival_of",
    "rules_of",
    "score_poses",
    "search_spec_for",
    "sigmas_along_cross",
    "squared_errors",
    "stops_of",
    "survey_surface",
    "templates_of",
    "thresholds_at",
    "to_tile",
    "watch_finish",
]
