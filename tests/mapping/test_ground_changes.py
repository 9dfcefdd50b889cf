"""Who is believed where a new drive does not match the map: decided by hand-made matches."""

import numpy as np
import pytest

from lgprjax.mapping.changes import PLACE_M, Evidence, GroundVerdict, judge_ground

PLACES = 60
CHANGED = slice(20, 36)  # 8 m
OTHER, SAME = 0.3, 0.75


def judged(
    rows: list[np.ndarray],
    *,
    dates: list[int] | None = None,
    in_force: np.ndarray | None = None,
    sure: np.ndarray | None = None,
    apart_m: np.ndarray | None = None,
) -> GroundVerdict:
    """Verdict on a new drive's matches, one row an old baseline; dates rise with the number unless told, 0: unknown."""
    score = np.stack(rows) + np.random.default_rng(1).normal(scale=0.03, size=(len(rows), PLACES))
    days = np.array(dates or range(1, len(rows) + 2))
    newer = (days[:, None] > days[None, :]) & (days[:, None] > 0) & (days[None, :] > 0)
    return judge_ground(
        Evidence(
            at_m=(np.arange(PLACES) + 0.5) * PLACE_M,
            score=score,
            apart_m=np.where(np.isfinite(score), 0.05, np.nan) if apart_m is None else apart_m,
            in_force=np.isfinite(score) if in_force is None else in_force,
            sure=np.ones(PLACES, bool) if sure is None else sure,
            newer=newer,
        )
    )


def matches(changed: float = SAME, usual: float = SAME) -> np.ndarray:
    """Strength along the drive, another one in the changed stretch."""
    out = np.full(PLACES, usual)
    out[CHANGED] = changed
    return out


def test_ground_that_is_as_it_was_is_left_alone() -> None:
    verdict = judged([matches(), matches()])
    assert verdict.changed == ()
    assert not verdict.held.any()
    assert verdict.usual == pytest.approx(SAME, abs=0.05)


def test_one_newer_drive_alone_retires_nothing_and_is_held_back_itself() -> None:
    verdict = judged([matches(OTHER), matches(OTHER)])
    assert [ground.drive for ground in verdict.changed] == [0, 1]
    for ground in verdict.changed:
        assert ground.agreeing == ()
        assert (ground.start_m, ground.stop_m) == (10.0, 18.0)
        assert ground.score == pytest.approx(OTHER, abs=0.03)
    np.testing.assert_array_equal(np.flatnonzero(verdict.held), np.arange(20, 36))


def test_two_newer_drives_that_agree_outvote_the_old_ones() -> None:
    held_back = np.ones((3, PLACES), bool)
    held_back[2, CHANGED] = False
    verdict = judged([matches(OTHER), matches(OTHER), matches()], in_force=held_back)
    assert [(ground.drive, ground.agreeing) for ground in verdict.changed] == [(0, (2,)), (1, (2,))]
    assert not verdict.held.any()
    assert verdict.confirmed[2].all()
    assert not verdict.confirmed[:2, CHANGED].any()


def test_labels_that_are_apart_do_not_agree() -> None:
    """The same ground, but half a metre off: whose labels are wrong is not known, and nothing comes into force."""
    held_back = np.ones((3, PLACES), bool)
    held_back[2, CHANGED] = False
    apart_m = np.full((3, PLACES), 0.05)
    apart_m[2, CHANGED] = 0.4
    verdict = judged([matches(OTHER), matches(OTHER), matches()], in_force=held_back, apart_m=apart_m)
    assert {ground.agreeing for ground in verdict.changed} == {()}
    assert verdict.held[CHANGED].all()
    assert not verdict.confirmed[:, CHANGED].any()


def test_a_disturbance_of_one_day_changes_nothing_later() -> None:
    """The drive before was held back; this one finds the old ground."""
    held_back = np.ones((3, PLACES), bool)
    held_back[2, CHANGED] = False
    verdict = judged([matches(), matches(), matches(OTHER)], in_force=held_back)
    assert verdict.changed == ()
    assert not verdict.confirmed[2, CHANGED].any()
    assert not verdict.held.any()


def test_three_days_with_three_grounds_retire_nothing() -> None:
    held_back = np.ones((2, PLACES), bool)
    held_back[1, CHANGED] = False
    verdict = judged([matches(OTHER), matches(OTHER)], in_force=held_back)
    assert [(ground.drive, ground.agreeing) for ground in verdict.changed] == [(0, ())]
    np.testing.assert_array_equal(np.flatnonzero(verdict.held), np.arange(20, 36))


def test_who_is_not_known_to_be_newer_does_not_outvote() -> None:
    """Older than the map, a map without dates, a drive without a date, a witness as old as the map."""
    held_back = np.ones((3, PLACES), bool)
    held_back[2, CHANGED] = False
    for dates in ([3, 3, 2, 1], [0, 0, 1, 2], [1, 1, 2, 0], [2, 2, 2, 3]):
        verdict = judged([matches(OTHER), matches(OTHER), matches()], dates=dates, in_force=held_back)
        assert {ground.agreeing for ground in verdict.changed} == {()}, dates
        assert verdict.held[CHANGED].all()
        assert not verdict.confirmed[2, CHANGED].any()


def test_an_old_baseline_that_still_matches_keeps_the_new_one_in_force() -> None:
    """One of two old baselines was disturbed: the new drive agrees with the other, and is not held back."""
    verdict = judged([matches(OTHER), matches()])
    assert [(ground.drive, ground.agreeing) for ground in verdict.changed] == [(0, (1,))]
    assert not verdict.held.any()


def test_ground_that_a_baseline_of_the_same_day_knows_has_not_changed() -> None:
    """A weak match has another reason then; where dates are not known, nobody can say."""
    for dates, changed in (([1, 1, 2], 0), ([2, 1, 3], 0), ([0, 0, 2], 1), ([1, 1, 0], 1)):
        assert len(judged([matches(OTHER), matches()], dates=dates).changed) == changed, dates


def test_a_stretch_is_a_metre_and_a_half_at_least_and_not_cut_by_a_chance_match() -> None:
    for places, found in ((2, 0), (3, 1)):
        row = matches()
        row[20 : 20 + places] = OTHER
        assert len(judged([row]).changed) == found
    row = matches(OTHER)
    row[[26, 27]] = SAME
    (ground,) = judged([row]).changed
    assert (ground.first, ground.last) == (20, 35)


def test_a_poor_day_is_no_change() -> None:
    """Snow: every match is weak; what has changed is weaker still."""
    assert judged([matches(0.5, 0.5)]).changed == ()
    (ground,) = judged([matches(0.2, 0.5)]).changed
    assert (ground.first, ground.last) == (20, 35)


def test_where_drive_lane_or_match_is_missing_nothing_is_said() -> None:
    sure = np.ones(PLACES, bool)
    sure[CHANGED] = False
    assert judged([matches(OTHER)], sure=sure).changed == ()
    row = matches(OTHER)
    row[CHANGED] = np.nan
    verdict = judged([matches(OTHER), row])
    assert [ground.drive for ground in verdict.changed] == [0]
    verdict = judged([np.full(PLACES, np.nan)])
    assert verdict.changed == ()
    assert np.isnan(verdict.usual)
