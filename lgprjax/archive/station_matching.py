"""Stations of a map registered on a tile, as live scans would be: their templates, and what the search answers."""

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int

from lgprjax.archive.map_route import mask_of, on_map
from lgprjax.formats import MapFile
from lgprjax.radar import to_coefficients, uniform_array
from lgprjax.registration import (
    Code,
    Fix,
    Problem,
    RegisterOptions,
    Template,
    Thresholds,
    register_batch,
    rules_of,
    search_spec_for,
    to_tile,
)
from lgprjax.subsurface import GroundMap, MapDescription

_LEAST_SCORE, _LEAST_LEAD = 3.0, 1.4
"""Of a match between baselines of one map, in noise floors: their labels say that it is the same ground, so that its
neighbourhood is what it must stand out from. The lead is that of a scan; that of a window falls with its length."""
_LANES = 4  # a tile of usual spacing holds three or four places
_FEW_CHANNELS = 3  # an array of no more channels is matched in windows
_WINDOW_WAVELENGTHS = 4.0
_ROOM_M = 0.15  # to both sides: a trace at the rim would be lost on the way to the match, and hold it back
_LEAST_TRACES = 0.25  # of a template that lie over the ground: fewer say nothing


class StationFixes(NamedTuple):
    """Stations registered on a tile, one row each.

    Attributes:
        prior: where they were expected, in the tile's frame.
        fix: in the tile's frame.
        share: of the template's traces that took part.
    """

    prior: Float[np.ndarray, "template 5"]
    fix: Fix
    share: Float[np.ndarray, " template"]


def window_stations(description: MapDescription) -> int:
    """Stations of a template: one of an array; four wavelengths where three channels or fewer say too little."""
    if description.channels > _FEW_CHANNELS:
        return 1
    return 1 + round(_WINDOW_WAVELENGTHS * description.settings.wavelength_m / description.settings.step_m)


def register_stations(
    source: MapFile,
    ground: GroundMap,
    tile: int,
    stations: Int[np.ndarray, " template"],
    pose: Float[np.ndarray, "template 5"],
    options: RegisterOptions,
    *,
    over_ground: bool,
) -> StationFixes:
    """Register templates about stations of a database on a tile.

    Args:
        source: the database that the stations come from.
        ground: its tiles, or those of some of its baselines.
        tile: number of the tile.
        stations: numbers of the templates' last stations.
        pose: where each is expected on the tile's ground, in the map's frame: its label, or better.
        options: the search.
        over_ground: only the traces that lie over the tile's ground where they are expected take part: what a
            neighbouring lane does not reach is no disagreement. For poses right to a decimetre; without it a template
            is whole, and one that finds too little ground is declined.
    """
    description, basis = ground.description, ground.basis
    frame, mask = ground.frame(tile), mask_of(ground.tile(tile))
    count = window_stations(description)
    channels, step_m = description.channels, description.settings.step_m
    search_m, window_m = options.search_half_m(), (count - 1) * step_m
    array = uniform_array(channels, description.channel_pitch_m)
    spec = search_spec_for(ground, tile, array, search_m=search_m, window_m=window_m)
    asked = Thresholds(_LEAST_SCORE, _LEAST_LEAD / (1.0 + 0.5 * window_m))
    rules = rules_of(description.settings.wavelength_m, replace(options, own_thresholds=asked), window_m)
    half_width = np.array([search_m, search_m, options.height_m, np.radians(1.0), np.radians(1.5)])
    parts = []
    for low in range(0, len(stations), _LANES):
        chosen = stations[low : low + _LANES]
        lanes = np.concatenate([chosen, np.full(_LANES - len(chosen), chosen[0])])
        template = _templates(source, lanes, count, basis_of=ground)
        prior = to_tile(
            np.concatenate([pose[low : low + _LANES], np.tile(pose[low], (_LANES - len(chosen), 1))]), frame
        )
        there = np.asarray(template.valid)
        if over_ground:
            turned = turned_by(np.asarray(template.offset_m, dtype=np.float64), prior[:, 3])
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
            ),
            rules,
            jnp.float32(ground.source.height_reference_m[tile]),
            basis.angular_frequency_rad_per_ns,
            spec=spec,
        )
        code = np.where(share >= _LEAST_TRACES, np.asarray(fix.code), int(Code.OFF_MAP)).astype(np.int32)
        kept = slice(len(chosen))
        rows = Fix(*(np.asarray(field)[kept] for field in fix._replace(code=code)))
        parts.append(StationFixes(prior[kept], rows, share[kept]))
    return StationFixes(
        np.concatenate([part.prior for part in parts]),
        Fix(*(np.concatenate(field) for field in zip(*(part.fix for part in parts), strict=True))),
        np.concatenate([part.share for part in parts]),
    )


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
    offset = turned_by(apart.reshape(batch, traces, 2), -centre[:, 3])
    return Template(
        coefficients=jnp.asarray(coefficients[where].reshape(batch, traces, -1)),
        offset_m=jnp.asarray(offset, dtype=jnp.float32),
        valid=jnp.asarray(valid.reshape(batch, traces)),
        last_scan=jnp.asarray(first.reshape(batch, traces)),
    )


def turned_by(
    vector_m: Float[np.ndarray, "template trace 2"], angle_rad: Float[np.ndarray, " template"]
) -> Float[np.ndarray, "template trace 2"]:
    """Vectors turned counter-clockwise."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    x, y = vector_m[..., 0], vector_m[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)
