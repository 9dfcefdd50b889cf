"""The supervisor over toy processes: every way to die is found in time, told and mended, and nothing is left over."""

import itertools
import json
import os
import signal
import time
from pathlib import Path

import pytest

from lgprjax.run_records import unpack
from lgprjax.runtime.process import PROCESSES, UNUSABLE_INPUT
from lgprjax.runtime.ring import Ring
from runtime.supervised_run import LIMIT_S, SupervisedRun, is_there, wait_gone

STARTED = tuple(name for name in PROCESSES if name not in ("coverage", "output"))
"""Processes of a run on a course."""
FOUND_S = 0.35
"""0.2 s, and slack for a machine that does much else beside."""


def test_all_ready_is_said_once_on_one_line_and_told_to_control(tmp_path: Path) -> None:
    with SupervisedRun(tmp_path).start() as run:
        line = run.wait_ready()
        for name in STARTED:
            run.wait_note(ready=name)
        assert line.startswith("ready after ")
        assert line.endswith(" s")
        assert all(run.starts(name)[0][1] is False for name in STARTED)
        status, output, errors = run.end()
    assert (status, output, errors) == (0, "", "")


@pytest.mark.parametrize(
    ("name", "by", "why", "silent_s"),
    [
        ("control", signal.SIGALRM, "exit 7", 5.0),
        ("control", signal.SIGKILL, "signal 9", 5.0),
        ("control", signal.SIGSTOP, "hung 0.", 0.2),
        ("control", signal.SIGUSR1, "hung 0.", 0.2),
        # Whether it first runs out of memory or of time is the machine's affair.
        ("control", signal.SIGUSR2, "", 0.2),
        ("registration", signal.SIGKILL, "signal 9", 5.0),
        ("recorder", signal.SIGSTOP, "hung 0.", 0.2),
    ],
    ids=["exit", "kill", "stop", "busy-loop", "memory", "registration-kill", "recorder-stop"],
)
def test_a_death_is_found_told_and_mended(
    tmp_path: Path, name: str, by: int, why: str, silent_s: float, capsys: pytest.CaptureFixture[str]
) -> None:
    # As on a vehicle; where the machine does not permit it, a line says so.
    real_time = "[control]\nrealtime_priority = 20"
    with SupervisedRun(tmp_path, real_time, silent_s=silent_s).start() as run:
        run.wait_ready()
        before = run.starts(name)
        pid = before[-1][0]
        began_ns = time.monotonic_ns()
        os.kill(pid, by)
        died = run.wait_note(after_ns=began_ns, died=name)
        found_s = (died.mono_ns - began_ns) / 1e9
        with capsys.disabled():
            print(f"\n{name}, {died.content['why']}: found after {found_s:.3f} s")
        run.wait_note(after_ns=died.mono_ns, ready=name)
        starts = run.starts(name)
        log = [unpack(message) for message in Ring(run.rings / "supervisor_log").take()]
        status, _, errors = run.end()
    assert found_s < FOUND_S
    assert died.content["why"].startswith(why)
    assert starts[len(before)][1] is (name in ("control", "recorder"))
    assert not is_there(pid)
    # The recorder is told the same.
    assert (died.mono_ns, died.content) in [(record.mono_ns, json.loads(record.payload)) for record in log]
    assert f"{name} died: {died.content['why']}" in errors.splitlines()
    assert status == 0


def test_a_new_control_process_is_told_how_the_others_are(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path)
    (run.run_folder / "recorder.fails").write_text("3")
    with run.start():
        run.wait_ready()
        display = run.starts("display")[-1][0]
        (run.run_folder / "display.fails").write_text("1")
        os.kill(display, signal.SIGKILL)
        run.wait_note(died="display")
        run.wait_note(left="recorder")
        began_ns = time.monotonic_ns()
        os.kill(run.starts("control")[-1][0], signal.SIGKILL)
        died = run.wait_note(after_ns=began_ns, died="control")
        ready = run.wait_note(after_ns=died.mono_ns, ready="control")
        # The dead one had taken what was told of them before.
        for name in ("registration", "monitor"):
            run.wait_note(after_ns=ready.mono_ns, ready=name)
        run.wait_note(after_ns=ready.mono_ns, left="recorder")
        run.wait_note(after_ns=died.mono_ns, died="display")
        time.sleep(0.1)
        log = [json.loads(unpack(message).payload) for message in Ring(run.rings / "supervisor_log").take()]
        told = [note.content for note in run.notes]
        run.end()
    # Told anew once, and only to control: it is no change.
    assert [told.count({"ready": name}) for name in ("registration", "monitor")] == [2, 2]
    assert [log.count({"ready": name}) for name in ("registration", "monitor", "control")] == [1, 1, 2]


