"""The world that the devices share."""

import pytest

from lgprjax.simulation.devices.world import CourseWorld
from simulation.devices.stage_host import make_world


@pytest.fixture(scope="session")
def world() -> CourseWorld:
    """A course; nothing that happens on it changes it."""
    return make_world()
