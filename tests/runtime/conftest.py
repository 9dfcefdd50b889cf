"""What the tests of the runtime share."""

from canon.course_fixtures import config, loaded, moments, world

__all__ = ["config", "loaded", "moments", "world"]