def test_deaths_at_once_after_the_start_are_waited_out_longer_and_longer(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path)
    (run.run_folder / "registration.fails").write_text("4")
    with run.start():
        times_s = [run.wait_note(count, died="registration").mono_ns / 1e9 for count in range(1, 5)]
        (run.run_folder / "registration.fails").unlink()
        run.wait_note(ready="registration")
        assert run.wait_ready().startswith("ready")
        assert not any(after for _, after in run.starts("registration"))
    waits_s = [after - before for before, after in itertools.pairwise(times_s)]
    # Each holds a start beside the wait.
    assert all(wait_s >= least_s for wait_s, least_s in zip(waits_s, (0.1, 0.2, 0.4), strict=True))
    assert waits_s[2] > waits_s[0]


def test_a_control_process_that_cannot_use_its_files_ends_the_run(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path)
    (run.run_folder / "control.fails").write_text(str(UNUSABLE_INPUT))
    with run.start():
        output, errors = run.process.communicate(timeout=LIMIT_S)
        assert (run.process.returncode, output) == (1, "")
        assert "control died: exit 4" in errors
        assert len(run.starts("control")) == 1
        assert not wait_gone(run.pids())


def test_once_it_was_ready_it_is_started_again_whatever_it_says(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path)
    with run.start():
        run.wait_ready()
        (run.run_folder / "control.fails").write_text(str(UNUSABLE_INPUT))
        os.kill(run.starts("control")[0][0], signal.SIGKILL)
        run.wait_note(3, died="control")
        (run.run_folder / "control.fails").unlink()
        run.wait_note(2, ready="control")


def test_without_display_or_monitor_it_is_ready_and_says_so(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path)
    (run.run_folder / "display.fails").write_text("1")
    with run.start():
        assert run.wait_ready().endswith(" s without display")


def test_a_recorder_that_ran_out_of_storage_is_left(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path)
    (run.run_folder / "recorder.fails").write_text("3")
    with run.start():
        assert run.wait_ready().endswith(" s without recorder")
        assert run.wait_note(left="recorder").content["why"] == "exit 3"
        time.sleep(0.3)
        assert len(run.starts("recorder")) == 1
        assert not [note for note in run.notes if "died" in note.content]


def test_a_mandatory_recorder_is_waited_for(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path, "[recording]\nmandatory = true")
    (run.run_folder / "recorder.fails").write_text("1")
    with run.start():
        run.wait_note(3, died="recorder")
        for name in ("control", "registration", "display", "monitor"):
            run.wait_note(ready=name)
        time.sleep(0.05)
        status, output, _ = run.end()
    assert (status, output) == (0, "")


@pytest.mark.parametrize("by", [signal.SIGTERM, signal.SIGINT], ids=["SIGTERM", "SIGINT"])
def test_the_end_is_in_order_and_leaves_nothing(tmp_path: Path, by: int) -> None:
    with SupervisedRun(tmp_path).start() as run:
        run.wait_ready()
        pids = run.pids()
        status, _, _ = run.end(by)
    assert status == 0
    assert run.ends()[0] == "control"
    assert run.ends()[-1] == "recorder"
    assert sorted(run.ends()) == sorted(STARTED)
    assert not [pid for pid in pids if is_there(pid)]
    assert not run.rings.exists()


def test_a_killed_supervisor_takes_all_its_processes_with_it_and_a_run_starts_anew(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path)
    (run.run_folder / "placed").touch()
    with run.start():
        run.wait_ready()
        pids = run.pids()
        assert len(pids) == len(STARTED)
        run.process.kill()
        run.process.wait()
        assert wait_gone(pids, 2.0) == []
    # Asked, not killed: it writes what waits.
    assert run.ends() == ["recorder"]
    with run.start():
        assert run.wait_ready().startswith("ready after")


def test_a_second_run_on_the_same_device_is_refused_and_the_first_drives_on(tmp_path: Path) -> None:
    with SupervisedRun(tmp_path).start() as run:
        run.wait_ready()
        other = SupervisedRun(tmp_path)
        other.rings = tmp_path / "other_rings"
        other.run_folder = tmp_path / "other_run"
        with other.start():
            _, errors = other.process.communicate(timeout=20.0)
        assert other.process.returncode == 1
        assert errors.strip() == (
            f"{run.config}: ports.drive_by_wire.url: expected {tmp_path}/ttyDRIVE, not driven by another run, "
            f"found process {run.process.pid} holds it"
        )
        assert not other.rings.exists()
        assert not other.run_folder.exists()
        assert run.rings.exists()
        assert all(is_there(pid) for pid in run.pids())
