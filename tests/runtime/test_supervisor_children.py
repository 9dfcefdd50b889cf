"""What is held against a process, by a clock of the test's own; the processes are real and do nothing."""

import signal
import struct
import subprocess
import sys
import time
from collections.abc import Iterator, Sequence
from pathlib import Path

import pytest

from lgprjax.runtime.process import PROCESSES, Heartbeats
from lgprjax.runtime.supervisor import Child, Limits, ProcessReports, What, end_children

STARTING, WARMING, READY, ENDING = range(4)
LIMITS = Limits(silent_s=0.2, start_s=30.0, patient=False)


def say(folder: Path, name: str, time_s: float, stage: int, pid: int, count: int) -> None:
    """A heartbeat by its layout: u64 time in ns, u32 stage, u32 pid, u32 count, u32 0."""
    row = struct.pack("<QIIII", round(time_s * 1e9), stage, pid, count, 0)
    with (folder / "heartbeats").open("r+b") as table:
        table.seek(24 * PROCESSES.index(name))
        table.write(row)


class Watched:
    """A child, its process number and its heartbeats."""

    def __init__(self, folder: Path, command: Sequence[str], limits: Limits = LIMITS) -> None:
        self.folder = folder
        self.given: list[bool] = []

        def started(died: bool) -> Sequence[str]:
            self.given.append(died)
            return command

        self.child = Child("monitor", started, {}, Heartbeats(folder), limits)
        self.now_s = 1000.0

    @property
    def pid(self) -> int:
        """Of the process that runs."""
        process = self.child._process
        assert process is not None
        return process.pid

    def look(self, passed_s: float = 0.01) -> list[ProcessReports]:
        """A look after ``passed_s``."""
        self.now_s += passed_s
        return self.child.look(self.now_s, passed_s)

    def say(self, stage: int, count: int, ago_s: float = 0.0) -> None:
        """A heartbeat of the process itself."""
        say(self.folder, "monitor", self.now_s - ago_s, stage, self.pid, count)

    def until_told(self, passed_s: float = 0.0) -> list[ProcessReports]:
        """Looks until something is told, with the clock of the test standing still."""
        until_s = time.monotonic() + 10.0
        while time.monotonic() < until_s:
            if told := self.look(passed_s):
                return told
            time.sleep(0.001)
        raise AssertionError("nothing was told")


@pytest.fixture
def sleeper(tmp_path: Path) -> Iterator[Watched]:
    watched = Watched(tmp_path, ("sleep", "60"))
    assert watched.look() == []
    yield watched
    watched.child.kill()


def test_ready_is_told_once_and_silence_counts_from_the_last_beat(sleeper: Watched) -> None:
    sleeper.say(WARMING, 1)
    assert sleeper.look() == []
    ready = [sleeper.child.ready]
    for count in range(2, 60):
        sleeper.say(READY, count)
        assert sleeper.look() == ([ProcessReports(What.READY, "monitor")] if count == 2 else [])
    assert [*ready, sleeper.child.ready] == [False, True]
    began_s, told = sleeper.now_s, sleeper.look()
    while not told:
        assert sleeper.now_s - began_s < 0.3
        told = sleeper.look()
    assert sleeper.now_s - began_s == pytest.approx(0.2, abs=0.015)
    assert [(one.what, one.name) for one in told] == [(What.DIED, "monitor")]


def test_a_machine_that_stood_still_hung_nobody(sleeper: Watched) -> None:
    sleeper.say(READY, 1)
    sleeper.look()
    assert sleeper.look(3.0) == []
    # It beat once just before the machine stood still, for three seconds more.
    sleeper.say(READY, 2)
    assert sleeper.look(3.0) == []
    sleeper.say(READY, 3)
    assert sleeper.look() == []


def test_before_ready_only_the_time_to_come_up_counts(sleeper: Watched) -> None:
    for _ in range(299):
        assert sleeper.look(0.1) == []
    told = sleeper.look(0.2)
    assert [one.what for one in told] == [What.DIED]
    assert "30.1" in told[0].why


def test_once_ready_it_cannot_hide_in_warming(sleeper: Watched) -> None:
    sleeper.say(READY, 1)
    sleeper.look()
    sleeper.say(WARMING, 2)
    told = [found for _ in range(30) for found in sleeper.look()]
    assert [one.what for one in told][:1] == [What.DIED]


