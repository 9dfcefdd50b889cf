"""Matching a map's own stations as live scans: against the ground of the other baselines, and their own.

Score, search and acceptance are those of registration, with its default thresholds.
"""

from dataclasses import replace
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.formats import MapFile
from lgprjax.radar import to_coefficients, uniform_array
from lgprjax.registration import (
    Code,
    Fix,
    RegisterOptions,
    SearchProblem,
    Template,
    Thresholds,
    register_batch,
    rules_of,
    search_spec_for,
    to_tile,
)
from lgprjax.subsurface import GroundMap, MapDescription, SpatialIndex, Tile

# The route of a map in equal steps, and its ground: passes, width, share of the array on the map.


class DrivePlaces(NamedTuple):
    """Places along one baseline's own track, in equal steps, also across gaps of the baseline.

    Attributes:
        pose: east_m, north_m, yaw_rad of each place.
        station: nearest station of the baseline along its track; -1 if none in force is within half a step.
        fresh: whether the place is in force, without an earlier baseline in force nearby, so that the route continues
            there.
    """

    pose: Float[np.ndarray, "place 3"]
    station: Int[np.ndarray, " place"]
    fresh: Bool[np.ndarray, " place"]


class MapRoute(NamedTuple):
    """The map's ground in order of driving, each stretch counted once: the first baseline, then additions of later
    ones.

    Attributes:
        at_m: distance along the route.
        pose: east_m, north_m, yaw_rad of each place.
        drive, place: baseline of the place, and its number among that baseline's places.
    """

    at_m: Float[np.ndarray, " route"]
    pose: Float[np.ndarray, "route 3"]
    drive: Int[np.ndarray, " route"]
    place: Int[np.ndarray, " route"]


class RouteGround(NamedTuple):
    """Ground at each place of the route.

    Attributes:
        passes: baselines within an array's width.
        width_m: gapless ground across the route at the place; 0 without any.
        overlap: share of an array's antennas on the map, its centre on the route.
    """

    passes: Int[np.ndarray, " route"]
    width_m: Float[np.ndarray, " route"]
    overlap: Float[np.ndarray, " route"]


def places_of_drives(source: MapFile, step_m: float) -> list[DrivePlaces]:
    """Places of every baseline, ``step_m`` apart along its own track."""
    radius_m = max(source.description.array_width_m, step_m)
    out: list[DrivePlaces] = []
    earlier, retired = np.zeros((0, 2)), source.retired > 0
    for number in range(int(source.drive.max()) + 1):
        stations = np.flatnonzero(source.drive == number)
        if len(stations) < 2:
            out.append(DrivePlaces(np.zeros((0, 3)), np.zeros(0, np.int64), np.zeros(0, bool)))
            continue
        pose = source.pose[stations]
        path = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(pose[:, :2], axis=0).T))])
        at = np.arange(0.5 * step_m, max(path[-1], step_m), step_m)
        where = np.stack([np.interp(at, path, pose[:, column]) for column in (0, 1, 3)], axis=1)
        nearest = np.clip(np.searchsorted(path, at), 1, len(path) - 1)
        nearest = np.where(np.abs(path[nearest - 1] - at) < np.abs(path[nearest] - at), nearest - 1, nearest)
        in_force = ~retired[stations[nearest]]
        close = np.abs(path[nearest] - at) <= 0.5 * step_m
        station = np.where(close & in_force, stations[nearest], -1)
        fresh = in_force.copy()
        # Compared with earlier places, not stations: a gap in one baseline is a hole, not another road.
        if len(earlier):
            index = SpatialIndex(earlier, 8.0)
            fresh &= np.array([index.nearest(point, radius_m) is None for point in where[:, :2]])
        out.append(DrivePlaces(where, station, fresh))
        earlier = np.concatenate([earlier, where[in_force, :2]])
    return out


def route_of(drives: list[DrivePlaces], step_m: float) -> MapRoute:
    """The fresh places of all baselines, one after the other."""
    pose = np.concatenate([places.pose[places.fresh] for places in drives])
    drive = np.concatenate([np.full(int(places.fresh.sum()), number) for number, places in enumerate(drives)])
    place = np.concatenate([np.flatnonzero(places.fresh) for places in drives])
    return MapRoute((np.arange(len(pose)) + 0.5) * step_m, pose, drive, place)


