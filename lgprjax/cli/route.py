"""``lgprjax route``: list the routes of a map, a drive or waypoints, select one, and export its waypoints."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import UsageError, console, counted, verdict

_TEN_MPH = 4.47
_SUFFIX = ".route.toml"
_SOURCE = "map, drive log, folder of a run, or waypoints: .csv, .geojson, .gpx"


@dataclass(frozen=True)
class RouteList:
    """List the routes of a map, one for each baseline, or of a drive or waypoints."""

    file: Annotated[Positional[Path], arg(metavar="SOURCE", help=_SOURCE)]
    json: Path | None = None
    """JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Print."""
        from lgprjax.cli.maps import drive_of
        from lgprjax.mapping import read_source

        _, frame, routes = read_source(drive_of(self.file))
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
    """Write a route file: a route of a map, a drive or waypoints, or a section of it, with direction and speed.

    The command checks the route and rejects one that the vehicle cannot drive. The route file is valid as long as its
    source is unchanged. Waypoints up to 50 m apart are joined by a smooth curve; their speeds are not read.
    """

    file: Annotated[Positional[Path], arg(metavar="SOURCE", help=_SOURCE)]
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
        from lgprjax.cli.maps import drive_of
        from lgprjax.files import file_hash
        from lgprjax.formats import RouteFile, write_route
        from lgprjax.mapping import lay_route, read_source, route_named

        source = read_source(drive_of(self.file))
        check_outputs(self.output, force=self.force)
        length_m = route_named(source, self.route).length_m
        chosen = RouteFile(
            map=source.path,
            map_sha256=file_hash(source.path),
            route=self.route,
            from_m=self.from_m,
            to_m=length_m if self.to_m is None else self.to_m,
            direction="against" if self.against else "along",
            cruise_mps=self.cruise_mps,
            lateral_mps2=self.lateral_mps2,
            vehicle=self.vehicle,
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
    """Write waypoints of a route every 0.25 m: WGS-84 position, heading, arc length, curvature, speed and gear.

    Several route files are joined in their order: each begins within 10 m and 45° of the end of the one before.
    route select makes one route of the result.
    """

    files: Annotated[
        Positional[tuple[str, ...]],
        arg(metavar="X.route.toml...|SOURCE ROUTE", help="route files, or a source and the name of its route"),
    ]
    output: Annotated[Path, arg(aliases=["-o"], metavar="F", help="waypoints to write: .csv, .geojson or .gpx")]
    force: bool = False
    """replace existing outputs"""

    def run(self) -> None:
        """Export."""
        from lgprjax.cli.maps import drive_of
        from lgprjax.formats import RouteFile, write_waypoints
        from lgprjax.mapping import joined_waypoints, lay_route, open_route, read_source, route_named, waypoints_of

        files = [Path(each) for each in self.files]
        if all(each.name.endswith(_SUFFIX) for each in files):
            opened = [open_route(each) for each in files]
            parts = [(file, waypoints_of(laid, source)) for file, (_, laid, source) in zip(files, opened, strict=True)]
            name = " and ".join(dict.fromkeys(chosen.route for chosen, _, _ in opened))
        else:
            if len(files) != 2 or files[0].name.endswith(_SUFFIX):
                found = " ".join(self.files)
                raise UsageError(f"ROUTE: expected route files, or a source and the name of its route, found {found}")
            source, name = read_source(drive_of(files[0])), self.files[1]
            length_m = route_named(source, name).length_m
            # The whole route at 10 mph: the defaults of route select.
            chosen = RouteFile(
                map=source.path,
                map_sha256="",
                route=name,
                from_m=0.0,
                to_m=length_m,
                direction="along",
                cruise_mps=_TEN_MPH,
                lateral_mps2=1.5,
                vehicle=None,
            )
            parts = [(files[0], waypoints_of(lay_route(chosen, source, file=files[0]), source))]
        waypoints = joined_waypoints(parts)
        write_waypoints(self.output, name, waypoints, force=self.force)
        joined = f" of {len(parts)} routes" if len(parts) > 1 else ""
        verdict(f"wrote {self.output}: {len(waypoints.leg)} waypoints{joined}")
