"""A map's own stations as live scans: matched against the ground of the other baselines, and against their own.

The score, the search and the judgement are those of registration, with its default thresholds.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.archive.station_matching import register_stations, turned_by
from lgprjax.formats import MapFile
from lgprjax.radar import to_coefficients
from lgprjax.registration import RegisterOptions
from lgprjax.subsurface import GroundMap, MapDescription, StationPlaces, Stations


class Matches(NamedTuple):
    """Templates matched, one row each; NaN where it was not tried.

    Attributes:
        along_m, cross_m: where the ground puts the station less where its label does, in the station's heading.
        sigma_m: larger of the match's sigmas along and across.
        correlation: at the match.
        strength: correlation times the root of the overlap.
        rival: strength of the best place at least 0.6 of a wavelength away, within the search region.
        share: of the template's traces that lie over the ground it is matched with.
        code: of registration; ``off_map`` where it was not tried.
    """

    along_m: Float[np.ndarray, " template"]
    cross_m: Float[np.ndarray, " template"]
    sigma_m: Float[np.ndarray, " template"]
    correlation: Float[np.ndarray, " template"]
    strength: Float[np.ndarray, " template"]
    rival: Float[np.ndarray, " template"]
    share: Float[np.ndarray, " template"]
    code: Int[np.ndarray, " template"]


class KeptStations:
    """A database of which only some stations hold data: a ``StationSource``.

    All stations keep their places, so that tiles have the shapes of the whole map's and nothing is compiled anew.

    Args:
        source: the database.
        kept: stations that hold data.
    """

    def __init__(self, source: MapFile, kept: Bool[np.ndarray, " scan"]) -> None:
        self._source = source
        self.kept: Bool[np.ndarray, " scan"] = kept
        self.description: MapDescription = source.description
        self.places: StationPlaces = source.places
        self.tile_frame: Float[np.ndarray, "tile 3"] = source.tile_frame
        self.height_reference_m: Float[np.ndarray, " tile"] = source.height_reference_m

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Profiles of the stations with these rising numbers; the others are not valid."""
        kept = self.kept[stations]
        read = self._source.read_stations(stations[kept])

        def spread(values: np.ndarray) -> np.ndarray:
            out = np.zeros((len(stations), *values.shape[1:]), values.dtype)
            out[kept] = values
            return out

        return Stations(*(spread(field) for field in read))


class OtherBaselines(KeptStations):
    """A database in which one baseline holds no data.

    Args:
        source: the database.
        left_out: number of the baseline.
    """

    def __init__(self, source: MapFile, left_out: int) -> None:
        super().__init__(source, np.asarray(source.drive != left_out))


def match_stations(
    source: MapFile,
    ground: GroundMap,
    tile: int,
    stations: Int[np.ndarray, " template"],
    options: RegisterOptions,
) -> Matches:
    """Match templates about stations of a database against a tile.

    Only the traces that lie over the tile's ground where their labels put them take part: what a neighbouring lane
    does not reach is no disagreement.

    Args:
        source: the database that the stations come from.
        ground: its tiles, or those of its other baselines.
        tile: number of the tile.
        stations: numbers of the templates' last stations.
        options: the search.
    """
    pose = source.pose[stations]
    prior, fix, share = register_stations(source, ground, tile, stations, pose, options, over_ground=True)
    off = np.asarray(fix.pose, dtype=np.float64)[:, :2] - prior[:, :2]
    turned_back = turned_by(off[:, None], -prior[:, 3])[:, 0]
    covariance = np.asarray(fix.covariance, dtype=np.float64)
    return Matches(
        along_m=turned_back[:, 0],
        cross_m=turned_back[:, 1],
        sigma_m=np.sqrt(np.maximum(covariance[:, 0, 0], covariance[:, 1, 1])),
        correlation=np.asarray(fix.correlation, dtype=np.float64),
        strength=np.asarray(fix.margin, dtype=np.float64) + np.asarray(fix.runner_up, dtype=np.float64),
        rival=np.asarray(fix.runner_up, dtype=np.float64),
        share=share,
        code=np.asarray(fix.code),
    )


class StretchSignal(NamedTuple):
    """What the stations about one place hold.

    Attributes:
        power: mean square of the gained traces.
        repeats: correlation with the stations an eighth of a wavelength farther: the share that is ground.
        beside: for each pair of neighbouring channels, sum of products and root of the product of the powers.
    """

    power: float
    repeats: float
    beside: Float[np.ndarray, "pair 2"]


def signal_about(source: MapFile, ground: GroundMap, station: int, reach: int, lag: int) -> StretchSignal:
    """Signal of the stations ``reach`` to each side of one, of its own baseline."""
    numbers = np.arange(max(station - reach, 0), min(station + reach + lag + 1, len(source.pose)))
    numbers = numbers[source.drive[numbers] == source.drive[station]]
    read = source.read_stations(numbers)
    full = 2 * reach + lag + 1
    profile = np.zeros((full, *read.profile.shape[1:]), np.float32)
    valid = np.zeros((full, read.valid.shape[1]), bool)
    profile[: len(numbers)], valid[: len(numbers)] = read.profile, read.valid
    value = np.asarray(to_coefficients(jnp.asarray(profile), jnp.asarray(valid), ground.basis), dtype=np.float64)
    power = np.sum(value**2, axis=2)

    def product(a: np.ndarray, b: np.ndarray, both: Bool[np.ndarray, "..."]) -> np.ndarray:
        return np.where(both, np.sum(a * b, axis=2), 0.0)

    both = valid[lag:] & valid[:-lag]
    level = np.sqrt(np.sum(power[lag:], where=both) * np.sum(power[:-lag], where=both))
    pair = valid[:, 1:] & valid[:, :-1]
    beside = np.stack(
        [
            product(value[:, 1:], value[:, :-1], pair).sum(axis=0),
            np.sqrt(np.sum(power[:, 1:], axis=0, where=pair) * np.sum(power[:, :-1], axis=0, where=pair)),
        ],
        axis=1,
    )
    return StretchSignal(
        power=float(np.sum(power, where=valid) / max(int(valid.sum()), 1)),
        repeats=float(product(value[lag:], value[:-lag], both).sum() / level) if level > 0.0 else 0.0,
        beside=beside,
    )
