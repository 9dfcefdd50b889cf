"""A map's own stations as live scans: matched against the ground of the other baselines, and against their own.

The score, the search and the judgement are those of registration, with its default thresholds.
"""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.archive.map_route import mask_of, on_map
from lgprjax.formats import MapFile
from lgprjax.radar import to_coefficients, uniform_array
from lgprjax.registration import (
    Code,
    Problem,
    RegisterOptions,
    Template,
    register_batch,
    rules_of,
    search_spec_for,
    to_tile,
)
from lgprjax.subsurface import GroundMap, MapDescription, Stations

_LANES = 4  # a tile of usual spacing holds three or four places
_FEW_CHANNELS = 3  # an array of no more channels is matched in windows
_WINDOW_WAVELENGTHS = 4.0
_ROOM_M = 0.15  # to both sides: a trace at the rim would be lost on the way to the match, and hold it back
_LEAST_TRACES = 0.25  # of a template that lie over the other baselines' ground: fewer say nothing


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


class OtherBaselines:
    """A database in which one baseline holds no data: a ``StationSource``.

    All stations keep their places, so that tiles have the shapes of the whole map's and nothing is compiled anew.

    Args:
        source: the database.
        left_out: number of the baseline.
    """

    def __init__(self, source: MapFile, left_out: int) -> None:
        self._source = source
        self.kept: Bool[np.ndarray, " scan"] = np.asarray(source.drive != left_out)
        self.description: MapDescription = source.description
        self.pose: Float[np.ndarray, "scan 5"] = source.pose
        self.drive: Int[np.ndarray, " scan"] = source.drive
        self.ground_up_m: Float[np.ndarray, " scan"] = source.ground_up_m
        self.tile_frame: Float[np.ndarray, "tile 3"] = source.tile_frame
        self.height_reference_m: Float[np.ndarray, " tile"] = source.height_reference_m

    def read_stations(self, stations: Int[np.ndarray, " scan"]) -> Stations:
        """Profiles of the stations with these rising numbers; those of the baseline left out are not valid."""
        kept = self.kept[stations]
        read = self._source.read_stations(stations[kept])

        def spread(values: np.ndarray) -> np.ndarray:
            out = np.zeros((len(stations), *values.shape[1:]), values.dtype)
            out[kept] = values
            return out

        return Stations(*(spread(field) for field in read))


