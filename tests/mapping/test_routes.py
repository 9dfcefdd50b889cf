"""Routes of a subsurface database: names, stretches, either way; waypoints where the stations are."""

from pathlib import Path

import h5py
import numpy as np
import pytest
from pyproj import Geod

from canon.site import Site
from lgprjax.files import file_hash
from lgprjax.formats import MapFile, RouteFile, write_route
from lgprjax.frames import LocalFrame
from lgprjax.mapping import lay_route, open_route, read_source, route_named, routes_of, stretch_of, waypoints_of
from refusals import refused


def chosen(site: Site, **changed: object) -> RouteFile:
    route = RouteFile(site.map, file_hash(site.map), "baseline_left", 2.0, 30.0, "along", 3.0, 1.5, None)
    return route._replace(**changed)  # type: ignore[arg-type]


def test_every_baseline_is_a_route(site: Site) -> None:
    with MapFile.open(site.map) as source:
        routes = routes_of(source)
        assert [each.name for each in routes] == ["baseline_left", "baseline_right"]
        for number, route in enumerate(routes):
            mine = source.pose[source.drive == number]
            np.testing.assert_array_equal(route.track.points_m, mine[:, :2])
            assert route.length_m == pytest.approx(np.sum(np.hypot(*np.diff(mine[:, :2], axis=0).T)))
            assert not route.closed
        # Of one name, and of none, they are told apart.
        source.provenance = {"inputs": [{"file": "road.drive.h5"}] * 2}
        assert [each.name for each in routes_of(source)] == ["road#0", "road#1"]
        source.provenance = {}
        assert [each.name for each in routes_of(source)] == ["baseline0", "baseline1"]
    with refused("route", "baseline_left", "baseline_right", found="'left'"):
        route_named(read_source(site.map), "left")


def test_a_laid_route_stays_within_centimetres_of_its_stations_either_way(site: Site) -> None:
    source = read_source(site.map)
    route = route_named(source, "baseline_left")
    inside = (route.at_m >= 2.0) & (route.at_m <= 30.0)
    stations = route.track.points_m[inside]
    ends = []
    for direction in ("along", "against"):
        laid = lay_route(chosen(site, direction=direction), source, file="x")
        assert int(laid.leg_count) == 1
        assert float(laid.gear[0]) == 1.0
        assert float(laid.legs.length_m[0]) == pytest.approx(28.0, abs=0.15)
        rows = np.asarray(laid.legs.rows[0], np.float64)
        count = round(float(laid.legs.length_m[0] / laid.legs.spacing_m[0]))
        line = rows[1 : count + 2, :2]
        away = np.hypot(*(line[:, None] - stations[None]).transpose(2, 0, 1)).min(axis=1)
        # Stations stand 4 cm apart: half of that along the way, and what smoothing moved.
        assert away.max() < 0.06
        ends.append(line[[0, -1]])
    np.testing.assert_allclose(ends[0], ends[1][::-1], atol=0.05)


def test_a_stretch_that_is_none_is_refused(site: Site) -> None:
    route = route_named(read_source(site.map), "baseline_left")
    for from_m, to_m in ((-1.0, 10.0), (10.0, 10.0), (10.0, 11.0), (0.0, 99.0), (np.nan, 5.0)):
        with refused("from_m, to_m", file="x.route.toml"):
            stretch_of(route, from_m, to_m, "along", file="x.route.toml")


def test_waypoints_are_where_the_route_is_and_point_along_it(site: Site) -> None:
    with MapFile.open(site.map) as source:
        held = read_source(site.map)
        points = waypoints_of(lay_route(chosen(site), held, file="x"), held)
        frame = source.description.frame
        up = float(source.ground_up_m.mean())
    # Distances and azimuths on the ellipsoid, by another route than the local frame's.
    geod = Geod(ellps="WGS84")
    azimuth, _, distance = geod.inv(
        points.longitude_deg[:-1], points.latitude_deg[:-1], points.longitude_deg[1:], points.latitude_deg[1:]
    )
    np.testing.assert_allclose(distance, np.diff(points.arc_m), rtol=2e-3)
    middle = 0.5 * (points.heading_deg[:-1] + points.heading_deg[1:])
    assert np.abs((azimuth - middle + 180.0) % 360.0 - 180.0).max() < 0.3
    turned = np.radians(np.diff(np.unwrap(points.heading_deg, period=360.0)))
    np.testing.assert_allclose(-turned / np.diff(points.arc_m), points.curvature_radpm[:-1], atol=2e-3)
    np.testing.assert_allclose(points.height_m, frame.height_m + up, atol=0.3)
    assert set(points.gear) == {1}
    assert points.speed_mps.max() == pytest.approx(3.0)


