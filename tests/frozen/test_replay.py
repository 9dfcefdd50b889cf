"""Old recordings replay: every frame that was sent comes out again, to the bit.

The recordings were driven by ``ONE_ARITHMETIC``, and are replayed by it. See ``recordings`` for what they show.
"""

import json
import platform
from pathlib import Path

import pytest

from frozen.harness import ONE_ARITHMETIC, run_command
from frozen.recordings import lay_out

pytestmark = pytest.mark.skipif(platform.machine() not in ("x86_64", "AMD64"), reason="recorded on x86-64")


@pytest.mark.parametrize(("name", "ticks", "frames"), [("course", 2099, 2520), ("field", 1499, 1798)])
def test_a_recording_replays_to_the_same_frames(name: str, ticks: int, frames: int, tmp_path: Path) -> None:
    run = lay_out(name, tmp_path / name)
    told = tmp_path / "told.json"
    config = run / "config.toml"
    words = ["run", str(config), "--replay", str(run), "--json", str(told)]
    done = run_command(words, tmp_path, **ONE_ARITHMETIC)
    assert told.is_file(), done.err
    expected = {"ticks": ticks, "frames": frames, "differing": 0, "first": None, "starts": 1, "broken": None}
    assert json.loads(told.read_text(encoding="utf-8")) == expected
    assert done.status == 0
