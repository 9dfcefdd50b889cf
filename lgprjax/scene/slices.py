"""The part of the ground that a block of scans can see, in float32 about the block's own origin."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.scene.day import Conditions, usual_conditions
from lgprjax.scene.fields import Field, field_about, value_at
from lgprjax.scene.ground import Ground, Layers
from lgprjax.scene.objects import Utilities

TRENCHES = 2


class GroundSlice(NamedTuple):
    """What a block of scans sees; rows of strength 0 are padding.

    The arrays are NumPy's on the host and JAX's inside a compiled function.

    Attributes:
        stone_m, stone_strength_m: (along, cross, depth) and scattering length of stones and roots.
        stone_slowness: of the ground between the surface and the stone, relative to the day's mean.
        utilities, layers: as in the ground.
        slowness: the same as ``stone_slowness`` as fields over place: permanent, of the day.
        skin_m, skin_slowness: see ``Conditions``.
        cover_m: thickness of the snow; cover: (index, attenuation_per_m, lift, reflectivity).
        trenches: (from along, to along, from cross, to cross, depth).
        velocity_m_per_ns, attenuation_per_m: the day's; dispersive_share: see ``GroundConfig``.
    """

    stone_m: Float[np.ndarray, "stone 3"]
    stone_strength_m: Float[np.ndarray, " stone"]
    stone_slowness: Float[np.ndarray, " stone"]
    utilities: Utilities
    layers: Layers
    moisture: tuple[Field, Field]
    skin_m: Field
    skin_slowness: Float[np.ndarray, ""]
    cover_m: Field
    cover: Float[np.ndarray, "4"]
    trenches: Float[np.ndarray, "trench 5"]
    velocity_m_per_ns: Float[np.ndarray, ""]
    attenuation_per_m: Float[np.ndarray, ""]
    dispersive_share: Float[np.ndarray, ""]


def count_stones(ground: Ground, from_m: Float[np.ndarray, " block"], to_m: Float[np.ndarray, " block"]) -> int:
    """Most stones found in any of the windows [from, to] along the track."""
    along = ground.scatterers.place_m[:, 0]
    return int(np.max(np.searchsorted(along, to_m) - np.searchsorted(along, from_m)))


def count_utilities(ground: Ground, from_m: Float[np.ndarray, " block"], to_m: Float[np.ndarray, " block"]) -> int:
    """Most pipes and cables that reach into any of the windows [from, to] along the track."""
    low, high = _extent(ground.utilities)
    return int(np.max(np.sum((high[None] >= from_m[:, None]) & (low[None] <= to_m[:, None]), axis=1), initial=0))


def slice_ground(
    ground: Ground,
    from_m: float,
    to_m: float,
    *,
    stones: int,
    utilities: int = 8,
    origin_m: tuple[float, float] = (0.0, 0.0),
    conditions: Conditions | None = None,
) -> GroundSlice:
    """Cuts the window [from, to] along the track out of the ground, about ``origin_m`` (along, cross).

    Args:
        stones, utilities: rows of the result, the same for every block of a drive: nothing is compiled anew.
        conditions: of the day; without any the ground is as its config says.

    Raises:
        ValueError: the window holds more stones or utilities than asked for, or more than ``TRENCHES`` trenches.
    """
    conditions = usual_conditions() if conditions is None else conditions
    place_m, strength_m = ground.scatterers
    first, last = (int(i) for i in np.searchsorted(place_m[:, 0], [from_m, to_m]))
    if last - first > stones:
        raise ValueError(f"window [{from_m}, {to_m}] holds {last - first} stones, more than {stones}")
    origin = np.asarray(origin_m, np.float64)
    seen = place_m[first:last]
    place = np.zeros((stones, 3), np.float32)
    place[:, 2] = 1.0  # padding lies at a harmless depth: no division by zero
    place[: len(seen)] = seen - np.append(origin, 0.0)
    strength = np.zeros(stones, np.float32)
    strength[: len(seen)] = strength_m[first:last]
    slowness = np.ones(stones, np.float32)
    moisture = value_at(ground.moisture, seen[:, :2]) + value_at(conditions.moisture, seen[:, :2])
    in_skin = np.clip(value_at(conditions.skin_m, seen[:, :2]), 0.0, seen[:, 2]) / seen[:, 2]
    slowness[: len(seen)] = 1.0 + moisture + conditions.skin_slowness * in_skin
    turn = ground.layers.wave_rad_per_m @ origin
    layers = ground.layers._replace(
        relief_phase_rad=np.mod(ground.layers.relief_phase_rad + turn, 2 * np.pi),
        reflectivity_phase_rad=np.mod(ground.layers.reflectivity_phase_rad + turn, 2 * np.pi),
    )
    cover = conditions.cover
    return GroundSlice(
        stone_m=place,
        stone_strength_m=strength,
        stone_slowness=slowness,
        utilities=_near(ground.utilities, from_m, to_m, origin, utilities),
        layers=Layers(*(a.astype(np.float32) for a in layers)),
        moisture=(field_about(ground.moisture, origin), field_about(conditions.moisture, origin)),
        skin_m=field_about(conditions.skin_m, origin),
        skin_slowness=np.asarray(conditions.skin_slowness, np.float32),
        cover_m=field_about(conditions.cover_m, origin),
        cover=np.array([cover.index, cover.attenuation_per_m, cover.lift, cover.reflectivity], np.float32),
        trenches=_trenches_within(conditions.trenches, from_m, to_m, origin),
        velocity_m_per_ns=np.asarray(ground.config.velocity_m_per_ns * conditions.velocity_factor, np.float32),
        attenuation_per_m=np.asarray(ground.config.attenuation_per_m * conditions.attenuation_factor, np.float32),
        dispersive_share=np.asarray(ground.config.dispersive_share, np.float32),
    )


def _extent(utilities: Utilities) -> tuple[Float[np.ndarray, " utility"], Float[np.ndarray, " utility"]]:
    reach = np.abs(utilities.direction[:, 0]) * utilities.half_length_m
    return utilities.centre_m[:, 0] - reach, utilities.centre_m[:, 0] + reach


def _near(utilities: Utilities, from_m: float, to_m: float, origin_m: Float[np.ndarray, "2"], rows: int) -> Utilities:
    """Those that reach into the window, about the origin."""
    low, high = _extent(utilities)
    inside = (high >= from_m) & (low <= to_m)
    if inside.sum() > rows:
        raise ValueError(f"window [{from_m}, {to_m}] holds {inside.sum()} utilities, more than {rows}")
    out = Utilities(
        centre_m=np.zeros((rows, 2), np.float32),
        direction=np.tile(np.array([1.0, 0.0], np.float32), (rows, 1)),
        half_length_m=np.zeros(rows, np.float32),
        depth_m=np.ones(rows, np.float32),
        radius_m=np.ones(rows, np.float32),
        reflectivity=np.zeros(rows, np.float32),
    )
    near = Utilities(*(a[inside] for a in utilities))
    near = near._replace(centre_m=near.centre_m - origin_m)
    for padded, kept in zip(out, near, strict=True):
        padded[: len(kept)] = kept
    return out


def _trenches_within(
    trenches: Float[np.ndarray, "trench 5"], from_m: float, to_m: float, origin_m: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "kept 5"]:
    """The trenches that reach into the window, about the origin; rows without one lie far away."""
    inside = trenches[(trenches[:, 1] >= from_m) & (trenches[:, 0] <= to_m)]
    if len(inside) > TRENCHES:
        raise ValueError(f"window [{from_m}, {to_m}] holds {len(inside)} trenches, more than {TRENCHES}")
    out = np.full((TRENCHES, 5), 1e6)
    out[:, 4] = 0.0
    out[: len(inside)] = inside
    out[:, :2] -= origin_m[0]
    out[:, 2:4] -= origin_m[1]
    return out.astype(np.float32)
