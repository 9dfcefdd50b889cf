"""Correlation, search and judgement: one scan, a window of scans, a whole drive."""

from lgprjax.registration.correlation import OFF_MAP_SCORE, Score, Template, score_poses
from lgprjax.registration.drive import (
    BLOCK_SCANS,
    DriveFixes,
    LiveBlock,
    RegisterOptions,
    ground_map_for,
    live_chain,
    register_drive,
    search_spec_for,
    to_tile,
)
from lgprjax.registration.fix import WRONG_M, Code, Fix
from lgprjax.registration.integrity import Thresholds, default_thresholds
from lgprjax.registration.live import LiveChain, Track, templates_of
from lgprjax.registration.search import Problem, Region, SearchSpec, register_batch
from lgprjax.registration.survey import SurfacePicture, ground_under, survey_surface

__all__ = [
    "BLOCK_SCANS",
    "OFF_MAP_SCORE",
    "WRONG_M",
    "Code",
    "DriveFixes",
    "Fix",
    "LiveBlock",
    "LiveChain",
    "Problem",
    "Region",
    "RegisterOptions",
    "Score",
    "SearchSpec",
    "SurfacePicture",
    "Template",
    "Thresholds",
    "Track",
    "default_thresholds",
    "ground_map_for",
    "ground_under",
    "live_chain",
    "register_batch",
    "register_drive",
    "score_poses",
    "search_spec_for",
    "survey_surface",
    "templates_of",
    "to_tile",
]
