"""Scans -> stations -> regular grid tiles; sampling at a place; the spatial index."""

from lgprjax.subsurface.grid import GridSpec, Tile, TraceSet, grid_spec, grid_traces, leading_components, sample_tile
from lgprjax.subsurface.ground_map import GroundMap
from lgprjax.subsurface.stations import (
    Coherence,
    MapDescription,
    ScanBlock,
    SpatialIndex,
    StationBlock,
    StationPlaces,
    StationPositions,
    StationRuns,
    Stations,
    StationSource,
    TilePlacer,
    coherence_lags,
    stations_of_drive,
    stretches_of,
)

__all__ = [
    "Coherence",
    "GridSpec",
    "GroundMap",
    "MapDescription",
    "ScanBlock",
    "SpatialIndex",
    "StationBlock",
    "StationPlaces",
    "StationPositions",
    "StationRuns",
    "StationSource",
    "Stations",
    "Tile",
    "TilePlacer",
    "TraceSet",
    "coherence_lags",
    "grid_spec",
    "grid_traces",
    "leading_components",
    "sample_tile",
    "stations_of_drive",
    "stretches_of",
]
