"""Plausibility of recorded positions and clocks: one test for every reader and for ``check``.

A receiver writes zeros before its first fix, a wrong date until it has received the satellites' calendar, and now and
then a position that no vehicle can have reached. Such records are left out, and counted by reason.
"""

from collections import Counter
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

# Positions.

FASTEST_MPS = 70.0
"""Largest plausible speed of a survey vehicle."""
_STEP_M = 30.0
"""Largest step of a receiver at rest, from a poor fix to a good one; larger steps must be travel."""
_STEP_SIGMAS = 6.0
_STEPS_A_TRACE = 20
_EARTH_M = 6_371_000.0
_MOST_LINKS = 200
"""Earlier runs of positions from which a run may continue: bounds the time of a search among noise."""
NO_PLACE = "out of range or not a number"
ZEROS = "at latitude 0, longitude 0"
ASTRAY = "farther from the others than the vehicle can have travelled"
IMPLAUSIBLE = (NO_PLACE, ZEROS, ASTRAY)


class PlausiblePositions(NamedTuple):
    """Result of ``plausible_positions``.

    Attributes:
        kept: mask of positions to use.
        longitude_deg: longitude of all positions, from -180 to 180; NaN without a position.
        left_out: number of other positions, by reason.
    """

    kept: Bool[np.ndarray, " position"]
    longitude_deg: Float[np.ndarray, " position"]
    left_out: dict[str, int]

    def in_words(self) -> str:
        """Description of the positions left out; empty if there are none."""
        return left_out_in_words(self.left_out, len(self.kept))


def plausible_positions(
    latitude_deg: Float[np.ndarray, " position"],
    longitude_deg: Float[np.ndarray, " position"],
    reach_m: Float[np.ndarray, " position"] | None,
    sigma_m: Float[np.ndarray, " position"] | None = None,
) -> PlausiblePositions:
    """Judge positions by their values and by each other.

    Left out are: non-finite values, latitudes beyond 90 or longitudes beyond 360 degrees; zero for both if the other
    positions are elsewhere; and positions that the rest contradicts. The rest is the longest sequence in which every
    position is within the vehicle's possible travel of the previous one, plus a step of the receiver (30 m, and six
    sigmas of the two); repeated positions count once.

    Args:
        latitude_deg, longitude_deg: WGS-84, in order of time; longitudes from -360 to 360.
        reach_m: upper bound of the travel since the first position, never falling; ``None`` without a clock, for
            positions of traces: 20 usual steps from each to the next.
        sigma_m: horizontal standard deviation per axis; NaN if unknown.
    """
    there = on_earth(latitude_deg, longitude_deg)
    latitude_deg, longitude_deg = (np.where(there, each, np.nan) for each in (latitude_deg, longitude_deg))
    turned = np.where(np.abs(longitude_deg) > 180.0, (longitude_deg + 180.0) % 360.0 - 180.0, longitude_deg)
    zeros = there & (latitude_deg == 0.0) & (longitude_deg == 0.0)
    places = _on_sphere_m(latitude_deg, turned)
    others = np.flatnonzero(there & ~zeros)
    # A site without a place on the earth has its origin there, and its other positions near it.
    if zeros.any() and (not len(others) or _far_from_zero(places[others])):
        kept = there & ~zeros
    else:
        kept, zeros = there.copy(), np.zeros(len(zeros), bool)
    at = np.flatnonzero(kept)
    allowed_m = np.full(len(at), _STEP_M / 2.0)
    if sigma_m is not None:
        allowed_m += _STEP_SIGMAS * np.nan_to_num(sigma_m[at], nan=0.0, posinf=0.0, neginf=0.0)
    kept[at] = _longest_sequence(places[at], None if reach_m is None else reach_m[at], allowed_m)
    counts = {NO_PLACE: ~there, ZEROS: zeros, ASTRAY: there & ~zeros & ~kept}
    left_out = {reason: int(np.count_nonzero(which)) for reason, which in counts.items() if which.any()}
    return PlausiblePositions(kept, turned, left_out)


def on_earth(
    latitude_deg: Float[np.ndarray, " position"], longitude_deg: Float[np.ndarray, " position"]
) -> Bool[np.ndarray, " position"]:
    """Whether degrees are a place: latitudes to 90, longitudes to 180, or 360 where they count one way."""
    with np.errstate(invalid="ignore"):
        return np.asarray((np.abs(latitude_deg) <= 90.0) & (np.abs(longitude_deg) <= 360.0))


