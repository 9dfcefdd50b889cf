"""Ground that a new baseline finds changed: decided place by place along it, from how it matches each of the others.

One drive that does not match may have met snow, water or a fault of its own. Only where a second one, newer than the
old ground as well, agrees with it is the old ground taken out of force. Until then the new drive's own stations there
are held back: nothing says that they are better than those they contradict.
"""

from itertools import pairwise
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.archive.verdicts import runs

PLACE_M = 0.5
"""From place to place along a baseline: neighbours have about half of their ground's detail in common."""

_DIFFERS = 0.6  # of the drive's usual strength: on other ground the best of a small search reaches half of it
_AGREES = 0.75
_PLACED_M = 0.2  # a match farther off than this says that the labels do not agree, whatever the ground does
_LEAST_M = 1.5  # of ground that differs
_BRIDGED = 2  # places: chance may lift one or two among those that differ
_HALF = 0.5  # of the places of a stretch that must speak


class Evidence(NamedTuple):
    """What a new baseline's places say of the baselines that came by before.

    Attributes:
        at_m: of each place, along the new baseline.
        strength: of the place's match on each baseline's ground alone; NaN where there is none, or none with a signal.
        apart_m: of the match from where the labels put it.
        in_force: that baseline's ground takes part in the map there.
        sure: where the place is, is known by fixes before and after it, and its signal is ground.
        newer: of drive (row) than drive (column), by their dates; the last one is the new baseline. False where a date
            is not known.
    """

    at_m: Float[np.ndarray, " place"]
    strength: Float[np.ndarray, "drive place"]
    apart_m: Float[np.ndarray, "drive place"]
    in_force: Bool[np.ndarray, "drive place"]
    sure: Bool[np.ndarray, " place"]
    newer: Bool[np.ndarray, "drive_and_new drive_and_new"]


class ChangedGround(NamedTuple):
    """A stretch where the new baseline does not match an old one.

    Attributes:
        start_m, stop_m: along the new baseline.
        first, last: places, both included.
        drive: the old baseline.
        strength: median of the matches there.
        agreeing: newer baselines that the new one matches there: with it they outvote the old one. Empty where the
            ground is changed or disturbed, and nobody knows which.
    """

    start_m: float
    stop_m: float
    first: int
    last: int
    drive: int
    strength: float
    agreeing: tuple[int, ...]


class GroundVerdict(NamedTuple):
    """What to do about a new baseline's evidence.

    Attributes:
        changed: stretches, by old baseline.
        held: places of the new baseline that only contradict, and are held back.
        confirmed: places of each old baseline that the new one agrees with: what was held back there comes into force.
        usual: strength of the new baseline's matches; NaN where it matches nothing.
    """

    changed: tuple[ChangedGround, ...]
    held: Bool[np.ndarray, " place"]
    confirmed: Bool[np.ndarray, "drive place"]
    usual: float


def usual_strength(strength: Float[np.ndarray, "drive place"], sure: Bool[np.ndarray, " place"]) -> float:
    """Median, over the places that are known, of the best match there; NaN without any."""
    best = np.max(np.where(np.isfinite(strength), strength, -np.inf), axis=0, initial=-np.inf)
    best = best[sure & np.isfinite(best)]
    return float(np.median(best)) if len(best) else float("nan")


def differing(strength: Float[np.ndarray, "drive place"], usual: float) -> Bool[np.ndarray, "drive place"]:
    """Places whose matches, with those beside them, are so much weaker than usual that other ground explains it."""
    return np.asarray(_median_of_three(strength) < _DIFFERS * usual)


def judge_ground(evidence: Evidence) -> GroundVerdict:
    """Decide which stretches have changed, and which of the new baseline's places are held back."""
    strength = _median_of_three(evidence.strength)
    usual = usual_strength(evidence.strength, evidence.sure)
    low = (strength < _DIFFERS * usual) & evidence.sure
    high = (strength >= _AGREES * usual) & (evidence.apart_m <= _PLACED_M)
    confirmed = high.copy()
    # Ground that is as a baseline of that time or older has it did not change since: a weak match has another reason.
    count = len(strength)
    dated = evidence.newer[count, :count]
    for old in np.flatnonzero(dated):
        as_old = dated & ~evidence.newer[:count, old]
        low[old] &= ~np.any((high & evidence.in_force)[as_old], axis=0)
    in_force, contradicted = evidence.in_force.copy(), np.zeros(len(evidence.at_m), bool)
    changed = []
    for drive in range(len(strength)):
        for first, last in runs(_bridged(low[drive])):
            span = slice(first, last + 1)
            if (last + 1 - first) * PLACE_M < _LEAST_M or not in_force[drive, span].any():
                continue
            agreeing = _agreeing(evidence, strength[:, span], evidence.apart_m[:, span], usual, drive)
            start_m, stop_m = float(evidence.at_m[first]) - PLACE_M / 2, float(evidence.at_m[last]) + PLACE_M / 2
            middle = float(np.nanmedian(strength[drive, span]))
            changed.append(ChangedGround(start_m, stop_m, first, last, drive, middle, agreeing))
            in_force[drive, span] &= not agreeing
            for other in agreeing:
                confirmed[other, span] |= np.isfinite(strength[other, span])
                in_force[other, span] |= confirmed[other, span]
            contradicted[span] |= not agreeing
    held = contradicted & ~np.any(high & in_force, axis=0)
    return GroundVerdict(tuple(changed), held, confirmed & ~held, usual)


def _agreeing(
    evidence: Evidence,
    strength: Float[np.ndarray, "drive part"],
    apart_m: Float[np.ndarray, "drive part"],
    usual: float,
    old: int,
) -> tuple[int, ...]:
    """Baselines newer than an old one that the new one, newer too, matches over most of a stretch."""
    new = len(strength)
    out = []
    for drive in np.flatnonzero(evidence.newer[:new, old] & evidence.newer[new, old]):
        told = np.isfinite(strength[drive])
        if told.mean() < _HALF or np.median(apart_m[drive, told]) > _PLACED_M:
            continue
        if np.median(strength[drive, told]) >= _AGREES * usual:
            out.append(int(drive))
    return tuple(out)


def _median_of_three(strength: Float[np.ndarray, "drive place"]) -> Float[np.ndarray, "drive place"]:
    """Median of each place and its two neighbours, of those that are known the lower one; NaN stays NaN."""
    padded = np.pad(strength, [(0, 0), (1, 1)], constant_values=np.nan)
    about = np.sort(np.stack([padded[:, :-2], padded[:, 1:-1], padded[:, 2:]]), axis=0)  # NaN goes last
    known = np.isfinite(about).sum(axis=0)
    middle = np.take_along_axis(about, (np.maximum(known - 1, 0) // 2)[None], axis=0)[0]
    return np.asarray(np.where(np.isfinite(strength), middle, np.nan))


def _bridged(low: Bool[np.ndarray, " place"]) -> Bool[np.ndarray, " place"]:
    """Stretches that differ, joined across few places."""
    out, stretches = low.copy(), runs(low)
    for (_, before), (after, _) in pairwise(stretches):
        if after - before - 1 <= _BRIDGED:
            out[before:after] = True
    return out
