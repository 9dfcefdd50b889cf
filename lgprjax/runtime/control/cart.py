"""A hand cart with a GNSS receiver alone, live: its pose by ``step_cart`` ten times a second, its tool's rows."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.autopilot import Mode
from lgprjax.formats import read_vehicle
from lgprjax.navigation import GnssObservation, cart_model, cart_rules, init_cart, step_cart
from lgprjax.navigation.cart_filter import SPEED, CartFilterState, CartModel, cart_pose_covariance
from lgprjax.run_records import COVER, StopBits, ToolBits
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.senses import LocalPosition
from lgprjax.runtime.gnss import Quality

COVER_TICKS = 5
_PRESENT_PERIODS = 1.5


class CartPilot:
    """The cart's live pose; it commands nothing.

    Args:
        config: of the run, of mode record with a table ``coverage``.

    Raises:
        InputError: the vehicle file cannot be used.
    """

    def __init__(self, config: RuntimeConfig) -> None:
        path = config.path(config.vehicle)
        at = read_vehicle(path).navigation
        self._model = cart_model(gnss_x_m=at.gnss_x_m or 0.0, gnss_y_m=at.gnss_y_m or 0.0)
        self._present_s = _PRESENT_PERIODS * config.sensors.gnss_period_s
        self._state: CartFilterState | None = None
        self._newest: LocalPosition | None = None
        self._fresh, self._last_ns = False, 0
        self._row = np.full(14, np.nan, np.float32)

    def warm_up(self) -> None:
        """Compile."""
        state = init_cart(self._model, jnp.float32(0.0), jnp.float32(0.0))
        for _ in range(2):
            state, row = _step(self._model, state, np.zeros(6, np.float32))
        jax.block_until_ready(row)

    def take(self, place: LocalPosition) -> None:
        """A position; of several before a step the newest is used."""
        self._newest, self._fresh = place, True

    def step(self, now_ns: int) -> bytes | None:
        """The row of ``COVER`` of a tenth of a second; ``None`` before the first position.

        Every moment at which the heading is known counts: whether the tool works is not measured.
        """
        place = self._newest
        if place is None:
            return None
        if self._state is None:
            self._state = init_cart(self._model, jnp.float32(place.x_m), jnp.float32(place.y_m))
            self._last_ns = now_ns
        age_s, step_s = (now_ns - place.time_ns) / 1e9, (now_ns - self._last_ns) / 1e9
        numbers = (step_s, self._fresh, place.x_m, place.y_m, place.reported_m**2, age_s)
        self._state, row = _step(self._model, self._state, np.array(numbers, np.float32))
        self._row, self._fresh, self._last_ns = np.asarray(row), False, now_ns
        cover = np.zeros((), COVER)
        cover["x_m"], cover["y_m"], cover["yaw_rad"] = self._row[:3]
        cover["covariance"] = self._covariance
        cover["speed_mps"] = self._row[12] if self.heading_known else np.nan
        for name in ("left_mps", "right_mps", "depth_m"):
            cover[name] = np.nan
        cover["tool"] = ToolBits.COUNTS if self.heading_known else 0
        cover["mode"], cover["line"] = Mode.MANUAL, -1
        cover["stop"] = 0 if self.heading_known else StopBits.HEADING
        cover["gnss_quality"] = self._quality(age_s)
        return cover.tobytes()

    @property
    def heading_known(self) -> bool:
        """Whether the cart surely moves forward, so that its course is its heading."""
        return bool(self._row[-1] > 0.5)

    def state(self, now_ns: int) -> dict[str, Any]:
        """For the page: pose and live accuracy; positions as ± one sigma of the larger axis."""
        place = self._newest
        age_s = math.inf if place is None else (now_ns - place.time_ns) / 1e9
        covariance = self._covariance.astype(np.float64)
        known = bool(np.isfinite(covariance).all())
        sigma_m = math.sqrt(max(float(np.linalg.eigvalsh(covariance[:2, :2])[1]), 0.0)) if known else math.nan
        x, y, yaw = (float(each) for each in self._row[:3])
        return {
            "pose": [x, y, yaw if self.heading_known else math.nan],
            "gnss_pose": [x, y, 0.0],
            "sigma_along_m": sigma_m,
            "sigma_cross_m": sigma_m,
            "speed_mps": float(self._row[12]) if self.heading_known else math.nan,
            "field": {
                "perimeter": [],
                "fence": [],
                "lines": 0,
                "gnss": self._quality(age_s).name.lower(),
                "gnss_age_s": age_s,
                "heading_known": self.heading_known,
                "sigma_m": sigma_m,
                "sigma_heading_deg": math.degrees(math.sqrt(max(float(covariance[2, 2]), 0.0))) if known else math.nan,
            },
        }

    @property
    def _covariance(self) -> np.ndarray:
        return self._row[3:12].reshape(3, 3)

    def _quality(self, age_s: float) -> Quality:
        return self._newest.quality if self._newest is not None and age_s < self._present_s else Quality.NONE


@jax.jit
def _step(
    model: CartModel, state: CartFilterState, numbers: Float[Array, "6"]
) -> tuple[CartFilterState, Float[Array, "14"]]:
    """One vector in and one out: pose, covariance, speed, and whether the heading is known."""
    step_s, fresh, x, y, variance, age_s = numbers
    fix = GnssObservation(x, y, variance * jnp.eye(2, dtype=jnp.float32), age_s, fresh > 0.5)
    state, info = step_cart(model, cart_rules(), state, step_s, fix)
    mean = state.estimate.mean
    covariance = cart_pose_covariance(model, state.estimate)
    tail = jnp.stack([mean[SPEED], info.heading_known.astype(jnp.float32)])
    return state, jnp.concatenate([mean[:3], covariance.ravel(), tail])
