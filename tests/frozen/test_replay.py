"""Old recordings replay: every frame that was sent comes out again, to the bit.

The recordings were driven by ``AS_DRIVEN``, and are replayed by it. See ``recordings`` for what they show.
"""

import json
import platform
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest

from frozen.harness import AS_DRIVEN, Done, run_command
from frozen.recordings import lay_out

pytestmark = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="recorded on x86-64")


_FRAMES = {"course": (1200, 1442), "field": (1498, 1797)}
"""Ticks that are replayed, and frames that were sent in them."""


@pytest.fixture(scope="module")
def replayed(tmp_path_factory: pytest.TempPathFactory) -> dict[str, tuple[Done, Path]]:
    """Of each recording, what the command said and the figures that it wrote; both at a time."""

    def replay(name: str) -> tuple[Done, Path]:
        folder = tmp_path_factory.mktemp(name)
        run, told = lay_out(name, folder / "driven"), folder / "told.json"
        words = ["run", str(run / "config.toml"), "--replay", str(run), "--json", str(told)]
        return run_command(words, folder, **AS_DRIVEN), told

    with ThreadPoolExecutor() as pool:
        return dict(zip(_FRAMES, pool.map(replay, _FRAMES), strict=True))


@pytest.mark.parametrize("name", _FRAMES)
def test_a_recording_replays_to_the_same_frames(name: str, replayed: dict[str, tuple[Done, Path]]) -> None:
    done, told = replayed[name]
    assert told.is_file(), done.err
    ticks, frames = _FRAMES[name]
    expected = {"ticks": ticks, "frames": frames, "differing": 0, "first": None, "starts": 1, "broken": None}
    assert json.loads(told.read_text(encoding="utf-8")) == expected
    assert done.status == 0
