"""From the mode of the posterior to a pose with its covariance: Gauss-Newton on the stops around (host side).

The posterior decides where; the climb finds the last millimetres, height, heading and roll from the stops of a metre or
two of travel. Errors of labels and of the odometer, which it cannot see, are added to its covariance.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float, Int

from lgprjax.registration.bayes.drive import DriveFilter, Followed
from lgprjax.registration.bayes.filter import SURE_SIGMAS
from lgprjax.registration.candidates import map_odometry_covariance
from lgprjax.registration.estimates import unknown_attitude
from lgprjax.registration.fix import WRONG_M, Code, Fix, blank_fixes
from lgprjax.registration.judge import POOLED_SIGMA, RegisterOptions
from lgprjax.registration.queries import LiveChain, Stops, least_overlap, rotation, templates_of
from lgprjax.registration.refine import CLIMB_STEPS, Finished, Region, finish_best
from lgprjax.registration.template_bank import PreparedGround, TileBatch, fixes_to_map, to_tile

_BATCH = 16
_REFINED_M = 1.0
"""Of travel, and no less than two wavelengths: stops to a side that refine a fix."""
_TRACES = 192  # of a template
_SCALE_STEP = 0.005
_AWAY = 0.6  # of the wavelength: a climb that ends farther off left its peak
_RIM_MASS = 0.1
_FOLLOWED_SCALE = 0.005


class Reach(NamedTuple):
    """Metres of travel whose stops refine a fix, behind it and ahead of it."""

    behind_m: float
    ahead_m: float


def refined_m(wavelength_m: float) -> float:
    """Travel to a side whose stops refine a fix."""
    return max(_REFINED_M, 2.0 * wavelength_m)


def fixes_of(
    stops: Stops,
    found: Followed,
    led: DriveFilter,
    prepared: PreparedGround,
    chain: LiveChain,
    options: RegisterOptions,
    sigma_scale: float,
    reach: Reach,
    *,
    few: bool = False,
) -> tuple[Fix, Float[np.ndarray, "stop 2 2"], Float[np.ndarray, " stop"]]:
    """Fix of every reported stop; the part of each covariance due to map and odometer; time scales.

    Args:
        stops: of the drive, in the order of travel; earlier ones, with their coefficients, before those reported.
        found: what the filter reports of the last of them.
        led: the filter, for its lattice and likelihood.
        prepared: ground of the map for the array.
        chain: of the drive.
        options: of the search.
        sigma_scale: of the map, measured by the search's matches.
        reach: of the stops that refine a fix.
        few: one at a time: a compiled shape.
    """
    count, wavelength_m = len(found.p_false), led.wavelength_m
    before = len(stops.number) - count
    own = Stops(*(field[before:] for field in stops))
    fixes = blank_fixes(count)
    fixes.code[:] = codes_of(found, options.risk)
    fixes.p_false[:] = found.p_false
    scale = fill_coefficients(own, found, chain)
    place = own.reckoned_m + found.error_m
    tiles = _tiles_at(led, place)
    fixes.code[(tiles < 0) & (fixes.code == Code.OK)] = Code.OFF_MAP
    first, last = _around(stops, reach)
    fixes.window_m[:] = (stops.path_m[last] - stops.path_m[first])[before:]
    profile_ns = len(led.ground.basis.gain) * led.ground.description.settings.sample_interval_ns
    followed = 0.0 if options.time_scale is not None else _FOLLOWED_SCALE
    unknown = unknown_attitude(prepared.array, profile_ns, followed)
    half = options.half_width(own.sigma_yaw_rad, options.search_half_m())
    half[:, 2:5] = np.hypot(half[:, 2:5], 3.0 * unknown)
    half[:, 3] = np.hypot(half[:, 3], 3.0 * found.turn_sigma_rad)
    half[:, 2] = np.maximum(half[:, 2], np.abs(found.height_m) + options.height_m)
    known = led.likelihood
    numbers = (1.0 + fixes.window_m / led.spacing_m) / (known.memory * np.maximum(known.variance, found.variance))
    candidate = np.where(fixes.p_false < 1.0, tiles, -1)
    least = np.float32(least_overlap(prepared.array, wavelength_m))
    size = 1 if few else _BATCH
    for batch in prepared.batches(candidate, own.pose[:, 3], own.speed_mps, size):
        rows = np.concatenate([batch.rows, np.full(size - len(batch.rows), batch.rows[0])])
        some = _Some(before + rows, place[rows], found.height_m[rows], half[rows], numbers[rows], found.turn_rad[rows])
        _finish(stops, some, first, last, batch, prepared, led, least, fixes)
    # Matches of the filter weigh several stops by how they depend on each other: they need no pooled scale.
    _add_what_no_match_sees(own, fixes, unknown, max(sigma_scale / POOLED_SIGMA, 1.0))
    _widen(own, fixes, found.aside_m2)
    beside = map_odometry_covariance(prepared, tiles, fixes, 0.0)
    fixes.covariance[:, :2, :2] += np.nan_to_num(beside)
    return fixes, beside, scale


def fill_coefficients(stops: Stops, found: Followed, chain: LiveChain) -> Float[np.ndarray, " stop"]:
    """Give stops their coefficients, each at the time scale that is reported of it. Returns these scales."""
    scale = np.round(found.scale / _SCALE_STEP) * _SCALE_STEP
    for each in np.unique(scale):
        rows = np.flatnonzero(scale == each)
        stops.coefficients[rows] = chain.coefficients(stops.filtered[rows], stops.valid[rows], float(each))
    return np.asarray(scale)


def codes_of(found: Followed, risk: float) -> Int[np.ndarray, " stop"]:
    """Why a posterior is no position: off the map, foreign ground, beyond the lattice's rim, or several places."""
    reasons = (
        (found.widest <= 0.0, Code.OFF_MAP),
        (found.p_false < risk, Code.OK),
        (found.foreign > 0.5 * found.p_false, Code.LOW_CORRELATION),
        (found.rim > _RIM_MASS, Code.EDGE),
    )
    code = np.full(len(found.p_false), Code.AMBIGUOUS, np.int32)
    for applies, reason in reversed(reasons):
        code = np.where(applies, np.int32(reason), code)
    return code