def reach_in_time_m(time_s: Float[np.ndarray, " position"]) -> Float[np.ndarray, " position"]:
    """Upper bound of the travel by times alone; steps backward count like steps forward."""
    return FASTEST_MPS * np.concatenate([np.zeros(min(1, len(time_s))), np.cumsum(np.abs(np.diff(time_s)))])


def plausible_places(
    x_m: Float[np.ndarray, " position"],
    y_m: Float[np.ndarray, " position"],
    reach_m: Float[np.ndarray, " position"] | None,
) -> Bool[np.ndarray, " position"]:
    """Mask of plausible positions in metres of a plane, all finite: those that the rest does not contradict."""
    places = np.stack([x_m, y_m, np.zeros_like(x_m)], axis=1)
    return _longest_sequence(places, reach_m, np.full(len(x_m), _STEP_M / 2.0))


def known_sigma(sigma: Float[np.ndarray, " record"]) -> Float[np.ndarray, " record"]:
    """Stated sigmas or variances; NaN (unknown) for zero, negative or non-finite values."""
    return np.where(np.isfinite(sigma) & (sigma > 0.0), sigma, np.nan)


def left_out_in_words(left_out: Mapping[str, int], total: int) -> str:
    """Counts of records that were left out, as text; empty without any."""
    texts = ", ".join(f"{count} {reason}" for reason, count in left_out.items())
    return f"left out {sum(left_out.values())} of {total} positions ({texts})" if texts else ""


def _on_sphere_m(
    latitude_deg: Float[np.ndarray, " position"], longitude_deg: Float[np.ndarray, " position"]
) -> Float[np.ndarray, "position 3"]:
    """Places on a sphere: its chords are distances, across the date line and at the poles too."""
    latitude, longitude = np.radians(latitude_deg), np.radians(longitude_deg)
    axes = (np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude), np.sin(latitude))
    return _EARTH_M * np.stack(axes, axis=1)


_SITE_M = 10_000.0


def _far_from_zero(places_m: Float[np.ndarray, "position 3"]) -> bool:
    return bool(np.median(np.linalg.norm(places_m - [_EARTH_M, 0.0, 0.0], axis=1)) > _SITE_M)


def _longest_sequence(
    places_m: Float[np.ndarray, "position 3"],
    reach_m: Float[np.ndarray, " position"] | None,
    allowed_m: Float[np.ndarray, " position"],
) -> Bool[np.ndarray, " position"]:
    """The positions of the longest sequence of runs: a run ends where the next position is out of reach."""
    count = len(places_m)
    if not count:
        return np.zeros(0, bool)
    step_m = np.linalg.norm(np.diff(places_m, axis=0), axis=1)
    if reach_m is None:
        reach_m = _STEPS_A_TRACE * (float(np.median(step_m)) if count > 1 else 0.0) * np.arange(count)
    breaks = np.flatnonzero(step_m > np.diff(reach_m) + allowed_m[1:] + allowed_m[:-1]) + 1
    first, stop = np.concatenate([[0], breaks]), np.concatenate([breaks, [count]])
    # A receiver that repeats its last known place has one position, at any number of repetitions.
    best = np.add.reduceat(np.concatenate([[1], step_m > 0.0]), first)
    before = np.full(len(first), -1)
    for run in range(1, len(first)):
        earlier = np.arange(max(0, run - _MOST_LINKS), run)
        ends, begin = stop[earlier] - 1, first[run]
        apart_m = np.linalg.norm(places_m[begin] - places_m[ends], axis=1)
        reached = apart_m <= reach_m[begin] - reach_m[ends] + allowed_m[begin] + allowed_m[ends]
        lengths = np.where(reached, best[earlier], 0)
        link = int(np.argmax(lengths))
        if lengths[link]:
            best[run] += lengths[link]
            before[run] = earlier[link]
    kept = np.zeros(count, bool)
    run = int(np.argmax(best))
    while run >= 0:
        kept[first[run] : stop[run]] = True
        run = int(before[run])
    return kept


# Lengths of a path by two sources.

_OTHER_LENGTH = 1.5


def lengths_disagree(one_m: float, other_m: float) -> bool:
    """Whether a stated length, zero if it is not, and another one are not both right: 1.5 times as long, or less."""
    return one_m > 0.0 and max(one_m, other_m) > _OTHER_LENGTH * min(one_m, other_m)


