"""Filtered and smoothed estimates of a skid-steer vehicle: consistent, and told by the fix that ends a drop-out."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation import SmoothedDrive, contradicted_m, skid_rules, smooth_skid
from navigation.skid_drives import FieldDrives, draw_field_drives
from navigation.skid_runs import MODEL, begin, pose_errors

RUNS, SECONDS, STEP_S = 12, 230.0, 0.1
SETTLED = 600
"""Tick from which every heading is known."""
_SMOOTH = jax.jit(
    jax.vmap(lambda state, motion, told: smooth_skid(MODEL, skid_rules(), state, motion, told), (0, 1, 1))
)


class Smoothed(NamedTuple):
    """Drives, and what the smoother made of them."""

    drives: FieldDrives
    found: SmoothedDrive

    def errors(self, name: str) -> tuple[np.ndarray, np.ndarray]:
        """Errors of an estimate and its covariances, [run, tick], from where the heading is known."""
        error, covariance = pose_errors(np.moveaxis(self.drives.truth, 0, 1), getattr(self.found, name))
        return error[:, SETTLED:], covariance[:, SETTLED:]


def smoothed(drives: FieldDrives) -> Smoothed:
    return Smoothed(drives, _SMOOTH(begin(drives.start_m), drives.motions, drives.observations))


def drawn(*, off_s: float = 30.0, every_s: float = 90.0, seed: int = 17) -> FieldDrives:
    return draw_field_drives(runs=RUNS, seconds=SECONDS, seed=seed, step_s=STEP_S, off_s=off_s, every_s=every_s)


def check_drop_outs(of: Smoothed) -> None:
    """The sigma in the middle of each drop-out, and at its end, beside the live one's."""
    live, later = (
        np.sqrt(np.asarray(each.covariance[..., 0, 0] + each.covariance[..., 1, 1]))
        for each in (of.found.filtered, of.found.smoothed)
    )
    off = ~of.drives.fixes
    begins, ends = np.flatnonzero(off[1:] & ~off[:-1]) + 1, np.flatnonzero(~off[1:] & off[:-1]) + 1
    whole = [(one, other) for one, other in zip(begins, ends, strict=False) if one > 300]
    assert whole
    for one, other in whole:
        middle = (one + other) // 2
        assert np.mean(later[:, middle] / live[:, middle]) <= 0.75
        assert np.mean(later[:, other - 1] / live[:, other - 1]) <= 0.5
    # Nothing is told of what comes after the last fix, and nothing is lost.
    np.testing.assert_array_equal(later[:, -1], live[:, -1])


@pytest.fixture(scope="module")
def off_30_of_90() -> Smoothed:
    return smoothed(drawn())


def test_errors_are_as_large_as_the_covariances_say(off_30_of_90: Smoothed) -> None:
    """Twelve runs with some three independent stretches each: sigma of the mean 0.14."""
    for name in ("filtered", "smoothed"):
        error, covariance = off_30_of_90.errors(name)
        nees = np.mean(np.einsum("rti,rtij,rtj->rt", error, np.linalg.inv(covariance), error)) / 3.0
        assert 0.6 < nees < 1.4, name
        assert np.linalg.eigvalsh(covariance).min() > 0.0
        # An inch while fixes come, for three seconds already, and a fifth of a degree at all times.
        fixes = off_30_of_90.drives.fixes
        fixed = (np.convolve(fixes, np.ones(30))[: len(fixes)] > 29.5)[SETTLED:]
        assert np.sqrt((error[:, fixed, :2] ** 2).sum(axis=-1).mean()) < 0.0254
        assert np.degrees(np.sqrt(np.mean(error[..., 2] ** 2))) < 0.2
        assert np.degrees(np.abs(error[..., 2])).max() < 1.0


def test_honest_observations_pass_and_every_heading_is_started_once(off_30_of_90: Smoothed) -> None:
    info = off_30_of_90.found.info
    assert np.asarray(info.heading_known)[:, SETTLED:].all()
    np.testing.assert_array_equal(np.asarray(info.heading_started).sum(axis=1), 1)
    assert not np.asarray(info.heading_restarted).any()
    offered, accepted, nis = (np.asarray(each, np.float64) for each in (info.offered, info.accepted, info.nis))
    for source, parts in enumerate((2, 1)):
        some = offered[..., source] > 0.0
        assert 0.8 < nis[..., source][some].mean() / parts < 1.2
        assert (offered - accepted)[..., source].sum() / some.sum() < 2e-3
    assert not np.asarray(info.reacquired)[..., 0].any()


def test_a_drop_out_is_told_by_the_fix_that_ends_it(off_30_of_90: Smoothed) -> None:
    check_drop_outs(off_30_of_90)


def test_what_later_evidence_contradicts_is_taken_back(off_30_of_90: Smoothed) -> None:
    drives = drawn(off_s=0.0, seed=18)
    fix = drives.observations.gnss
    # From 120 s on every fix is half a metre off: rejected, and followed in the end, for nobody else witnesses.
    shifted = np.asarray(fix.x_m).copy()
    shifted[1200:] += 0.5
    wrong = drives._replace(observations=drives.observations._replace(gnss=fix._replace(x_m=jnp.asarray(shifted))))
    found = smoothed(wrong).found
    for run in range(RUNS):
        one = jax.tree.map(lambda leaf, lane=run: leaf[lane], found)
        taken = contradicted_m(one)
        jumps = np.flatnonzero(np.asarray(one.jump_m) > 0.0)
        assert len(jumps) == 1
        assert 1240 < jumps[0] < 1290
        assert taken[jumps[0] - 1] == pytest.approx(0.5, abs=0.15)
        # Back to the last fix that was believed, no farther.
        assert 1180 < np.flatnonzero(taken > 0.0)[0] <= 1201
        assert not contradicted_m(jax.tree.map(lambda leaf, lane=run: leaf[lane], off_30_of_90.found)).any()
