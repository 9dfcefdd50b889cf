"""A registration of many drives that is interrupted from the keyboard goes on where it was."""

import os
import signal
import subprocess
import sys
import time
from pathlib import Path

import pytest

import lgprjax
from batch.short_drives import DRIVES, Short, make_short
from batch.test_many_drives import run_in
from canon.site import Site
from lgprjax.batch import claimed, plan_jobs, read_records


@pytest.fixture(scope="module")
def short(site: Site, tmp_path_factory: pytest.TempPathFactory) -> Short:
    return make_short(site, tmp_path_factory)


def test_ctrl_c_keeps_what_is_done(short: Short, tmp_path: Path) -> None:
    out = tmp_path / "out"
    command: list[object] = [sys.executable, "-c", "import sys; from lgprjax.cli import main; main(sys.argv[1:])"]
    command += ["register", short.map, *short.drives, "-o", out, "--workers", "1", "--threads", "1"]
    root = {"PYTHONPATH": str(Path(lgprjax.__file__).parents[1])}
    process = subprocess.Popen([str(word) for word in command], env={**os.environ, **root}, stderr=subprocess.PIPE)
    until = time.monotonic() + 120.0
    # As soon as there is a record: the others take a second or two, and a busy machine may come late to this line.
    while not list(out.glob("jobs/*.json")) and time.monotonic() < until:
        time.sleep(0.01)
    process.send_signal(signal.SIGINT)
    _, said = process.communicate(timeout=30.0)
    assert process.returncode == 130, said.decode()
    assert "Traceback" not in said.decode()
    done = read_records(out)
    assert 1 <= len(done) < DRIVES
    assert not list(out.rglob("*.partial*"))
    names = [path.name.removesuffix(".drive.h5") for path in short.drives]
    run = run_in(short, out)
    with claimed(run, names, force=False):
        plan = plan_jobs(run, short.drives, force=False)
    assert plan.done == sorted(done)
    assert [job.name for job in plan.todo] == [name for name in names if name not in done]