def passes_at(source: MapFile, route: MapRoute) -> Int[np.ndarray, " route"]:
    """Baselines in force within an array's width of each place."""
    in_force = source.retired == 0
    index, radius_m = SpatialIndex(source.pose[in_force, :2], 8.0), source.description.array_width_m
    drive = source.drive[in_force]
    return np.array([len(np.unique(drive[index.near(point, radius_m)])) for point in route.pose[:, :2]])


class TileMask(NamedTuple):
    """The cells of a tile that a baseline covers, on the host."""

    valid: Bool[np.ndarray, "along cross"]
    origin_m: Float[np.ndarray, "2"]
    cell_m: Float[np.ndarray, "2"]


def mask_of(tile: Tile) -> TileMask:
    """A tile's mask."""
    return TileMask(np.asarray(tile.valid), np.asarray(tile.origin_m), np.asarray(tile.cell_m))


def on_map(mask: TileMask, position_m: Float[np.ndarray, "*place 2"]) -> Bool[np.ndarray, "*place"]:
    """Positions where a trace can be scored: all four cells around are covered (as in ``sample_tile``)."""
    base = np.floor((position_m - mask.origin_m) / mask.cell_m).astype(np.int64)
    size = np.array(mask.valid.shape)
    inside = np.all((base >= 0) & (base + 1 < size), axis=-1)
    i, j = np.moveaxis(np.clip(base, 0, size - 2), -1, 0)
    return np.asarray(
        inside & mask.valid[i, j] & mask.valid[i + 1, j] & mask.valid[i, j + 1] & mask.valid[i + 1, j + 1]
    )


def ground_at(mask: TileMask, pose: Float[np.ndarray, "3"], channels: int, pitch_m: float) -> tuple[float, float]:
    """Width of ground across a place, and the share of an array's antennas on the map.

    Args:
        mask: mask of the tile.
        pose: along_m, cross_m and yaw_rad of the place in the tile's frame.
        channels, pitch_m: number and spacing of the array's channels.
    """
    left = np.array([-np.sin(pose[2]), np.cos(pose[2])])
    antennas = (np.arange(channels) - 0.5 * (channels - 1)) * pitch_m
    overlap = float(np.mean(on_map(mask, pose[:2] + antennas[:, None] * left)))
    step_m = 0.5 * float(mask.cell_m[1])
    reach = int(max(mask.valid.shape) * max(mask.cell_m) / step_m)
    covered = on_map(mask, pose[:2] + (np.arange(-reach, reach + 1) * step_m)[:, None] * left)
    if not covered[reach]:
        return 0.0, overlap
    right_end = np.flatnonzero(~covered[: reach + 1])
    left_end = np.flatnonzero(~covered[reach:])
    cells = (left_end[0] if len(left_end) else reach) + (reach - right_end[-1] if len(right_end) else reach)
    return float(cells) * step_m, overlap


# Stations of a map registered on a tile like live scans: their templates and fixes.

_LEAST_SCORE, _LEAST_LEAD = 3.0, 1.4
"""Least score and margin of a match between baselines of one map, in noise floors. By the labels it is the same ground,
so that a match needs to exceed its neighbourhood only. The margin is that of a scan; that of a window falls with its
length.
"""
_LANES = 4  # a tile of usual spacing holds three or four places
_FEW_CHANNELS = 3  # an array of at most this many channels is matched in windows
_WINDOW_WAVELENGTHS = 4.0
_ROOM_M = 0.15  # to both sides: a trace at the edge would be lost during refinement, and hold the match back
_LEAST_TRACES = 0.25  # of a template over the ground: fewer are not conclusive


class StationFixes(NamedTuple):
    """Stations registered on a tile, one row each.

    Attributes:
        prior: expected pose, in the tile's frame.
        fix: fix in the tile's frame.
        share: share of the template's traces used.
    """

    prior: Float[np.ndarray, "template 5"]
    fix: Fix
    share: Float[np.ndarray, " template"]


