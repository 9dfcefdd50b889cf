"""Registration as a Bayes filter over the error of dead reckoning, with one state for "not on this lattice's ground".

    predict     odometry lets the error wander; a little mass leaks to anywhere, to foreign ground, and back
    weigh       times the evidence of the stop's correlation at every place, against foreign ground
    normalise
    report      the mode, and the probability of everything else

A stop is a scan every few centimetres of travel. The state is joint over alternatives (time scale and height), over the
repeatability of the ground, and over places along and across. ``run`` leads it over a chunk of stops without a word to
the host; on board a chunk is one stop. Source: Bayes filters on grids (Thrun, Burgard and Fox, 2005, 8.2).
"""

from functools import partial
from typing import NamedTuple, TypeVar

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Bool, Float, Int

from lgprjax.registration.bayes.likelihood import RHOS, Likelihood, evidence
from lgprjax.registration.bayes.score import LatticeGround, Surface, correlate
from lgprjax.registration.fix import WRONG_M

ArrayT = TypeVar("ArrayT", Array, np.ndarray)
_SCATTER_M = 2.0
"""Travel over which the drive's own scatter is averaged."""
_BESIDE = (7, 7)
"""Places ahead of the mode, and as many behind, from which a stop's scatter is taken."""
_LEAST_CELLS = 24.0
_LEAST_FAR = 200.0
"""Places that measure the scatter of foreign ground: those of a lattice over the whole region."""
SURE_SIGMAS = 4.0
_MOST_ASIDE = 0.5  # of the wavelength: beyond it a place resembles the mode's by chance alone
_KEPT = 15.0 / 16.0
"""Of a sum of correlations, from stop to stop."""


class FilterState(NamedTuple):
    """Posterior after a stop.

    Attributes:
        mass: of each alternative, repeatability and place; with ``foreign`` it sums to one.
        foreign: of ground that is not the map's, and of all places and alternatives beyond the lattice.
        variance: of the correlation ahead of the mode and behind it, over the last metres.
        summed: correlation at each place, summed over the last stops.
        alone: mean square of such a sum if stops were independent.
    """

    mass: Float[Array, "plane rho along cross"]
    foreign: Float[Array, ""]
    variance: Float[Array, ""]
    summed: Float[Array, "along cross"]
    alone: Float[Array, ""]


class Stop(NamedTuple):
    """One stop, or a chunk of them.

    Attributes:
        live: traces at every alternative, see ``live_components``.
        valid: 1 for channels that hold data.
        corner: of the lattice on the ground, see ``correlate``.
        offset: of the channels.
        facing: heading as a unit vector, along and across.
        travel_m: since the stop before, never negative.
        wander: variance that the error gains on the way, along and across, in squared lattice steps.
        leap: probability that dead reckoning has lost its place: an observed step of positions.
        there: the stop exists; chunks are filled to their size.
    """

    live: Float[Array, "*stop plane channel component"]
    valid: Float[Array, "*stop channel"]
    corner: Float[Array, "*stop 2"]
    offset: Float[Array, "*stop channel 2"]
    facing: Float[Array, "*stop 2"]
    travel_m: Float[Array, "*stop"]
    wander: Float[Array, "*stop 2"]
    leap: Float[Array, "*stop"]
    there: Bool[Array, "*stop"]


class Model(NamedTuple):
    """What the filter assumes.

    Attributes:
        likelihood: of the map and the array.
        step_m: of the lattice, along and across.
        wavelength_m: within which ground resembles itself.
        spacing_m: travel for which a stop holds the evidence that the likelihood was measured for.
        apart: places along from the mode at which ground does not resemble that of the mode any more.
        lost, foreign, back: mass that leaks in a metre to anywhere on the lattice, to foreign ground, and from there.
        mixing: mass that alternatives exchange with a neighbour in a metre, and repeatabilities.
        neighbour: of alternatives: 1 for neighbours, else 0.
        whole: the lattice covers the whole region.
    """

    likelihood: Likelihood
    step_m: Float[Array, "2"]
    wavelength_m: Float[Array, ""]
    spacing_m: Float[Array, ""]
    apart: Float[Array, ""]
    lost: Float[Array, ""]
    foreign: Float[Array, ""]
    back: Float[Array, ""]
    mixing: Float[Array, ""]
    neighbour: Float[Array, "plane plane"]
    whole: Bool[Array, ""]


