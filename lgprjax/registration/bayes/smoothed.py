"""A recorded drive through the filter: stops gathered, led from both ends, joined, refined, spread to all scans."""

from collections.abc import Iterable

import jax
import numpy as np
from jaxtyping import Float

from lgprjax.radar import ArrayGeometry, centre_of
from lgprjax.registration.bayes.drive import DriveFilter, Followed, astray_of
from lgprjax.registration.bayes.likelihood import Likelihood
from lgprjax.registration.bayes.refine import Reach, fixes_of, refined_m
from lgprjax.registration.bayes.smooth import LAG, SEGMENT, join, reversed_report
from lgprjax.registration.fix import blank_fixes
from lgprjax.registration.judge import RegisterOptions
from lgprjax.registration.queries import LiveChain, LiveScans, Operators, Stops, stops_of
from lgprjax.registration.search import BLOCK_SCANS, DriveFixes, LiveBlock, Searched, live_chain, places_of, propagate
from lgprjax.registration.template_bank import PreparedGround
from lgprjax.subsurface import GroundMap


def smooth_drive(
    ground: GroundMap,
    operators: Operators,
    array: ArrayGeometry,
    blocks: Iterable[LiveBlock],
    options: RegisterOptions,
    *,
    likelihood: Likelihood,
    sigma_scale: float,
    recorded: int,
    prepared: PreparedGround,
) -> DriveFixes:
    """Fixes of every scan of a drive by the filter, smoothed by later scans.

    Args:
        ground: from ``ground_map_for`` with the same options.
        operators: of the drive's recording at a time scale, with the map's settings.
        array: geometry of the drive.
        blocks: the drive's scans in order.
        options: of the search.
        likelihood: of map and array.
        sigma_scale: of the map, measured by the search's matches.
        recorded: numbers of a trace.
        prepared: of ground and array.
    """
    chain = live_chain(ground, operators, array, recorded)
    led = DriveFilter(prepared, chain, options, likelihood)
    scans, stops, chosen = _gathered(chain, led, blocks, array, ground)
    side_m = refined_m(led.wavelength_m)
    astray, parts = astray_of(stops), [(blank_fixes(0), np.zeros((0, 2, 2)), np.zeros(0))]
    for low in range(0, len(stops.number), SEGMENT):
        high = min(low + SEGMENT, len(stops.number))
        own = Stops(*(field[low : min(high + LAG, len(stops.number))] for field in stops))
        here = Stops(*(field[: high - low] for field in own))
        found = _smoothed(led.follow(here, astray[low:high]), own, prepared, chain, options, led)
        parts.append(fixes_of(here, found, led, prepared, chain, options, sigma_scale, Reach(side_m, side_m)))
    fix, beside, scale = jax.tree.map(lambda *fields: np.concatenate(fields), *parts)
    place = places_of(scans, centre_of(array))
    return _spread(scans, chosen, Searched(fix, place[chosen], scans.track.leg[chosen], beside, scale), place)


def _gathered(
    chain: LiveChain, led: DriveFilter, blocks: Iterable[LiveBlock], array: ArrayGeometry, ground: GroundMap
) -> tuple[LiveScans, Stops, np.ndarray]:
    """All scans without their traces, the stops, and numbers of the scans that they are."""
    parts: list[Stops] = []
    scans: list[LiveScans] = []
    next_m: float | None = None
    for block in blocks:
        part = chain.feed(block.traces, block.valid, block.track, BLOCK_SCANS)
        at, next_m = led.choose(part, float(part.path_m[0]) if next_m is None else next_m)
        if part.background is not None:
            for earlier in parts:
                earlier.filtered[:] -= np.where(earlier.valid[..., None], part.background, np.float32(0.0))
        parts.append(stops_of(part, at, array, ground.basis))
        scans.append(part._replace(filtered=part.filtered[:0], valid=part.valid[:0], background=None))
    stops = Stops(*(np.concatenate(field) for field in zip(*parts, strict=True)))
    track = type(scans[0].track)(*(np.concatenate(f) for f in zip(*(each.track for each in scans), strict=True)))
    number, path_m, reckoned_m = (
        np.concatenate([getattr(each, name) for each in scans]) for name in ("number", "path_m", "dead_reckoned_m")
    )
    joined = scans[0]._replace(track=track, number=number, path_m=path_m, dead_reckoned_m=reckoned_m)
    return joined, stops, stops.number


def _smoothed(
    forward: Followed,
    stops: Stops,
    prepared: PreparedGround,
    chain: LiveChain,
    options: RegisterOptions,
    led: DriveFilter,
) -> Followed:
    """The forward report joined with that of a filter that comes from the other end of these stops."""
    back = Stops(*(field[::-1] for field in stops))
    back = back._replace(path_m=back.path_m[:1] - back.path_m, leg=-back.leg)
    other = DriveFilter(prepared, chain, options, led.likelihood)
    count = len(forward.p_false)
    backward = reversed_report(other.follow(back, astray_of(stops)[::-1]))
    after = min(count + 1, len(stops.number))
    last = np.zeros(after, bool)
    last[: after - 1] = stops.leg[: after - 1] != stops.leg[1:after]
    last[-1] = True
    padded = Followed(
        *(
            np.concatenate([a, b[count:after]])
            for a, b in zip(forward, Followed(*(f[:after] for f in backward)), strict=True)
        )
    )
    both = join(padded, Followed(*(f[:after] for f in backward)), last, led.step_m, led.places, led.wavelength_m)
    return Followed(*(field[:count] for field in both))


def _spread(scans: LiveScans, stops: np.ndarray, found: Searched, place: Float[np.ndarray, "scan 3"]) -> DriveFixes:
    """Fixes of all scans: each that of the nearest stop of its leg."""
    count, leg, path_m = len(scans.number), scans.track.leg, scans.path_m
    searched = np.zeros(count, bool)
    searched[stops] = True
    if not len(stops):
        return propagate(scans, place, found, np.full(count, -1), searched)
    owner = np.maximum(np.searchsorted(stops, np.arange(count), side="right") - 1, 0)
    after = np.minimum(owner + 1, len(stops) - 1)
    closer = path_m[stops[after]] - path_m < path_m - path_m[stops[owner]]
    owner = np.where(closer & (leg[stops[after]] == leg), after, owner)
    return propagate(scans, place, found, owner, searched)
