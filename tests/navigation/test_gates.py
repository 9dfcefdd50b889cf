"""The gates: what jumps, sticks or lies is kept out while another source witnesses, and let in where none does."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation import (
    FilterState,
    GnssObservation,
    HeadingObservation,
    LgprObservation,
    MotionInput,
    Observations,
    OdometerObservation,
    default_model,
    default_rules,
    init_filter,
    step_filter,
)
from lgprjax.vehicle import VehiclePose

STEP_S, SPEED_MPS, TICKS, FAULT = 1.0 / 21.0, 4.47, 630, 210
"""Half a minute east at 10 mph; the fault comes after ten seconds."""
GNSS_LEVER_M, ARRAY_M = 0.8, 6.0
REACQUIRE_GNSS = 15


class Given(NamedTuple):
    """One drive's sources: places of the rear axle as each source has it, and when it gives one."""

    gnss_m: np.ndarray
    gnss_on: np.ndarray
    lgpr_m: np.ndarray
    lgpr_on: np.ndarray
    wheels_mps: np.ndarray


Places = tuple[jax.Array, ...]
"""The same on the device."""


class Seen(NamedTuple):
    """What came of it, a tick a row: error of the rear axle, each source's fate, conflict."""

    error_m: np.ndarray
    accepted: np.ndarray
    rejected: np.ndarray
    reacquired: np.ndarray
    conflict_s: np.ndarray


def honest() -> Given:
    rng = np.random.default_rng(3)
    ticks = np.arange(TICKS)
    truth = np.stack([(ticks + 1) * STEP_S * SPEED_MPS, np.zeros(TICKS)], axis=1)
    return Given(
        truth + rng.normal(0.0, 0.01, truth.shape),
        ticks % 4 == 0,
        truth + rng.normal(0.0, 0.02, truth.shape),
        np.full(TICKS, True),
        SPEED_MPS + rng.normal(0.0, 0.03, TICKS),
    )


def given_as(
    gnss_m: np.ndarray | float = 0.0, lgpr_m: float = 0.0, *, lgpr: bool = True, sticks: bool = False
) -> Given:
    """A drive whose GNSS or LGPR is aside from the fault on, whose GNSS sticks, or that has no LGPR at all."""
    given = honest()
    given.gnss_m[FAULT:, 1] += gnss_m
    given.lgpr_m[FAULT:, 1] += lgpr_m
    if sticks:
        given.gnss_m[FAULT:] = given.gnss_m[FAULT]
    return given._replace(lgpr_on=given.lgpr_on & lgpr)


def garbled() -> Given:
    """Positions that are no numbers, now and then infinite."""
    given = honest()
    given.gnss_m[FAULT : FAULT + 42], given.lgpr_m[FAULT : FAULT + 42] = np.nan, np.inf
    return given


def witnessless_then_back() -> Given:
    """GNSS jumps by 3 m while LGPR witnesses; eight seconds later LGPR falls silent."""
    given = given_as(3.0)
    return given._replace(lgpr_on=given.lgpr_on & (np.arange(TICKS) < FAULT + 168))


DRIVES = {
    "0.3 m, witnessed": given_as(0.3),
    "30 m, witnessed": given_as(30.0),
    "3 m, alone": given_as(3.0, lgpr=False),
    "stuck, witnessed": given_as(sticks=True),
    "stuck, alone": given_as(sticks=True, lgpr=False),
    "LGPR lost": given_as(lgpr_m=5.0),
    # By a tenth of a metre a second.
    "spoofed": given_as(0.1 * STEP_S * np.arange(TICKS - FAULT)),
    "garbled": garbled(),
    "witness lost": witnessless_then_back(),
}


@pytest.fixture(scope="module")
def seen() -> dict[str, Seen]:
    """All drives in one batch."""
    model = default_model(zero_slip_m=1.4, gnss_x_m=GNSS_LEVER_M, gnss_y_m=0.0, array_x_m=ARRAY_M, array_y_m=0.0)
    model = model._replace(initial_position_m=jnp.float32(0.05), initial_yaw_rad=jnp.float32(0.01))
    rules = default_rules()
    assert int(rules.reacquire_after[0]) == REACQUIRE_GNSS
    stacked = [np.stack(part) for part in zip(*DRIVES.values(), strict=True)]
    given = tuple(jnp.asarray(part, part.dtype if part.dtype == np.bool_ else jnp.float32) for part in stacked)
    zero, yes = jnp.float32(0.0), jnp.asarray(True)

    def drive(one: Places) -> tuple[jax.Array, ...]:
        def tick(state: FilterState, now: Places) -> tuple[FilterState, tuple[jax.Array, ...]]:
            (gnss, gnss_on, lgpr, lgpr_on, wheels) = now
            observations = Observations(
                GnssObservation(gnss[0] + GNSS_LEVER_M, gnss[1], 1e-4 * jnp.eye(2), zero, gnss_on),
                HeadingObservation(zero, jnp.float32(1e-4), zero, yes),
                OdometerObservation(wheels, jnp.float32(1e-3), yes),
                LgprObservation(lgpr[0] + ARRAY_M, lgpr[1], zero, 4e-4 * jnp.eye(3), zero, lgpr_on),
            )
            state, info = step_filter(model, rules, state, MotionInput(zero, jnp.float32(STEP_S)), observations)
            rejected = info.offered & ~info.accepted
            kept = (state.estimate.mean[:2], info.accepted, rejected, info.reacquired, state.gates.conflict_s)
            return state, kept

        start = init_filter(model, VehiclePose(zero, zero, zero), jnp.float32(SPEED_MPS))
        fates: tuple[jax.Array, ...] = jax.lax.scan(tick, start, one)[1]
        return fates

    out = [np.asarray(part) for part in jax.jit(jax.vmap(drive))(given)]
    truth = np.stack([(np.arange(TICKS) + 1) * STEP_S * SPEED_MPS, np.zeros(TICKS)], axis=1)
    return {
        name: Seen(np.hypot(*(out[0][row] - truth).T), *(part[row] for part in out[1:]))
        for row, name in enumerate(DRIVES)
    }


