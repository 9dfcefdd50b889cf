"""Scores of foreign ground on a map, for one array: the map's own traces moved to other places of it."""

import numpy as np
from jaxtyping import Float

from lgprjax.batch.chance import _scans_of, _StationChain, _swapped
from lgprjax.formats import MapFile
from lgprjax.radar import ArrayGeometry, uniform_array
from lgprjax.registration import PreparedGround, RegisterOptions
from lgprjax.registration.bayes import DriveFilter, Likelihood, measure_likelihood
from lgprjax.registration.queries import stops_of
from lgprjax.subsurface import GroundMap

_STRETCH, _STRETCHES = 16, 60  # stops of a stretch, and stretches
_HALF, _LEAST_PLACES = 10, 20  # places to each side that a stretch is scored at, and that must be on the map


def likelihood_of(source: MapFile, ground: GroundMap, array: ArrayGeometry, options: RegisterOptions) -> Likelihood:
    """Likelihood of an array's scans on a map, measured on the map alone.

    Args:
        source: map.
        ground: tiles of the map.
        array: array of the drive; only its number of channels matters, at the map's pitch.
        options: options of the search.
    """
    description = source.description
    channels = min(len(array.x_m), description.channels)
    own = uniform_array(channels, description.channel_pitch_m)
    prepared = PreparedGround(ground, own)
    stretches: list[Float[np.ndarray, "stop place"]] = []
    for swapped in _swapped(source, channels, options.search_half_m()):
        led = DriveFilter(prepared, _StationChain(ground), options, measure_likelihood([]))
        scans = _scans_of(source, swapped, channels)
        at, _ = led.choose(scans, 0.0)
        r, cover = led.correlations(stops_of(scans, at, own, ground.basis), _HALF)
        for low in range(0, len(r) - _STRETCH + 1, _STRETCH):
            some = slice(low, low + _STRETCH)
            whole = np.all(cover[some] > 1.0 - 1e-3, axis=0)
            if whole.sum() >= _LEAST_PLACES:
                stretches.append(r[some][:, whole])
        if len(stretches) >= _STRETCHES:
            break
    return measure_likelihood(stretches)
