"""What the finish asks of every trace: the live trace, the ground below it, and their products over depth."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.radar import cos_sin
from lgprjax.registration.correlation import Template
from lgprjax.subsurface import Tile


class Heard(NamedTuple):
    """What the traces of each pose hear, and the cells of ground below them.

    Attributes:
        real, imaginary: of the live traces, brought to the tile's height.
        corners: ground here, one cell across, one along, and both.
        part: where between them, along and across.
        turned_m: offset of each trace, along and across.
        covered: on the map and valid.
    """

    real: Float[Array, "batch trace half"]
    imaginary: Float[Array, "batch trace half"]
    corners: Float[Array, "batch trace 4 coefficient"]
    part: Float[Array, "batch trace 2"]
    turned_m: Float[Array, "batch trace 2"]
    covered: Bool[Array, "batch trace"]


class Sums(NamedTuple):
    """Products over depth of every trace; 0 where none counts. ``delayed`` is the ground's change with height."""

    ground_ground: Float[Array, "batch trace"]
    ground_along: Float[Array, "batch trace"]
    ground_cross: Float[Array, "batch trace"]
    along_along: Float[Array, "batch trace"]
    along_cross: Float[Array, "batch trace"]
    cross_cross: Float[Array, "batch trace"]
    along_delayed: Float[Array, "batch trace"]
    cross_delayed: Float[Array, "batch trace"]
    delayed_delayed: Float[Array, "batch trace"]
    live_ground: Float[Array, "batch trace"]
    live_along: Float[Array, "batch trace"]
    live_cross: Float[Array, "batch trace"]
    live_delayed: Float[Array, "batch trace"]


def hear_traces(
    tile: Tile,
    template: Template,
    pose: Float[Array, "batch 6"],
    height_reference_m: Float[Array, ""],
    rate_rad_per_m: Float[Array, " half"],
) -> Heard:
    """What the traces of each pose hear; ``rate_rad_per_m`` is the phase that a metre of height takes off."""
    forward, left = template.offset_m[..., 0], template.offset_m[..., 1]
    turned = _turned(template, pose)
    corners, part, on_map = _cell_of(tile, pose[:, None, :2] + turned)
    height_m = pose[:, 2, None] + left * jnp.sin(pose[:, 4, None]) + forward * jnp.sin(pose[:, 5, None])
    c, s = cos_sin((height_reference_m - height_m)[..., None] * rate_rad_per_m[None, None])
    real, imaginary = jnp.split(template.coefficients, 2, axis=-1)
    return Heard(
        real * c + imaginary * s,
        imaginary * c - real * s,
        tile.coefficients.reshape(-1, tile.coefficients.shape[-1])[corners],
        part,
        turned,
        on_map & template.valid,
    )


def _turned(template: Template, pose: Float[Array, "batch 6"]) -> Float[Array, "batch trace 2"]:
    """Offsets of the traces in the tile's frame."""
    forward, left = template.offset_m[..., 0], template.offset_m[..., 1]
    cos, sin = jnp.cos(pose[:, 3, None]), jnp.sin(pose[:, 3, None])
    return jnp.stack([cos * forward - sin * left, sin * forward + cos * left], axis=-1)


def trace_sums(heard: Heard, rate_rad_per_m: Float[Array, " half"], cell_m: Float[Array, "2"]) -> Sums:
    """All products in one pass over depth.

    Height moves the live trace in delay. Turned back, it moves the ground the other way, so that the curvature is
    that of the ground, not of what the live trace holds besides it.
    """
    half = rate_rad_per_m.shape[0]
    lead = heard.covered.shape
    near, nearer, far, farther = (heard.corners[:, :, k].reshape(*lead, 2, half) for k in range(4))
    u, v = heard.part[..., 0][..., None, None], heard.part[..., 1][..., None, None]
    low = near + v * (nearer - near)
    along = far + v * (farther - far) - low
    ground = low + u * along
    cross = (1.0 - u) * (nearer - near) + u * (farther - far)
    rate = rate_rad_per_m[None, None]
    g, a, c = ((wave[:, :, 0], wave[:, :, 1]) for wave in (ground, along, cross))
    d = (rate * g[1], -rate * g[0])
    live = (heard.real, heard.imaginary)
    ground_alone = [(g, g), (g, a), (g, c), (a, a), (a, c), (c, c), (a, d), (c, d), (d, d)]
    pairs = [*ground_alone, (live, g), (live, a), (live, c), (live, d)]
    terms = [one[0] * other[0] + one[1] * other[1] for one, other in pairs]
    p, q, one = 1.0 / cell_m[0], 1.0 / cell_m[1], jnp.float32(1.0)
    per_m = (one, p, q, p * p, p * q, q * q, p, q, one, one, p, q, one)
    return Sums(
        *(jnp.where(heard.covered, total * unit, 0.0) for total, unit in zip(_totals(terms, 2), per_m, strict=True))
    )


