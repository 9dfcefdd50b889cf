"""The recorder and its disk: full, nearly full, slow, failing, gone."""

import errno
import os
import threading
import time
from itertools import pairwise
from pathlib import Path

import pytest

from lgprjax.formats.run_log import read_run
from lgprjax.runtime.recorder import DISK_FULL, DISK_REFUSED, DiskSync
from runtime.recorder_process import end, make_place, make_record, make_recorder, recorded, ring, start_recorder


def test_a_disk_that_is_full(tmp_path: Path) -> None:
    place = make_place(tmp_path, least_free_mb=0)
    control = ring(place, "control_log")
    messages = [make_record(n, bytes(3000)) for n in range(60)]
    process = start_recorder(place, limit=100_000)
    for message in messages:
        control.put(message)
    _, said = process.communicate(timeout=20)
    assert process.returncode == DISK_REFUSED
    (line,) = said.splitlines()
    assert f" {place.run}: " in line
    assert os.strerror(errno.EFBIG) in line
    # Once there is room again nothing is lost: what is not on the disk waits in its ring.
    assert end(start_recorder(place, after_death=True)) == (0, "")
    assert [data for _, data in read_run(place.run)] == messages
    assert read_run(place.run).summary.complete


def test_a_disk_that_is_nearly_full(tmp_path: Path) -> None:
    place = make_place(tmp_path, least_free_mb=1 << 40)
    process = start_recorder(place)
    _, said = process.communicate(timeout=20)
    assert process.returncode == DISK_FULL
    assert said.count("\n") == 1
    assert "recording.least_free_mb" in said
    summary = read_run(place.run).summary
    assert summary.complete
    assert summary.end not in (None, "ended")


@pytest.mark.parametrize("wrong", ["file", "gone"])
def test_a_folder_that_cannot_be_written(tmp_path: Path, wrong: str) -> None:
    place = make_place(tmp_path, least_free_mb=0, segment_s=0.3)
    if wrong == "file":
        place.run.write_text("no folder")
        process = start_recorder(place)
    else:
        process = start_recorder(place)
        place.run.rename(tmp_path / "pulled")
    _, said = process.communicate(timeout=20)
    assert process.returncode == DISK_REFUSED
    assert f" {place.run}: " in said
    assert said.count("\n") == 1
    assert ring(place, "control_log").put(b"the others go on")


def test_a_disk_that_is_slow_holds_nothing_up(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = make_place(tmp_path, least_free_mb=0)
    control = ring(place, "control_log")
    recorder = make_recorder(place)
    free = threading.Event()
    monkeypatch.setattr(os, "fdatasync", lambda _file: free.wait(20.0))
    begun_s, passes = time.monotonic(), 0
    while time.monotonic() - begun_s < 0.4:
        control.put(make_record(passes))
        recorder.write()
        passes += 1
        time.sleep(0.005)
    assert passes > 20
    assert control.waiting == 0
    free.set()
    recorder.close("test")
    assert len(recorded(place)["control_log"]) == passes


def test_a_disk_that_fails_later_is_heard_of(monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(_file: int) -> None:
        raise OSError(errno.EIO, os.strerror(errno.EIO))

    sync = DiskSync()
    monkeypatch.setattr(os, "fdatasync", fail)
    sync.data(0)
    with pytest.raises(OSError, match=os.strerror(errno.EIO)):
        sync.drain()
    free = threading.Event()
    monkeypatch.setattr(os, "fdatasync", lambda _file: free.wait(20.0))
    stuck = DiskSync(longest_s=0.05)
    stuck.data(0)
    time.sleep(0.2)
    with pytest.raises(TimeoutError, match=r"0\.05 s"):
        stuck.check()
    free.set()


def test_what_was_written_is_asked_for_on_the_disk_in_time(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = make_place(tmp_path, least_free_mb=0, segment_s=0.5)
    asked: list[float] = []
    real = os.fdatasync

    def told(file: int) -> None:
        asked.append(time.monotonic())
        real(file)

    monkeypatch.setattr(os, "fdatasync", told)
    recorder = make_recorder(place)
    begun_s = time.monotonic()
    while time.monotonic() - begun_s < 1.0:
        recorder.write()
        time.sleep(0.01)
    recorder.close("test")
    assert len(asked) >= 2
    assert max(after - before for before, after in pairwise([begun_s, *asked])) < 0.5
