"""How widely a drive that is being tracked searches next: rungs of a ladder, and when to change from one to another."""

from dataclasses import dataclass
from typing import NamedTuple

from lgprjax.registration.fix import Code
from lgprjax.registration.options import RegisterOptions

GOOD_TO_NARROW = 4
"""Strong fixes in a row after which the region shrinks by a rung."""

BAD_TO_WIDEN = 8
"""Scans in a row without a fix after which it grows by one."""

CLEARLY = 0.04
"""A fix is strong when its strength leads what is asked for by this much."""

_CARRIED_M = 0.3  # what a carried fix may be wrong by at once: a fix called ok is no farther off
_DRIFT = 0.05  # share of the travel that odometry and heading may lead astray
_LEAST_HALF = 0.9  # of the wavelength: a narrower region holds nothing but the match itself


class Rung(NamedTuple):
    """One size of the search; every one is a compile of its own, made ahead.

    Attributes:
        half_m: half side of the search square.
        heights: tried by the coarse stage.
        summits: of the coarse stage that are finished.
        particles, iterations: of the swarm, where that is the finish.
        more_strength: that an ok fix must have beyond what is asked in the default region: among more places the best
            wrong one is better by chance.
    """

    name: str
    half_m: float
    heights: int
    summits: int
    particles: int
    iterations: int
    more_strength: float


LADDER = (
    Rung("track", 0.5, 2, 2, 16, 8, 0.0),
    Rung("normal", 1.5, 2, 2, 24, 12, 0.0),
    Rung("wide", 3.5, 2, 3, 32, 16, 0.06),
    Rung("lost", 7.0, 2, 4, 48, 24, 0.08),
)


class Lock(NamedTuple):
    """What a tracked drive knows of its own state.

    Attributes:
        rung: number of the rung to search on next.
        locked: there was an ok fix.
        good: strong fixes in a row on this rung.
        bad: scans in a row without a fix.
        since_m: travel since the last ok fix.
        doubted: the last fixes disagree with the log's prior and have yet to stand a search of the widest region.
        doubt_m: distance from the log's prior beyond which they do.
    """

    rung: int
    locked: bool
    good: int
    bad: int
    since_m: float
    doubted: bool
    doubt_m: float


class Outcome(NamedTuple):
    """What a search gave.

    Attributes:
        code: of the fix.
        strength: its correlation times the root of the overlap.
        travelled_m: path since the search before it.
        astray_m: distance of the fix from the log's prior.
    """

    code: int
    strength: float
    travelled_m: float
    astray_m: float


class Turn(NamedTuple):
    """What the next scan is searched with.

    Attributes:
        rung: number of the rung.
        about_log: about the log's prior, not about the last ok fix carried on.
    """

    rung: int
    about_log: bool


@dataclass(frozen=True)
class Policy:
    """What the rules of a drive measure with.

    Attributes:
        ladder: of this drive, narrow to wide.
        search_m: how far the log's prior may be wrong.
        least_strength: that an ok fix must reach.
    """

    ladder: tuple[Rung, ...]
    search_m: float
    least_strength: float

    @staticmethod
    def of(options: RegisterOptions, wavelength_m: float) -> "Policy":
        """Policy of a drive on a map: no rung narrower than a match, and one of them exactly ``search_m``."""
        halves = [max(rung.half_m, _LEAST_HALF * wavelength_m) for rung in LADDER]
        start = next((n for n, half_m in enumerate(halves) if half_m >= options.search_m), len(halves) - 1)
        halves[start] = options.search_m
        ladder = tuple(rung._replace(half_m=half) for rung, half in zip(LADDER, halves, strict=True))
        if options.never_wider:
            ladder = ladder[: start + 1]
        return Policy(ladder, options.search_m, float(options.thresholds.strength))

    def rung_for(self, reach_m: float) -> int:
        """Narrowest rung that reaches so far, or the widest."""
        enough = [number for number, rung in enumerate(self.ladder) if rung.half_m >= reach_m]
        return enough[0] if enough else len(self.ladder) - 1


