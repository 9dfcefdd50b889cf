"""The matching kernel on arrays: scans, priors and a tile of ground in, fixes out; and construction of batches."""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.api.inputs import require_number, require_slice
from lgprjax.errors import InputError
from lgprjax.formats import DriveLog, MapFile
from lgprjax.registration import (
    BLOCK_SCANS,
    MIN_OVERLAP,
    Fix,
    LiveChain,
    RegisterOptions,
    Rules,
    SearchProblem,
    SearchSpec,
    Stops,
    Template,
    Track,
    live_chain,
    register_batch,
    rules_of,
    score_poses,
    search_spec_for,
    stops_of,
    templates_of,
    to_tile,
)
from lgprjax.registration.judge import independent_numbers
from lgprjax.registration.refine import PRIOR
from lgprjax.subsurface import GroundMap, Tile

if TYPE_CHECKING:
    from lgprjax.batch import HeldGround

_TOGETHER = 16  # scans whose products with all cells of a tile are in memory together
_FARTHEST_M = 30.0  # largest distance of a scan from the middle of its batch
_EXTENT_STEP_M = 4.0  # extents of a tile are multiples of it, so that few shapes are compiled
_WINDOW_SPACING = 0.3  # of the wavelength, between the scans of a window


@jax.tree_util.register_static
@dataclass(frozen=True)
class Shape:
    """Static sizes of a search, the same for all stacked batches."""

    search: SearchSpec


class Batch(NamedTuple):
    """Scans to match on one tile, made by ``Map.batch``; a pytree of arrays on the device.

    Attributes:
        tile: ground gridded in the tile frame, x along the road, y to the left.
        scans: trace coefficients of every scan, and offsets from the array centre.
        prior: prior poses in the tile frame: along_m, cross_m, height_m above ground, yaw_rad, roll_rad.
        half_width: half widths of the search region around the prior, same order.
        finite: whether a scan has enough finite traces.
        rules: acceptance thresholds.
        height_reference_m: antenna height of the tile, m.
        angular_frequency_rad_per_ns: angular frequencies of the coefficients, rad/ns.
        tile_frame: east_m, north_m and yaw_rad of the tile frame in the map frame.
        window_m: length of the matched window, m.
        shape: static sizes of the search.
    """

    tile: Tile
    scans: Template
    prior: Float[Array, "scan 5"]
    half_width: Float[Array, "scan 5"]
    finite: Bool[Array, " scan"]
    rules: Rules
    height_reference_m: Float[Array, ""]
    angular_frequency_rad_per_ns: Float[Array, " half"]
    tile_frame: Float[Array, "3"]
    window_m: Float[Array, ""]
    shape: Shape

    def __repr__(self) -> str:
        *_, scans, traces, coefficients = jnp.shape(self.scans.coefficients)
        cells = " x ".join(map(str, jnp.shape(self.tile.valid)[-2:]))
        return f"Batch: {scans} scans of {traces} traces with {coefficients} coefficients on a tile of {cells} cells"


def match(batch: Batch) -> Fix:
    """Match the scans of a batch to their tile: a pure function of arrays, for jit, vmap and grad.

    It scores every cell of the search region by normalised correlation, refines the best candidate to its peak, and
    accepts or rejects the fix by noise floor and runner-up. Scans are independent. ``register`` also selects the window
    length, estimates the time scale and propagates the position from scan to scan, and therefore locates scans that
    this function rejects.

    Args:
        batch: batch from ``Map.batch``. Leaves may have a further leading axis under ``vmap``.

    Returns:
        Fixes of the scans. Poses and covariances are in the map frame, in float32: 1 mm resolution on a map of 10 km. A
        code reports a scan that cannot be matched; other scans are not affected. Correlation and pose have gradients at
        the peak, the pose by Gauss-Newton curvature; the other fields have none.

    Example:
        import jax
        import jax.numpy as jnp

        site = lx.open_map("site.map.h5")
        batch = site.batch("drives/live.drive.h5", scans=slice(200, 700, 100))
        fix = jax.jit(lx.match)(batch)
        print(fix.pose[:, :2], fix.code)   # east and north in metres; lx.Code.OK is 0


        def at_height(height_m):           # with the array's prior height taken to be this
            return lx.match(batch._replace(prior=batch.prior.at[:, 2].set(height_m))).correlation


        correlations = jax.vmap(at_height)(jnp.array([0.25, 0.30, 0.35]))


        def mean_correlation(coefficients):
            scans = batch.scans._replace(coefficients=coefficients)
            return jnp.mean(lx.match(batch._replace(scans=scans)).correlation)


        slope = jax.grad(mean_correlation)(batch.scans.coefficients)
    """
    fix: Fix = _match(batch)
    return fix


