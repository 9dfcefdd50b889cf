"""What stops ahead say as well: the filter led from the other end, and both reports joined.

Forward posterior at a stop, times the backward one of the stop after it, over the prior: each stop's evidence counts
once. Memory is that of one crop of places a stop and direction, so that segments of a long drive are joined by
themselves (``SEGMENT``).
"""

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.registration.bayes.drive import Followed
from lgprjax.registration.bayes.filter import elsewhere
from lgprjax.registration.queries import rotation

SEGMENT, LAG = 8192, 512
"""Stops that are joined at once, and of the backward pass that lie beyond them: some hundred MB."""
_PRIOR = 0.5
_DECIDED = 1e-4  # mass beyond the crop


def join(
    forward: Followed,
    backward: Followed,
    last: Bool[np.ndarray, " stop"],
    step_m: Float[np.ndarray, "2"],
    places: int,
    wavelength_m: float,
) -> Followed:
    """Reports of both directions joined, at every stop.

    Args:
        forward, backward: of the same stops, in the same order.
        last: no stop of the same leg follows.
        step_m: of the lattice.
        places: of the whole lattice, over which the prior is uniform.
        wavelength_m: in the soil.
    """
    after = np.minimum(np.arange(len(last)) + 1, len(last) - 1)
    behind = Followed(*(field[after] for field in backward))
    # Beyond the end of a leg nothing is known but the prior.
    out_ahead = np.where(last, 1.0, np.clip(1.0 - behind.crop.sum(axis=(1, 2)), 0.0, 1.0))
    crop_ahead = np.where(last[:, None, None], 0.0, behind.crop)
    ahead = behind._replace(crop=crop_ahead.astype(np.float32))
    out = np.clip(1.0 - forward.crop.sum(axis=(1, 2)), 0.0, 1.0)
    size = forward.crop.shape[1]
    each = _PRIOR / places
    others = 1.0 - each * size**2
    # On the places of the forward one, which has followed the alternatives for longer, unless the other is surer.
    first = out <= np.maximum(out_ahead, _DECIDED)
    here, there = _chosen(first, forward, ahead), _chosen(first, ahead, forward)
    other = _resampled(there, here, step_m, each * np.maximum(out, out_ahead))
    joint = here.crop * other / each
    beyond = out * out_ahead / others
    # Without a report from the other end, the first is used.
    joint, beyond = (
        np.where(last.reshape(-1, *(1,) * (one.ndim - 1)), alone, one)
        for one, alone in ((joint, forward.crop.astype(np.float64)), (beyond, out))
    )
    here = Followed(
        *(np.where(last.reshape(-1, *(1,) * (a.ndim - 1)), b, a) for a, b in zip(here, forward, strict=True))
    )
    whole = joint.sum(axis=(1, 2)) + beyond
    joint, beyond = joint / whole[:, None, None], beyond / whole
    row, column = np.unravel_index(joint.reshape(len(joint), -1).argmax(axis=1), joint.shape[1:])
    along = (np.arange(size)[None] - row[:, None]) * step_m[0]
    cross = (np.arange(size)[None] - column[:, None]) * step_m[1]
    turn = (here.heading - here.yaw)[:, None, None]
    ahead_m = along[:, :, None] * np.cos(turn) + cross[:, None] * np.sin(turn)
    aside_m = cross[:, None] * np.cos(turn) - along[:, :, None] * np.sin(turn)
    far, aside_m2 = elsewhere(joint, ahead_m, aside_m, np.asarray(wavelength_m))
    p_false = beyond + far
    place_m = np.stack([row * step_m[0], column * step_m[1]], axis=-1)
    error_m = here.first_m + np.einsum("ijs,sj->si", rotation(here.yaw), place_m)
    foreign = np.where(last, forward.foreign, forward.foreign * ahead.foreign / _PRIOR) / whole
    return here._replace(
        error_m=error_m,
        p_false=np.clip(p_false, 0.0, 1.0),
        foreign=np.minimum(foreign, 1.0),
        aside_m2=aside_m2,
        crop=joint.astype(np.float32),
        rim=np.minimum(forward.rim, ahead.rim),
        r=forward.r,
        cover=forward.cover,
        widest=forward.widest,
    )


def reversed_report(report: Followed) -> Followed:
    """The same stops in the opposite order."""
    return Followed(*(field[::-1] for field in report))


def _chosen(first: Bool[np.ndarray, " stop"], one: Followed, other: Followed) -> Followed:
    return Followed(*(np.where(first.reshape(-1, *(1,) * (a.ndim - 1)), a, b) for a, b in zip(one, other, strict=True)))


def _resampled(
    of: Followed, at: Followed, step_m: Float[np.ndarray, "2"], floor: Float[np.ndarray, " stop"]
) -> Float[np.ndarray, "stop _ _"]:
    """Mass of one report at the places of another's crop, no less than ``floor`` a place."""
    size = of.crop.shape[1]
    grid = np.stack(np.meshgrid(np.arange(size), np.arange(size), indexing="ij"), axis=-1) * step_m
    out = np.empty((len(floor), size, size))
    for low in range(0, len(floor), 256):
        some = slice(low, low + 256)
        place_m = np.einsum("ijs,abj->sabi", rotation(at.yaw[some]), grid) + at.first_m[some, None, None]
        away = place_m - of.first_m[some, None, None]
        cells = np.einsum("jis,sabj->sabi", rotation(of.yaw[some]), away) / step_m
        base = np.floor(cells).astype(int)
        part = cells - base
        value = np.zeros(cells.shape[:3])
        number = np.arange(len(cells))[:, None, None]
        for i, j in np.ndindex(2, 2):
            index = base + (i, j)
            inside = np.all((index >= 0) & (index < size), axis=-1)
            index = np.clip(index, 0, size - 1)
            weight = np.abs(1 - i - part[..., 0]) * np.abs(1 - j - part[..., 1])
            value += np.where(inside, weight * of.crop[some][number, index[..., 0], index[..., 1]], 0.0)
        out[some] = np.maximum(value, floor[some, None, None])
    return out
