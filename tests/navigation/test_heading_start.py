"""The first heading: from a straight way and pairs of fixes, forward or back, and from nothing else."""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation import DeltaHeading, GnssObservation, SkidMotion, SkidObservations, skid_rules
from lgprjax.navigation.skid_filter import (
    HeadingStart,
    KeptFix,
    StartedHeading,
    Way,
    init_heading_start,
    step_heading_start,
)
from navigation.skid_drives import ANTENNA_X_M, ANTENNA_Y_M, TRACK_M
from navigation.skid_runs import MODEL, begin, filter_lanes, pose_errors

STEP_S, TICKS = 0.05, 2400
FORWARD, BACKWARD, SLOW, ARC, STANDING, COARSE, FROZEN, LATER = range(8)
SPEEDS_MPS = [0.5, -0.5, 0.1, 0.5, 0.0, 0.5, 0.5, 0.5]
YAW_RAD = np.array([0.7, -2.9, 3.1, 0.0, 1.0, 2.0, -1.0, -0.5])
FIX_SIGMA_M = np.array([0.02, 0.02, 0.02, 0.02, 0.02, 0.4, 0.02, 0.02])
LATER_S = 60.0
"""The last lane drives on an arc of 4 m until then, and straight on from then on."""


class Started(NamedTuple):
    """When each lane first knew its heading, infinite for never; errors and their sigmas after each tick."""

    at_s: np.ndarray
    yaw_error_deg: np.ndarray
    yaw_sigma_deg: np.ndarray
    position_error_m: np.ndarray
    starts: np.ndarray
    known: np.ndarray


@pytest.fixture(scope="module")
def started() -> Started:
    """Eight lanes with true wheels and INS; fixes with white errors, once a second, 0.1 s late."""
    rng = np.random.default_rng(9)
    lanes, time = len(SPEEDS_MPS), (np.arange(TICKS)[:, None] + 1) * STEP_S
    speed = np.broadcast_to(np.array(SPEEDS_MPS), (TICKS, lanes))
    rate = np.zeros((TICKS, lanes))
    rate[:, ARC] = 0.5 / 3.0
    rate[time[:, 0] <= LATER_S, LATER] = 0.5 / 4.0
    yaw = YAW_RAD + np.cumsum(rate, axis=0) * STEP_S
    middle = yaw - 0.5 * rate * STEP_S
    x, y = (np.cumsum(speed * turned(middle), axis=0) * STEP_S for turned in (np.cos, np.sin))
    # A tenth of a second before.
    old = 0.1
    then = yaw - old * rate
    back_x, back_y = (-old * speed * turned(yaw - 0.5 * old * rate) for turned in (np.cos, np.sin))
    antenna = np.stack(
        [
            x + back_x + np.cos(then) * ANTENNA_X_M - np.sin(then) * ANTENNA_Y_M,
            y + back_y + np.sin(then) * ANTENNA_X_M + np.cos(then) * ANTENNA_Y_M,
        ],
        axis=-1,
    )
    fix = antenna + FIX_SIGMA_M[:, None] * rng.standard_normal(antenna.shape)
    # A receiver that goes on telling about one place, give or take a centimetre.
    fix[:, FROZEN] = antenna[0, FROZEN] + 0.01 * rng.standard_normal((TICKS, 2))
    ticks = np.arange(TICKS)[:, None] + np.zeros(lanes, int)
    single = jnp.float32
    motion = SkidMotion(
        single(speed - rate * TRACK_M / 2), single(speed + rate * TRACK_M / 2), jnp.full((TICKS, lanes), STEP_S, single)
    )
    covariance = np.broadcast_to((FIX_SIGMA_M**2)[:, None, None] * np.eye(2), (TICKS, lanes, 2, 2))
    gnss = GnssObservation(
        single(fix[..., 0]),
        single(fix[..., 1]),
        single(covariance),
        jnp.full((TICKS, lanes), old, single),
        jnp.asarray(ticks % 20 == 19),
    )
    turn = (rate + np.roll(rate, 1, axis=0)) * STEP_S + 3e-5 * rng.standard_normal(rate.shape)
    delta = DeltaHeading(single(turn), jnp.full((TICKS, lanes), 0.1, single), jnp.asarray(ticks % 2 == 1))
    _, filtered = filter_lanes(skid_rules(), begin(np.zeros((lanes, 2))), motion, SkidObservations(gnss, delta))
    error, said = pose_errors(np.stack([x, y, yaw], axis=-1), filtered.estimate)
    known = np.asarray(filtered.info.heading_known)[:, 0]
    return Started(
        np.where(known.any(axis=0), known.argmax(axis=0) * STEP_S, np.inf),
        np.degrees(error[..., 2]),
        np.degrees(np.sqrt(said[..., 2, 2])),
        np.hypot(error[..., 0], error[..., 1]),
        np.asarray(filtered.info.heading_started)[:, 0].sum(axis=0),
        known,
    )


