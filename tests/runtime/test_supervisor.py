"""The supervisor over toy processes: a death is found in time, told and mended, and nothing is left over.

More ways to die: ``validation/loops/test_supervisor.py``.
"""

import json
import os
import signal
import time
from pathlib import Path

import pytest

from lgprjax.run_records import unpack
from lgprjax.runtime.process import PROCESSES, UNUSABLE_INPUT
from lgprjax.runtime.ring import Ring
from refusals import printed_refusal
from runtime.supervised_run import LIMIT_S, SupervisedRun, check_death, is_there, wait_gone

STARTED = tuple(name for name in PROCESSES if name not in ("coverage", "output"))
"""Processes of a run on a course."""


def test_all_ready_is_said_once_on_one_line_and_the_end_is_in_order(tmp_path: Path) -> None:
    with SupervisedRun(tmp_path).start() as run:
        line = run.wait_ready()
        for name in STARTED:
            run.wait_note(ready=name)
        assert not any(name in line for name in STARTED)
        assert all(run.starts(name)[0][1] is False for name in STARTED)
        pids = run.pids()
        assert run.end() == (0, "", "")
    assert (run.ends()[0], run.ends()[-1]) == ("control", "recorder")
    assert sorted(run.ends()) == sorted(STARTED)
    assert not [pid for pid in pids if is_there(pid)]
    assert not run.rings.exists()


@pytest.mark.parametrize(("by", "silent_s"), [(signal.SIGKILL, 5.0), (signal.SIGSTOP, 0.2)], ids=["killed", "hung"])
def test_a_dead_control_process_is_found_told_and_mended(tmp_path: Path, by: int, silent_s: float) -> None:
    found_s, why = check_death(tmp_path, "control", by, silent_s)
    # 0.2 s, and slack for a machine that does much else beside.
    assert found_s < 0.35
    assert by == signal.SIGSTOP or str(int(by)) in why


def test_a_new_control_process_is_told_how_the_others_are(tmp_path: Path) -> None:
    """The recorder ran out of storage, which no new start mends; the display dies again and again."""
    run = SupervisedRun(tmp_path)
    (run.run_folder / "recorder.fails").write_text("3")
    (run.run_folder / "display.fails").write_text("1")
    with run.start():
        line = run.wait_ready()
        assert [name for name in STARTED if name in line] == ["recorder", "display"]
        assert "3" in run.wait_note(left="recorder").content["why"]
        run.wait_note(died="display")
        began_ns = time.monotonic_ns()
        os.kill(run.starts("control")[-1][0], signal.SIGKILL)
        died = run.wait_note(after_ns=began_ns, died="control")
        ready = run.wait_note(after_ns=died.mono_ns, ready="control")
        # The dead one had taken what was told of them before.
        for name in ("registration", "monitor"):
            run.wait_note(after_ns=ready.mono_ns, ready=name)
        run.wait_note(after_ns=ready.mono_ns, left="recorder")
        run.wait_note(after_ns=died.mono_ns, died="display")
        assert len(run.starts("recorder")) == 1
        time.sleep(0.1)
        log = [json.loads(unpack(message).payload) for message in Ring(run.rings / "supervisor_log").take()]
        told = [note.content for note in run.notes]
        run.end()
    # Told anew once, and only to control: it is no change.
    assert [told.count({"ready": name}) for name in ("registration", "monitor")] == [2, 2]
    assert [log.count({"ready": name}) for name in ("registration", "monitor", "control")] == [1, 1, 2]


def test_a_control_process_that_cannot_use_its_files_ends_the_run_unless_it_was_ready(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path)
    fails = run.run_folder / "control.fails"
    with run.start():
        run.wait_ready()
        fails.write_text(str(UNUSABLE_INPUT))
        os.kill(run.starts("control")[0][0], signal.SIGKILL)
        run.wait_note(3, died="control")
        fails.unlink()
        run.wait_note(2, ready="control")
        run.end()
    before = len(run.starts("control"))
    fails.write_text(str(UNUSABLE_INPUT))
    with run.start():
        output, errors = run.process.communicate(timeout=LIMIT_S)
        assert (run.process.returncode, output) == (1, "")
        assert any("control" in line and str(UNUSABLE_INPUT) in line for line in errors.splitlines())
        assert len(run.starts("control")) == before + 1
        assert not wait_gone(run.pids())


def test_a_mandatory_recorder_is_waited_for(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path, "[recording]\nmandatory = true")
    (run.run_folder / "recorder.fails").write_text("1")
    with run.start():
        run.wait_note(3, died="recorder")
        for name in ("control", "registration", "display", "monitor"):
            run.wait_note(ready=name)
        time.sleep(0.05)
        status, output, _ = run.end(signal.SIGINT)
    assert (status, output) == (0, "")


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
        run.wait_ready()


def test_a_second_run_on_the_same_device_is_refused_and_the_first_drives_on(tmp_path: Path) -> None:
    with SupervisedRun(tmp_path).start() as run:
        run.wait_ready()
        other = SupervisedRun(tmp_path)
        other.rings = tmp_path / "other_rings"
        other.run_folder = tmp_path / "other_run"
        with other.start():
            _, errors = other.process.communicate(timeout=20.0)
        assert other.process.returncode == 1
        refusal = printed_refusal(f"lgprjax: {errors}")
        refusal.check("ports.drive_by_wire.url", tmp_path / "ttyDRIVE", file=run.config, found=run.process.pid)
        assert not other.rings.exists()
        assert not other.run_folder.exists()
        assert run.rings.exists()
        assert all(is_there(pid) for pid in run.pids())
