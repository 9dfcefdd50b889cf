"""How a run that is driven for some seconds ends: what it writes afterwards is not cut off."""

import signal
import time
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from lgprjax.cli import run as verb
from lgprjax.runtime import supervisor


def test_a_run_that_arrives_early_is_not_ended_while_its_drive_is_written(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its time is up a tenth of a second after it is ready, before its drive is written."""
    late: list[int] = []
    written: list[Path] = []
    before = signal.signal(signal.SIGTERM, lambda number, _: late.append(number))

    def supervise(*_: object, ready: Callable[[Any], None]) -> int:
        ready(supervisor.Ready(1.0, ()))
        return 0

    def write(_: object, folder: Path) -> bool:
        time.sleep(0.3)
        written.append(folder)
        return True

    monkeypatch.setattr(supervisor, "supervise", supervise)
    monkeypatch.setattr(supervisor, "make_rings_folder", lambda: tmp_path)
    monkeypatch.setattr(verb, "_write_drive", write)
    config: Any = SimpleNamespace(display=SimpleNamespace(host="", port=0), mode="drive", coverage=None)
    try:
        assert verb._drive(config, tmp_path / "run", 0.1) == 0
    finally:
        signal.signal(signal.SIGTERM, before)
    assert written == [tmp_path / "run"]
    assert late == []


@pytest.mark.parametrize(("mode", "status"), [("record", 1), ("drive", 0)])
def test_a_recording_without_its_drive_log_fails(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, mode: str, status: int
) -> None:
    monkeypatch.setattr(verb, "supervised", lambda *_: 0)
    monkeypatch.setattr(verb, "_write_drive", lambda *_: False)
    config: Any = SimpleNamespace(mode=mode, coverage=None)
    assert verb._drive(config, tmp_path, None) == status