def window_stations(description: MapDescription) -> int:
    """Stations of a template: one of an array; four wavelengths where three channels or fewer say too little."""
    if description.channels > _FEW_CHANNELS:
        return 1
    return 1 + round(_WINDOW_WAVELENGTHS * description.settings.wavelength_m / description.settings.step_m)


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
    description, basis = ground.description, ground.basis
    frame, mask = ground.frame(tile), mask_of(ground.tile(tile))
    count = window_stations(description)
    channels, step_m = description.channels, description.settings.step_m
    spec = search_spec_for(
        ground, tile, uniform_array(channels, description.channel_pitch_m), _searched(options, count, step_m)
    )
    rules = rules_of(description.settings.wavelength_m, channels, count * channels, options)
    half_width = np.array([options.search_m, options.search_m, options.height_m, np.radians(1.0), np.radians(1.5)])
    parts = []
    for low in range(0, len(stations), _LANES):
        chosen = stations[low : low + _LANES]
        lanes = np.concatenate([chosen, np.full(_LANES - len(chosen), chosen[0])])
        template = _templates(source, lanes, count, basis_of=ground)
        prior = to_tile(source.pose[lanes], frame)
        turned = _turned(np.asarray(template.offset_m, dtype=np.float64), prior[:, 3])
        there = np.asarray(template.valid)
        aside = np.stack([-np.sin(prior[:, 3]), np.cos(prior[:, 3])], axis=-1)[:, None]
        for room_m in (0.0, _ROOM_M, -_ROOM_M) if channels > _FEW_CHANNELS else (0.0,):
            there = there & on_map(mask, prior[:, None, :2] + turned + room_m * aside)
        share = there.sum(axis=1) / np.maximum(np.asarray(template.valid).sum(axis=1), 1)
        fix = register_batch(
            ground.tile(tile),
            Problem(
                template=template._replace(valid=jnp.asarray(there)),
                prior=jnp.asarray(prior, dtype=jnp.float32),
                half_width=jnp.asarray(np.tile(half_width, (_LANES, 1)), dtype=jnp.float32),
                finite=jnp.asarray(share >= _LEAST_TRACES),
                number=jnp.asarray(lanes, dtype=jnp.uint32),
            ),
            rules,
            jnp.float32(ground.source.height_reference_m[tile]),
            basis.angular_frequency_rad_per_ns,
            spec=spec,
        )
        off = np.asarray(fix.pose, dtype=np.float64)[:, :2] - prior[:, :2]
        turned_back = _turned(off[:, None], -prior[:, 3])[:, 0]
        covariance = np.asarray(fix.covariance, dtype=np.float64)
        strength = np.asarray(fix.margin, dtype=np.float64) + np.asarray(fix.runner_up, dtype=np.float64)
        code = np.where(share >= _LEAST_TRACES, np.asarray(fix.code), int(Code.OFF_MAP))
        row = Matches(
            along_m=turned_back[:, 0],
            cross_m=turned_back[:, 1],
            sigma_m=np.sqrt(np.maximum(covariance[:, 0, 0], covariance[:, 1, 1])),
            correlation=np.asarray(fix.correlation, dtype=np.float64),
            strength=strength,
            rival=np.asarray(fix.runner_up, dtype=np.float64),
            share=share,
            code=code,
        )
        parts.append(Matches(*(field[: len(chosen)] for field in row)))
    return Matches(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _searched(options: RegisterOptions, count: int, step_m: float) -> RegisterOptions:
    """The options with the window that the templates have: the search spec leaves room for it."""
    return RegisterOptions(search_m=options.search_m, window_m=(count - 1) * step_m)


def _templates(source: MapFile, last: Int[np.ndarray, " template"], count: int, basis_of: GroundMap) -> Template:
    """Templates of ``count`` stations of one baseline that end at the given ones."""
    description = source.description
    member = np.maximum(last[:, None] - np.arange(count)[None, :], 0)
    numbers, where = np.unique(member, return_inverse=True)
    stations = source.read_stations(numbers)
    pose = source.pose[numbers]
    full = len(last) * count

    def padded(values: np.ndarray) -> Array:
        out = np.zeros((full, *values.shape[1:]), values.dtype)
        out[: len(values)] = values
        return jnp.asarray(out)

    coefficients = np.asarray(to_coefficients(padded(stations.profile), padded(stations.valid), basis_of.basis))
    where = where.reshape(member.shape)
    centre = source.pose[last]
    apart = pose[where][:, :, None, :2] + stations.antenna_m[where][..., :2] - centre[:, None, None, :2]
    # A gap of the baseline, or the end of the one before, ends a window.
    path = np.hypot(*np.moveaxis(pose[where][..., :2] - centre[:, None, :2], -1, 0))
    near = path <= (np.arange(count) + 1.0) * 1.5 * description.settings.step_m
    same = source.drive[member] == source.drive[last][:, None]
    valid = stations.valid[where] & (near & same & (last[:, None] >= np.arange(count)))[..., None]
    batch, traces = len(last), count * description.channels
    first = np.zeros((batch, count, description.channels), bool)
    first[:, 0] = True
    offset = _turned(apart.reshape(batch, traces, 2), -centre[:, 3])
    return Template(
        coefficients=jnp.asarray(coefficients[where].reshape(batch, traces, -1)),
        offset_m=jnp.asarray(offset, dtype=jnp.float32),
        valid=jnp.asarray(valid.reshape(batch, traces)),
        last_scan=jnp.asarray(first.reshape(batch, traces)),
    )


def _turned(
    vector_m: Float[np.ndarray, "template trace 2"], angle_rad: Float[np.ndarray, " template"]
) -> Float[np.ndarray, "template trace 2"]:
    """Vectors turned counter-clockwise."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    x, y = vector_m[..., 0], vector_m[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


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