class Posterior(NamedTuple):
    """Report of a stop.

    Attributes:
        mode: place with the largest mass, along and across.
        p_false: probability of everything elsewhere (``elsewhere``), foreign ground included.
        foreign: of it, foreign ground and all beyond the lattice.
        rim: mass in the outermost places of the lattice.
        plane, rho: mass of the alternatives and of the repeatabilities.
        r: correlation at the mode, for the alternative with the largest mass.
        cover: share of the array on the map there; ``widest`` the largest on the lattice.
        variance: see ``FilterState``.
        aside_m2: variance of the place at right angles to the heading, within 0.3 m of the mode.
        crop: mass of the places about the mode; ``crop_at`` its first one.
    """

    mode: Int[Array, "*stop 2"]
    p_false: Float[Array, "*stop"]
    foreign: Float[Array, "*stop"]
    rim: Float[Array, "*stop"]
    plane: Float[Array, "*stop plane"]
    rho: Float[Array, "*stop rho"]
    r: Float[Array, "*stop"]
    cover: Float[Array, "*stop"]
    widest: Float[Array, "*stop"]
    variance: Float[Array, "*stop"]
    aside_m2: Float[Array, "*stop"]
    crop: Float[Array, "*stop _ _"]
    crop_at: Int[Array, "*stop 2"]


def predict(state: FilterState, stop: Stop, model: Model) -> FilterState:
    """The state before a stop is heard."""
    mass, foreign = state.mass, state.foreign
    for axis, variance in ((2, stop.wander[0]), (3, stop.wander[1])):
        mass = diffused(mass, jnp.minimum(0.5 * variance, 0.25), axis)
    mixing = jnp.minimum(model.mixing * stop.travel_m, 0.1)
    ways = jnp.sum(model.neighbour, axis=1)
    mass = mass + mixing * (jnp.einsum("gh,hrij->grij", model.neighbour, mass) - ways[:, None, None, None] * mass)
    mass = diffused(mass, mixing, 1)
    places = mass.shape[2] * mass.shape[3]
    of_plane = jnp.sum(mass, axis=(2, 3), keepdims=True)
    leap = jnp.minimum(model.lost * stop.travel_m + stop.leap, 1.0)
    gone, returned = model.foreign * stop.travel_m, model.back * stop.travel_m * foreign
    fresh = returned / (mass.shape[0] * mass.shape[1] * places)
    held = (1.0 - gone) * ((1.0 - leap) * mass + leap * of_plane / places) + fresh
    return state._replace(mass=held, foreign=foreign - returned + gone * jnp.sum(of_plane))


