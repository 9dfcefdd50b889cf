"""Routes of a subsurface database, a drive log or waypoints: stretches in either direction, as drivable legs."""

from collections.abc import Sequence
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats import (
    DriveLog,
    MapFile,
    RouteFile,
    Waypoints,
    WaypointTrack,
    read_route,
    read_vehicle,
    read_waypoints,
)
from lgprjax.frames import LocalFrame, body_to_local
from lgprjax.navigation import RoutePath, RouteSpeeds, RouteTrack, is_closed, legs_of_track, make_route_path
from lgprjax.radar import centre_of
from lgprjax.recordings.vehicles import chassis_of
from lgprjax.subsurface import SpatialIndex

_LEAST_M = 2.0
_NEAR_M = 20.0
_JOIN_M, _JOIN_DEG = 10.0, 45.0
_SPARSE_M, _WIDEST_M, _STEP_M = 1.0, 50.0, 0.25


class Route(NamedTuple):
    """A baseline or track as a route, in the local frame of its source.

    Attributes:
        name: name of its drive log or track; with its number if not unique.
        track: recorded track of the array's centre.
        at_m: distance along the track at each point.
        up_m: height of the ground at each point; 0 if the source has no heights.
        closed: whether it ends at its start.
    """

    name: str
    track: RouteTrack
    at_m: Float[np.ndarray, " point"]
    up_m: Float[np.ndarray, " point"]
    closed: bool

    @property
    def length_m(self) -> float:
        """Length along the points, m."""
        return float(self.at_m[-1])


class RouteSource(NamedTuple):
    """A file with routes, their frame, and the routes."""

    path: Path
    frame: LocalFrame
    routes: list[Route]


def read_source(path: str | Path) -> RouteSource:
    """The routes of a file.

    Args:
        path: a subsurface database (``.map.h5``), a drive log (``.drive.h5``), or waypoints for ``read_waypoints``,
            which are taken for the array's centre. Waypoints more than a metre apart are joined by a smooth curve.

    Raises:
        InputError: the file cannot be read, or has gaps that no route can have.
    """
    file = Path(path)
    if file.name.endswith(".drive.h5"):
        return _source_of_drive(file)
    if file.suffix == ".h5":
        with MapFile.open(file) as source:
            return RouteSource(file, source.description.frame, routes_of(source))
    tracks = read_waypoints(file)
    height_m = tracks[0].height_m[0]
    first = (tracks[0].latitude_deg[0], tracks[0].longitude_deg[0], height_m if np.isfinite(height_m) else 0.0)
    frame = LocalFrame(*(float(each) for each in first))
    names = [track.name for track in tracks]
    if len(set(names)) < len(names):
        raise InputError(file, "tracks", "a name of its own for each", ", ".join(names))
    return RouteSource(file, frame, [_route_of_waypoints(file, track, frame) for track in tracks])


def _source_of_drive(file: Path) -> RouteSource:
    with DriveLog.open(file) as log:
        track, array = log.description.navigation, log.description.array
    places = (track.latitude_deg, track.longitude_deg, track.height_m)
    latitude, longitude, height = (np.asarray(each) for each in places)
    frame = LocalFrame(float(latitude[0]), float(longitude[0]), float(height[0]))
    east, north, up = frame.to_local(latitude, longitude, height)
    yaw = frame.yaw_of_heading(np.asarray(track.heading_deg), longitude)
    points = np.stack(body_to_local(east, north, yaw, *centre_of(array)), axis=1)
    return RouteSource(file, frame, [_route(file.name.removesuffix(".drive.h5"), points, yaw, up)])


def _route(
    name: str,
    points_m: Float[np.ndarray, "point 2"],
    yaw_rad: Float[np.ndarray, " point"],
    up_m: Float[np.ndarray, " point"],
) -> Route:
    at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points_m, axis=0).T))])
    return Route(name, RouteTrack(name, points_m, yaw_rad), at, up_m, is_closed(points_m, yaw_rad))