@jax.jit
def _match(batch: Batch) -> Fix:
    """Compiled once for a shape, even if the caller does not."""
    fix = _search(batch)
    east, north, yaw = batch.tile_frame
    cos, sin = jnp.cos(yaw), jnp.sin(yaw)
    turn = jnp.eye(5).at[:2, :2].set(jnp.stack([jnp.stack([cos, -sin]), jnp.stack([sin, cos])]))
    moved = jnp.stack([east, north, jnp.zeros_like(yaw), yaw, jnp.zeros_like(yaw)])
    return fix._replace(
        pose=fix.pose @ turn.T + jnp.broadcast_to(moved, fix.pose.shape),
        covariance=turn @ fix.covariance @ turn.T,
        window_m=fix.window_m + batch.window_m,
    )


@jax.custom_jvp
def _search(batch: Batch) -> Fix:
    """Fixes in the tile's frame, some scans at a time."""
    count = batch.prior.shape[0]
    chunks = -(-count // _TOGETHER)
    each = -(-count // chunks)
    rows = (batch.scans, batch.prior, batch.half_width, batch.finite)
    # Equal chunks, the last padded with copies of the first scan.
    order = np.concatenate([np.arange(count), np.zeros(chunks * each - count, int)])
    chunked = jax.tree.map(lambda field: field[order].reshape(chunks, each, *field.shape[1:]), rows)

    def one(part: tuple[Template, Array, Array, Array]) -> Fix:
        fix: Fix = register_batch(
            batch.tile,
            SearchProblem(*part),
            batch.rules,
            batch.height_reference_m,
            batch.angular_frequency_rad_per_ns,
            spec=batch.shape.search,
        )
        return fix

    found = jax.lax.map(one, chunked)
    fixes: Fix = jax.tree.map(lambda field: field.reshape(chunks * each, *field.shape[2:])[:count], found)
    return fixes


@_search.defjvp
def _search_jvp(primals: tuple[Batch], tangents: tuple[Batch]) -> tuple[Fix, Fix]:
    """Derivatives at the peak, for a fixed candidate.

    By the implicit function theorem the pose moves by the covariance times the change of the slope of the posterior
    there; the covariance holds the Gauss-Newton curvature, which the search uses as well.
    """
    (batch,), (change,) = primals, tangents
    fix = _search(batch)
    found = jnp.isfinite(fix.correlation)
    pose = jnp.where(found[:, None], fix.pose, batch.prior)

    def peak(at: Batch) -> tuple[Float[Array, "scan 5"], Float[Array, " scan"]]:
        """Slope of the score, and the correlation, at the poses found."""

        def strength(pose: Float[Array, "5"], scan: Template) -> tuple[Float[Array, ""], Float[Array, ""]]:
            score = score_poses(
                at.tile, scan, pose[None], at.height_reference_m, at.angular_frequency_rad_per_ns, MIN_OVERLAP
            )
            return score.score[0], score.correlation[0]

        slope, correlation = jax.vmap(jax.grad(strength, has_aux=True))(pose, at.scans)
        return slope, correlation

    (slope, correlation), (bends, gains) = jax.jvp(peak, (batch,), (change,))
    weight = independent_numbers(jnp.asarray(fix.noise_floor)) / jnp.maximum(1.0 - correlation**2, 1e-3)
    # Position is free within the region; attitude and height are held to the prior.
    pull = jnp.asarray(PRIOR[:5], jnp.float32).at[:2].set(0.0)[None] / batch.half_width**2
    side = weight[:, None] * bends + pull * change.prior
    covariance = fix.covariance / batch.rules.thresholds.sigma_scale**2
    moves = jnp.where(
        found[:, None], jnp.einsum("nij,nj->ni", jnp.where(found[:, None, None], covariance, 0.0), side), 0.0
    )
    along_slope = jnp.sum(slope * moves, axis=1) / jnp.sqrt(jnp.maximum(fix.overlap, MIN_OVERLAP))
    still = Fix(*(_still(jnp.asarray(field)) for field in fix))
    return fix, still._replace(pose=moves, correlation=jnp.where(found, gains + along_slope, 0.0))


def _still(field: Array) -> Array | np.ndarray:
    """A tangent of nothing; integers have a type of their own for it, which only NumPy holds."""
    if jnp.issubdtype(field.dtype, jnp.floating):
        return jnp.zeros_like(field)
    return np.zeros(field.shape, jax.dtypes.float0)


def batch_of(
    source: MapFile, held: "HeldGround", path: Path, scans: slice, *, options: RegisterOptions, window_m: float
) -> Batch:
    """Scans of a drive for ``match``; see ``Map.batch``.

    Raises:
        InputError: as ``Map.batch`` does, or the drive cannot be used on this map.
    """
    from lgprjax.batch.register import find_alignment, may_be_misaligned, reversed_track
    from lgprjax.recordings.drives import AS_STATED, live_operators, track_of_drive

    description = source.description
    require_number("window_m", window_m, f"0 to {_FARTHEST_M:g}", 0.0, _FARTHEST_M)
    require_slice(scans)
    with DriveLog.open(path) as log:
        track = track_of_drive(log, description.frame).track
        alignment = find_alignment(source, log, track, options, held) if may_be_misaligned(log) else AS_STATED
        if alignment.reversed:
            track = reversed_track(track)
        chosen = np.arange(log.scans)[scans]
        if not len(chosen):
            raise InputError(path, "scans", f"a slice with scans from 0 to {log.scans - 1}", str(scans))
        half_m = options.search_half_m(track.sigma_m[chosen])
        ground, number = _ground_about(source, track.pose[chosen, :2], half_m + window_m, path)
        operators = live_operators(source, log, track, alignment)
        chain = live_chain(ground, operators, log.description.array, int(operators(1.0).shape[0]))
        spacing_m = _WINDOW_SPACING * description.settings.wavelength_m
        stops = _stops(log, track, chain, ground, chosen, window_m + spacing_m)
        made = chain.coefficients(stops.filtered, stops.valid, options.time_scale or 1.0)
        stops = stops._replace(coefficients=made)
        last = np.searchsorted(stops.number, chosen)
        member, fresh = _members(stops, last, window_m, spacing_m)
        template = templates_of(stops, log.description.array, last, member, fresh)
        shape = Shape(search_spec_for(ground, number, log.description.array, search_m=half_m, window_m=window_m))
    frame = ground.frame(number)
    facing = np.cos(track.pose[chosen, 3] - frame[2]) * np.where(track.speed_mps[chosen] < 0.0, -1.0, 1.0)
    # Live scans are filtered causally: so is the ground, if all scans have the same direction along it.
    direction = int(np.sign(facing[0])) if np.all(facing > 0.5) or np.all(facing < -0.5) else 0
    valid = np.asarray(template.valid)
    return Batch(
        tile=ground.tile(number, direction),
        scans=template,
        prior=jnp.asarray(to_tile(track.pose[chosen], frame), jnp.float32),
        half_width=jnp.asarray(options.half_width(track.sigma_yaw_rad[chosen], half_m)[:, :5], jnp.float32),
        finite=jnp.asarray(valid.mean(axis=1) >= MIN_OVERLAP),
        rules=rules_of(
            description.settings.wavelength_m, replace(options, search_m=half_m), window_m, chance=held.chance
        ),
        height_reference_m=jnp.float32(source.height_reference_m[number]),
        angular_frequency_rad_per_ns=ground.basis.angular_frequency_rad_per_ns,
        tile_frame=jnp.asarray(frame, jnp.float32),
        window_m=jnp.float32(window_m),
        shape=shape,
    )


def _ground_about(
    source: MapFile, places_m: Float[np.ndarray, "scan 2"], room_m: float, path: Path
) -> tuple[GroundMap, int]:
    """A map with tiles long enough for these places, and the number of the tile that contains them."""
    description = source.description
    middle = 0.5 * (places_m.min(axis=0) + places_m.max(axis=0))
    spread_m = float(np.max(np.hypot(*(places_m - middle).T)))
    if spread_m > _FARTHEST_M:
        expected = f"scans within {2.0 * _FARTHEST_M:g} m of each other"
        raise InputError(path, "scans", expected, f"scans {2.0 * spread_m:.1f} m apart")
    array_m = 0.5 * description.channels * description.channel_pitch_m
    half_m = spread_m + 1.5 * (room_m + 0.5) + array_m + description.tile_spacing_m
    half_m = _EXTENT_STEP_M * float(np.ceil(half_m / _EXTENT_STEP_M))
    ground = GroundMap(source, half_along_m=half_m, half_cross_m=half_m)
    number = ground.tile_near(middle, room_m)
    if number is None:
        raise InputError(path, "scans", f"scans over the map {source.description.name}", "scans outside the map")
    return ground, number


def _stops(
    log: DriveLog,
    track: Track,
    chain: LiveChain,
    ground: GroundMap,
    chosen: Int[np.ndarray, " scan"],
    before_m: float,
) -> Stops:
    """The chosen scans and those within ``before_m`` of travel before them, in the order in which they were driven.

    The drive is read from far enough before the first for the background filter to have settled.
    """
    from lgprjax.batch.register import live_blocks

    low, high = int(chosen.min()), int(chosen.max())
    path_m = np.cumsum(np.abs(np.diff(track.travel_m, prepend=track.travel_m[0])))
    settling_m = 2.0 * ground.description.settings.track_filter_m + before_m
    start = int(np.searchsorted(path_m, path_m[low] - settling_m))
    first = int(np.searchsorted(path_m, path_m[low] - before_m))
    parts = []
    for block in live_blocks(log, track, None, start):
        fed = chain.feed(block.traces, block.valid, block.track, BLOCK_SCANS)
        numbers = fed.number + start
        rows = np.flatnonzero((numbers >= first) & (numbers <= high))
        parts.append(stops_of(fed._replace(number=numbers), rows, log.description.array, ground.basis))
        if numbers[-1] >= high:
            break
    return Stops(*(np.concatenate(field) for field in zip(*parts, strict=True)))


def _members(
    stops: Stops, last: Int[np.ndarray, " scan"], window_m: float, spacing_m: float
) -> tuple[Int[np.ndarray, "scan member"], Bool[np.ndarray, "scan member"]]:
    """Scans of each window, the last one first, and which of them exist: a drive begins, and travel may be
    interrupted.
    """
    wanted_m = stops.path_m[last][:, None] - np.arange(1 + round(window_m / spacing_m)) * spacing_m
    member = np.clip(np.searchsorted(stops.path_m, wanted_m - 1e-6), 0, last[:, None])
    member[:, 0] = last
    fresh = (stops.leg[member] == stops.leg[last][:, None]) & (wanted_m >= stops.path_m[0] - 1e-6)
    return member, fresh
