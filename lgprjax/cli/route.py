"""``lgprjax route``: list the routes of a map, select one, and export its waypoints."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import UsageError, console, counted, verdict

_TEN_MPH = 4.47
_SUFFIX = ".route.toml"


@dataclass(frozen=True)
class RouteList:
    """List the routes of a map, one for each baseline."""

    file: Annotated[Positional[Path], arg(metavar="MAP", help="map, M.map.h5")]
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Print."""
        from lgprjax.formats import MapFile
        from lgprjax.mapping import routes_of

        with MapFile.open(self.file) as source:
            routes = routes_of(source)
            frame = source.description.frame
        figures = []
        table = Table("route", "length m", "start", "heading deg", "closed", title=self.file.name)
        for route in routes:
            first = route.track.points_m[:1]
            latitude, longitude, _ = frame.to_geodetic(first[:, 0], first[:, 1], first[:, 0] * 0.0)
            heading = frame.heading_of_yaw(route.track.yaw_rad[:1], longitude)
            figures.append(
                {
                    "route": route.name,
                    "length_m": round(route.length_m, 2),
                    "stations": len(route.at_m),
                    "start_latitude_deg": float(latitude[0]),
                    "start_longitude_deg": float(longitude[0]),
                    "start_heading_deg": round(float(heading[0]), 2),
                    "ends_where_it_began": route.closed,
                }
            )
            place = f"{latitude[0]:.7f}, {longitude[0]:.7f}"
            closed = "yes" if route.closed else "no"
            table.add_row(route.name, f"{route.length_m:.1f}", place, f"{heading[0]:.0f}", closed)
        console.print(table)
        if self.json is not None:
            write_figures(self.json, {"map": self.file.name, "routes": figures}, force=self.force)
        name = routes[0].name if routes else "ROUTE"
        verdict(
            f"{counted(len(routes), 'route')} in {self.file}", f"route select {self.file} {name} -o {name}.route.toml"
        )


@dataclass(frozen=True)
class RouteSelect:
    """Write a route file: a route of a map, or a section of it, with direction and speed.

    The command checks the route and rejects one that the vehicle cannot drive. The route file is valid as long as the
    map is unchanged.
    """

    file: Annotated[Positional[Path], arg(metavar="MAP", help="map, M.map.h5")]
    route: Annotated[Positional[str], arg(metavar="ROUTE", help="name of the route, from route list")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="X.route.toml", help="route file to write")]
    from_m: float = 0.0
    """start of the section, in metres along the recorded route"""
    to_m: float | None = None
    """end of the section; default: the end of the route"""
    against: bool = False
    """drive the section backward, from its end to its start"""
    cruise_mps: float = _TEN_MPH
    """maximum speed"""
    lateral_mps2: float = 1.5
    """maximum lateral acceleration; limits the speed in bends"""
    vehicle: Path | None = None
    """vehicle file; bends tighter than its turning radius are rejected"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Select."""
        from lgprjax.files import file_hash
        from lgprjax.formats import MapFile, RouteFile, write_route
        from lgprjax.mapping import lay_route, route_named

        with MapFile.open(self.file) as source:
            check_outputs(self.output, force=self.force)
            length_m = route_named(source, self.route).length_m
            chosen = RouteFile(
                self.file,
                file_hash(self.file),
                self.route,
                self.from_m,
                length_m if self.to_m is None else self.to_m,
                "against" if self.against else "along",
                self.cruise_mps,
                self.lateral_mps2,
                self.vehicle,
            )
            laid = lay_route(chosen, source, file=self.output)
        write_route(self.output, chosen, force=self.force)
        legs = int(laid.leg_count)
        metres = float(laid.legs.length_m[:legs].sum())
        slowest = float(laid.speed_mps[:legs].min())
        text = f"{metres:.1f} m in {legs} leg{'s' if legs > 1 else ''}, {slowest:.3g} to {self.cruise_mps:.3g} m/s"
        verdict(f"wrote {self.output}: {text}", f"route export {self.output} -o waypoints.gpx")


@dataclass(frozen=True)
class RouteExport:
    """Write waypoints of a route every 0.25 m: WGS-84 position, heading, arc length, curvature, speed and gear."""

    file: Annotated[Positional[Path], arg(metavar="X.route.toml|MAP", help="route file, or map and ROUTE")]
    output: Annotated[Path, arg(aliases=["-o"], metavar="F", help="waypoints to write: .csv, .geojson or .gpx")]
    route: Annotated[
        Positional[str | None], arg(metavar="ROUTE", help="name of the route, if the first argument is a map")
    ] = None
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Export."""
        from lgprjax.formats import MapFile, RouteFile, read_route, write_waypoints
        from lgprjax.mapping import lay_route, require_map, route_named, waypoints_of

        chosen = None
        if self.file.name.endswith(_SUFFIX):
            if self.route is not None:
                raise UsageError("ROUTE: expected none with a route file")
            chosen = read_route(self.file)
            require_map(chosen, self.file)
        elif self.route is None:
            raise UsageError("ROUTE: expected the name of a route (lgprjax route list), found none")
        with MapFile.open(self.file if chosen is None else chosen.map) as source:
            if chosen is None:
                assert self.route is not None
                length_m = route_named(source, self.route).length_m
                # The whole baseline at 10 mph: the defaults of route select.
                chosen = RouteFile(self.file, "", self.route, 0.0, length_m, "along", _TEN_MPH, 1.5, None)
            waypoints = waypoints_of(lay_route(chosen, source, file=self.file), source)
        write_waypoints(self.output, chosen.route, waypoints, force=self.force)
        verdict(f"wrote {self.output}: {len(waypoints.leg)} waypoints")
