"""A hand cart with a GNSS receiver alone, live: its pose ten times per second, its tool's rows some seconds later."""

import math
from collections import deque
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.autopilot import Mode
from lgprjax.formats import read_vehicle
from lgprjax.navigation import GnssObservation, cart_model, cart_rules
from lgprjax.navigation.cart_filter import SPEED, CartModel, cart_pose_covariance
from lgprjax.navigation.cart_live import LateCart, init_late_cart, late_ticks, step_late_cart
from lgprjax.run_records import COVER, StopBits, ToolBits
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.senses import LocalPosition
from lgprjax.runtime.gnss import Quality

COVER_TICKS = 5
_STEP_S = 0.1
_PRESENT_PERIODS = 1.5


class CartPilot:
    """The cart's live pose, without commands.

    Args:
        config: configuration of the run, of mode record with a table ``coverage``.

    Raises:
        InputError: the vehicle file cannot be used.
    """

    def __init__(self, config: RuntimeConfig) -> None:
        path = config.path(config.vehicle)
        at = read_vehicle(path).navigation
        self._model = cart_model(gnss_x_m=at.gnss_x_m or 0.0, gnss_y_m=at.gnss_y_m or 0.0)
        self._present_s = _PRESENT_PERIODS * config.sensors.gnss_period_s
        self._ticks = late_ticks(self._model, _STEP_S)
        self._state: LateCart | None = None
        self._newest: LocalPosition | None = None
        self._fresh, self._last_ns, self._mapped_m = False, 0, 0.0
        self._row = self._late = np.full(14, np.nan, np.float32)
        self._waiting: deque[tuple[int, Quality]] = deque(maxlen=self._ticks + 1)

    def warm_up(self) -> None:
        """Compile."""
        state = init_late_cart(self._model, jnp.float32(0.0), jnp.float32(0.0), self._ticks)
        for _ in range(2):
            state, rows = _step(self._model, state, np.zeros(6, np.float32))
        jax.block_until_ready(rows)

    def take(self, place: LocalPosition) -> None:
        """Take a position; a step uses the newest one."""
        self._newest, self._fresh = place, True

    def step(self, now_ns: int) -> tuple[int, bytes] | None:
        """A tenth of a second: time and row of ``COVER`` of the moment that has waited long enough; at first ``None``.

        Every moment at which the heading is known counts: whether the tool works is not measured.
        """
        place = self._newest
        if place is None:
            return None
        if self._state is None:
            self._state = init_late_cart(self._model, jnp.float32(place.x_m), jnp.float32(place.y_m), self._ticks)
            self._last_ns = now_ns
        age_s, step_s = (now_ns - place.time_ns) / 1e9, (now_ns - self._last_ns) / 1e9
        numbers = (step_s, self._fresh, place.x_m, place.y_m, place.reported_m**2, age_s)
        self._state, rows = _step(self._model, self._state, np.array(numbers, np.float32))
        self._fresh, self._last_ns, before = False, now_ns, self._late
        self._row, self._late = np.asarray(rows)
        self._waiting.append((now_ns, self._quality(age_s)))
        if len(self._waiting) <= self._ticks:
            return None
        then_ns, quality = self._waiting[0]
        known = bool(self._late[-1] > 0.5)
        cover = np.zeros((), COVER)
        cover["x_m"], cover["y_m"], cover["yaw_rad"] = self._late[:3]
        cover["covariance"] = self._late[3:12].reshape(3, 3)
        moved_m = float(np.hypot(*(self._late[:2] - before[:2])))
        goes_on = known and before[-1] > 0.5 and step_s > 0.0
        self._mapped_m += moved_m if goes_on else 0.0
        cover["speed_mps"] = moved_m / step_s if goes_on else np.nan
        for name in ("left_mps", "right_mps", "depth_m"):
            cover[name] = np.nan
        cover["tool"] = ToolBits.COUNTS if known else 0
        cover["mode"], cover["line"] = Mode.MANUAL, -1
        cover["stop"] = 0 if known else StopBits.HEADING
        cover["gnss_quality"] = quality
        return then_ns, cover.tobytes()

    @property
    def heading_known(self) -> bool:
        """Whether the cart surely moves forward, so that its course is its heading."""
        return bool(self._row[-1] > 0.5)

    def state(self, now_ns: int) -> dict[str, Any]:
        """State for the page: the newest pose, its accuracy and that of the mapped pose, one sigma each."""
        place = self._newest
        age_s = math.inf if place is None else (now_ns - place.time_ns) / 1e9
        sigma_m, sigma_heading_deg = _sigmas(self._row)
        mapped_m, mapped_deg = _sigmas(self._late) if self._late[-1] > 0.5 else (math.nan, math.nan)
        x, y, yaw = (float(each) for each in self._row[:3])
        return {
            "pose": [x, y, yaw if self.heading_known else math.nan],
            "gnss_pose": [x, y, 0.0],
            "sigma_along_m": sigma_m,
            "sigma_cross_m": sigma_m,
            "speed_mps": float(self._row[12]) if self.heading_known else math.nan,
            "travel_m": self._mapped_m,
            "field": {
                "perimeter": [],
                "fence": [],
                "lines": 0,
                "gnss": self._quality(age_s).name.lower(),
                "gnss_age_s": age_s,
                "heading_known": self.heading_known,
                "sigma_m": sigma_m,
                "sigma_heading_deg": sigma_heading_deg,
                "mapped_sigma_m": mapped_m,
                "mapped_sigma_heading_deg": mapped_deg,
                "mapped_after_s": self._ticks * _STEP_S,
            },
        }

    def _quality(self, age_s: float) -> Quality:
        return self._newest.quality if self._newest is not None and age_s < self._present_s else Quality.NONE


def _sigmas(row: np.ndarray) -> tuple[float, float]:
    """Standard deviations of the position's larger axis, metres, and of the heading, degrees; NaN if unknown."""
    covariance = row[3:12].reshape(3, 3).astype(np.float64)
    if not np.isfinite(covariance).all():
        return math.nan, math.nan
    largest = float(np.linalg.eigvalsh(covariance[:2, :2])[1])
    return math.sqrt(max(largest, 0.0)), math.degrees(math.sqrt(max(float(covariance[2, 2]), 0.0)))


@jax.jit
def _step(model: CartModel, state: LateCart, numbers: Float[Array, "6"]) -> tuple[LateCart, Float[Array, "2 14"]]:
    """One vector in; now and late: pose, covariance, speed (now), and whether the heading is known."""
    step_s, fresh, x, y, variance, age_s = numbers
    fix = GnssObservation(x, y, variance * jnp.eye(2, dtype=jnp.float32), age_s, fresh > 0.5)
    state, late = step_late_cart(model, cart_rules(), state, step_s, fix)
    newest = state.filter.estimate
    covariance = cart_pose_covariance(model, newest)
    now = [*newest.mean[:3], *covariance.ravel(), newest.mean[SPEED], state.filter.known]
    then = [*late.pose, *late.covariance.ravel(), jnp.float32(0.0), late.known]
    return state, jnp.stack([jnp.stack([jnp.asarray(each, jnp.float32) for each in row]) for row in (now, then)])
