"""The story that is frozen."""

import pytest

from canon.story import Story, story_of


@pytest.fixture(scope="session")
def story(tmp_path_factory: pytest.TempPathFactory) -> Story:
    """Made once a session."""
    return story_of(tmp_path_factory)
