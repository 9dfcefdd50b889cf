"""The skid-steer filter against a float64 filter on the same log, and against what sensors do to it."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation import (
    GateRules,
    SkidEstimate,
    SkidFilterState,
    SkidMotion,
    SkidObservations,
    skid_pose,
    skid_pose_covariance,
    skid_rules,
)
from navigation.skid_drives import FieldDrives, draw_field_drives
from navigation.skid_oracle import Oracle
from navigation.skid_runs import MODEL, Filtered, begin, filter_lanes, pose_errors, scan_lanes

STEP_S, SECONDS, LANES = 0.05, 120.0, 8
HONEST, POISONED, REPEATED, LOSSY, JUMPED, STUCK, TURNED_ROUND, WITHOUT_INS = range(LANES)
TURNING_S = 66.0
"""From here on the vehicle is in its first half turn; the fixes are there all the time."""


class Lanes(NamedTuple):
    """One drive, eight ways to be heard."""

    truth: np.ndarray
    start: SkidFilterState
    motions: SkidMotion
    observations: SkidObservations


class Outcome(NamedTuple):
    error: np.ndarray
    covariance: np.ndarray
    known: np.ndarray
    offered: np.ndarray
    accepted: np.ndarray
    reacquired: np.ndarray
    restarted: np.ndarray
    filtered: Filtered


def tick_of(seconds: float) -> int:
    return round(seconds / STEP_S)


@pytest.fixture(scope="module")
def drive() -> FieldDrives:
    return draw_field_drives(runs=1, seconds=SECONDS, seed=8, step_s=STEP_S, off_s=0.0)


def poison(motion: list[np.ndarray], gnss: list[np.ndarray], turn: list[np.ndarray], lane: int) -> None:
    """Numbers that are none, in slots that say they are valid, and in the wheels, every few seconds."""
    every = np.arange(tick_of(4.0), len(motion[0]), tick_of(4.3))
    motion[0][every, lane], motion[1][every + 1, lane] = np.nan, np.inf
    gnss[0][every + 2, lane], gnss[4][every + 2, lane] = np.nan, True
    gnss[0][every + 3, lane], gnss[1][every + 3, lane], gnss[4][every + 3, lane] = 1.0, 1.0, True
    gnss[2][every + 3, lane] = np.nan
    gnss[2][every + 4, lane], gnss[4][every + 4, lane] = np.array([[4e-4, 1.0], [1.0, 4e-4]]), True
    gnss[3][every + 5, lane], gnss[4][every + 5, lane] = np.nan, True
    turn[0][every + 6, lane], turn[2][every + 6, lane] = np.inf, True
    turn[1][every + 7, lane], turn[2][every + 7, lane] = np.nan, True
    # A turn that no such vehicle makes.
    turn[0][every + 9, lane], turn[2][every + 9, lane] = 3.0, True


def repeat(gnss: list[np.ndarray], turn: list[np.ndarray], lane: int) -> None:
    """Each fix comes again a tick later with its age grown, and once more as it was; each delta heading comes twice."""
    comes, speaks = np.flatnonzero(gnss[4][:, lane]), np.flatnonzero(turn[2][:, lane])
    for later, older in ((1, STEP_S), (2, 0.0)):
        again = comes[comes + later < len(gnss[4])]
        for part in (0, 1, 3):
            gnss[part][again + later, lane] = gnss[part][again, lane]
        gnss[3][again + later, lane] += older
        gnss[4][again + later, lane] = True
    again = speaks[speaks + 1 < len(turn[2])]
    turn[0][again + 1, lane], turn[2][again + 1, lane] = turn[0][again, lane], True


@pytest.fixture(scope="module")
def lanes(drive: FieldDrives) -> Lanes:
    def eightfold(part: jax.Array) -> np.ndarray:
        return np.repeat(np.asarray(part), LANES, axis=1)

    motion = [eightfold(part) for part in drive.motions]
    gnss = [eightfold(part) for part in drive.observations.gnss]
    turn = [eightfold(part) for part in drive.observations.delta_heading]
    poison(motion, gnss, turn, POISONED)
    repeat(gnss, turn, REPEATED)
    turn[2][np.flatnonzero(turn[2][:, LOSSY])[::3], LOSSY] = False
    gnss[4][np.flatnonzero(gnss[4][:, LOSSY])[::3], LOSSY] = False
    # One fix beside the others at 50 s; from 90 s on all of them.
    single = np.flatnonzero(gnss[4][:, JUMPED] & (np.arange(len(gnss[4])) >= tick_of(50.0)))[0]
    gnss[0][single, JUMPED] += 2.0
    gnss[1][tick_of(90.0) :, JUMPED] += 3.0
    turn[0][tick_of(TURNING_S - 3.0) :, STUCK] = 0.0
    turn[2][:, WITHOUT_INS] = False
    start = begin(np.repeat(drive.start_m, LANES, axis=0))
    # One filter believes to know its heading, which is wrong by 40°.
    known = start.start._replace(known=jnp.arange(LANES) == TURNED_ROUND)
    wrong = float(drive.truth[0, 0, 2]) + 0.7
    mean = start.estimate.mean.at[TURNED_ROUND, 2].set(wrong)
    covariance = start.estimate.covariance.at[TURNED_ROUND, 2, 2].set(4e-4)
    start = start._replace(estimate=SkidEstimate(mean, covariance), start=known)
    observations = SkidObservations(
        type(drive.observations.gnss)(*(jnp.asarray(part) for part in gnss)),
        type(drive.observations.delta_heading)(*(jnp.asarray(part) for part in turn)),
    )
    return Lanes(np.repeat(drive.truth, LANES, axis=1), start, SkidMotion(*map(jnp.asarray, motion)), observations)


@pytest.fixture(scope="module")
def outcome(lanes: Lanes) -> Outcome:
    _, filtered = filter_lanes(skid_rules(), lanes.start, lanes.motions, lanes.observations)
    error, covariance = pose_errors(lanes.truth, filtered.estimate)
    info = filtered.info
    offered, accepted, reacquired = (np.asarray(fate)[:, 0] for fate in (info.offered, info.accepted, info.reacquired))
    return Outcome(
        error,
        covariance,
        np.asarray(info.heading_known)[:, 0],
        offered,
        accepted,
        reacquired,
        np.asarray(info.heading_restarted)[:, 0],
        filtered,
    )


def test_it_is_the_textbook_s_filter(lanes: Lanes, outcome: Outcome) -> None:
    """From a heading on, for 40 s with a half turn: mean and covariance of a float64 filter with a cloned yaw."""
    begins, ends = tick_of(45.0), tick_of(85.0)
    estimate = outcome.filtered.estimate
    mean = np.asarray(estimate.mean, np.float64)[:, HONEST]
    covariance = np.asarray(estimate.covariance, np.float64)[:, HONEST]
    left, right = (np.asarray(side, np.float64)[:, HONEST] for side in lanes.motions[:2])
    x, y, reported, age, comes = (np.asarray(part)[:, HONEST] for part in lanes.observations.gnss)
    turn, span, speaks = (np.asarray(part)[:, HONEST] for part in lanes.observations.delta_heading)
    # Begin where a delta heading has just ended, and all of it is accepted from there on.
    while not (speaks[begins] and outcome.accepted[begins, HONEST, 1]):
        begins += 1
    oracle = Oracle(MODEL, mean[begins], covariance[begins])
    oracle.begin_turn(left[begins], right[begins])
    last, worst_mean, worst_covariance = begins, 0.0, 0.0
    for tick in range(begins + 1, ends):
        wheels = (float(left[tick]), float(right[tick]))
        oracle.predict(*wheels, STEP_S)
        if speaks[tick]:
            if tick - last == round(float(span[tick]) / STEP_S):
                oracle.hear_turn(float(turn[tick]), float(span[tick]), *wheels)
            oracle.begin_turn(*wheels)
            last = tick
        if comes[tick]:
            place = np.array([x[tick], y[tick]], np.float64)
            oracle.hear_fix(place, np.asarray(reported[tick], np.float64), float(age[tick]), *wheels)
        sigma = np.sqrt(np.diagonal(oracle.covariance))
        off = mean[tick] - oracle.mean
        off[2] = np.angle(np.exp(1j * off[2]))
        kept = np.arange(12) != 3
        worst_mean = max(worst_mean, float(np.abs(off / sigma)[kept].max()))
        apart = (covariance[tick] - oracle.covariance) / np.outer(sigma, sigma)
        worst_covariance = max(worst_covariance, float(np.abs(apart[np.ix_(kept, kept)]).max()))
    assert not np.any(outcome.reacquired[begins:ends, HONEST])
    assert worst_mean < 0.05, worst_mean
    assert worst_covariance < 0.02, worst_covariance


def test_poison_is_harmless(outcome: Outcome) -> None:
    """Numbers that are none are not offered; the estimate stays finite, close, and within what it says."""
    estimate = outcome.filtered.estimate
    assert np.isfinite(np.asarray(estimate.mean)).all()
    assert np.isfinite(np.asarray(estimate.covariance)).all()
    late = outcome.known[:, POISONED] & (np.arange(len(outcome.known)) > tick_of(45.0))
    assert late.sum() > tick_of(70.0)
    assert np.hypot(*outcome.error[late, POISONED, :2].T).max() < 0.12
    assert np.degrees(np.abs(outcome.error[late, POISONED, 2])).max() < 1.0


def test_what_comes_twice_counts_once(outcome: Outcome) -> None:
    """Repeats, with their age grown or not, change no digit."""
    for leaf in outcome.filtered.estimate:
        np.testing.assert_array_equal(np.asarray(leaf)[:, REPEATED], np.asarray(leaf)[:, HONEST])


def test_lost_messages_cost_no_honesty(outcome: Outcome) -> None:
    """A third of the delta headings and of the fixes is lost: the count of the turn starts anew at each."""
    late = outcome.known[:, LOSSY] & (np.arange(len(outcome.known)) > tick_of(45.0))
    error, covariance = outcome.error[late, LOSSY], outcome.covariance[late, LOSSY]
    assert not outcome.reacquired[:, LOSSY].any()
    assert np.all(np.abs(error) < 4.0 * np.sqrt(np.einsum("tii->ti", covariance)))
    assert np.degrees(np.sqrt(np.mean(error[:, 2] ** 2))) < 0.5
    assert np.degrees(np.abs(error[:, 2])).max() < 1.5


def test_fixes_that_jump_are_shut_out_and_then_taken_back(outcome: Outcome) -> None:
    """A single one is rejected; those that stay aside are followed from the sixth on, for nobody else witnesses."""
    offered, accepted = outcome.offered[:, JUMPED, 0], outcome.accepted[:, JUMPED, 0]
    rejected = np.flatnonzero(offered & ~accepted)
    assert len(rejected) == 6
    assert tick_of(50.0) <= rejected[0] < tick_of(52.5)
    back = np.flatnonzero(outcome.reacquired[:, JUMPED, 0])
    assert len(back) == 1
    assert tick_of(95.0) <= back[0] < tick_of(99.0)
    before, after = slice(tick_of(45.0), back[0]), slice(back[0] + tick_of(3.0), None)
    assert np.abs(outcome.error[before, JUMPED, :2]).max() < 0.15
    np.testing.assert_allclose(outcome.error[after, JUMPED, 1], -3.0, atol=0.15)


def test_an_ins_that_is_stuck_costs_the_heading(outcome: Outcome) -> None:
    """It says "no turn" in a turn: within 2 s of turning the heading is given up, not believed."""
    lost = ~outcome.known[:, STUCK] & (np.arange(len(outcome.known)) > tick_of(50.0))
    first = np.flatnonzero(lost)[0] * STEP_S
    assert TURNING_S - 3.0 < first < TURNING_S + 2.0
    assert np.degrees(np.abs(outcome.error[: round(first / STEP_S), STUCK, 2][tick_of(40.0) :])).max() < 12.0
    # On the next line the fixes tell it again, and the INS cannot draw it further off than they contradict.
    assert outcome.known[tick_of(105.0) : tick_of(118.0), STUCK].all()
    assert np.degrees(np.abs(outcome.error[tick_of(105.0) : tick_of(118.0), STUCK, 2])).max() < 5.0


def test_straight_fixes_replace_a_wrong_heading(outcome: Outcome) -> None:
    """40° off and sure of it: restarted within the first straight way, and then as good as any other."""
    restarted = np.flatnonzero(outcome.restarted[:, TURNED_ROUND])
    assert len(restarted) == 1
    assert restarted[0] < tick_of(35.0)
    after = outcome.error[tick_of(45.0) :, TURNED_ROUND, 2]
    assert np.degrees(np.abs(after)).max() < 1.0


def test_wheels_alone_carry_a_heading(outcome: Outcome) -> None:
    """Without INS: started from fixes, kept by wheels and fixes, less sure and honest."""
    late = outcome.known[:, WITHOUT_INS] & (np.arange(len(outcome.known)) > tick_of(45.0))
    assert late.sum() > tick_of(10.0)
    error, covariance = outcome.error[late, WITHOUT_INS], outcome.covariance[late, WITHOUT_INS]
    assert np.all(np.abs(error) < 4.5 * np.sqrt(np.einsum("tii->ti", covariance)))
    sigma = np.sqrt(outcome.covariance[tick_of(45.0) : tick_of(60.0), :, 2, 2])
    assert np.all(sigma[:, WITHOUT_INS] > 1.5 * sigma[:, HONEST])


def test_one_compilation_and_lanes_alone(lanes: Lanes, outcome: Outcome) -> None:
    """Other lanes and other rules of the same shape compile nothing, and lanes do not see each other."""
    before = scan_lanes._cache_size()  # type: ignore[attr-defined]
    rules: GateRules = skid_rules()
    turned_about = jax.tree.map(lambda leaf: leaf[:, ::-1], (lanes.motions, lanes.observations))
    start = jax.tree.map(lambda leaf: leaf[::-1], lanes.start)
    _, other = filter_lanes(rules, start, *turned_about)
    assert scan_lanes._cache_size() == before  # type: ignore[attr-defined]
    for leaf, same in zip(other.estimate, outcome.filtered.estimate, strict=True):
        np.testing.assert_array_equal(np.asarray(leaf)[:, ::-1], np.asarray(same))
    pose = skid_pose(other.estimate)
    np.testing.assert_array_equal(np.asarray(pose.yaw_rad), np.asarray(other.estimate.mean)[..., 2])
    assert skid_pose_covariance(other.estimate).shape == (*pose.x_m.shape, 3, 3)
