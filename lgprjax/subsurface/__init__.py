"""Scans -> stations -> regular grid tiles; sampling at a place; the index of what lies where."""

from lgprjax.subsurface.components import leading_components
from lgprjax.subsurface.grid import GridSpec, TraceSet, grid_spec, grid_traces
from lgprjax.subsurface.ground_map import GroundMap, MapDescription, Stations, StationSource, padded_stations
from lgprjax.subsurface.index import SpatialIndex, TilePlacer
from lgprjax.subsurface.stations import (
    Coherence,
    ScanBlock,
    StationBlock,
    coherence_lags,
    stations_of_drive,
)
from lgprjax.subsurface.tile import Tile, sample_tile

__all__ = [
    "Coherence",
    "GridSpec",
    "GroundMap",
    "MapDescription",
    "ScanBlock",
    "SpatialIndex",
    "StationBlock",
    "StationSource",
    "Stations",
    "Tile",
    "TilePlacer",
    "TraceSet",
    "coherence_lags",
    "grid_spec",
    "grid_traces",
    "leading_components",
    "padded_stations",
    "sample_tile",
    "stations_of_drive",
]