def _route_of_waypoints(file: Path, track: WaypointTrack, frame: LocalFrame) -> Route:
    # Waypoints without heights have those of the frame's anchor; with heights they are still projected level, because a
    # slope shortens distances by less than a centimetre.
    level = np.full(len(track.latitude_deg), frame.height_m)
    east, north, _ = frame.to_local(track.latitude_deg, track.longitude_deg, level)
    points = np.stack([east, north], axis=1)
    up = np.where(np.isfinite(track.height_m), track.height_m - frame.height_m, 0.0)
    yaw, gears = frame.yaw_of_heading(track.heading_deg, track.longitude_deg), track.gear
    moved = np.append(True, np.hypot(*np.diff(points, axis=0).T) > 0.0)
    steps = np.hypot(*np.diff(points[moved], axis=0).T)
    if len(steps) < 1 or steps.max() > _WIDEST_M:
        found = "all at one place" if len(steps) < 1 else f"{steps.max():.1f} m after waypoint {np.argmax(steps) + 1}"
        raise InputError(file, f"{track.name}: waypoints", f"gaps of at most {_WIDEST_M:g} m", found)
    if np.median(steps) > _SPARSE_M and np.ptp(gears) == 0:
        points, up = _joined(points[moved], up[moved])
        yaw, gears = np.full(len(points), np.nan), np.full(len(points), gears[0])
    ahead = np.gradient(points, axis=0)
    yaw = np.where(np.isfinite(yaw), yaw, np.arctan2(ahead[:, 1], ahead[:, 0])) + np.where(gears < 0, np.pi, 0.0)
    return _route(track.name, points, yaw, up)


def _joined(
    points_m: Float[np.ndarray, "waypoint 2"], up_m: Float[np.ndarray, " waypoint"]
) -> tuple[Float[np.ndarray, "point 2"], Float[np.ndarray, " point"]]:
    """Points every quarter of a metre on a curve of continuous curvature through waypoints; heights between them."""
    from scipy.interpolate import CubicSpline  # takes a while to import, and few routes need it

    at = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(points_m, axis=0).T))])
    along = np.linspace(0.0, at[-1], max(round(at[-1] / _STEP_M), 1) + 1)
    kind = "not-a-knot" if len(at) > 3 else "natural"
    return np.asarray(CubicSpline(at, points_m, bc_type=kind)(along)), np.interp(along, at, up_m)


def routes_of(source: MapFile) -> list[Route]:
    """Routes of all baselines that have two stations or more, in their order."""
    routes: list[Route] = []
    names = _names(source)
    for number, name in enumerate(names):
        pose = source.pose[source.drive == number]
        if len(pose) < 2:
            continue
        shown = name if names.count(name) == 1 else f"{name}#{number}"
        routes.append(_route(shown, pose[:, :2], pose[:, 3], source.ground_up_m[source.drive == number]))
    return routes


def route_named(source: RouteSource, name: str) -> Route:
    """The route of that name.

    Raises:
        InputError: the file has no such route.
    """
    for route in source.routes:
        if route.name == name:
            return route
    raise InputError(source.path, "route", "one of " + ", ".join(each.name for each in source.routes), repr(name))


def stretch_of(
    route: Route, from_m: float, to_m: float, direction: Literal["along", "against"], *, file: str | Path
) -> RouteTrack:
    """Track of a stretch in the order of driving.

    Args:
        route: route of a source.
        from_m, to_m: start and end along the recorded route.
        direction: direction of driving: as recorded, or reversed.
        file: path of the file, for errors.

    Raises:
        InputError: the stretch is shorter than two metres, or beyond the route's end.
    """
    if not 0.0 <= from_m < to_m <= route.length_m + 0.01:
        found = f"{from_m:g} to {to_m:g} m"
        raise InputError(file, "from_m, to_m", f"a stretch within 0 to {route.length_m:.2f} m", found)
    inside = (route.at_m >= from_m) & (route.at_m <= to_m)
    if to_m - from_m < _LEAST_M or np.count_nonzero(inside) < 2:
        raise InputError(file, "from_m, to_m", f"a stretch of at least {_LEAST_M:g} m", f"{to_m - from_m:g} m")
    track = RouteTrack(route.name, route.track.points_m[inside], route.track.yaw_rad[inside])
    return track.reversed() if direction == "against" else track


def lay_route(
    chosen: RouteFile, source: RouteSource, *, file: str | Path, frame: LocalFrame | None = None
) -> RoutePath:
    """The legs of a chosen route, for the anchor of its vehicle.

    Args:
        chosen: route from ``read_route``, or one to be written.
        source: source of the route.
        file: path of the route file, for errors.
        frame: frame of the result; by default that of the source.

    Raises:
        InputError: the route or stretch does not exist, it has a gap, or a bend that the vehicle cannot drive.
    """
    route = route_named(source, chosen.route)
    track = stretch_of(route, chosen.from_m, chosen.to_m, chosen.direction, file=file)
    if frame is not None and frame != source.frame:
        track = _moved(track, source.frame, frame)
    legs, gears = legs_of_track(track)
    chassis = None if chosen.vehicle is None else chassis_of(read_vehicle(chosen.vehicle), chosen.vehicle)
    speeds = RouteSpeeds(chosen.cruise_mps, chosen.lateral_mps2)
    return make_route_path(legs, gears, chassis, speeds, name=f"{file}: {route.name}")


