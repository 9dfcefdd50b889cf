"""The compiled step at work: the state that it carries, and the field that it is driven on."""

import math

import jax
import jax.numpy as jnp
import numpy as np

from lgprjax.autopilot.skid_step import SkidState
from lgprjax.runtime.config import CoverageTable
from lgprjax.runtime.control.setup import TICK_S
from lgprjax.runtime.control.skid.compiled import (
    SkidNumbers,
    SkidResult,
    as_skid_vector,
    start_skid_compiled,
    step_skid_compiled,
)
from lgprjax.runtime.control.skid.senses import SkidSensed
from lgprjax.runtime.control.skid.setup import SkidLoaded
from lgprjax.runtime.control.vehicle_kind import Wish

_NOTHING = SkidResult(*[math.nan] * len(SkidResult._fields))


class SkidPilot:
    """Navigation and autopilot of one vehicle.

    Args:
        loaded: from ``load_skid``.
        coverage: of the configuration.

    Attributes:
        result: of the last tick; all NaN before there is a position.
    """

    def __init__(self, loaded: SkidLoaded, coverage: CoverageTable) -> None:
        self._loaded, self._guidance = loaded, coverage.guidance
        self._state: SkidState | None = None
        self.result = _NOTHING

    @property
    def started(self) -> bool:
        """There is a pose, if not a heading."""
        return self._state is not None

    def warm_up(self) -> None:
        """Compile."""
        numbers = as_skid_vector(SkidNumbers(*[0.0] * len(SkidNumbers._fields))._replace(step_s=TICK_S))
        state = start_skid_compiled(self._loaded.setup, np.float32(0.0), np.float32(0.0))
        # Each after each: what one of them gives is not in every detail what another gives.
        for _ in range(3):
            state, row = self._step(state, numbers)
        jax.block_until_ready(row)

    def step(self, sensed: SkidSensed, wish: Wish, cap_mps: float, now_ns: int) -> SkidResult:
        """A tick; before there is a position nothing is known.

        An estimate that is no number is begun anew once the operator has the vehicle.
        """
        if not wish.engaged and not math.isfinite(self.result.x_m):
            self._state = None
        if self._state is None:
            if sensed.place is None:
                return self.result
            x, y = np.float32(sensed.place.x_m), np.float32(sensed.place.y_m)
            self._state = start_skid_compiled(self._loaded.setup, x, y)
        self._state, row = self._step(self._state, as_skid_vector(_numbers(sensed, wish, cap_mps, now_ns)))
        self.result = SkidResult(*np.asarray(row).tolist())
        return self.result

    def _step(self, state: SkidState, numbers: np.ndarray) -> tuple[SkidState, jax.Array]:
        held = self._loaded
        stepped: tuple[SkidState, jax.Array] = step_skid_compiled(
            held.setup, held.route, held.fence, state, jnp.asarray(numbers), guidance=self._guidance
        )
        return stepped


def _numbers(sensed: SkidSensed, wish: Wish, cap_mps: float, now_ns: int) -> SkidNumbers:
    place, turn = sensed.place, sensed.turn
    return SkidNumbers(
        step_s=sensed.step_s,
        left_mps=sensed.left_mps,
        right_mps=sensed.right_mps,
        gnss_valid=float(place is not None),
        gnss_x_m=0.0 if place is None else place.x_m,
        gnss_y_m=0.0 if place is None else place.y_m,
        gnss_m2=1.0 if place is None else place.reported_m**2,
        gnss_age_s=0.0 if place is None else (now_ns - place.time_ns) / 1e9,
        turn_valid=float(turn is not None),
        turn_rad=0.0 if turn is None else turn.turn_rad,
        span_s=0.0 if turn is None else turn.span_s,
        engaged=float(wish.engaged),
        drives=float(wish.drives),
        stop=float(wish.stop),
        speed_cap_mps=cap_mps,
        set_speed_mps=wish.set_speed_mps,
        age_s=sensed.box_age_s,
    )
