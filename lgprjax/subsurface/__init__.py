"""Scans -> stations -> regular grid tiles; sampling at a place; the index of what lies where."""

from lgprjax.subsurface.components import leading_components
from lgprjax.subsurface.grid import GridSpec, TraceSet, grid_spec, grid_traces
from lgprjax.subsurface.ground_map import GroundMap
from lgprjax.subsurface.index import SpatialIndex, TilePlacer
from lgprjax.subsurface.station_places import Places, StationPlaces, Stretches, stretches_of
from lgprjax.subsurface.station_source import MapDescription, Stations, StationSource
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