def fixes_of(one: Seen) -> np.ndarray:
    """Fate of each GNSS fix from the fault on: 1 accepted, 0 rejected."""
    offered = one.accepted[FAULT:, 0] | one.rejected[FAULT:, 0]
    return np.asarray(one.accepted[FAULT:, 0][offered])


@pytest.mark.parametrize("size", ["0.3 m", "30 m"])
def test_a_jump_that_lgpr_witnesses_moves_nothing(seen: dict[str, Seen], size: str) -> None:
    one = seen[f"{size}, witnessed"]
    assert not fixes_of(one)[:15].any()
    assert not one.reacquired.any()
    assert one.error_m[FAULT:].max() < 0.05
    assert np.all(np.diff(one.conflict_s[FAULT + 3 : FAULT + 63]) > 0.0)
    if size == "30 m":
        assert not fixes_of(one).any()
        assert one.conflict_s[-1] > 19.0


def test_a_jump_without_a_witness_is_taken_after_so_many_rejects_and_not_before(seen: dict[str, Seen]) -> None:
    one = seen["3 m, alone"]
    fates = fixes_of(one)
    assert not fates[:REACQUIRE_GNSS].any()
    assert fates[REACQUIRE_GNSS:].all()
    taken = np.flatnonzero(one.reacquired[:, 0])
    assert len(taken) == 1
    assert one.error_m[taken[0] - 1] < 0.05
    assert one.error_m[taken[0]] == pytest.approx(3.0, abs=0.05)
    assert one.error_m[-1] == pytest.approx(3.0, abs=0.05)
    assert one.conflict_s.max() == 0.0


def test_a_stuck_receiver_is_rejected_within_a_second_and_never_taken(seen: dict[str, Seen]) -> None:
    for one in (seen["stuck, witnessed"], seen["stuck, alone"]):
        assert np.flatnonzero(one.rejected[FAULT:, 0])[0] * STEP_S < 1.0
        assert not one.accepted[FAULT + 8 :, 0].any()
        assert one.error_m[FAULT : FAULT + 21].max() < 0.05
    assert seen["stuck, witnessed"].error_m.max() < 0.05


def test_lgpr_on_a_wrong_place_is_kept_out_by_gnss(seen: dict[str, Seen]) -> None:
    one = seen["LGPR lost"]
    assert not one.accepted[FAULT:, 3].any()
    assert one.error_m[FAULT:].max() < 0.05
    assert one.conflict_s[-1] > 19.0


def test_a_slow_drift_that_passes_every_gate_is_called_a_conflict(seen: dict[str, Seen]) -> None:
    one = seen["spoofed"]
    conflict = np.flatnonzero(one.conflict_s > 0.0)
    lasting = conflict[0] + np.argmax(np.diff(one.conflict_s[conflict[0] :]) > 0.0)
    assert 0.0 < (lasting - FAULT) * STEP_S < 10.0
    # The drift is shared out between what GNSS and what LGPR and its lever may be off by: within the nominal foot.
    assert one.error_m[lasting] < 0.25
    assert one.error_m[FAULT:].max() < 0.3


def test_what_is_no_number_is_as_if_not_offered(seen: dict[str, Seen]) -> None:
    one = seen["garbled"]
    during = slice(FAULT, FAULT + 42)
    assert not (one.accepted[during] | one.rejected[during])[:, [0, 3]].any()
    assert np.all(np.isfinite(one.error_m))
    assert one.error_m[FAULT:].max() < 0.05


def test_rejects_before_the_witness_fell_silent_do_not_count(seen: dict[str, Seen]) -> None:
    one = seen["witness lost"]
    rejects = np.flatnonzero(one.rejected[:, 0])
    taken = np.flatnonzero(one.reacquired[:, 0])
    assert len(taken) == 1
    assert np.sum((rejects >= FAULT + 168) & (rejects < taken[0])) == REACQUIRE_GNSS