class _Some(NamedTuple):
    """Stops of a batch, and what their climbs begin with."""

    rows: Int[np.ndarray, " end"]
    place_m: Float[np.ndarray, "end 2"]
    height_m: Float[np.ndarray, " end"]
    half: Float[np.ndarray, "end 6"]
    numbers: Float[np.ndarray, " end"]
    turn_rad: Float[np.ndarray, " end"]


def _around(stops: Stops, reach: Reach) -> tuple[Int[np.ndarray, " stop"], Int[np.ndarray, " stop"]]:
    """First and last stop about each, of the same leg."""
    at = np.arange(len(stops.number))
    first = np.searchsorted(stops.path_m, stops.path_m - reach.behind_m - 1e-6)
    last = np.searchsorted(stops.path_m, stops.path_m + reach.ahead_m + 1e-6, side="right") - 1
    leg = np.searchsorted(stops.leg, stops.leg), np.searchsorted(stops.leg, stops.leg, side="right") - 1
    return np.minimum(np.maximum(first, leg[0]), at), np.maximum(np.minimum(last, leg[1]), at)


def _tiles_at(led: DriveFilter, place_m: Float[np.ndarray, "stop 2"]) -> Int[np.ndarray, " stop"]:
    """Tiles of fixes: one serves as long as it can, however many stops come at once."""
    out = np.full(len(place_m), -1)
    for row, place in enumerate(place_m):
        led.fix_tile = led.ground.tile_holding(led.fix_tile, place, 1.0)
        out[row] = -1 if led.fix_tile is None else led.fix_tile
    return out


