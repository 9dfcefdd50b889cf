"""What of a drive the loop's model is given: commands that hold, where the servo is placed, and which records count."""

from pathlib import Path

import jax.numpy as jnp
import numpy as np

from lgprjax.tuning.loop import LoopLogs
from lgprjax.tuning.studies.drives import LoopDrive, loop_logs
from lgprjax.vehicle import ideal_servo

TIME_S = 0.02 * np.arange(1000)


def logs_of(commanded: np.ndarray, command_rad: np.ndarray | None = None, time_s: np.ndarray = TIME_S) -> LoopLogs:
    """One drive at 3 m/s; the second lane is padding."""
    none = np.full(len(time_s), np.nan)
    command = 0.1 * np.sin(time_s) if command_rad is None else command_rad
    front = 0.2 * np.cos(time_s)
    speed, rate = np.full(len(time_s), 3.0), 0.05 * np.cos(time_s)
    fields = (Path("d"), time_s, command, front, none, none, speed, rate, commanded, commanded, none)
    return loop_logs([LoopDrive(*fields, None)], ideal_servo())


def test_a_log_that_begins_with_commands_may_have_others_under_way() -> None:
    logs = logs_of(np.ones(1000, bool))
    assert np.flatnonzero(logs.placed[0]).tolist() == [0, 999]
    assert not np.any(logs.front_used[0, :11])
    assert np.all(logs.front_used[0, 11:999])
    assert not np.any(logs.front_used[1])
    np.testing.assert_allclose(logs.front_rad[0, :1000], 0.2 * np.cos(TIME_S), atol=1e-6)


def test_until_it_is_engaged_the_servo_stands_where_the_wheels_are() -> None:
    logs = logs_of((TIME_S > 4.99) & (TIME_S < 11.99))
    # With the first command too: it turns from there.
    assert np.flatnonzero(~np.asarray(logs.placed[0, :1000])).tolist() == list(range(251, 599))
    # Before it nothing was under way.
    assert np.flatnonzero(logs.front_used[0]).tolist() == list(range(250, 599))


def test_a_command_holds_to_the_next_unless_that_is_long_in_coming() -> None:
    command = 0.1 * np.sin(TIME_S)
    command[101:105] = np.nan
    command[500:600] = np.nan
    logs = logs_of(np.isfinite(command), command)
    np.testing.assert_allclose(logs.command_rad[0, 100:105], command[100], atol=1e-7)
    assert not np.any(logs.placed[0, 1:499])
    assert np.all(logs.placed[0, 499:601])
    assert not np.any(logs.front_used[0, 499:600])


def test_after_a_gap_in_the_log_commands_may_be_under_way_again() -> None:
    time_s = np.concatenate([TIME_S[:300], TIME_S[400:]])
    logs = logs_of(np.ones(900, bool), time_s=time_s)
    assert np.all(logs.placed[0, 299:401])
    assert not np.any(logs.front_used[0, 299:411])
    assert np.all(logs.front_used[0, 411:999])


def test_a_drive_without_commands_has_nothing_that_counts() -> None:
    logs = logs_of(np.zeros(1000, bool), np.full(1000, np.nan))
    assert not np.any(logs.front_used)
    assert np.all(logs.placed[0, :1000])
    assert bool(jnp.all(jnp.isfinite(logs.command_rad)))
    assert {field.shape for field in logs} == {(2, 4096)}
