"""The supervisor over toy processes: every way to die, and deaths that come again and again."""

import itertools
import signal
from collections.abc import Callable
from pathlib import Path

import pytest

from runtime.supervised_run import SupervisedRun, check_death


@pytest.mark.parametrize(
    ("name", "by", "silent_s"),
    [
        ("control", signal.SIGALRM, 5.0),
        ("control", signal.SIGKILL, 5.0),
        ("control", signal.SIGSTOP, 0.2),
        ("control", signal.SIGUSR1, 0.2),
        # Whether it first runs out of memory or of time is the machine's affair.
        ("control", signal.SIGUSR2, 0.2),
        ("registration", signal.SIGKILL, 5.0),
        ("recorder", signal.SIGSTOP, 0.2),
    ],
    ids=["exit", "kill", "stop", "busy-loop", "memory", "registration-kill", "recorder-stop"],
)
def test_a_death_is_found_told_and_mended(
    tmp_path: Path, name: str, by: int, silent_s: float, record_property: Callable[[str, object], None]
) -> None:
    found_s, why = check_death(tmp_path, name, by, silent_s)
    record_property("found_s", round(found_s, 3))
    record_property("why", why)
    assert found_s < 0.35


def test_deaths_at_once_after_the_start_are_waited_out_longer_and_longer(tmp_path: Path) -> None:
    run = SupervisedRun(tmp_path)
    (run.run_folder / "registration.fails").write_text("4")
    with run.start():
        times_s = [run.wait_note(count, died="registration").mono_ns / 1e9 for count in range(1, 5)]
        (run.run_folder / "registration.fails").unlink()
        run.wait_note(ready="registration")
        run.wait_ready()
        assert not any(after for _, after in run.starts("registration"))
    waits_s = [after - before for before, after in itertools.pairwise(times_s)]
    # Each holds a start beside the wait.
    assert all(wait_s >= least_s for wait_s, least_s in zip(waits_s, (0.1, 0.2, 0.4), strict=True))
    assert waits_s[2] > waits_s[0]