def _finish(
    stops: Stops,
    some: _Some,
    first: Int[np.ndarray, " stop"],
    last: Int[np.ndarray, " stop"],
    batch: TileBatch,
    prepared: PreparedGround,
    led: DriveFilter,
    least_overlap: np.float32,
    fixes: Fix,
) -> None:
    """Climb from the stops of a batch and write their fixes."""
    ground, rows, wavelength_m = led.ground, some.rows, led.wavelength_m
    frame = ground.frame(batch.number)
    members = int(np.clip(_TRACES // len(prepared.array.x_m), 8, 64))
    spread = np.round(np.linspace(last[rows], first[rows], members - 1, axis=1)).astype(int)
    member = np.concatenate([rows[:, None], spread], axis=1)
    fresh = np.diff(spread, axis=1, prepend=last[rows][:, None] + 1) != 0
    fresh = np.concatenate([np.ones((len(rows), 1), bool), fresh & (spread != rows[:, None])], axis=1)
    template = templates_of(stops, prepared.array, rows, member, fresh)
    prior = stops.pose[rows].copy()
    prior[:, 3] += some.turn_rad
    start = np.concatenate([some.place_m, prior[:, 2:]], axis=1)
    start[:, 2] += np.clip(some.height_m, -some.half[:, 2], some.half[:, 2])
    half = some.half.copy()
    from_prior = to_tile(start, frame)[:, :2] - to_tile(prior, frame)[:, :2]
    half[:, :2] = np.maximum(half[:, :2], np.abs(from_prior) + wavelength_m)
    level = [(0, 0), (0, 1)]
    found: Finished = jax.device_get(
        finish_best(
            batch.ready.tile,
            np.float32(ground.source.height_reference_m[batch.number]),
            ground.basis.angular_frequency_rad_per_ns,
            template,
            np.pad(to_tile(start, frame), level).astype(np.float32),
            Region(
                jnp.asarray(np.pad(to_tile(prior, frame), level), dtype=jnp.float32),
                jnp.asarray(half, dtype=jnp.float32),
                jnp.asarray(stops.number[rows], dtype=jnp.uint32),
            ),
            (1.0 / np.sqrt(np.maximum(some.numbers, 1.0))).astype(np.float32),
            least_overlap,
            heading=members * len(prepared.array.x_m) > 1,
            pitch=False,
            steps=np.int32(CLIMB_STEPS + 1),
        )
    )
    count = len(batch.rows)
    own = batch.rows
    found = jax.tree.map(lambda field: np.asarray(field)[:count], found)
    pose, covariance = fixes_to_map(np.asarray(found.pose), np.asarray(found.covariance), frame)
    fixes.pose[own], fixes.covariance[own] = pose, covariance
    fixes.correlation[own] = found.correlation
    fixes.overlap[own], fixes.overlap_channels[own] = found.overlap, found.overlap_channels
    fixes.noise_floor[own] = 1.0 / np.sqrt(np.maximum(some.numbers[:count], 1.0))
    # A heading turns the stops about their middle.
    at = rows[:count]
    middle_m = 0.5 * (stops.reckoned_m[first[at]] + stops.reckoned_m[last[at]]) - stops.reckoned_m[at]
    turn = rotation(pose[:, 3] - stops.pose[at, 3])
    away = np.hypot(*(pose[:, :2] - some.place_m[:count] - middle_m + np.einsum("ijs,sj->si", turn, middle_m)).T)
    lost = ~np.isfinite(pose[:, 0])
    astray = np.asarray(found.unfinished) | (away > _AWAY * wavelength_m)
    ok = fixes.code[own] == Code.OK
    fixes.code[own] = np.where(ok & lost, Code.LOW_OVERLAP, np.where(ok & astray, Code.EDGE, fixes.code[own]))


def _widen(stops: Stops, fixes: Fix, aside_m2: Float[np.ndarray, " stop"]) -> None:
    """State the filter's own spread aside where its ``p_false`` leaves places within it out (``elsewhere``)."""
    yaw = stops.pose[:, 3]
    side = np.stack([-np.sin(yaw), np.cos(yaw)], axis=-1)
    stated_m2 = np.einsum("si,sij,sj->s", side, np.asarray(fixes.covariance)[:, :2, :2], side)
    missing_m2 = np.where(SURE_SIGMAS**2 * aside_m2 > WRONG_M**2, np.maximum(aside_m2 - stated_m2, 0.0), 0.0)
    fixes.covariance[:, :2, :2] += missing_m2[:, None, None] * side[:, :, None] * side[:, None, :]


def _add_what_no_match_sees(stops: Stops, fixes: Fix, unknown: Float[np.ndarray, "3"], sigma_scale: float) -> None:
    """Scale the match's covariance and add attitude's; decline what is less sure than a right fix must be."""
    fixes.covariance[:] *= sigma_scale**2
    fixes.covariance[:, 2:, 2:] += np.diag(unknown**2)
    yaw = stops.pose[:, 3]
    facing = np.stack([np.cos(yaw), np.sin(yaw)], axis=-1)
    along_m2 = np.einsum("si,sij,sj->s", facing, np.asarray(fixes.covariance)[:, :2, :2], facing)
    unsure: Bool[np.ndarray, " stop"] = (fixes.code == Code.OK) & ~(along_m2 <= WRONG_M**2)
    fixes.code[unsure] = Code.AMBIGUOUS