def _moved(track: RouteTrack, source: LocalFrame, frame: LocalFrame) -> RouteTrack:
    """A track in another frame, both level at the height of their anchors."""
    east, north = track.points_m.T
    latitude, longitude, _ = source.to_geodetic(east, north, np.zeros(len(east)))
    x, y, _ = frame.to_local(latitude, longitude, np.full(len(east), frame.height_m))
    yaw = frame.yaw_of_heading(source.heading_of_yaw(track.yaw_rad, longitude), longitude)
    return RouteTrack(track.name, np.stack([x, y], axis=1), yaw)


def open_route(path: str | Path) -> tuple[RouteFile, RoutePath, RouteSource]:
    """Open a route file: its legs in the frame of their source, and the source.

    Raises:
        InputError: the file or its source is unusable, or the source is not the one that the route was chosen from.
    """
    chosen = read_route(path)
    require_map(chosen, path)
    source = read_source(chosen.map)
    return chosen, lay_route(chosen, source, file=path), source


def require_map(chosen: RouteFile, path: str | Path) -> None:
    """Refuse a map or other source that has changed since the route was chosen from it.

    Raises:
        InputError: the source has changed or is missing.
    """
    if not chosen.map.is_file():
        raise InputError(path, "map", "a file", f"no file {chosen.map}")
    digest = file_hash(chosen.map)
    if digest != chosen.map_sha256:
        expected = f"{chosen.map} as it was when the route was chosen, {chosen.map_sha256[:12]}..."
        raise InputError(path, "map_sha256", expected, f"{digest[:12]}...")


def waypoints_of(laid: RoutePath, source: RouteSource) -> Waypoints:
    """The rows of a laid route as waypoints, every quarter of a metre; heights are those of the nearest point.

    Args:
        laid: path from ``lay_route``.
        source: source of the route.
    """
    frame, index = source.frame, SpatialIndex(np.concatenate([each.track.points_m for each in source.routes]), 8.0)
    up_m = np.concatenate([each.up_m for each in source.routes])
    parts = []
    for leg in range(int(laid.leg_count)):
        spacing_m = float(laid.legs.spacing_m[leg])
        count = round(float(laid.legs.length_m[leg]) / spacing_m) + 1
        rows = np.asarray(laid.legs.rows[leg, 1 : count + 1], np.float64)
        # The last row begins the straight continuation: the curvature there is that of the previous arc.
        curvature = np.append(rows[:-1, 4], rows[-2, 4])
        near = [index.nearest(point, _NEAR_M) for point in rows[:, :2]]
        up = np.array([0.0 if each is None else up_m[each] for each in near])
        latitude, longitude, height = frame.to_geodetic(rows[:, 0], rows[:, 1], up)
        heading = frame.heading_of_yaw(np.arctan2(rows[:, 3], rows[:, 2]), longitude)
        number, gear = np.full(count, leg), np.full(count, int(laid.gear[leg]))
        speed = np.asarray(laid.speed_mps[leg, 1 : count + 1], np.float64)
        arc = np.arange(count) * spacing_m
        parts.append((number, gear, arc, latitude, longitude, height, heading, curvature, speed))
    return Waypoints(*(np.concatenate(columns) for columns in zip(*parts, strict=True)))


def joined_waypoints(parts: Sequence[tuple[str | Path, Waypoints]]) -> Waypoints:
    """Waypoints of several routes as those of one, in their order.

    Args:
        parts: file, for errors, and waypoints of each.

    Raises:
        InputError: a route begins more than 10 m from the end of the one before, or faces elsewhere by more than 45°.
    """
    legs, columns = 0, list[Waypoints]()
    for number, (file, points) in enumerate(parts):
        if number:
            before, last = parts[number - 1]
            here = LocalFrame(float(points.latitude_deg[0]), float(points.longitude_deg[0]), 0.0)
            east, north, _ = here.to_local(last.latitude_deg[-1:], last.longitude_deg[-1:], np.zeros(1))
            away_m = float(np.hypot(east, north)[0])
            turned = points.heading_deg[0] - last.heading_deg[-1] + (180.0 if points.gear[0] != last.gear[-1] else 0.0)
            turned = abs((turned + 180.0) % 360.0 - 180.0)
            if away_m > _JOIN_M or turned > _JOIN_DEG:
                expected = f"within {_JOIN_M:g} m and {_JOIN_DEG:g}° of the end of {before}"
                raise InputError(file, "start", expected, f"{away_m:.1f} m and {turned:.0f}°")
            # In one gear the drive continues: the joint is not the end of a leg.
            legs += int(points.gear[0] != last.gear[-1])
        columns.append(points._replace(leg=points.leg + legs))
        legs += int(points.leg[-1])
    return Waypoints(*(np.concatenate(each) for each in zip(*columns, strict=True)))


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
