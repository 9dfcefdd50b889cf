"""Polarity, time zero, gain and direction of a surveyed line against a map, found from the match itself.

Antennas of hand-drawn radars are turned about, recorders are set up anew every morning, and a line's start is where its
sheet says. Against a map of another day or another instrument a drive then scores nothing, or less than nothing. A few
stretches of it are matched with each of a few hypotheses; those that are no match score as foreign ground does, so that
the chances of all pieces together (Fisher's method) say which one is right, or that none is.
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace
from itertools import product
from typing import NamedTuple

import numpy as np
from scipy.stats import chi2

from lgprjax.archive.depth_levels import AS_STATED, Alignment, live_operators
from lgprjax.archive.held_ground import HeldGround
from lgprjax.archive.recordings import recording_of
from lgprjax.formats import DriveLog, MapFile, TraceRecording
from lgprjax.registration import (
    BLOCK_SCANS,
    PIECE_M,
    EvidenceSearch,
    LiveScans,
    RegisterOptions,
    Track,
    live_chain,
    p_foreign,
)

_STRETCHES, _STRETCH_M = 3, 16.0
_SHIFT_PERIODS = 0.2
"""Between hypotheses of the time zero: a match's own width is more."""
_FARTHEST = 8
_SHARE = 0.01
"""Of the risk, that foreign ground brings a hypothesis about."""
_MAIN_LOBE = 3.0
"""Evidence of the best sign and direction over the others, at which no other time zeros are looked at."""
_ALIKE = 0.8
_CLEAR = 1.5
"""Evidence of the best hypothesis over that of any that is not its neighbour."""


class _Evidence(NamedTuple):
    """Chances of a drive's pieces together, as Fisher's chi-square and its chance; ``pieces`` that told anything."""

    total: float
    chance: float
    pieces: int


def may_be_misaligned(log: DriveLog) -> bool:
    """Whether a drive was imported from lines, whose headers are filled in by hand."""
    return "lines" in log.description.provenance and isinstance(log.description.recording, TraceRecording)


def reversed_track(track: Track) -> Track:
    """The same places in the opposite order, as a vehicle drives them that reverses: antennas keep their sides."""
    return track._replace(
        pose=track.pose[::-1],
        travel_m=-track.travel_m,
        speed_mps=-track.speed_mps,
        sigma_m=track.sigma_m[::-1],
        sigma_yaw_rad=track.sigma_yaw_rad[::-1],
    )


