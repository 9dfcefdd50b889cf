"""Fixtures of the course on board."""

from canon.course_fixtures import config, loaded, moments, world

__all__ = ["config", "loaded", "moments", "world"]
