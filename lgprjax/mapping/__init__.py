"""Building, aligning, verifying and updating maps from drives."""

from lgprjax.mapping.build import MEASURING, build_map
from lgprjax.mapping.routes import (
    Route,
    RouteSource,
    joined_waypoints,
    lay_route,
    open_route,
    read_source,
    require_map,
    route_named,
    routes_of,
    stretch_of,
    waypoints_of,
)
from lgprjax.mapping.survey import places_of
from lgprjax.mapping.update import UPDATE_PASSES, update_map
from lgprjax.mapping.verify import MapFinding, MapHealth, RouteInterval, verify_map
from lgprjax.mapping.weights import DriveUpdate, UpdatedMap

__all__ = [
    "MEASURING",
    "UPDATE_PASSES",
    "DriveUpdate",
    "MapFinding",
    "MapHealth",
    "Route",
    "RouteInterval",
    "RouteSource",
    "UpdatedMap",
    "build_map",
    "joined_waypoints",
    "lay_route",
    "open_route",
    "places_of",
    "read_source",
    "require_map",
    "route_named",
    "routes_of",
    "stretch_of",
    "update_map",
    "verify_map",
    "waypoints_of",
]