def first_lock(policy: Policy) -> Lock:
    """Before the first fix: the log's prior, wrong by no more than ``search_m``."""
    return Lock(policy.rung_for(policy.search_m), False, 0, 0, 0.0, False, policy.search_m)


def next_lock(lock: Lock, outcome: Outcome, policy: Policy) -> Lock:
    """The state after a search.

    ============================================================  ====================================================
    after                                                         next
    ============================================================  ====================================================
    no ok fix yet                                                 the rung of ``search_m``, about the log's prior
    ok, strength 0.04 or more above what is asked, 4 in a row     a rung narrower
    ok, weaker                                                    the same rung, the count begins again
    ok on a narrower rung than ``lost``, ``doubt_m`` or more off  ``lost``, in doubt (below)
    ok in a turn of a lost drive (``next_turn``)                  the rung of that turn
    ``edge``                                                      a rung wider
    any other code but ``non_finite``, 8 in a row                 a rung wider
    no fix, 0.3 m and 5 % of the travel beyond the rung's half    the narrowest rung that reaches as far
    ``non_finite``                                                the same: such a scan says nothing but its travel
    ============================================================  ====================================================

    Doubt: the prior of the log may be wrong by ``search_m``, so a lock that disagrees by more is wrong, or the log is.
    The widest region, which as a rule holds both places, decides. The next ok fix is believed, and ``doubt_m`` becomes
    its distance from the log's prior and ``search_m`` more; it shrinks again with that distance.
    """
    last = len(policy.ladder) - 1
    if outcome.code != Code.OK:
        return _without_fix(lock, outcome, policy)
    strong = outcome.strength >= policy.least_strength + CLEARLY
    good = lock.good + 1 if strong else 0
    rung = next_turn(lock, policy).rung
    if lock.locked and lock.rung < last and outcome.astray_m > lock.doubt_m:
        return Lock(last, True, 0, 0, 0.0, True, lock.doubt_m)
    reach_m = outcome.astray_m + policy.search_m
    doubt_m = max(policy.search_m, reach_m if lock.rung == last else min(lock.doubt_m, reach_m))
    if good >= GOOD_TO_NARROW and rung > 0:
        return Lock(rung - 1, True, 0, 0, 0.0, False, doubt_m)
    return Lock(rung, True, good, 0, 0.0, False, doubt_m)


def _without_fix(lock: Lock, outcome: Outcome, policy: Policy) -> Lock:
    since_m = lock.since_m + outcome.travelled_m
    silent = outcome.code == Code.NON_FINITE
    bad = lock.bad if silent else lock.bad + 1
    good = lock.good if silent else 0
    rung = lock.rung
    if lock.locked:
        wider = outcome.code == Code.EDGE or (not silent and bad % BAD_TO_WIDEN == 0)
        rung = min(lock.rung + wider, len(policy.ladder) - 1)
        rung = max(rung, policy.rung_for(carried_reach_m(since_m)))
    return lock._replace(rung=rung, good=good, bad=bad, since_m=since_m)


def carried_reach_m(since_m: float) -> float:
    """How far from the last ok fix, carried on by odometry, a vehicle may be after some travel."""
    return _CARRIED_M + _DRIFT * since_m


def next_turn(lock: Lock, policy: Policy) -> Turn:
    """Rung and centre of the next search.

    Before the first fix the log's prior; with a lock the last ok fix carried on. A drive on the widest rung without a
    fix, or in doubt, takes turns of eight scans: the widest rung about the log's prior, the widest rung about the
    carried fix (the log's prior again, once odometry may be farther off than the rung reaches), and the rung of
    ``search_m`` about the log's prior, which asks for less strength.
    """
    last = len(policy.ladder) - 1
    if not lock.locked:
        return Turn(lock.rung, True)
    far = carried_reach_m(lock.since_m) > policy.ladder[last].half_m
    if lock.rung < last or (lock.bad == 0 and not lock.doubted):
        return Turn(lock.rung, far)
    turn = (lock.bad // BAD_TO_WIDEN) % 3
    if turn == 2:
        return Turn(policy.rung_for(policy.search_m), True)
    return Turn(last, turn == 0 or far)
