"""The filter is honest: its errors are as large as its covariance says, and its innovations as large as expected."""

from collections.abc import Callable

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from scipy.stats import chi2

from lgprjax.navigation import (
    SOURCES,
    FilterInfo,
    FilterState,
    MotionInput,
    NavEstimate,
    Observations,
    default_model,
    default_rules,
    init_filter,
    step_filter,
)
from lgprjax.vehicle import VehiclePose
from validation.filters.drawn_drives import Drawn, draw_drives

RUNS, TICKS, EVERY = 500, 630, 5


MODEL = default_model(zero_slip_m=1.4, gnss_x_m=0.8, gnss_y_m=0.3, array_x_m=6.0, array_y_m=-0.1)


@pytest.fixture(scope="module")
def drawn() -> Drawn:
    return draw_drives(MODEL, runs=RUNS, ticks=TICKS, seed=11)


@pytest.fixture(scope="module")
def filtered(drawn: Drawn) -> tuple[NavEstimate, FilterInfo]:
    """Estimates at every fifth tick, and what became of each tick's observations."""
    rules = default_rules()
    step = jax.vmap(step_filter, in_axes=(None, None, 0, 0, 0))

    def one(state: FilterState, given: tuple[MotionInput, Observations]) -> tuple[FilterState, FilterInfo]:
        return step(MODEL, rules, state, *given)

    def some(
        state: FilterState, given: tuple[MotionInput, Observations]
    ) -> tuple[FilterState, tuple[NavEstimate, FilterInfo]]:
        state, info = jax.lax.scan(one, state, given)
        return state, (state.estimate, info)

    start = jnp.asarray(drawn.start, jnp.float32)
    state = jax.vmap(lambda at: init_filter(MODEL, VehiclePose(at[0], at[1], at[2]), at[3]))(start)
    given = jax.tree.map(
        lambda leaf: leaf.reshape(TICKS // EVERY, EVERY, *leaf.shape[1:]), (drawn.motions, drawn.observations)
    )
    driven: tuple[NavEstimate, FilterInfo] = jax.jit(lambda: jax.lax.scan(some, state, given))()[1]
    return driven


def test_errors_are_as_large_as_the_covariance_says(
    drawn: Drawn, filtered: tuple[NavEstimate, FilterInfo], record_property: Callable[[str, object], None]
) -> None:
    """NEES of the 13 states: the mean over the runs lies in its 95 % band at nine tenths of the times and more."""
    estimates = filtered[0]
    error = drawn.truth[EVERY - 1 :: EVERY] - np.asarray(estimates.mean, np.float64)
    covariance = np.asarray(estimates.covariance, np.float64)
    assert np.linalg.eigvalsh(covariance)[..., 0].min() > 0.0
    nees = np.einsum("tri,tri->tr", error, np.linalg.solve(covariance, error[..., None])[..., 0]).mean(axis=1)
    low, high = chi2.ppf([0.025, 0.975], 13 * RUNS) / RUNS
    inside = float(np.mean((nees >= low) & (nees <= high)))
    record_property("nees_inside", round(inside, 3))
    record_property("nees_mean", round(float(nees.mean()), 2))
    assert inside >= 0.9


@pytest.mark.parametrize(("source", "parts"), list(zip(SOURCES, (2, 1, 1, 3), strict=True)))
def test_innovations_are_as_large_as_expected(
    source: str, parts: int, filtered: tuple[NavEstimate, FilterInfo], record_property: Callable[[str, object], None]
) -> None:
    """NIS of a source: the mean over the runs offered one lies in its 95 % band at nine tenths of the ticks."""
    index = SOURCES.index(source)
    nis = np.asarray(filtered[1].nis, np.float64)[..., index].reshape(TICKS, RUNS)
    offered = np.asarray(filtered[1].offered)[..., index].reshape(TICKS, RUNS)
    count = offered.sum(axis=1)
    some = count > 0
    assert np.all(nis[~offered] == 0.0)
    mean = nis.sum(axis=1)[some] / count[some]
    low, high = (chi2.ppf(share, parts * count[some]) / count[some] for share in (0.025, 0.975))
    inside = float(np.mean((mean >= low) & (mean <= high)))
    record_property("nis_inside", round(inside, 3))
    assert inside >= 0.9


def test_hardly_any_honest_observation_is_rejected(filtered: tuple[NavEstimate, FilterInfo]) -> None:
    """One in ten thousand by the thresholds; none by way of an outage."""
    offered, accepted = (np.asarray(part).sum(axis=(0, 1, 2)) for part in (filtered[1].offered, filtered[1].accepted))
    assert np.all(offered > 50_000)
    assert np.all((offered - accepted) / offered < 4e-4)
    assert not np.any(np.asarray(filtered[1].reacquired))