def test_a_straight_way_gives_a_heading(started: Started) -> None:
    """Eight fixes half a metre apart: 3.5 m and no more than a fix's way beyond; in reverse it is not turned round."""
    for lane in (FORWARD, BACKWARD, SLOW):
        way_m = started.at_s[lane] * abs(SPEEDS_MPS[lane])
        assert 3.4 < way_m < 6.0
        assert started.starts[lane] == 1
        since = started.known[:, lane]
        assert since[int(started.at_s[lane] / STEP_S) + 1 :].all()
        assert np.abs(started.yaw_error_deg[since, lane]).max() < 3.0
        assert np.all(np.abs(started.yaw_error_deg[since, lane]) < 4.0 * started.yaw_sigma_deg[since, lane])
        assert np.abs(started.yaw_error_deg[-1, lane]) < 1.0
        assert started.position_error_m[since, lane].max() < 0.1


def test_bends_standing_and_poor_fixes_give_none(started: Started) -> None:
    """An arc of 3 m radius, a vehicle that stands, fixes of 0.4 m, and a receiver that is stuck."""
    assert np.all(np.isinf(started.at_s[[ARC, STANDING, COARSE, FROZEN]]))
    # What is not known is told to be anything.
    assert np.all(started.yaw_sigma_deg[:, [STANDING, COARSE, FROZEN]] > 20.0)


def test_it_starts_when_the_way_becomes_straight(started: Started) -> None:
    """Not on the arc of 4 m, and not from fixes of the arc: 3.5 m after it at the earliest."""
    assert LATER_S + 7.0 <= started.at_s[LATER] < LATER_S + 12.0
    assert np.abs(started.yaw_error_deg[-1, LATER]) < 1.0


def test_a_heading_from_a_way_aside_is_stated_no_surer_than_it_is() -> None:
    """Exact fixes of a vehicle that is pushed aside at random, against the scatter of the headings from its ways."""
    rng = np.random.default_rng(10)
    lanes, apart_m, ticks, noise = 2000, 0.5, 8, 0.03
    aside_m = noise * np.sqrt(apart_m) * np.cumsum(rng.standard_normal((ticks, lanes)), axis=0)
    fixes = np.stack([np.broadcast_to(apart_m * np.arange(ticks)[:, None], aside_m.shape), aside_m], axis=-1)
    model = MODEL._replace(side_noise=jnp.float32(noise), start_pair_m=jnp.float32(0.99 * apart_m))
    zero = jnp.float32(0.0)

    def lane(seen_m: jax.Array) -> StartedHeading:
        def tick(start: HeadingStart, fix_m: jax.Array) -> tuple[HeadingStart, StartedHeading]:
            way = Way(jnp.float32(apart_m), zero, zero, jnp.float32(1.0))
            fix = KeptFix(fix_m, (zero, zero), zero, jnp.float32(1e-10), zero, jnp.asarray(True))
            return step_heading_start(model, start, way, fix, jnp.asarray(False))

        every: StartedHeading = jax.lax.scan(tick, init_heading_start(), seen_m)[1]
        return StartedHeading(*(each[-1] for each in every))

    found = jax.jit(jax.vmap(lane, in_axes=1))(jnp.asarray(fixes, jnp.float32))
    assert np.asarray(found.ready).mean() > 0.9
    scatter = np.mean(np.asarray(found.yaw_rad) ** 2)
    assert scatter <= np.mean(np.asarray(found.variance)) <= 3.0 * scatter
