"""The skid-steer filter is honest over a whole field: lines, turns, and GNSS off for 30 s of every 90 s."""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pytest

from lgprjax.navigation import skid_rules
from navigation.skid_drives import FieldDrives, draw_field_drives
from navigation.skid_runs import Filtered, begin, filter_lanes, pose_errors

Record = Callable[[str, object], None]


class Driven(NamedTuple):
    """Once a second: errors, what the filter says of them, whether it knows its heading, the age of the fix."""

    error: np.ndarray
    covariance: np.ndarray
    known: np.ndarray
    since_fix_s: np.ndarray
    filtered: Filtered

    def nees(self) -> np.ndarray:
        """A degree of freedom of x, y and yaw: mean over the runs that know their heading, each second."""
        whole = np.linalg.solve(self.covariance, self.error[..., None])[..., 0]
        single = np.einsum("tri,tri->tr", self.error, whole) / 3.0
        some = self.known.sum(axis=1) >= 0.95 * self.known.shape[1]
        return np.asarray(np.where(self.known, single, 0.0).sum(axis=1)[some] / self.known.sum(axis=1)[some])


def filtered_drives(drives: FieldDrives, step_s: float) -> Driven:
    every = round(1.0 / step_s)
    _, filtered = filter_lanes(skid_rules(), begin(drives.start_m), drives.motions, drives.observations, every=every)
    error, covariance = pose_errors(drives.truth[every - 1 :: every], filtered.estimate)
    known = np.asarray(filtered.info.heading_known)[:, -1]
    return Driven(error, covariance, known, np.asarray(filtered.since_fix_s), filtered)


@pytest.fixture(scope="module")
def driven() -> Driven:
    return filtered_drives(draw_field_drives(runs=200, seconds=200.0, seed=5, step_s=0.1), 0.1)


def test_errors_are_as_large_as_the_covariance_says(driven: Driven, record_property: Record) -> None:
    """NEES a degree of freedom, second by second, from the heading's start through two outages."""
    nees = driven.nees()
    record_property("nees", [round(float(each), 3) for each in (nees.min(), nees.mean(), nees.max())])
    assert len(nees) > 165
    assert nees.min() > 0.7
    assert nees.max() < 1.5
    variance = np.einsum("trii->tri", driven.covariance)
    each = (driven.error**2 / variance)[driven.known].mean(axis=0)
    assert np.all((each > 0.75) & (each < 1.3)), each


def test_an_inch_and_a_degree(driven: Driven, record_property: Record) -> None:
    """Position while fixes come, both axes together; heading all the time."""
    seconds = np.arange(len(driven.error))[:, None]
    fixed = driven.known & (seconds > 45) & (driven.since_fix_s < 2.5) & (seconds % 90 < 60)
    assert fixed.mean() > 0.4
    position_m = float(np.sqrt((driven.error[fixed][:, :2] ** 2).sum(axis=1).mean()))
    yaw = np.degrees(driven.error[driven.known & (seconds > 30)][:, 2])
    record_property("position_cm", round(100.0 * position_m, 2))
    record_property("heading_rms_deg", round(float(np.sqrt(np.mean(yaw**2))), 3))
    assert position_m < 0.0254
    assert np.sqrt(np.mean(yaw**2)) < 0.2
    assert np.abs(yaw).max() < 1.0


def test_every_heading_is_started_and_none_lost(driven: Driven) -> None:
    info = driven.filtered.info
    assert driven.known[45:].all()
    np.testing.assert_array_equal(np.asarray(info.heading_started).sum(axis=(0, 1)), 1)
    assert not np.asarray(info.heading_restarted).any()


def test_a_started_heading_is_as_good_as_it_says(driven: Driven) -> None:
    """At the first whole second after the start: within 1.5° in nearly every run, and honest."""
    first = driven.known.argmax(axis=0)
    runs = np.arange(driven.known.shape[1])
    yaw, variance = driven.error[first, runs, 2], driven.covariance[first, runs, 2, 2]
    assert np.mean(np.abs(yaw) < np.radians(1.5)) > 0.97
    assert 0.6 < np.mean(yaw**2 / variance) < 1.5


def test_honest_observations_pass(driven: Driven) -> None:
    """NIS about 1 a component, rejects as rare as the gates say."""
    info = driven.filtered.info
    offered, accepted = np.asarray(info.offered), np.asarray(info.accepted)
    nis = np.asarray(info.nis, np.float64)
    for source, parts in enumerate((2, 1)):
        some = offered[..., source]
        assert 0.8 < nis[..., source][some].mean() / parts < 1.2
        assert (some & ~accepted[..., source]).sum() / some.sum() < 4e-4
    assert np.asarray(info.reacquired)[..., 0].sum() == 0
    assert np.asarray(info.reacquired)[..., 1].sum() / offered[..., 1].sum() < 1e-3
    assert np.linalg.eigvalsh(np.asarray(driven.filtered.estimate.covariance, np.float64)).min() > -1e-9


def test_ten_minutes_at_fifty_hertz() -> None:
    """The rate on board: the same honesty over six outages."""
    whole = filtered_drives(draw_field_drives(runs=200, seconds=600.0, seed=6, step_s=0.02), 0.02)
    nees = whole.nees()
    assert nees.min() > 0.7, nees.min()
    assert nees.max() < 1.5, nees.max()
    assert whole.known[45:].all()
