"""Fixtures of the course on board: its configuration and files, loaded, and moments of a drive of it."""

from collections.abc import Callable
from pathlib import Path

import pytest

from canon.course import COURSE
from canon.course_loop import DRIVE, OnboardLoop
from canon.course_moments import Moment
from lgprjax.autopilot import Mode
from lgprjax.formats import MapFile
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.control.setup import Loaded, load
from lgprjax.simulation.devices.world import CourseWorld

MOMENTS = {"straight": 12.0, "bend": 22.0, "fast": 70.0}
"""Ways at which moments of a drive are kept: slow and straight, in a bend, and at three metres a second and more."""


@pytest.fixture(scope="session")
def config(course_run: Path) -> RuntimeConfig:
    """Of the course."""
    return read_config(course_run / "course.run.toml")


@pytest.fixture(scope="session")
def loaded(config: RuntimeConfig) -> Loaded:
    """Its files."""
    return load(config)


@pytest.fixture(scope="session")
def world(config: RuntimeConfig) -> CourseWorld:
    """The course that the devices stand on."""
    with MapFile.open(config.path(config.map)) as source:
        return CourseWorld(COURSE, source.description.frame, weather="clear", drive_seed=102)


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
