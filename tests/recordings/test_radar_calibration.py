"""Look-up, gain and delay of made-up arrays from what they recorded standing still, and recordings of no use."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from lgprjax.formats import SweepRecording, check_file, read_radar_calibration, read_run, write_radar_calibration
from lgprjax.recordings.radar_calibration import (
    Calibrated,
    average_sweeps,
    lookup_of,
    refuse_bad,
    response_of,
    sweeps_of,
)
from lgprjax.recordings.run_signals import signals_of_run
from recordings.standing_array import StandingArray
from refusals import refused
from runtime.swept_log import write_swept_log

_SCANS = 200
ARRAYS = {
    "husky": StandingArray(1),
    "short pulses": StandingArray(2, 4, 500.0, 2500.0, 201, delay_spread=0.3, drift=-0.15),
    "deep": StandingArray(3, 24, 30.0, 130.0, 41, gain_spread=0.5, noise=1e-2),
    "cold start": StandingArray(4, 7, 200.0, 800.0, 121, drift=0.3, turn_rad=0.8, gain_spread=0.1),
    "two channels": StandingArray(5, 2),
}


def empty(array: StandingArray, folder: Path, name: str = "empty") -> Path:
    return array.write_run(folder / name, array.record(0.0, _SCANS, 1))


def over_plate(array: StandingArray, folder: Path, echo: np.ndarray | None = None) -> Path:
    echo = array.plate(1.2 * array.period_ns * 0.15) if echo is None else echo
    return array.write_run(folder / "plate", array.record(echo, _SCANS, 2))


def lookup(*paths: Path) -> Calibrated:
    found = lookup_of(average_sweeps([sweeps_of(path) for path in paths]))
    refuse_bad(paths[0], found.checks)
    return found


def response(path: Path, known: SweepRecording) -> Calibrated:
    found = response_of(average_sweeps([sweeps_of(path)]), known, path)
    refuse_bad(path, found.checks)
    return found


def warnings(found: Calibrated) -> set[str]:
    return {each.name for each in found.checks if each.verdict == "look"}


@pytest.mark.parametrize("name", ARRAYS)
def test_gains_and_delays_come_back(name: str, tmp_path: Path) -> None:
    array = ARRAYS[name]
    known = lookup(empty(array, tmp_path)).known
    ratio = known.lookup_sweeps / known.lookup_calibration_sweep
    # What is left of the coupling in a sweep of another day: noise of the average and drift of single channels.
    later = array.numbers(array.record(0.0, 64, 3)).astype(np.complex128)
    left = np.mean(later[:, :-1] / later[:, -1:], axis=0) - ratio
    assert np.linalg.norm(left) < 0.005 * np.linalg.norm(ratio)
    found = response(over_plate(array, tmp_path), known).known
    assert found.channel_gain is not None
    assert found.channel_delay_ns is not None
    assert found.channel_valid is not None
    assert found.channel_valid.all()
    np.testing.assert_allclose(found.channel_gain, array.gain / array.gain.mean(), rtol=0.01)
    np.testing.assert_allclose(found.channel_delay_ns, array.delay_ns - array.delay_ns.mean(), atol=0.05)
    assert found.group_delay_ns == pytest.approx(array.cable_ns, abs=1e-3)
    np.testing.assert_allclose(found.frequencies_hz, array.hz)


def test_the_file_is_valid_and_comes_back(tmp_path: Path) -> None:
    array, path = ARRAYS["husky"], tmp_path / "x.radar.h5"
    found = response(over_plate(array, tmp_path), lookup(empty(array, tmp_path)).known).known
    write_radar_calibration(path, found, {"inputs": ["plate"]})
    assert check_file(path) == []
    again = read_radar_calibration(path, sweeps_of(tmp_path / "plate").layout)
    for name in SweepRecording.__dataclass_fields__:
        np.testing.assert_array_equal(getattr(again, name), getattr(found, name))
    write_radar_calibration(tmp_path / "l.radar.h5", lookup(tmp_path / "empty").known, {})
    bare = read_radar_calibration(tmp_path / "l.radar.h5", gain=2.0 * np.ones(11), delay_ns=np.zeros(11))
    np.testing.assert_array_equal(bare.response.gain, 2.0)
    other = sweeps_of(tmp_path / "plate").layout
    for changed in (
        other._replace(channels=12),
        other._replace(frequencies_hz=other.frequencies_hz + 1e6),
        other._replace(frequencies_hz=other.frequencies_hz[:-1]),
        other._replace(group_delay_ns=7.0),
    ):
        with refused("sweeps", changed, found=other, file=path):
            read_radar_calibration(path, changed)


def test_several_recordings_of_any_kind_are_averaged(tmp_path: Path) -> None:
    """A run folder and a drive log of other scans: together less noise than each alone."""
    array = replace(ARRAYS["husky"], noise=2e-2, own_drift=0.0)
    rows = array.numbers(array.record(0.0, 120, 5))
    blank = np.ones_like(rows[0])
    told = SweepRecording(array.hz, blank[:-1], blank[-1], array.cable_ns)
    write_swept_log(tmp_path / "e.drive.h5", rows[:, :-1], rows[:, -1], told)
    paths = (array.write_run(tmp_path / "e", array.record(0.0, 120, 1)), tmp_path / "e.drive.h5")
    found = [lookup(*each).known for each in (paths[:1], paths[1:], paths)]
    exact = array.own * array.coupling / (2.0 * array._ripple(5) * array.late(array.cable_ns))
    off = [np.linalg.norm(each.lookup_sweeps / each.lookup_calibration_sweep - exact) for each in found]
    assert off[2] < 0.85 * min(off[:2])


def test_channels_that_are_dead_or_disagree_are_not_used(tmp_path: Path) -> None:
    """A broken cable, and a channel that the plate does not reach; the others are measured as well as before."""
    array = ARRAYS["husky"]
    counts = array.record(0.0, _SCANS, 1)
    counts[:, 3] = np.random.default_rng(1).integers(-3, 4, counts[:, 3].shape)
    silent = lookup(array.write_run(tmp_path / "empty", counts))
    assert warnings(silent) == {"dead_channels"}
    echo = array.plate(0.5)
    echo[7] = 0.3 * array.late(9.0) - 0.4 * array.late(2.0)
    found = response(over_plate(array, tmp_path, echo), silent.known)
    assert warnings(found) == {"dead_channels", "disagreeing_channels"}
    assert found.known.channel_valid is not None
    assert found.known.channel_gain is not None
    assert found.known.channel_delay_ns is not None
    used = ~np.isin(np.arange(11), [3, 7])
    np.testing.assert_array_equal(found.known.channel_valid, used)
    gain, delay_ns = array.gain[used], array.delay_ns[used]
    np.testing.assert_allclose(found.known.channel_gain[used], gain / gain.mean(), rtol=0.01)
    np.testing.assert_allclose(found.known.channel_delay_ns[used], delay_ns - delay_ns.mean(), atol=0.05)


def test_a_passer_by_changes_nothing_of_the_average(tmp_path: Path) -> None:
    """An echo in a sixth of the scans is a warning, and the look-up is that of the others."""
    array = ARRAYS["husky"]
    echo = np.zeros((_SCANS, array.channels, array.steps), complex)
    echo[80:110] = 0.03 * array.late(14.0)
    found = lookup(array.write_run(tmp_path / "passed", array.record(echo, _SCANS, 1)))
    undisturbed = lookup(empty(array, tmp_path))
    assert "remaining_drift" in warnings(found)
    assert not warnings(undisturbed)
    apart = found.standing.mean - undisturbed.standing.mean
    assert np.linalg.norm(apart) < 0.002 * np.linalg.norm(undisturbed.standing.mean)


def _moved(array: StandingArray) -> np.ndarray:
    """The array moves away from the ground while it is recorded."""
    course = np.linspace(0.0, 1.0, _SCANS)
    return np.asarray(0.3 * array.late(4.0 + 2.0 * course)[:, None] * np.ones((1, array.channels, 1)))


@pytest.mark.parametrize(
    ("name", "changes", "echo"),
    [
        ("calibration_drift", {"drift": 0.6}, None),
        ("calibration_phase", {"turn_rad": 1.4}, None),
        ("remaining_drift", {}, _moved),
        ("remaining_drift", {"own_drift": 0.15}, None),
        ("saturation", {"full_scale": 1.0}, None),
        ("calibration_noise", {"noise": 0.6}, None),
    ],
)
def test_recordings_that_are_no_look_up(
    name: str, changes: dict[str, float], echo: Callable[[StandingArray], np.ndarray] | None, tmp_path: Path
) -> None:
    array = replace(ARRAYS["husky"], **changes)  # type: ignore[arg-type]
    heard = 0.0 if echo is None else echo(array)
    path = array.write_run(tmp_path / "empty", array.record(heard, _SCANS, 1))
    limit = next(each for each in lookup_of(average_sweeps([sweeps_of(path)])).checks if each.name == name)
    with refused(name, f"{limit.bad:g}", file=path):
        lookup(path)


@pytest.mark.parametrize("kind", ["nothing", "half of it", "drifted"])
def test_a_plate_that_is_not_in_view(kind: str, tmp_path: Path) -> None:
    array = ARRAYS["husky"]
    known = lookup(empty(array, tmp_path)).known
    echo = array.plate(0.5)
    if kind == "half of it":
        echo[5:] = 0.1 * np.random.default_rng(2).normal(size=(6, 3)) @ array.late(np.array([3.0, 7.0, 12.0]))
    with refused({"nothing": "plate_echo", "half of it": "disagreeing_channels", "drifted": "calibration_drift"}[kind]):
        if kind == "drifted":
            warm = replace(array, drift=0.6)
            response(warm.write_run(tmp_path / "plate", warm.record(echo, _SCANS, 2)), known)
        else:
            response(over_plate(array, tmp_path, 0.0 * echo if kind == "nothing" else echo), known)


def test_a_receiver_that_is_not_saturated_says_so(tmp_path: Path) -> None:
    """Eight bits and little noise: many entries are equal, and none is at the limit again and again."""
    array = replace(ARRAYS["husky"], noise=1e-3, full_scale=16.0 * 32)
    assert "saturation" not in warnings(lookup(empty(array, tmp_path)))
    loud = replace(ARRAYS["husky"], full_scale=1.7)
    counts = loud.record(0.0, _SCANS, 1)
    share = np.mean((np.abs(counts.astype(int)) >= 32767).any(axis=(0, 3)))
    found = lookup_of(average_sweeps([sweeps_of(loud.write_run(tmp_path / "loud", counts))]))
    assert share > 0.0
    assert next(each.value for each in found.checks if each.name == "saturation") == pytest.approx(100 * share, rel=0.3)


def test_sweeps_of_another_plan_or_array(tmp_path: Path) -> None:
    array = ARRAYS["husky"]
    first = sweeps_of(empty(array, tmp_path))
    fewer = array.record(0.0, _SCANS, 2)[:, 1:]
    for name, other in (
        ("steps", replace(array, steps=51)),
        ("band", replace(array, low_mhz=110.0)),
        ("cable", replace(array, cable_ns=7.0)),
        ("channels", array),
    ):
        counts = fewer if name == "channels" else other.record(0.0, _SCANS, 2)
        source = sweeps_of(other.write_run(tmp_path / name, counts))
        with refused("sweeps", source.layout, first.layout, file=name):
            average_sweeps([first, source])


def test_recordings_without_sweeps(tmp_path: Path) -> None:
    array = ARRAYS["husky"]
    (tmp_path / "nothing").mkdir()
    with refused("folder", file="nothing"):
        sweeps_of(tmp_path / "nothing")
    counts = array.record(0.0, _SCANS, 1)
    with refused("radar messages", "radar_sweep", found="none", file="mute"):
        sweeps_of(array.write_run(tmp_path / "mute", counts, described=False))
    with refused("sweeps", 64, found="40", file="short"):
        lookup(array.write_run(tmp_path / "short", counts[:40]))
    counts[:, -1] = 0
    with refused("calibration channel", file="unplugged"):
        lookup(array.write_run(tmp_path / "unplugged", counts))
    with refused("sweeps", found="none of 11", file="off"):
        lookup(array.write_run(tmp_path / "off", array.record(0.0, _SCANS, 1), valid=0))
    # A radar without a look-up of its own: its scans can be read once a calibration replaces it.
    run = read_run(empty(array, tmp_path))
    assert signals_of_run(run).scan_kept.sum() == 0
    assert signals_of_run(run, own_lookup=False).scan_kept.sum() == _SCANS
