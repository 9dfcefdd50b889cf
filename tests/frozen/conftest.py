"""What the command line makes of a small site and of two recorded runs, once a session."""

from pathlib import Path

import pytest

from frozen.made import make_all


@pytest.fixture(scope="session")
def made(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder with everything in it."""
    folder = tmp_path_factory.mktemp("frozen")
    make_all(folder)
    return folder
