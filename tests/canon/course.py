"""A course of 150 m off road with its map, route and run configuration."""

from pathlib import Path

from canon.map import of_many_grounds
from lgprjax.files import file_hash
from lgprjax.formats import MapFile, RouteFile, VehicleFile, read_vehicle, write_route, write_vehicle
from lgprjax.mapping import build_map, routes_of
from lgprjax.simulation.loop import OffRoad, make_course

COURSE = OffRoad(2, 150.0, 3)
ROOT = Path(__file__).resolve().parents[2]


def make_steering_only(folder: Path) -> str:
    """Write the course's vehicle without throttle and brake; name of its file."""
    table = read_vehicle(ROOT / "onboard" / "made_up.vehicle.toml").model_dump(exclude_none=True)
    pedals = ("throttle", "brake", "resistance")
    kept = {name: value for name, value in table.items() if name not in pedals}
    kept["found"] = {path: each for path, each in table["found"].items() if not path.startswith(pedals)}
    only = VehicleFile.model_validate({**kept, "speed_control": False})
    write_vehicle(folder / "steering_only.vehicle.toml", only, force=True)
    return "steering_only.vehicle.toml"


def make_course_run(folder: Path) -> None:
    """Write ``course.map.h5``, ``course.route.toml``, ``course.run.toml`` and the baseline's drive log."""
    course = make_course(COURSE, folder)
    database, vehicle = folder / "course.map.h5", ROOT / "onboard" / "made_up.vehicle.toml"
    build_map([course.baseline], database, measure=of_many_grounds)
    with MapFile.open(database) as source:
        first = routes_of(source)[0]
    route = RouteFile(database, file_hash(database), first.name, 0.0, first.length_m, "along", 4.47, 1.5, vehicle)
    write_route(folder / "course.route.toml", route)
    text = (ROOT / "onboard" / "simulated.run.toml").read_text(encoding="utf-8")
    text = text.replace("../out/onboard/course300", "course").replace("../out/onboard/", "")
    text = text.replace("made_up.vehicle.toml", str(vehicle)).replace("length_m = 300.0", "length_m = 150.0")
    (folder / "course.run.toml").write_text(text, encoding="utf-8")