def test_sparse_waypoints_are_joined_by_a_curve_without_corners(tmp_path: Path) -> None:
    """Every 15 m on a circle of 40 m: the curve stays on the circle, and turns as it does."""
    angle, frame = np.arange(0.0, 4.0, 15.0 / 40.0), LocalFrame(42.0, -71.0, 0.0)
    latitude, longitude, _ = frame.to_geodetic(40.0 * np.cos(angle), 40.0 * np.sin(angle), 0.0 * angle)
    rows = "".join(f"{lat:.10f},{lon:.10f}\n" for lat, lon in zip(latitude, longitude, strict=True))
    path = tmp_path / "circle.csv"
    path.write_text("latitude_deg,longitude_deg\n" + rows, encoding="utf-8")
    source = read_source(path)
    (route,) = source.routes
    assert np.diff(route.at_m).max() < 0.3
    lat, lon, _ = source.frame.to_geodetic(route.track.points_m[:, 0], route.track.points_m[:, 1], 0.0 * route.at_m)
    east, north, _ = frame.to_local(lat, lon, 0.0 * lat)
    assert np.abs(np.hypot(east, north) - 40.0).max() < 0.05
    chosen_one = RouteFile(path, file_hash(path), "circle", 0.0, route.length_m, "along", 3.0, 1.5, None)
    laid = lay_route(chosen_one, source, file="x")
    curvature = np.asarray(laid.legs.rows[0, 20 : int(4 * float(laid.legs.length_m[0])) - 20, 4])
    np.testing.assert_allclose(curvature, 1.0 / 40.0, atol=0.004)
    # A gap that no curve should bridge.
    far = rows.splitlines(keepends=True)
    path.write_text("latitude_deg,longitude_deg\n" + "".join(far[:3] + far[8:]), encoding="utf-8")
    with refused("circle: waypoints", 50, "after waypoint 3", file=path):
        read_source(path)


def test_a_route_in_another_frame_is_at_the_same_place(site: Site) -> None:
    source = read_source(site.map)
    other = LocalFrame(source.frame.latitude_deg + 0.003, source.frame.longitude_deg - 0.004, source.frame.height_m)
    here, there = (np.asarray(lay_route(chosen(site), source, file="x", frame=each).legs.rows[0, 1:100, :4], np.float64)
                   for each in (None, other))  # fmt: skip
    lat, lon, _ = other.to_geodetic(there[:, 0], there[:, 1], np.zeros(len(there)))
    east, north, _ = source.frame.to_local(lat, lon, np.full(len(there), source.frame.height_m))
    assert np.hypot(east - here[:, 0], north - here[:, 1]).max() < 0.002
    turned = np.arctan2(there[:, 3], there[:, 2]) - np.arctan2(here[:, 3], here[:, 2])
    # Meridians converge by sin(latitude) of the difference in longitude.
    np.testing.assert_allclose(turned, -np.radians(0.004) * np.sin(np.radians(42.0)), atol=1e-4)


def test_a_route_file_opens_with_its_own_map_only(site: Site, tmp_path: Path) -> None:
    path = tmp_path / "x.route.toml"
    write_route(path, chosen(site))
    read, laid, opened = open_route(path)
    assert read.route == "baseline_left"
    assert float(laid.legs.length_m[0]) == pytest.approx(28.0, abs=0.15)
    with MapFile.open(site.map) as source:
        assert opened.frame == source.description.frame

    changed = tmp_path / "changed.map.h5"
    changed.write_bytes(site.map.read_bytes())
    with h5py.File(changed, "r+") as store:
        store.attrs["name"] = "another"
    write_route(path, chosen(site, map=changed), force=True)
    with refused("map_sha256", "changed.map.h5", file=path, found=file_hash(changed)[:12]):
        open_route(path)
    write_route(path, chosen(site, map=tmp_path / "none.map.h5"), force=True)
    with refused("map", file=path, found="none.map.h5"):
        open_route(path)
