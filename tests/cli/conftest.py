"""What the tests of the command line share."""

from pathlib import Path

import pytest

from canon.shared import shared_folder
from canon.site import Site
from canon.story import Story, story_of
from canon.trench import first_scans


@pytest.fixture(scope="session")
def story(tmp_path_factory: pytest.TempPathFactory) -> Story:
    """Commands of a whole site that were run once a session."""
    return story_of(tmp_path_factory)


@pytest.fixture(scope="session")
def short(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The first 120 scans of the site's live drive: a small log to damage."""
    folder = shared_folder(
        tmp_path_factory, "short", lambda folder: first_scans(site.logs["live"], folder / "short.drive.h5", 120)
    )
    return folder / "short.drive.h5"


@pytest.fixture
def here(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """An empty folder that commands are run in."""
    monkeypatch.chdir(tmp_path)
    return tmp_path
