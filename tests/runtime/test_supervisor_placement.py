"""Where a process runs: cores, priority, threads; each in a process of its own."""

import errno
import os
import subprocess
import sys
from pathlib import Path

import pytest

from lgprjax.cli import main
from lgprjax.runtime.config import read_config
from lgprjax.runtime.main import process_command
from lgprjax.runtime.process import UNUSABLE_INPUT, check_cores
from lgprjax.runtime.supervisor import make_rings_folder, supervise
from refusals import printed_refusal, refused
from runtime.supervised_run import toy_command, write_config

CORES = sorted(os.sched_getaffinity(0))
PLACED = """
import os, sys
from lgprjax.runtime.config import read_config
from lgprjax.runtime.process import hold_to_cores, set_environment
config = read_config(sys.argv[1])
hold_to_cores(sys.argv[2], config)
set_environment(config)
print(*sorted(os.sched_getaffinity(0)))
print(os.environ["XLA_FLAGS"], os.environ["JAX_COMPILATION_CACHE_DIR"])
"""
REAL_TIME = """
import os, resource
from lgprjax.runtime.process import run_in_ordinary_time, run_in_real_time
if {permitted} == 0:
    resource.setrlimit(resource.RLIMIT_RTPRIO, (0, 0))
    if os.getuid() == 0:
        os.setuid(65534)
run_in_real_time("control", 10, threads_too=False)
print(os.sched_getscheduler(0) == os.SCHED_FIFO | os.SCHED_RESET_ON_FORK)
run_in_ordinary_time()
print(os.sched_getscheduler(0) & ~os.SCHED_RESET_ON_FORK == os.SCHED_OTHER)
"""


def run(code: str, *arguments: str) -> tuple[list[str], str]:
    """Lines said, and errors, of a program."""
    root = str(Path(__file__).parents[2])
    environment = {key: value for key, value in os.environ.items() if not key.startswith(("XLA", "JAX"))}
    done = subprocess.run(
        [sys.executable, "-c", code, *arguments],
        env={**environment, "PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=True,
        timeout=60,
    )
    return done.stdout.splitlines(), done.stderr


@pytest.mark.skipif(len(CORES) < 2, reason="one core: nothing to choose from")
def test_control_has_its_core_and_the_others_keep_off_it(tmp_path: Path) -> None:
    file = write_config(tmp_path, f"registration_core = {CORES[1]}\n[control]\ncore = {CORES[0]}")
    rest = " ".join(str(core) for core in CORES[1:])
    for name, cores in (("control", str(CORES[0])), ("recorder", rest)):
        lines, _ = run(PLACED, str(file), name)
        assert lines == [cores, f"--xla_cpu_multi_thread_eigen=false {tmp_path / 'cache'}"]


def test_a_core_that_is_not_there_is_one_line(tmp_path: Path) -> None:
    config = read_config(write_config(tmp_path, "[control]\ncore = 4096"))
    with refused("control.core", CORES[0], found=4096):
        check_cores(config)
    root = str(Path(__file__).parents[2])
    done = subprocess.run(
        process_command("monitor", config, tmp_path, tmp_path, False),
        env={**os.environ, "PYTHONPATH": root},
        capture_output=True,
        text=True,
        check=False,
        timeout=60,
    )
    assert done.returncode == UNUSABLE_INPUT
    printed_refusal(f"lgprjax: {done.stderr.removeprefix('monitor: ')}").check("control.core", found=4096)


def test_a_command_keeps_what_it_compiles_where_its_configuration_says(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    # Set first, so that it is as it was in the end.
    monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", "elsewhere")
    monkeypatch.delenv("JAX_COMPILATION_CACHE_DIR")
    with pytest.raises(SystemExit):
        main(["run", str(write_config(tmp_path, "")), "--replay", "nowhere"])
    assert os.environ["JAX_COMPILATION_CACHE_DIR"] == str(tmp_path / "cache")


def test_real_time_that_is_not_permitted_is_said_and_no_more() -> None:
    lines, errors = run(REAL_TIME.format(permitted=0))
    assert lines == ["False", "True"]
    (line,) = errors.splitlines()
    assert line.startswith("control: ")
    assert "10" in line


@pytest.mark.skipif(os.getuid() != 0, reason="needs the right to real time")
def test_real_time_where_it_is_permitted() -> None:
    lines, errors = run(REAL_TIME.format(permitted=1))
    # A container may forbid it to root too, and then it is said.
    assert lines == [str(not errors), "True"]


def test_memory_that_cannot_be_had_is_one_line_and_leaves_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def full(*_: int) -> None:
        raise OSError(errno.ENOSPC, os.strerror(errno.ENOSPC))

    monkeypatch.setattr(os, "posix_fallocate", full)
    with refused(found=os.strerror(errno.ENOSPC)):
        supervise(read_config(write_config(tmp_path)), tmp_path, tmp_path / "rings", command=toy_command)
    assert not (tmp_path / "rings").exists()


def test_rings_of_runs_that_were_killed_are_taken_away() -> None:
    with subprocess.Popen(("true",)) as gone:
        pass
    mine = make_rings_folder()
    left = mine.with_name(f"lgprjax-rings-{gone.pid}-abc")
    left.mkdir()
    (left / "notes").write_bytes(b"x")
    again = make_rings_folder()
    try:
        assert not left.exists()
        assert mine.exists()
        assert again != mine
    finally:
        mine.rmdir()
        again.rmdir()
