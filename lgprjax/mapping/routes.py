"""Routes of a subsurface database: one for each baseline, a stretch of it in either direction, as drivable legs."""

from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.batch.vehicles import chassis_of
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import MapFile, RouteFile, Waypoints, read_route, read_vehicle
from lgprjax.frames import LocalFrame
from lgprjax.navigation import RoutePath, RouteSpeeds, RouteTrack, is_closed, legs_of_track, make_route_path
from lgprjax.subsurface import SpatialIndex

_LEAST_M = 2.0
_NEAR_M = 20.0


class Route(NamedTuple):
    """A baseline as a route, in the map's local frame.

    Attributes:
        name: of its drive log; with its number if not unique.
        track: of the array's centre, as recorded.
        at_m: metres along it at each point.
        closed: it ends where it began.
    """

    name: str
    track: RouteTrack
    at_m: Float[np.ndarray, " point"]
    closed: bool

    @property
    def length_m(self) -> float:
        """Metres along the stations."""
        return float(self.at_m[-1])


def routes_of(source: MapFile) -> list[Route]:
    """Routes of all baselines that have two stations or more, in their order."""
    routes: list[Route] = []
    names = _names(source)
    for number, name in enumerate(names):
        pose = source.pose[source.drive == number]
        if len(pose) < 2:
            continue
        shown = name if names.count(name) == 1 else f"{name}#{number}"
        points, yaw = pose[:, :2], pose[:, 3]
        at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points, axis=0).T))])
        routes.append(Route(shown, RouteTrack(shown, points, yaw), at, is_closed(points, yaw)))
    return routes


def route_named(source: MapFile, name: str) -> Route:
    """The route of that name.

    Raises:
        InputError: the map has no such route.
    """
    routes = routes_of(source)
    for route in routes:
        if route.name == name:
            return route
    raise InputError(source.path, "route", "one of " + ", ".join(each.name for each in routes), repr(name))


def stretch_of(
    route: Route, from_m: float, to_m: float, direction: Literal["along", "against"], *, file: str | Path
) -> RouteTrack:
    """Track of a stretch in the order of driving.

    Args:
        route: of the map.
        from_m, to_m: along it as recorded.
        direction: as recorded, or reversed.
        file: for errors.

    Raises:
        InputError: a stretch of less than two metres, or beyond the route's end.
    """
    if not 0.0 <= from_m < to_m <= route.length_m + 0.01:
        found = f"{from_m:g} to {to_m:g} m"
        raise InputError(file, "from_m, to_m", f"a stretch within 0 to {route.length_m:.2f} m", found)
    inside = (route.at_m >= from_m) & (route.at_m <= to_m)
    if to_m - from_m < _LEAST_M or np.count_nonzero(inside) < 2:
        raise InputError(file, "from_m, to_m", f"a stretch of at least {_LEAST_M:g} m", f"{to_m - from_m:g} m")
    track = RouteTrack(route.name, route.track.points_m[inside], route.track.yaw_rad[inside])
    return track.reversed() if direction == "against" else track


def lay_route(chosen: RouteFile, source: MapFile, *, file: str | Path) -> RoutePath:
    """The legs of a chosen route, for the anchor of its vehicle, in the map's local frame.

    Args:
        chosen: from ``read_route``, or about to be written.
        source: its map.
        file: the route file, for errors.

    Raises:
        InputError: no such route or stretch, a gap in it, or a bend that the vehicle cannot drive.
    """
    route = route_named(source, chosen.route)
    track = stretch_of(route, chosen.from_m, chosen.to_m, chosen.direction, file=file)
    legs, gears = legs_of_track(track)
    chassis = None if chosen.vehicle is None else chassis_of(read_vehicle(chosen.vehicle), chosen.vehicle)
    speeds = RouteSpeeds(chosen.cruise_mps, chosen.lateral_mps2)
    return make_route_path(legs, gears, chassis, speeds, name=f"{file}: {route.name}")


def open_route(path: str | Path) -> tuple[RouteFile, RoutePath, LocalFrame]:
    """Open a route file: its legs, and their frame.

    Raises:
        InputError: the file or its map is unusable, or the map is not the one that the route was chosen from.
    """
    chosen = read_route(path)
    require_map(chosen, path)
    with MapFile.open(chosen.map) as source:
        return chosen, lay_route(chosen, source, file=path), source.description.frame


def require_map(chosen: RouteFile, path: str | Path) -> None:
    """Refuse a map that has changed since the route was chosen from it.

    Raises:
        InputError: it has, or is not there.
    """
    if not chosen.map.is_file():
        raise InputError(path, "map", "a file", f"no file {chosen.map}")
    digest = file_hash(chosen.map)
    if digest != chosen.map_sha256:
        expected = f"{chosen.map} as it was when the route was chosen, {chosen.map_sha256[:12]}..."
        raise InputError(path, "map_sha256", expected, f"{digest[:12]}...")


def waypoints_of(laid: RoutePath, source: MapFile) -> Waypoints:
    """The rows of a laid route as waypoints, every quarter of a metre; heights are those of the nearest station.

    Args:
        laid: from ``lay_route``.
        source: its map.
    """
    frame, index = source.description.frame, SpatialIndex(source.pose[:, :2], 8.0)
    parts = []
    for leg in range(int(laid.leg_count)):
        spacing_m = float(laid.legs.spacing_m[leg])
        count = round(float(laid.legs.length_m[leg]) / spacing_m) + 1
        rows = np.asarray(laid.legs.rows[leg, 1 : count + 1], np.float64)
        # The last row begins the straight continuation: the curvature there is that of the previous arc.
        curvature = np.append(rows[:-1, 4], rows[-2, 4])
        near = [index.nearest(point, _NEAR_M) for point in rows[:, :2]]
        up = np.array([0.0 if each is None else source.ground_up_m[each] for each in near])
        latitude, longitude, height = frame.to_geodetic(rows[:, 0], rows[:, 1], up)
        heading = frame.heading_of_yaw(np.arctan2(rows[:, 3], rows[:, 2]), longitude)
        number, gear = np.full(count, leg), np.full(count, int(laid.gear[leg]))
        speed = np.asarray(laid.speed_mps[leg, 1 : count + 1], np.float64)
        arc = np.arange(count) * spacing_m
        parts.append((number, gear, arc, latitude, longitude, height, heading, curvature, speed))
    return Waypoints(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def _names(source: MapFile) -> list[str]:
    """Name of each baseline: that of its drive log, if the map has it."""
    inputs = source.provenance.get("inputs")
    rows = inputs if isinstance(inputs, list) else []
    names = []
    for number in range(int(source.drive.max()) + 1):
        row = rows[number] if number < len(rows) else None
        file = row.get("file") if isinstance(row, dict) else None
        names.append(str(file).removesuffix(".drive.h5") if file else f"baseline{number}")
    return names
