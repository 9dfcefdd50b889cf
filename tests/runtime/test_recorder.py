"""The recorder as a process: what it is fed is on the disk once and in order, whatever happens to it."""

import json
import os
import subprocess
import time
import tomllib
from pathlib import Path

import pytest

from lgprjax.formats.run_log import read_run
from lgprjax.runtime import supervisor
from lgprjax.runtime.config import read_config
from lgprjax.runtime.main import process_command
from lgprjax.runtime.process import Heartbeats, ProcessStage
from lgprjax.runtime.ring import Ring
from lgprjax.runtime.service import SUPERVISOR
from runtime.recorder_process import (
    Feeder,
    check_kills,
    end,
    make_place,
    make_record,
    make_recorder,
    recorded,
    ring,
    start_recorder,
)


def test_everything_is_recorded_once_and_in_order(tmp_path: Path) -> None:
    place = make_place(tmp_path, least_free_mb=0, segment_s=0.2)
    process = start_recorder(place)
    feeder = Feeder(place, 1)
    time.sleep(0.7)
    beat = Heartbeats(place.rings).read("recorder")
    feeder.end()
    assert end(process) == (0, "")
    assert recorded(place) == feeder.put
    assert (beat.stage, beat.pid) == (ProcessStage.READY, process.pid)
    assert beat.count > 10
    reading = read_run(place.run)
    numbers = [number for number, _ in reading]
    summary = reading.summary
    assert summary.complete
    assert summary.end == "ended"
    assert summary.segments >= 3
    assert (summary.cut, summary.damaged) == ((), ())
    assert numbers == sorted(numbers)
    assert summary.last is not None
    assert len(numbers) + summary.segments + 1 == summary.last + 1  # each segment's own first record, and the end
    assert Heartbeats(place.rings).read("recorder").stage is ProcessStage.ENDING


def test_killed_at_random_moments_it_loses_and_repeats_nothing(tmp_path: Path) -> None:
    """More of them: ``validation/loops/test_killed.py``."""
    check_kills(tmp_path, 4, 11)


def test_beside_the_segments_stands_what_a_reader_needs(tmp_path: Path) -> None:
    place = make_place(tmp_path, least_free_mb=0)
    before_ns = time.time_ns(), time.monotonic_ns()
    make_recorder(place).close("ended")
    place.config.write_text("changed = 1")
    first = json.loads((place.run / "run.json").read_text())
    copied = (place.run / "config.toml").read_text()
    assert tomllib.loads(copied)["recording"] == {"least_free_mb": 0}
    assert first["uuid"] == str(read_run(place.run).summary.run)
    (clock,) = first["clocks"]
    for name, low in zip(("utc_ns", "mono_ns"), before_ns, strict=True):
        assert 0 < clock[name] - low < 20e9
    # Both clocks of one moment: their difference is the computer's.
    assert abs((clock["utc_ns"] - clock["mono_ns"]) - (time.time_ns() - time.monotonic_ns())) < 1e8
    assert {path.name for path in place.run.iterdir()} == {"0000.lgprun", "config.toml", "run.json"}


def test_written_but_not_let_go_of_is_not_recorded_twice(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    place = make_place(tmp_path, least_free_mb=0)
    control = ring(place, "control_log")
    messages = [make_record(n) for n in range(50)]
    recorder = make_recorder(place)
    released: list[int] = []

    def dies(_ring: Ring, end: int) -> None:
        released.append(end)

    monkeypatch.setattr(Ring, "release", dies)
    for message in messages[:30]:
        control.put(message)
    recorder.write()
    assert len(released) == 3
    monkeypatch.undo()
    assert control.waiting > 0
    # The process dies here; its successor knows by the disk what it has to let go of.
    control.put(messages[30])
    second = make_recorder(place, after_death=True)
    second.write()
    second.close("ended")
    numbers, found = zip(*read_run(place.run), strict=True)
    assert list(found) == messages[:31]
    # Number 0 and the one after the relaunch are the recorder's own.
    assert list(numbers) == [*range(1, 31), 32]


def test_the_supervisor_tells_a_recorder_that_it_replaces_one_that_died(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    place = make_place(tmp_path, least_free_mb=0)
    control, config = ring(place, "control_log"), read_config(place.config)
    messages = [make_record(n) for n in range(50)]
    for message in messages:
        control.put(message)
    # As the real thing that is killed between its write to the disk and its word to the ring.
    recorder = make_recorder(place)
    monkeypatch.setattr(Ring, "release", lambda *_: None)
    recorder.write()
    monkeypatch.undo()
    commands = [
        supervisor._command(process_command, "recorder", config, place.rings, place.run, died) for died in (False, True)
    ]
    assert ["--after-death" in command for command in commands] == [False, True]
    environment = {**os.environ, SUPERVISOR: str(os.getpid())}
    with subprocess.Popen(commands[1], env=environment, stderr=subprocess.PIPE, text=True) as process:
        until_s = time.monotonic() + 20.0
        while Heartbeats(place.rings).read("recorder").stage is not ProcessStage.READY:
            assert time.monotonic() < until_s
            assert process.poll() is None
            time.sleep(0.01)
        assert end(process) == (0, "")
    assert recorded(place)["control_log"] == messages


def test_what_an_earlier_recording_in_the_folder_had_written_lets_go_of_nothing(tmp_path: Path) -> None:
    place = make_place(tmp_path, least_free_mb=0)
    before, after = [make_record(n) for n in range(5)], [make_record(n) for n in range(10, 30)]
    first = make_recorder(place)
    for message in before:
        ring(place, "control_log").put(message)
    first.write()
    first.close("ended")
    # New rings, as after a new start of everything, and the first recorder on them died before it wrote anything.
    for path in place.rings.iterdir():
        path.unlink()
    for message in after:
        ring(place, "control_log").put(message)
    second = make_recorder(place, after_death=True)
    second.write()
    second.close("ended")
    assert recorded(place)["control_log"] == before + after


def test_messages_that_found_no_room_are_told(tmp_path: Path) -> None:
    place = make_place(tmp_path, least_free_mb=0)
    log = ring(place, "supervisor_log")
    message = make_record(0, bytes(60_000))
    while log.put(message):
        pass
    assert not log.put(message)
    for after_death in (False, True):
        recorder = make_recorder(place, after_death=after_death)
        recorder.write()
        recorder.close("ended")
    summary = read_run(place.run).summary
    assert summary.dropped == {"control_log": 0, "registration_log": 0, "supervisor_log": 2}
    assert not summary.complete
    assert summary.missing == ()
    # New rings, as after a new start of everything, take nothing back.
    for path in place.rings.iterdir():
        path.unlink()
    make_recorder(place).close("ended")
    assert read_run(place.run).summary.dropped["supervisor_log"] == 2
