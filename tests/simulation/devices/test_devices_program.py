"""The program of the devices: its specification, its parent, and its ports' thread."""

import json
import os
import threading
from pathlib import Path
from typing import Any

import pytest

from lgprjax.simulation.devices import program
from lgprjax.simulation.devices.course_stage import CourseSpec
from lgprjax.simulation.devices.stage import StageSpec, read_spec
from refusals import refused


def test_a_poor_spec_ends_in_one_line(tmp_path: Path) -> None:
    path = tmp_path / "spec.json"
    path.write_text('{"ports": "p", "truth": "t", "seed": 1}', encoding="utf-8")
    with refused("length_m", file=path):
        read_spec(path, CourseSpec)
    path.write_text("{", encoding="utf-8")
    with refused(file=path):
        read_spec(path, CourseSpec)


class _IdleStage:
    """A stage that moves and sends nothing; its ports' thread dies where it is told to."""

    def __init__(self, begin_ns: int, *, fails: bool) -> None:
        self.next_ns, self.latest_s = begin_ns, dict[str, float]()
        # The stage that warms up begins at 0.
        self._fails = fails and begin_ns > 0

    def warm(self) -> None:
        pass

    def renew(self) -> None:
        pass

    def tick(self) -> None:
        self.next_ns += 10_000_000

    def render(self, tick: None) -> None:
        pass

    def emit(self, now_ns: int) -> list[tuple[str, bytes]]:
        if self._fails:
            raise ValueError(f"70000 at {now_ns} ns")
        return []


def _idle(parent: int, *, fails: bool) -> program.RealTime:
    def make(begin_ns: int) -> Any:
        return _IdleStage(begin_ns, fails=fails)

    return program.RealTime(make, 1.0, parent)


def test_devices_whose_parent_died_while_they_were_compiled_end() -> None:
    real = _idle(os.getppid() + 1, fails=False)
    guard = threading.Timer(20.0, real.end)
    guard.start()
    real.run()
    assert guard.is_alive()
    guard.cancel()


def test_a_spec_says_whose_devices_they_are(tmp_path: Path) -> None:
    path = tmp_path / "spec.json"
    bare = {"ports": "p", "truth": "t"}
    path.write_text(json.dumps(bare), encoding="utf-8")
    assert read_spec(path, StageSpec).parent == os.getppid()
    path.write_text(json.dumps({**bare, "parent": 4711}), encoding="utf-8")
    assert read_spec(path, StageSpec).parent == 4711


def test_what_ends_the_thread_of_the_ports_is_raised() -> None:
    with pytest.raises(ValueError, match="70000"):
        _idle(os.getppid(), fails=True).run()