def shown(state: FilterState, surface: Surface, stop: Stop, model: Model) -> tuple[FilterState, Float[Array, ""]]:
    """What places more than a wavelength from the mode show, where the lattice covers the region: scatter of foreign
    ground over the last metres, and its memory, else 0.
    """
    place = jnp.sum(state.mass, axis=(0, 1))
    mode = jnp.unravel_index(jnp.argmax(place), place.shape)
    along, cross = (
        (jnp.arange(place.shape[axis]) - mode[axis]).astype(jnp.float32) * model.step_m[axis] for axis in range(2)
    )
    far = (along[:, None] ** 2 + cross[None] ** 2 > model.wavelength_m**2) & (surface.cover > 0.0)
    cells = jnp.sum(far, dtype=jnp.float32)

    def mean(square: Float[Array, "along cross"]) -> Float[Array, ""]:
        return jnp.sum(jnp.where(far, square, 0.0)) / jnp.maximum(cells, 1.0)

    share = jnp.minimum(stop.travel_m / model.spacing_m, 1.0)
    kept, fresh = _KEPT**share, share * surface.r[len(surface.r) // 2]
    summed = kept * state.summed + fresh
    alone = kept**2 * state.alone + mean(fresh**2)
    # About a known place its own ground's correlation stays where it is, stop after stop: no memory of foreign ground.
    wide = model.whole & (cells >= _LEAST_FAR)
    memory = jnp.where(wide & (alone > 0.0), mean(summed**2) / jnp.maximum(alone, 1e-12), 0.0)
    variance = renewed(state.variance, mean(jnp.mean(surface.r**2, axis=0)), wide, stop.travel_m)
    return state._replace(summed=summed, alone=alone, variance=variance), memory


def renewed(
    mean: Float[Array, ""], fresh: Float[Array, ""], heard: Bool[Array, ""], travel_m: Float[Array, ""]
) -> Float[Array, ""]:
    """Mean over the last metres of travel with a fresh value."""
    return mean + jnp.where(heard, 1.0 - jnp.exp(-travel_m / _SCATTER_M), 0.0) * (fresh - mean)


def weigh(state: FilterState, surface: Surface, stop: Stop, model: Model) -> FilterState:
    """The state times the evidence of a surface, normalised."""
    known = model.likelihood
    state, memory = shown(state, surface, stop, model)
    variance = jnp.maximum(known.variance, state.variance)
    numbers: Array = 1.0 / (variance * jnp.maximum(memory, known.memory))
    numbers = numbers * jnp.minimum(stop.travel_m / model.spacing_m, 1.0) * surface.cover
    rho = jnp.asarray(RHOS, dtype=jnp.float32)[None, :, None, None]
    ratio = evidence(surface.r[:, None], rho, numbers[None, None])
    mass, foreign = normalised(state.mass, state.foreign, ratio, jnp.asarray(known.tail))
    return state._replace(mass=mass, foreign=foreign)


def normalised(
    mass: Float[Array, "*state"], foreign: Float[Array, ""], ratio: Float[Array, "*state"], tail: Float[Array, ""]
) -> tuple[Float[Array, "*state"], Float[Array, ""]]:
    """Mass and foreign ground after a stop whose evidence is ``ratio``; a share ``tail`` of stops says nothing."""
    any_way = tail * jnp.sum(mass * ratio) / jnp.maximum(jnp.sum(mass), 1e-30)
    mass, foreign = mass * ((1.0 - tail) * ratio + any_way), foreign * (1.0 - tail + any_way)
    whole = jnp.sum(mass) + foreign
    return mass / whole, foreign / whole


def scatter(state: FilterState, stop: Stop, ground: LatticeGround, model: Model, reach: tuple[int, int]) -> FilterState:
    """The drive's own scatter, renewed by places ahead of the mode and behind it, for the likeliest alternative."""
    place = jnp.sum(state.mass, axis=(0, 1))
    mode = jnp.stack(jnp.unravel_index(jnp.argmax(place), place.shape)).astype(jnp.float32)
    plane = jnp.argmax(jnp.sum(state.mass, axis=(1, 2, 3)))
    live = jax.lax.dynamic_slice_in_dim(stop.live, plane, 1, axis=0)
    square, cells = jnp.float32(0.0), jnp.float32(0.0)
    half = 0.5 * jnp.asarray(_BESIDE, jnp.float32)
    for side in (-1.0, 1.0):
        corner = stop.corner + mode - half + jnp.stack([side * model.apart, jnp.float32(0.0)])
        surface = correlate(ground, live, stop.valid, corner, stop.offset, _BESIDE, reach)
        square += jnp.sum(surface.r[0] ** 2 * surface.cover)
        cells += jnp.sum(surface.cover > 0.0, dtype=jnp.float32)
    heard = ~model.whole & (cells >= _LEAST_CELLS)
    return state._replace(variance=renewed(state.variance, square / jnp.maximum(cells, 1.0), heard, stop.travel_m))


def elsewhere(place: ArrayT, ahead_m: ArrayT, aside_m: ArrayT, wavelength_m: ArrayT) -> tuple[ArrayT, ArrayT]:
    """Mass elsewhere: more than 0.3 m from the mode along the heading, or aside by that and by four sigmas.

    An array narrower than a wavelength cannot tell places aside from each other as it can those ahead; its fixes state
    that sigma, and a place within it is no other place. Half a wavelength away is another one in any case.

    Args:
        place: mass of each place, the last two axes; of NumPy or of JAX.
        ahead_m, aside_m: of each from the mode, in the vehicle's heading.
        wavelength_m: in the soil.

    Returns:
        the mass, and the variance aside within 0.3 m, m².
    """
    near = ((abs(ahead_m) <= WRONG_M) & (abs(aside_m) <= WRONG_M)).astype(place.dtype) * place
    variance_m2 = (near * aside_m**2).sum((-2, -1)) / (near.sum((-2, -1)) + 1e-30)
    reach_m = (SURE_SIGMAS * variance_m2**0.5).clip(WRONG_M, (_MOST_ASIDE * wavelength_m).clip(WRONG_M))
    far = (abs(ahead_m) > WRONG_M) | (abs(aside_m) > reach_m[..., None, None])
    return (far.astype(place.dtype) * place).sum((-2, -1)), variance_m2


def report(state: FilterState, surface: Surface, facing: Float[Array, "2"], model: Model, crop: int) -> Posterior:
    """What the state says."""
    place = jnp.sum(state.mass, axis=(0, 1))
    size = place.shape
    mode = jnp.stack(jnp.unravel_index(jnp.argmax(place), size)).astype(jnp.int32)
    along, cross = (
        (jnp.arange(size[axis], dtype=jnp.float32) - mode[axis].astype(jnp.float32)) * model.step_m[axis]
        for axis in range(2)
    )
    ahead = along[:, None] * facing[0] + cross[None] * facing[1]
    aside = cross[None] * facing[0] - along[:, None] * facing[1]
    far, aside_m2 = elsewhere(place, ahead, aside, model.wavelength_m)
    plane, rho = jnp.sum(state.mass, axis=(1, 2, 3)), jnp.sum(state.mass, axis=(0, 2, 3))
    r = surface.r[jnp.argmax(plane)]
    shape = (min(crop, size[0]), min(crop, size[1]))
    first = jnp.clip(mode - jnp.asarray(shape) // 2, 0, jnp.asarray(size) - jnp.asarray(shape))
    inner = jnp.pad(jnp.zeros((size[0] - 2, size[1] - 2)), 1, constant_values=1.0)
    return Posterior(
        mode=mode,
        p_false=jnp.clip(state.foreign + far, 0.0, 1.0),
        foreign=state.foreign,
        rim=jnp.sum(place * inner),
        plane=plane,
        rho=rho,
        r=r[mode[0], mode[1]],
        cover=surface.cover[mode[0], mode[1]],
        widest=jnp.max(surface.cover),
        variance=state.variance,
        aside_m2=aside_m2,
        crop=jax.lax.dynamic_slice(place, (first[0], first[1]), shape),
        crop_at=first,
    )


def step(
    state: FilterState, stop: Stop, ground: LatticeGround, model: Model, reach: tuple[int, int], crop: int
) -> tuple[FilterState, Posterior]:
    """One stop: predict, weigh, normalise, report. A stop that is not there changes nothing."""
    planes, size = len(state.mass), (state.mass.shape[2], state.mass.shape[3])
    # A branch is computed into memory. Without it the compiler computes the correlation of a place again for every
    # repeatability and every sum over places, which takes two to three times as long.
    surface = jax.lax.cond(
        stop.there,
        lambda: correlate(ground, stop.live, stop.valid, stop.corner, stop.offset, size, reach),
        lambda: Surface(jnp.zeros((planes, *size)), jnp.zeros(size)),
    )
    after = weigh(predict(state, stop, model), surface, stop, model)
    posterior = report(after, surface, stop.facing, model, crop)
    after = scatter(after, stop, ground, model, reach)
    return jax.tree.map(lambda new, old: jnp.where(stop.there, new, old), after, state), posterior


@partial(jax.jit, static_argnames=("reach", "crop"))
def run(
    state: FilterState, stops: Stop, ground: LatticeGround, model: Model, *, reach: tuple[int, int], crop: int
) -> tuple[FilterState, Posterior]:
    """A chunk of stops over one tile, in order.

    Args:
        state: before the first of them.
        stops: with a leading axis.
        ground: of the tile.
        model: of the filter.
        reach: places that a channel may be from the array's centre, along and across.
        crop: side of ``Posterior.crop``.
    """
    return jax.lax.scan(lambda before, stop: step(before, stop, ground, model, reach, crop), state, stops)


def begin(planes: int, shape: tuple[int, int], foreign: float, variance: float) -> FilterState:
    """Nothing known: uniform on the lattice, with a prior mass of foreign ground."""
    each = (1.0 - foreign) / (planes * len(RHOS) * shape[0] * shape[1])
    return FilterState(
        mass=jnp.full((planes, len(RHOS), *shape), each, jnp.float32),
        foreign=jnp.float32(foreign),
        variance=jnp.float32(variance),
        summed=jnp.zeros(shape, jnp.float32),
        alone=jnp.float32(0.0),
    )


def diffused(mass: Float[Array, "plane rho along cross"], share: Float[Array, ""], axis: int) -> Array:
    """A share goes to each neighbour along an axis; at the ends it stays."""
    count = mass.shape[axis]
    first, second = (jax.lax.slice_in_dim(mass, at, at + count - 1, axis=axis) for at in (0, 1))
    from_next, to_next = (
        jnp.pad(second - first, [ends if each == axis else (0, 0) for each in range(mass.ndim)])
        for ends in ((0, 1), (1, 0))
    )
    return mass + share * (from_next - to_next)
