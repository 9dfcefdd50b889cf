"""Labels follow right fixes, not wrong ones, and stay as given where there are none."""

import numpy as np
import pytest

from lgprjax.mapping.update import LabelCorrection, correct_labels
from lgprjax.registration import Code, Fix, Track

SPACING_M = 0.1
LENGTH_M = 300.0
LEVER_M = (3.0, 0.0)
SCANS = round(LENGTH_M / SPACING_M)
AT_M = np.arange(SCANS) * SPACING_M


def track_of(labels: np.ndarray) -> Track:
    sigma_yaw, unstated = np.full(SCANS, 0.005), np.full(SCANS, np.nan)
    return Track(labels, AT_M, np.full(SCANS, 5.0), sigma_yaw, unstated, np.zeros(SCANS, np.int64))


class Drive:
    """A straight drive to the north-east; its labels drift, its fixes are right to 2 cm."""

    def __init__(self, seed: int = 0) -> None:
        self.rng = np.random.default_rng(seed)
        yaw = np.radians(30.0)
        self.truth = np.zeros((SCANS, 5))
        self.truth[:, 0], self.truth[:, 1] = AT_M * np.cos(yaw), AT_M * np.sin(yaw)
        self.truth[:, 2], self.truth[:, 3] = 0.3, yaw
        self.wrong = np.zeros((SCANS, 5))
        phase = 2.0 * np.pi * AT_M / 400.0
        self.wrong[:, 0], self.wrong[:, 1] = 0.6 + 0.3 * np.sin(phase), -0.4 + 0.2 * np.cos(phase)
        self.wrong[:, 3] = np.radians(0.4)
        self.fixed = self.truth + self.rng.normal(size=(SCANS, 5)) * [0.02, 0.02, 0.0, np.radians(0.2), 0.0]
        self.code = np.full(SCANS, Code.OK, np.int32)
        # The labels' lever turns with their yaw: their axle stands where the wheels put it.

    def labels(self) -> np.ndarray:
        return self.truth + self.wrong

    def corrected(self) -> LabelCorrection:
        covariance = np.tile(np.diag([4e-4, 4e-4, 1e-4, np.radians(0.2) ** 2, 1e-4]), (SCANS, 1, 1))
        nothing = np.zeros(SCANS)
        fix = Fix(
            pose=np.where((self.code == Code.OK)[:, None], self.fixed, np.nan),
            covariance=covariance,
            correlation=nothing,
            runner_up=nothing,
            margin=nothing,
            noise_floor=nothing,
            overlap_channels=np.zeros(SCANS, np.int32),
            overlap=nothing,
            code=self.code,
            p_false=nothing,
            window_m=nothing,
        )
        track = track_of(self.labels())
        return correct_labels(track, fix, np.zeros((SCANS, 2, 2)), LEVER_M)

    def left_m(self, correction: LabelCorrection) -> np.ndarray:
        """Distance of the corrected labels from the truth."""
        return np.asarray(np.hypot(*(self.wrong[:, [0, 1, 3]] + correction.offset)[:, :2].T))

    def lose(self, start_m: float, stop_m: float) -> None:
        self.code[(start_m <= AT_M) & (stop_m > AT_M)] = Code.LOW_CORRELATION


def test_a_slow_error_is_taken_away() -> None:
    drive = Drive()
    correction = drive.corrected()
    assert correction.corrected.all()
    assert np.sqrt(np.mean(drive.left_m(correction) ** 2)) < 0.01
    np.testing.assert_allclose(correction.offset[:, 2], -np.radians(0.4), atol=np.radians(0.1))
    assert correction.located_m == pytest.approx(LENGTH_M, abs=2.0)


@pytest.mark.parametrize("run_m", [0.1, 4.0])
def test_wrong_fixes_do_not_bend_it(run_m: float) -> None:
    """A tenth of the fixes, single ones or runs of four metres, all 0.8 m to one side."""
    right, drive = Drive(), Drive()
    wrong = np.zeros(SCANS, bool)
    for start_m in drive.rng.uniform(0.0, LENGTH_M - run_m, round(0.1 * LENGTH_M / run_m)):
        wrong |= (start_m <= AT_M) & (start_m + run_m > AT_M)
    drive.fixed[wrong, :2] += [0.64, -0.48]
    assert 0.06 < wrong.mean() < 0.12
    apart = np.hypot(*(drive.corrected().offset - right.corrected().offset)[:, :2].T)
    assert np.sqrt(np.mean(apart**2)) < 0.01
    assert apart.max() < 0.03


def test_a_gap_is_crossed_and_its_sigma_is_that_of_a_bridged_walk() -> None:
    drive = Drive()
    drive.lose(140.0, 160.0)
    correction = drive.corrected()
    assert correction.between[(AT_M > 2.0) & (AT_M < LENGTH_M - 2.0)].all()
    assert drive.left_m(correction).max() < 0.05
    # In the middle of a gap L between known ends a walk of q a metre has q L / 4.
    middle = correction.sigma_m[np.argmin(np.abs(AT_M - 150.0))]
    assert middle == pytest.approx(0.03 * np.sqrt(21.0 / 4.0), rel=0.1)


def test_far_from_all_fixes_labels_stay_as_given() -> None:
    drive = Drive()
    drive.lose(0.0, 40.0)
    drive.lose(160.0, LENGTH_M)
    correction = drive.corrected()
    np.testing.assert_array_equal(correction.offset[AT_M > 240.0], 0.0)
    assert np.isinf(correction.sigma_m[AT_M > 187.0]).all()
    assert not correction.corrected[(AT_M < 12.0) | (AT_M > 187.0)].any()
    assert correction.corrected[(AT_M > 18.0) & (AT_M < 182.0)].all()
    assert not correction.between[(AT_M < 39.0) | (AT_M > 161.0)].any()
    steps = np.hypot(*np.diff(correction.offset[:, :2], axis=0).T)
    assert steps.max() < 0.01


@pytest.mark.parametrize("held_m", [20.0, 80.0])
def test_a_step_of_gnss_is_followed(held_m: float) -> None:
    """Labels jump aside by 1.1 m, for a while: the wheels do not, the fixes stay where they were."""
    drive = Drive()
    jumped = (AT_M >= 120.0) & (120.0 + held_m > AT_M)
    drive.wrong[jumped, :2] += [0.9, 0.6]
    correction = drive.corrected()
    known = correction.corrected
    assert known.mean() > 0.98
    assert drive.left_m(correction)[known].max() < 0.05
    # Of the metre that holds the step nobody knows which side a scan is on.
    assert not known[np.abs(AT_M - 120.0) < 0.5].any()


def test_without_fixes_nothing_is_said() -> None:
    """Nor by a lone group of them: on other ground a few may agree by chance."""
    drive = Drive()
    drive.lose(0.0, 150.0)
    drive.lose(152.0, LENGTH_M)
    assert drive.corrected().located_m == 0.0
    drive.lose(0.0, LENGTH_M)
    correction = drive.corrected()
    assert correction.located_m == 0.0
    assert not correction.corrected.any()
    np.testing.assert_array_equal(correction.offset, 0.0)


def test_applied_moves_poses_and_nothing_else() -> None:
    drive = Drive()
    correction = drive.corrected()
    track = track_of(drive.labels())
    moved = correction.applied(track)
    np.testing.assert_allclose(moved.pose[:, [0, 1, 3]] - track.pose[:, [0, 1, 3]], correction.offset, atol=1e-12)
    np.testing.assert_array_equal(moved.pose[:, [2, 4]], track.pose[:, [2, 4]])
