"""What the tests of the runtime share: a course, its map and route, and the control loop's files, loaded once."""

from collections.abc import Callable
from pathlib import Path

import pytest

from lgprjax.autopilot import Mode
from lgprjax.files import file_hash
from lgprjax.formats import MapFile, RouteFile, write_route
from lgprjax.mapping import build_map, routes_of
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.control.setup import Loaded, load
from lgprjax.simulation.devices.world import CourseWorld
from lgprjax.simulation.loop import OffRoad, make_course
from many_grounds import of_many_grounds
from onboard_loop import DRIVE, OnboardLoop
from onboard_moments import Moment

COURSE = OffRoad(2, 150.0, 3)
ROOT = Path(__file__).resolve().parents[2]


@pytest.fixture(scope="session")
def onboard_folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Map, route and configuration of a course of 150 m."""
    folder = tmp_path_factory.mktemp("onboard")
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


MOMENTS = {"straight": 12.0, "bend": 22.0, "fast": 70.0}
"""Ways at which moments of a drive are kept: slow and straight, in a bend, and at three metres a second and more."""


def _beyond(way_m: float) -> Callable[[OnboardLoop], bool]:
    return lambda loop: loop.stage._known.last.travel_m > way_m


@pytest.fixture(scope="session")
def moments(world: CourseWorld, config: RuntimeConfig, loaded: Loaded) -> dict[str, Moment]:
    """A drive at several moments; faults and buttons begin in copies of them."""
    faster = [
        {"after": {"mode": 4, "for_s": 8.0 + 0.6 * number}, "do": "press", "button": "plus", "for_s": 0.25}
        for number in range(8)
    ]
    loop = OnboardLoop(world, config, loaded, [*DRIVE, *faster], [])
    found: dict[str, Moment] = {}
    for name, way_m in MOMENTS.items():
        assert loop.run(60.0, until=_beyond(way_m)), name
        assert loop.mode is Mode.SPEED, [event for _, event in loop.events]
        found[name] = Moment(loop, (world, config, loaded))
        loop = found[name].copy()
    return found
