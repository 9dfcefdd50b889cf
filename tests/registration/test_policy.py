"""The policy of a tracked drive, row by row of its table."""

from itertools import pairwise

import pytest

from lgprjax.pso import SwarmConfig
from lgprjax.registration import Code, RegisterOptions
from lgprjax.registration.policy import (
    BAD_TO_WIDEN,
    GOOD_TO_NARROW,
    Lock,
    Outcome,
    Policy,
    first_lock,
    next_lock,
    next_turn,
)

TRACK, NORMAL, WIDE, LOST = range(4)
POLICY = Policy.of(RegisterOptions(search_m=1.5), wavelength_m=0.4)
STRONG = Outcome(Code.OK, 0.85, 0.04, 0.5)
WEAK = Outcome(Code.OK, 0.65, 0.04, 0.5)
BAD = Outcome(Code.LOW_CORRELATION, 0.3, 0.04, 0.0)


def after(lock: Lock, *outcomes: Outcome, policy: Policy = POLICY) -> Lock:
    for outcome in outcomes:
        lock = next_lock(lock, outcome, policy)
    return lock


def locked(rung: int) -> Lock:
    return first_lock(POLICY)._replace(rung=rung, locked=True)


@pytest.mark.parametrize(
    ("search_m", "rung"), [(0.5, TRACK), (0.51, NORMAL), (1.5, NORMAL), (3.0, WIDE), (7.0, LOST), (12.0, LOST)]
)
def test_start_is_the_rung_of_the_search_region(search_m: float, rung: int) -> None:
    policy = Policy.of(RegisterOptions(search_m=search_m), wavelength_m=0.4)
    lock = first_lock(policy)
    assert lock.rung == rung
    assert policy.ladder[rung].half_m == search_m
    assert next_turn(lock, policy) == (rung, True)


def test_no_region_is_narrower_than_a_match() -> None:
    policy = Policy.of(RegisterOptions(search_m=2.0), wavelength_m=2.0)
    assert [rung.half_m for rung in policy.ladder] == [1.8, 1.8, 2.0, 7.0]
    assert first_lock(policy).rung == WIDE


def test_a_drive_without_a_fix_stays_where_it_started() -> None:
    """The promise of search_m holds until a fix says otherwise: other ground is never searched more widely."""
    lock = after(first_lock(POLICY), *[BAD] * 500)
    assert lock.rung == NORMAL
    assert not lock.locked
    assert next_turn(lock, POLICY) == (NORMAL, True)


def test_strong_fixes_in_a_row_narrow_a_rung_at_a_time() -> None:
    lock = locked(LOST)
    seen = []
    for _ in range(4 * GOOD_TO_NARROW):
        lock = next_lock(lock, STRONG, POLICY)
        seen.append(lock.rung)
    n = GOOD_TO_NARROW
    assert seen == [LOST] * (n - 1) + [WIDE] * n + [NORMAL] * n + [TRACK] * (n + 1)


def test_a_weak_fix_neither_narrows_nor_widens() -> None:
    assert after(locked(WIDE), *[WEAK] * 50).rung == WIDE
    interrupted = [*[STRONG] * (GOOD_TO_NARROW - 1), WEAK] * 10
    assert after(locked(WIDE), *interrupted).rung == WIDE


def test_scans_without_a_fix_widen_a_rung_at_a_time() -> None:
    lock = locked(TRACK)
    seen = []
    for _ in range(4 * BAD_TO_WIDEN):
        lock = next_lock(lock, BAD, POLICY)
        seen.append(lock.rung)
    n = BAD_TO_WIDEN
    assert seen == [TRACK] * (n - 1) + [NORMAL] * n + [WIDE] * n + [LOST] * (n + 1)


def test_one_fix_among_bad_scans_holds_the_rung() -> None:
    row = [*[BAD] * (BAD_TO_WIDEN - 1), WEAK] * 5
    lock = after(locked(TRACK), *row)
    assert lock.rung == TRACK
    assert lock.since_m == 0.0


def test_the_edge_widens_at_once() -> None:
    assert after(locked(TRACK), Outcome(Code.EDGE, 0.8, 0.04, 0.0)).rung == NORMAL


@pytest.mark.parametrize(
    ("travel_m", "rung"), [(3.9, TRACK), (4.1, NORMAL), (23.9, NORMAL), (24.1, WIDE), (65.0, LOST)]
)
def test_the_region_grows_with_the_travel(travel_m: float, rung: int) -> None:
    """0.3 m and a twentieth of the way must fit into the region; scans that say nothing do not count as bad."""
    lock = after(locked(TRACK), *[Outcome(Code.NON_FINITE, float("nan"), travel_m / 40, 0.0)] * 40)
    assert lock.rung == rung
    assert lock.bad == 0


def test_a_fix_too_far_from_the_log_must_stand_the_widest_search() -> None:
    far = STRONG._replace(astray_m=1.6)
    lock = next_lock(locked(TRACK), far, POLICY)
    assert lock.rung == LOST
    assert lock.doubted
    assert next_turn(lock, POLICY) == (LOST, True)
    believed = next_lock(lock, far, POLICY)
    assert not believed.doubted
    assert believed.doubt_m == pytest.approx(1.6 + 1.5)
    # Believed once, the same distance raises no new doubt; a distance that is gone is not remembered.
    assert after(believed, *[far] * 40).rung == TRACK
    assert after(believed, *[STRONG] * 40).doubt_m == pytest.approx(0.5 + 1.5)
    assert after(believed, *[STRONG] * 40, STRONG._replace(astray_m=2.1)).rung == LOST


def test_a_lost_drive_asks_the_log_and_odometry_in_turn() -> None:
    lock = next_lock(locked(TRACK), STRONG._replace(astray_m=2.0), POLICY)
    turns = []
    for _ in range(4 * BAD_TO_WIDEN):
        turns.append(next_turn(lock, POLICY))
        lock = next_lock(lock, BAD, POLICY)
    n = BAD_TO_WIDEN
    assert turns == [(LOST, True)] * n + [(LOST, False)] * n + [(NORMAL, True)] * n + [(LOST, True)] * n


def test_a_fix_of_a_turn_leads_on_from_its_rung() -> None:
    """Ground too weak for the widest rung's strength is found again as at the start."""
    lock = locked(LOST)._replace(bad=2 * BAD_TO_WIDEN)
    assert next_lock(lock, WEAK, POLICY).rung == NORMAL


def test_after_a_long_way_only_the_log_is_asked() -> None:
    """0.3 m and 5 % of 135 m are more than the widest region."""
    lock = locked(LOST)._replace(since_m=135.0)
    assert all(next_turn(lock._replace(bad=bad), POLICY).about_log for bad in range(40))


def test_with_a_lock_the_fix_is_asked() -> None:
    for rung in (TRACK, NORMAL, WIDE, LOST):
        assert next_turn(locked(rung), POLICY) == (rung, False)


def test_more_places_must_be_told_from_chance() -> None:
    """More strength is asked the wider the region, and the swarm is larger."""
    ladder = Policy.of(RegisterOptions(swarm=SwarmConfig(24, 12)), wavelength_m=0.4).ladder
    for narrow, wide in pairwise(ladder):
        assert wide.half_m > narrow.half_m
        assert wide.more_strength >= narrow.more_strength
        assert wide.particles * wide.iterations > narrow.particles * narrow.iterations
        assert wide.summits >= narrow.summits
    assert ladder[LOST].more_strength > 0.0