def path_length_m(
    latitude_deg: Float[np.ndarray, " position"], longitude_deg: Float[np.ndarray, " position"], least_m: float
) -> float:
    """Length of the polyline through positions at least so far apart, and the last one: noise adds no length to it."""
    places = _on_sphere_m(latitude_deg, longitude_deg)
    length_m, last = 0.0, places[0]
    for place in places[1:]:
        step_m = float(np.linalg.norm(place - last))
        if step_m >= least_m:
            length_m, last = length_m + step_m, place
    return length_m + float(np.linalg.norm(places[-1] - last))


# Clocks with a date.

_RECORDING_NS = 86_400 * 10**9


def of_one_recording(stamp_ns: Int[np.ndarray, " record"]) -> Bool[np.ndarray, " record"]:
    """Which stamps are within a day of the middle one: computers without a battery begin in 1970, or years behind."""
    if not len(stamp_ns):
        return np.zeros(0, bool)
    middle = np.sort(stamp_ns)[len(stamp_ns) // 2]
    return np.asarray(np.abs(stamp_ns - middle) <= _RECORDING_NS)


# Clocks that state a time of day with every record, and a date with some.

_DAY_S = 86_400.0
_SILENT_S = 30.0
"""Records with less time between them are of one run of the clock, and of one date."""
_SAME_LOG_DAYS = 366
"""Dates of a log farther apart are not both right: receivers begin years away, or 1,024 weeks."""


class DatedClock(NamedTuple):
    """Result of ``date_by_majority``.

    Attributes:
        time_s: time of each record since day 0; all NaN without any date.
        other_dates: number of records whose own date was not used, by that day.
    """

    time_s: Float[np.ndarray, " record"]
    other_dates: dict[int, int]


def date_by_majority(day_s: Float[np.ndarray, " record"], day: Sequence[int | None]) -> DatedClock:
    """Times of records in the order of a log, by their times of day and by the dates that most of them have.

    The clock is continuous within a run of records: it has one date, that of most of its records, and midnights are
    counted. A run without a date, or with one more than a year from that of most records of the log, follows the run
    before it, or precedes the next one. The time of day is always kept.

    Args:
        day_s: time of day, s.
        day: number of each record's own day; ``None`` without one.
    """
    count = len(day_s)
    # Steps of the time of day are less than half a day either way: midnights pass unseen otherwise.
    steps_s = (np.diff(day_s) + 0.5 * _DAY_S) % _DAY_S - 0.5 * _DAY_S
    clock_s = np.concatenate([day_s[:1], day_s[:1] + np.cumsum(steps_s)])
    first = np.concatenate([[0], np.flatnonzero(np.abs(steps_s) > _SILENT_S) + 1])
    stop = np.append(first[1:], count)
    # The day at which the clock's zero would be, by each dated record.
    zero = [None if each is None else each - round((clock_s[i] - day_s[i]) / _DAY_S) for i, each in enumerate(day)]
    votes = [Counter(each for each in zero[a:b] if each is not None) for a, b in zip(first, stop, strict=True)]
    days = sorted(each for each in day if each is not None)
    if not days:
        return DatedClock(np.full(count, np.nan), {})
    usual = days[len(days) // 2]
    chosen: list[int | None] = []
    for a, vote in zip(first, votes, strict=True):
        near = [(n, each) for each, n in vote.items() if abs(each + clock_s[a] // _DAY_S - usual) <= _SAME_LOG_DAYS]
        chosen.append(max(near, key=lambda pair: pair[0])[1] if near else None)
    _fill(chosen, clock_s[first], clock_s[stop - 1])
    time_s = np.empty(count)
    other: Counter[int] = Counter()
    for a, b, base in zip(first, stop, chosen, strict=True):
        assert base is not None
        time_s[a:b] = clock_s[a:b] + _DAY_S * base
        dated = zip(day[a:b], zero[a:b], strict=True)
        other.update(told for told, at in dated if told is not None and at is not None and at != base)
    return DatedClock(time_s, dict(other))


def _fill(chosen: list[int | None], begin_s: Float[np.ndarray, " run"], end_s: Float[np.ndarray, " run"]) -> None:
    """Date the runs without a date: soon after the run before them, or, at the start, soon before the next one."""
    known = [i for i, each in enumerate(chosen) if each is not None]
    for i in range(known[0] - 1, -1, -1):
        following = chosen[i + 1]
        assert following is not None
        chosen[i] = following + int(np.floor((begin_s[i + 1] - end_s[i]) / _DAY_S))
    for i in range(known[0] + 1, len(chosen)):
        before = chosen[i - 1]
        if chosen[i] is None and before is not None:
            chosen[i] = before - int(np.floor((begin_s[i] - end_s[i - 1]) / _DAY_S))
