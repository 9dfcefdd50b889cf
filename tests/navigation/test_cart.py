"""A hand cart with GNSS alone, at the source's speeds: what it is sure of is so, and where it may have been turned."""

from functools import partial
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np

from lgprjax.navigation import (
    GnssObservation,
    SmoothedCart,
    cart_model,
    cart_rules,
    init_cart,
    smooth_cart,
    step_cart,
)
from lgprjax.navigation.cart_filter import CartModel, cart_pose_covariance
from lgprjax.navigation.cart_live import LateCart, init_late_cart, late_ticks, step_late_cart
from navigation.cart_drives import ANTENNA_X_M, ANTENNA_Y_M, STEP_S, CartDrives, draw_cart_drives
from navigation.skid_drives import ANTENNA_X_M as SKID_X_M
from navigation.skid_drives import ANTENNA_Y_M as SKID_Y_M
from navigation.skid_drives import SLIDE_SIGMA_M, draw_field_drives

MODEL = cart_model(gnss_x_m=ANTENNA_X_M, gnss_y_m=ANTENNA_Y_M)
RUNS, SECONDS = 16, 400.0
smoothed = jax.jit(jax.vmap(lambda model, fixes: smooth_cart(model, cart_rules(), STEP_S, fixes), (None, 0)))


@partial(jax.jit, static_argnames="ticks")
def _live(model: CartModel, fixes: GnssObservation, ticks: int) -> tuple[SmoothedCart, SmoothedCart]:
    def one(fixes: GnssObservation) -> tuple[SmoothedCart, SmoothedCart]:
        first = jnp.argmax(fixes.valid)
        start = init_late_cart(model, jnp.nan_to_num(fixes.x_m[first]), jnp.nan_to_num(fixes.y_m[first]), ticks)

        def step(state: LateCart, fix: GnssObservation) -> tuple[LateCart, tuple[SmoothedCart, SmoothedCart]]:
            state, late = step_late_cart(model, cart_rules(), state, jnp.float32(STEP_S), fix)
            newest = state.filter.estimate
            now = SmoothedCart(newest.mean[:3], cart_pose_covariance(model, newest), state.filter.known)
            return state, (now, late)

        found: tuple[SmoothedCart, SmoothedCart] = jax.lax.scan(step, start, fixes)[1]
        return found

    return jax.vmap(one)(fixes)


def live(model: CartModel, drives: CartDrives) -> tuple[SmoothedCart, SmoothedCart, int]:
    """Drives as they are known at once, and as they are mapped some ticks later; and how many."""
    ticks = late_ticks(model, STEP_S)
    return *_live(model, jax.tree.map(jnp.asarray, drives.fixes), ticks), ticks


def late_drives(drives: CartDrives, ticks: int) -> CartDrives:
    """The truth that a late pose is of: at the start of the oldest tick that waits."""
    shifted = np.roll(drives.truth, ticks, axis=1), np.roll(drives.on_line, ticks, axis=1)
    return drives._replace(truth=shifted[0], on_line=shifted[1])


class Told(NamedTuple):
    """Errors of what was known, with their covariance."""

    error: np.ndarray
    covariance: np.ndarray

    @property
    def nees(self) -> float:
        """A degree of freedom of x, y and yaw."""
        whole = np.linalg.solve(self.covariance, self.error[..., None])[..., 0]
        return float(np.mean(np.sum(self.error * whole, axis=-1)) / 3.0)

    @property
    def heading_deg(self) -> float:
        """RMS."""
        return float(np.degrees(np.sqrt(np.mean(self.error[:, 2] ** 2))))

    @property
    def position_m(self) -> float:
        """RMS, both axes together."""
        return float(np.sqrt(np.mean(np.sum(self.error[:, :2] ** 2, axis=1))))


def told(truth: np.ndarray, found: SmoothedCart, where: np.ndarray) -> Told:
    error = truth - np.asarray(found.pose, np.float64)
    error[..., 2] = np.angle(np.exp(1j * error[..., 2]))
    some = np.asarray(found.known) & where
    return Told(error[some], np.asarray(found.covariance, np.float64)[some])


