"""What the tests of the runtime share: a course, its map and route, and the control loop's files, loaded once."""

from pathlib import Path

import pytest

from lgprjax.archive import build_map, file_hash, routes_of
from lgprjax.formats import MapFile, RouteFile, write_route
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.control.setup import Loaded, load
from lgprjax.simulation.devices.course_world import CourseWorld
from lgprjax.simulation.loop import OffRoad, make_course

COURSE = OffRoad(2, 150.0, 3)
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def onboard_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Map, route and configuration of a course of 150 m."""
    folder = tmp_path_factory.mktemp("onboard")
    course = make_course(COURSE, folder)
    database, vehicle = folder / "course.map.h5", ROOT / "onboard" / "made_up.vehicle.toml"
    build_map([course.baseline], database)
    with MapFile.open(database) as source:
        first = routes_of(source)[0]
    route = RouteFile(database, file_hash(database), first.name, 0.0, first.length_m, "along", 4.47, 1.5, vehicle)
    write_route(folder / "course.route.toml", route)
    text = (ROOT / "onboard" / "simulated.run.toml").read_text(encoding="utf-8")
    text = text.replace("../out/onboard/course300", "course").replace("../out/onboard/", "")
    text = text.replace("made_up.vehicle.toml", str(vehicle)).replace("length_m = 300.0", "length_m = 150.0")
    (folder / "course.run.toml").write_text(text, encoding="utf-8")
    return folder


@pytest.fixture(scope="session")
def config(onboard_folder: Path) -> RuntimeConfig:
    """Of the course."""
    return read_config(onboard_folder / "course.run.toml")


@pytest.fixture(scope="session")
def loaded(config: RuntimeConfig) -> Loaded:
    """Its files."""
    return load(config)


@pytest.fixture(scope="session")
def world(config: RuntimeConfig) -> CourseWorld:
    """The course that the devices stand on."""
    with MapFile.open(config.path(config.map)) as source:
        return CourseWorld(COURSE, source.description.frame, weather="clear", drive_seed=102)