def test_an_ending_may_take_longer_to_write(sleeper: Watched) -> None:
    sleeper.say(READY, 1)
    sleeper.look()
    sleeper.say(ENDING, 2)
    assert not any(sleeper.look() for _ in range(400))
    assert [one.what for _ in range(200) for one in sleeper.look()][:1] == [What.DIED]


@pytest.mark.parametrize("wild", ["stage", "pid"])
def test_beats_that_are_none_count_for_nothing(sleeper: Watched, wild: str) -> None:
    sleeper.say(READY, 1)
    sleeper.look()
    told: list[ProcessReports] = []
    for count in range(2, 40):
        pid, stage = (sleeper.pid + 1, READY) if wild == "pid" else (sleeper.pid, 77)
        say(sleeper.folder, "monitor", sleeper.now_s, stage, pid, count)
        told += sleeper.look()
        if told:
            break
    assert [one.what for one in told] == [What.DIED]


def test_what_hangs_is_gone_before_it_is_started_again(sleeper: Watched) -> None:
    first = sleeper.pid
    sleeper.say(READY, 1)
    sleeper.look(5.0)
    while not sleeper.look():
        pass
    assert not sleeper.child.ready
    until_s = time.monotonic() + 10.0
    while len(sleeper.given) < 2 and time.monotonic() < until_s:
        assert sleeper.look(0.0) == []
    assert sleeper.given == [False, True]
    assert sleeper.pid != first
    assert not Path(f"/proc/{first}").exists()


def test_waits_double_up_to_two_seconds_and_a_long_life_ends_them(tmp_path: Path) -> None:
    watched = Watched(tmp_path, ("false",), LIMITS._replace(patient=True))
    waits_s = []
    watched.look(0.0)
    for _ in range(8):
        (told,) = watched.until_told()
        assert "1" in told.why
        died_s, starts = watched.now_s, len(watched.given)
        while len(watched.given) == starts:
            watched.look()
        waits_s.append(watched.now_s - died_s)
    assert waits_s == pytest.approx([0.1, 0.2, 0.4, 0.8, 1.6, 2.0, 2.0, 2.0], abs=0.011)
    watched.now_s += 2.0
    watched.until_told()
    starts = len(watched.given)
    watched.look()
    assert len(watched.given) == starts + 1
    watched.child.kill()


@pytest.mark.parametrize(
    ("apart_s", "patient", "left"),
    [(29.0, False, True), (35.0, False, False), (29.0, True, False)],
    ids=["too often", "seldom enough", "control"],
)
def test_ten_deaths_in_five_minutes_are_enough(tmp_path: Path, apart_s: float, patient: bool, left: bool) -> None:
    watched = Watched(tmp_path, ("false",), LIMITS._replace(patient=patient, start_s=1e9))
    told: list[ProcessReports] = []
    for _ in range(12):
        watched.now_s += apart_s
        watched.look(0.0)
        if watched.child.left:
            break
        told += watched.until_told()
    assert watched.child.left is left
    assert len(watched.given) == (10 if left else 12)
    assert (told[-1].what is What.LEFT) is left


def test_a_command_that_cannot_be_started_is_a_death(tmp_path: Path) -> None:
    watched = Watched(tmp_path, (str(tmp_path / "no_such_program"),))
    assert [one.what for one in watched.look()] == [What.DIED]
    assert watched.look(0.05) == []
    assert len(watched.look(0.06)) == 1


def test_what_does_not_end_is_killed_after_the_limit(tmp_path: Path) -> None:
    deaf = Watched(tmp_path, (sys.executable, "-S", "-c", "import signal, time; signal.signal(15, 1); time.sleep(60)"))
    stopped = Watched(tmp_path, ("sleep", "60"))
    deaf.look()
    stopped.look()
    time.sleep(0.3)
    subprocess.run(("kill", "-STOP", str(stopped.pid)), check=True)
    processes = [deaf.child._process, stopped.child._process]
    began_s = time.monotonic()
    end_children((deaf.child, stopped.child), 0.5)
    assert 0.5 <= time.monotonic() - began_s < 3.0
    assert [process.poll() for process in processes if process is not None] == [-signal.SIGKILL, -signal.SIGTERM]