class Line(NamedTuple):
    """Figures of drives: RMS of all and on lines alone, and the share of lines on which the heading is known."""

    all: Told
    on_lines: Told
    known: float


def judge(drives: CartDrives, found: SmoothedCart) -> Line:
    """Figures of drives, held to an inch and a degree (MF section 4)."""
    line = Line(
        told(drives.truth, found, np.ones_like(drives.on_line)),
        told(drives.truth, found, drives.on_line),
        float(np.mean(np.asarray(found.known)[drives.on_line])),
    )
    assert line.on_lines.heading_deg < 1.2
    assert line.all.heading_deg < 1.3
    assert line.all.position_m < 0.0254
    assert 0.6 < line.all.nees < 1.2
    # Nothing is far out: of tails as of a normal one some 1e-4 are beyond four sigmas.
    assert np.mean(line.all.error[:, 2] ** 2 > 16.0 * line.all.covariance[:, 2, 2]) < 2e-3
    return line


def test_an_inch_and_a_degree_with_gnss_alone() -> None:
    """Turns on the spot cost ground alone."""
    drives = draw_cart_drives(runs=RUNS, seconds=SECONDS, seed=19, on_the_spot=True)
    found = smoothed(MODEL, drives.fixes)
    assert judge(drives, found).known > 0.45


def test_a_body_that_slides_in_bends_is_told() -> None:
    """Tracks point aside of their way in a bend, which one antenna cannot see: it stands in the covariance."""
    drives = draw_field_drives(runs=RUNS, seconds=SECONDS, seed=41, step_s=STEP_S, off_s=0.0)
    model = cart_model(gnss_x_m=SKID_X_M, gnss_y_m=SKID_Y_M, slip_ahead_m=SLIDE_SIGMA_M)
    gnss = jax.tree.map(lambda leaf: jnp.moveaxis(leaf, 1, 0), drives.observations.gnss)
    # Of the log each fix stands in the tick in which it was taken.
    early = np.asarray(gnss.age_s) > STEP_S
    moved = jax.tree.map(lambda leaf: jnp.asarray(_earlier(np.asarray(leaf), early)), gnss)
    moved = moved._replace(age_s=jnp.where(jnp.asarray(_earlier(early, early)), moved.age_s - STEP_S, moved.age_s))
    truth = np.moveaxis(drives.truth, 0, 1)
    whole = told(truth, smoothed(model, moved), np.ones(truth.shape[:2], bool))
    assert 0.5 < whole.nees < 1.3, whole.nees
    assert whole.heading_deg < 2.0


def _earlier(rows: np.ndarray, early: np.ndarray) -> np.ndarray:
    """Rows with those that are early a tick sooner, which is empty: fixes come once a second."""
    kept = rows.copy()
    kept[:, :-1][early[:, 1:]] = rows[:, 1:][early[:, 1:]]
    kept[early] = False if rows.dtype == bool else np.nan
    return kept


def test_a_cart_that_stands_or_is_not_heard_gives_its_heading_up() -> None:
    """Straight on until it is known, then no fixes, or fixes of one place."""
    one = jnp.float32
    step = jax.jit(step_cart)
    fix = draw_cart_drives(runs=1, seconds=1.0, seed=1, on_the_spot=False).fixes
    fix = jax.tree.map(lambda leaf: leaf[0, 0], fix)
    for heard in (False, True):
        state = init_cart(MODEL, one(0.0), one(0.0))
        rng, seen, lost_s = np.random.default_rng(4), False, None
        for tick in range(600):
            x = 0.04 * min(tick, 300)
            valid = tick % 10 == 0 and (tick <= 300 or heard)
            at = np.array([x, 0.0]) + 0.012 * rng.standard_normal(2)
            heard_fix = fix._replace(x_m=one(at[0]), y_m=one(at[1]), age_s=one(0.0), valid=jnp.asarray(valid))
            state, info = step(MODEL, cart_rules(), state, one(0.1), heard_fix)
            seen |= bool(info.heading_known)
            if tick > 300 and lost_s is None and not bool(info.heading_known):
                lost_s = 0.1 * (tick - 300)
        assert seen
        assert lost_s is not None
        assert lost_s < 5.0
        assert not bool(info.heading_known)
