"""The smoothed estimate of a skid-steer vehicle: consistent, and told by the fix that ends a drop-out."""

import jax
import numpy as np
import pytest

from lgprjax.coverage import Tool
from lgprjax.navigation import SmoothedDrive, contradicted_m, skid_pose_covariance, skid_rules, smooth_skid
from navigation.skid_drives import FieldDrives, draw_field_drives
from navigation.skid_runs import MODEL, begin, pose_errors
from true_cells import claims_and_truth

RUNS, SECONDS, STEP_S = 12, 230.0, 0.1
TOOL = Tool(1.2, 0.3, 1.2, 0.0)
_SMOOTH = jax.jit(
    jax.vmap(lambda state, motion, told: smooth_skid(MODEL, skid_rules(), state, motion, told), (0, 1, 1))
)


def smoothed(drives: FieldDrives) -> SmoothedDrive:
    whole: SmoothedDrive = _SMOOTH(begin(drives.start_m), drives.motions, drives.observations)
    return whole


def nees(drives: FieldDrives, estimate, since: int) -> float:  # type: ignore[no-untyped-def]
    """Normalised error squared, a degree of freedom."""
    error, covariance = pose_errors(np.moveaxis(drives.truth, 0, 1), estimate)
    error, covariance = error[:, since:], covariance[:, since:]
    return float(np.mean(np.einsum("rti,rtij,rtj->rt", error, np.linalg.inv(covariance), error)) / 3.0)


@pytest.mark.parametrize(("off_s", "every_s"), [(30.0, 90.0), (90.0, 180.0)])
def test_a_drop_out_is_told_by_the_fix_that_ends_it(off_s: float, every_s: float) -> None:
    drives = draw_field_drives(runs=RUNS, seconds=SECONDS, seed=17, step_s=STEP_S, off_s=off_s, every_s=every_s)
    found = smoothed(drives)
    # From where the heading is known. Twelve runs with some three independent stretches each: sigma of the mean 0.14.
    assert 0.6 < nees(drives, found.filtered, 600) < 1.4
    assert 0.6 < nees(drives, found.smoothed, 600) < 1.4
    live, later = (
        np.sqrt(np.asarray(each.covariance[..., 0, 0] + each.covariance[..., 1, 1]))
        for each in (found.filtered, found.smoothed)
    )
    off = ~drives.fixes
    begins, ends = np.flatnonzero(off[1:] & ~off[:-1]) + 1, np.flatnonzero(~off[1:] & off[:-1]) + 1
    whole = [(one, other) for one, other in zip(begins, ends, strict=False) if one > 300]
    assert whole
    for one, other in whole:
        middle = (one + other) // 2
        assert np.mean(later[:, middle] / live[:, middle]) <= 0.75
        assert np.mean(later[:, other - 1] / live[:, other - 1]) <= 0.5
    # Nothing is told of what comes after the last fix, and nothing is lost.
    np.testing.assert_array_equal(later[:, -1], live[:, -1])
    assert np.linalg.eigvalsh(np.asarray(found.smoothed.covariance, np.float64)[..., :3, :3]).min() > 0.0


@pytest.mark.parametrize(("off_s", "every_s"), [(30.0, 90.0), pytest.param(90.0, 180.0, marks=pytest.mark.campaign)])
def test_the_area_worked_smoothed_against_truth(off_s: float, every_s: float) -> None:
    """What a fix at a drop-out's end gives back of the area, and that it is true."""
    drives = draw_field_drives(runs=RUNS, seconds=SECONDS, seed=17, step_s=STEP_S, off_s=off_s, every_s=every_s)
    found = smoothed(drives)
    truth = np.moveaxis(drives.truth, 0, 1)
    known = np.asarray(found.info.heading_known)
    turn = np.abs(np.diff(np.unwrap(truth[..., 2], axis=1), axis=1, prepend=truth[:, :1, 2])) / STEP_S > 0.05
    shares = {}
    for name, estimate in (("live", found.filtered), ("smoothed", found.smoothed)):
        pose = np.asarray(estimate.mean[..., :3])
        covariance = np.asarray(skid_pose_covariance(estimate))
        # The tool is on in lines once the heading is known; each claim against where it truly was.
        on = known & ~turn
        parts = [claims_and_truth(TOOL, pose[run], covariance[run], on[run], truth[run], on[run]) for run in range(3)]
        for level, (claimed, true, worked) in zip((0.95, 0.996), np.sum(parts, axis=0), strict=True):
            shares[name, level] = claimed / worked
            told = f"claimed to worked {claimed / worked:.3f}, true {true / claimed:.5f}"
            print(f"off {off_s:g} of {every_s:g} s, {name}, {level:g}: {told}")
            assert true >= level * claimed
    assert all(shares["smoothed", level] > shares["live", level] for level in (0.95, 0.996))


def test_what_later_evidence_contradicts_is_taken_back() -> None:
    drives = draw_field_drives(runs=RUNS, seconds=SECONDS, seed=18, step_s=STEP_S, off_s=0.0)
    fix = drives.observations.gnss
    # From 120 s on every fix is half a metre off: rejected, and followed in the end, for nobody else witnesses.
    shifted = np.asarray(fix.x_m).copy()
    shifted[1200:] += 0.5
    wrong = drives._replace(
        observations=drives.observations._replace(gnss=fix._replace(x_m=jax.numpy.asarray(shifted)))
    )
    found = smoothed(wrong)
    for run in range(RUNS):
        one = jax.tree.map(lambda leaf, lane=run: leaf[lane], found)
        taken = contradicted_m(one)
        jumps = np.flatnonzero(np.asarray(one.jump_m) > 0.0)
        assert len(jumps) == 1
        assert 1240 < jumps[0] < 1290
        assert taken[jumps[0] - 1] == pytest.approx(0.5, abs=0.15)
        # Back to the last fix that was believed, no farther.
        assert 1180 < np.flatnonzero(taken > 0.0)[0] <= 1201
    quiet = smoothed(drives)
    assert not any(contradicted_m(jax.tree.map(lambda leaf, lane=run: leaf[lane], quiet)).any() for run in range(RUNS))
