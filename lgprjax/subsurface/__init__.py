"""Scans -> stations -> regular grid tiles; sampling at a place; the index of what lies where."""

from lgprjax.subsurface.grid import GridSpec, Tile, TraceSet, grid_spec, grid_traces, leading_components, sample_tile
from lgprjax.subsurface.ground_map import GroundMap
from lgprjax.subsurface.stations import (
    Coherence,
    MapDescription,
    Places,
    ScanBlock,
    SpatialIndex,
    StationBlock,
    StationPlaces,
    Stations,
    StationSource,
    Stretches,
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
    "Places",
    "ScanBlock",
    "SpatialIndex",
    "StationBlock",
    "StationPlaces",
    "StationSource",
    "Stations",
    "Stretches",
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