def window_stations(description: MapDescription) -> int:
    """Stations of a template: one for an array; four wavelengths for three channels or fewer."""
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
    """Register templates around stations of a database on a tile.

    Args:
        source: database of the stations.
        ground: tiles of the database, or of some of its baselines.
        tile: number of the tile.
        stations: numbers of the templates' last stations.
        pose: expected pose of each on the tile's ground, in the map's frame: its label, or a better estimate.
        options: options of the search.
        over_ground: whether to use only the traces expected over the tile's ground, because traces outside a
            neighbouring baseline do not disagree. For poses known to a decimetre; without it all traces are used, and a
            template with too little ground is rejected.
    """
    description, basis = ground.description, ground.basis
    frame, mask = ground.frame(tile), mask_of(ground.tile(tile))
    count = window_stations(description)
    channels, step_m = description.channels, description.settings.step_m
    search_m, window_m = options.search_half_m(), (count - 1) * step_m
    array = uniform_array(channels, description.channel_pitch_m)
    spec = search_spec_for(ground, tile, array, search_m=search_m, window_m=window_m)
    required = Thresholds(_LEAST_SCORE, _LEAST_LEAD / (1.0 + 0.5 * window_m))
    rules = rules_of(description.settings.wavelength_m, replace(options, own_thresholds=required), window_m)
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
            SearchProblem(
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
    scan = np.broadcast_to(np.arange(count, dtype=np.int32)[None, :, None], (batch, count, description.channels))
    offset = turned_by(apart.reshape(batch, traces, 2), -centre[:, 3])
    return Template(
        coefficients=jnp.asarray(coefficients[where].reshape(batch, traces, -1)),
        offset_m=jnp.asarray(offset, dtype=jnp.float32),
        valid=jnp.asarray(valid.reshape(batch, traces)),
        scan=jnp.asarray(scan.reshape(batch, traces)),
    )


def turned_by(
    vector_m: Float[np.ndarray, "template trace 2"], angle_rad: Float[np.ndarray, " template"]
) -> Float[np.ndarray, "template trace 2"]:
    """Vectors rotated counter-clockwise."""
    cos, sin = np.cos(angle_rad)[:, None], np.sin(angle_rad)[:, None]
    x, y = vector_m[..., 0], vector_m[..., 1]
    return np.stack([cos * x - sin * y, sin * x + cos * y], axis=-1)


class Matches(NamedTuple):
    """Matches of templates, one row each; NaN for templates not tried.

    Attributes:
        along_m, cross_m: matched place minus label, along and across the station's heading.
        sigma_m: larger of the match's sigmas along and across.
        correlation: correlation at the match.
        score: correlation times the root of the overlap.
        rival: score of the best place at least 0.6 of a wavelength away, within the search region.
        share: share of the template's traces over the matched ground.
        code: code of registration; ``off_map`` for templates not tried.
    """

    along_m: Float[np.ndarray, " template"]
    cross_m: Float[np.ndarray, " template"]
    sigma_m: Float[np.ndarray, " template"]
    correlation: Float[np.ndarray, " template"]
    score: Float[np.ndarray, " template"]
    rival: Float[np.ndarray, " template"]
    share: Float[np.ndarray, " template"]
    code: Int[np.ndarray, " template"]


def match_stations(
    source: MapFile,
    ground: GroundMap,
    tile: int,
    stations: Int[np.ndarray, " template"],
    options: RegisterOptions,
) -> Matches:
    """Match templates around stations of a database against a tile.

    Only traces that are over the tile's ground by their labels are used, because traces outside a neighbouring baseline
    do not disagree.

    Args:
        source: database of the stations.
        ground: tiles of the database, or of its other baselines.
        tile: number of the tile.
        stations: numbers of the templates' last stations.
        options: options of the search.
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
        score=np.asarray(fix.margin, dtype=np.float64) + np.asarray(fix.runner_up, dtype=np.float64),
        rival=np.asarray(fix.runner_up, dtype=np.float64),
        share=share,
        code=np.asarray(fix.code),
    )


class StretchSignal(NamedTuple):
    """Signal of the stations around one place.

    Attributes:
        power: mean square of the gained traces.
        repeats: correlation with the stations an eighth of a wavelength farther: the share that is ground.
        beside: for each pair of neighbouring channels, sum of products and root of the product of the powers.
    """

    power: float
    repeats: float
    beside: Float[np.ndarray, "pair 2"]


def signal_about(source: MapFile, ground: GroundMap, station: int, reach: int, lag: int) -> StretchSignal:
    """Signal of the stations within ``reach`` of one, on its own baseline."""
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