def find_alignment(
    source: MapFile, log: DriveLog, track: Track, options: RegisterOptions, held: HeldGround
) -> Alignment:
    """The hypothesis that the drive's ground agrees with, if one does; else ``AS_STATED``.

    What is taken as stated would have been taken so without a look. Another hypothesis is taken only where foreign
    ground would hardly ever have brought it about, and that chance, of all that were tried, is added to its fixes'.

    Args:
        source: the map.
        log: a drive of traces.
        track: of the drive in the map's frame.
        options: the search.
        held: ground of the map.
    """
    settings = source.description.settings
    period_ns = 2e9 / (settings.band_low_hz + settings.band_high_hz)
    search = replace(options, time_scale=1.0, window_m=None, own_thresholds=None)

    def evidence(alignment: Alignment) -> _Evidence:
        return _evidence(source, log, track, search, held, alignment)

    assumed = log.description.provenance.get("assumed")
    either = (False, True) if isinstance(assumed, dict) and "direction" in assumed else (False,)
    found: dict[Alignment, _Evidence] = {}

    def look(levels: Sequence[bool], steps: Sequence[int]) -> Alignment:
        """Look at more hypotheses; the best of all so far."""
        for sign, levelled, step, back in product((1, -1), levels, steps, either):
            alignment = Alignment(sign, step * _SHIFT_PERIODS * period_ns, levelled, back)
            if alignment not in found:
                found[alignment] = evidence(alignment)
        return max(found, key=lambda key: found[key].total)

    best = look((False,), (0,))
    if found[best].pieces == 0:
        return AS_STATED
    # A wave resembles itself a period later, with the other sign half a period later. At its own place it has one sign,
    # and is more than there; where it does not look so, every time zero is looked at.
    plain = found[best].total >= _MAIN_LOBE * max(each.total for key, each in found.items() if key != best)
    for sign, periods in product((1, -1), (-1.0, -0.5, 0.5, 1.0)) if plain else ():
        beside = best._replace(sign=sign * best.sign, later_ns=periods * period_ns)
        found[beside] = evidence(beside)
        plain &= found[beside].total < found[best].total
    if not plain:
        best = look((False,), range(-_FARTHEST, _FARTHEST + 1))
    if found[best].chance * len(found) > _SHARE * options.risk:
        best = look((True,), (0,))
    if best != AS_STATED:
        for part in (-0.5, 0.5):
            near = best._replace(later_ns=best.later_ns + part * _SHIFT_PERIODS * period_ns)
            found[near] = evidence(near)
        best = max(found, key=lambda key: found[key].total)
    # Height moves a wave as well: among neighbours that are about as good, the one nearest to what is stated.
    alike = [
        key
        for key, each in found.items()
        if key._replace(later_ns=best.later_ns) == best
        and abs(key.later_ns - best.later_ns) < 1.1 * _SHIFT_PERIODS * period_ns
        and each.total >= _ALIKE * found[best].total
    ]
    best = min(alike, key=lambda key: abs(key.later_ns))
    others = [
        each.total
        for key, each in found.items()
        if (key.sign, key.reversed) != (best.sign, best.reversed)
        or abs(key.later_ns - best.later_ns) > 2.1 * _SHIFT_PERIODS * period_ns
    ]
    tried = len(found)
    chance = found[best].chance * tried
    if chance > _SHARE * options.risk:
        told = f"polarity and time zero as stated: none of {tried} others matches the map better than chance"
        return AS_STATED._replace(told=told)
    if found[best].total < _CLEAR * max(others, default=0.0):
        return AS_STATED._replace(told=f"polarity and time zero as stated: {tried} others are ambiguous")
    if best == AS_STATED:
        return AS_STATED
    parts = [
        "inverted" if best.sign < 0 else "",
        f"time zero {best.later_ns:+.2f} ns" if best.later_ns else "",
        "depths levelled as the map's" if best.levelled else "",
        "walked the other way" if best.reversed else "",
    ]
    told = ", ".join(part for part in parts if part)
    return best._replace(chance=chance, told=f"against the map: {told} (found among {tried})")


def _evidence(
    source: MapFile, log: DriveLog, track: Track, options: RegisterOptions, held: HeldGround, alignment: Alignment
) -> _Evidence:
    moved = reversed_track(track) if alignment.reversed else track
    operators = live_operators(source, log, moved, alignment)
    array = log.description.array
    prepared = held.prepared_for(array)
    wavelength_m = source.description.settings.wavelength_m
    piece_m = PIECE_M * max(1.0, wavelength_m)
    chances: list[float] = []
    for traces, valid, part in _stretches(log, moved, max(_STRETCH_M, 3.0 * piece_m)):
        chain = live_chain(held.ground, operators, log.channels, int(operators(1.0).shape[0]))
        search = EvidenceSearch(prepared, chain, options, held.chance)
        scans: LiveScans = chain.feed(traces, valid, part, BLOCK_SCANS)
        path_m, z, area_m2 = search.highest(scans)
        chance = held.chance.for_windows(search.plan.windows_m, wavelength_m)
        p = p_foreign(np.nan_to_num(z, nan=0.0), area_m2, chance, float(len(search.plan.windows_m)))
        piece = np.floor((path_m - path_m[0]) / piece_m)
        for number in np.unique(piece):
            own = piece == number
            if np.isfinite(z[own]).any():
                chances.append(float(np.clip(np.min(p[own][np.isfinite(z[own])]), 1e-300, 1.0)))
    total = -2.0 * float(np.sum(np.log(chances))) if chances else 0.0
    return _Evidence(total, float(chi2.sf(total, 2 * len(chances))) if chances else 1.0, len(chances))


def _stretches(log: DriveLog, track: Track, length_m: float) -> Iterator[tuple[np.ndarray, np.ndarray, Track]]:
    """Some stretches spread over a drive, no longer than a block."""
    path_m = np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[0])))
    wanted = min(_STRETCHES, max(1, int(path_m[-1] / length_m)))
    for begin_m in np.linspace(0.0, max(path_m[-1] - length_m, 0.0), wanted):
        first = int(np.searchsorted(path_m, begin_m))
        last = min(int(np.searchsorted(path_m, begin_m + length_m)) + 1, first + BLOCK_SCANS, len(path_m))
        block = next(recording_of(log).blocks(last - first, first))
        yield block.recorded, block.valid, Track(*(field[first:last] for field in track))