def normal_equations(
    sums: Sums, heard: Heard, template: Template, pose: Float[Array, "batch 6"], power: Float[Array, " batch"]
) -> tuple[Float[Array, "batch 6 6"], Float[Array, "batch 6"]]:
    """Matrix and right side of a step, per unit of live power: P'QP and P'Q(live), Q taking the ground out.

    How far each degree of freedom moves a trace along, across and up: (1, 0, 0), (0, 1, 0), (0, 0, 1), yaw
    (-b, a, 0) with (a, b) its offset in the tile's frame, roll and pitch (0, 0, lift) and (0, 0, tilt).
    """
    a, b = heard.turned_m[..., 0], heard.turned_m[..., 1]
    lift = template.offset_m[..., 1] * jnp.cos(pose[:, 4, None])
    tilt = template.offset_m[..., 0] * jnp.cos(pose[:, 5, None])
    xx, xy, yy = sums.along_along, sums.along_cross, sums.cross_cross
    xz, yz, zz = sums.along_delayed, sums.cross_delayed, sums.delayed_delayed
    xt, yt, zt = a * xy - b * xx, a * yy - b * xy, a * yz - b * xz
    upper = (
        (xx, xy, xz, xt, lift * xz, tilt * xz),
        (yy, yz, yt, lift * yz, tilt * yz),
        (zz, zt, lift * zz, tilt * zz),
        (a * yt - b * xt, lift * zt, tilt * zt),
        (lift * lift * zz, lift * tilt * zz),
        (tilt * tilt * zz,),
    )
    turn = a * sums.ground_cross - b * sums.ground_along
    onto = (sums.ground_along, sums.ground_cross, turn)
    rise = sums.live_delayed
    turn = a * sums.live_cross - b * sums.live_along
    toward = (sums.live_along, sums.live_cross, rise, turn, lift * rise, tilt * rise)
    terms = [term for row in (*upper, onto, toward, (sums.ground_ground, sums.live_ground)) for term in row]
    totals = iter(_totals(terms, 1))
    gram = {(i, j): next(totals) for i in range(6) for j in range(i, 6)}
    still = jnp.zeros_like(power)
    along, cross, yaw = (next(totals) for _ in range(3))
    on = jnp.stack([along, cross, still, yaw, still, still], axis=-1)
    side = jnp.stack([next(totals) for _ in range(6)], axis=-1)
    ground, product = totals
    full = jnp.stack([gram[min(i, j), max(i, j)] for i in range(6) for j in range(6)], axis=-1).reshape(-1, 6, 6)
    safe, level = jnp.maximum(ground, 1e-30), jnp.maximum(power, 1e-30)
    alpha = product / safe
    matrix = full - on[:, :, None] * (on / safe[:, None])[:, None, :]
    side = side - on * alpha[:, None]
    return matrix * (alpha**2 / level)[:, None, None], side * (alpha / level)[:, None]


def _totals(terms: list[Array], axis: int) -> list[Array]:
    """Sums of many terms along an axis in one pass."""
    zeros = [jnp.float32(0.0)] * len(terms)
    totals: list[Array] = jax.lax.reduce(
        terms, zeros, lambda one, other: [a + b for a, b in zip(one, other, strict=True)], (axis,)
    )
    return totals


def _cell_of(
    tile: Tile, position_m: Float[Array, "*batch 2"]
) -> tuple[Int[Array, "*batch 4"], Float[Array, "*batch 2"], Bool[Array, "*batch"]]:
    """Numbers of the four cells about each place, where between them, and whether all are on the map."""
    lead = (1,) * (position_m.ndim - 1) + (2,)
    cells = (position_m - tile.origin_m.reshape(lead)) / tile.cell_m.reshape(lead)
    low = jnp.floor(cells)
    size = jnp.asarray(tile.valid.shape, dtype=jnp.int32).reshape(lead)
    base = low.astype(jnp.int32)
    inside = jnp.all((base >= 0) & (base + 1 < size), axis=-1)
    base = jnp.clip(base, 0, size - 2)
    width = tile.valid.shape[1]
    step = jnp.asarray([0, 1, width, width + 1], dtype=jnp.int32).reshape((1,) * (position_m.ndim - 1) + (4,))
    corners = (base[..., 0] * width + base[..., 1])[..., None] + step
    return corners, cells - low, inside & jnp.all(tile.valid.reshape(-1)[corners], axis=-1)


def leads_off_map(
    tile: Tile, template: Template, pose: Float[Array, "batch 6"], min_overlap: float | Float[Array, ""]
) -> Bool[Array, "batch 2"]:
    """Along and across: whether a cell to either side of each pose leaves less than ``min_overlap`` on the map."""
    step = np.array([[1.0, 0.0], [-1.0, 0.0], [0.0, 1.0], [0.0, -1.0]], np.float32)
    moved = jnp.asarray(step)[:, None, None] * tile.cell_m[None, None, None]
    _, _, on_map = _cell_of(tile, (pose[:, None, :2] + _turned(template, pose))[None] + moved)
    traces = jnp.maximum(jnp.sum(template.valid, axis=-1, dtype=jnp.float32), 1.0)[None]
    off = jnp.sum(on_map & template.valid[None], axis=-1, dtype=jnp.float32) / traces < min_overlap
    return jnp.stack([off[0] & off[1], off[2] & off[3]], axis=-1)
