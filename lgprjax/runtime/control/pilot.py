"""The compiled step at work: the state that it carries, the route that is chosen, and where the vehicle is on it."""

import math
from typing import NamedTuple

import jax
import numpy as np

from lgprjax.autopilot import OnboardState
from lgprjax.navigation import PlanCode, RoutePath
from lgprjax.runtime.config import ControlTable, SensorsTable
from lgprjax.runtime.control.compiled import (
    FOLLOWED,
    TickNumbers,
    TickResult,
    acquire_compiled,
    as_vector,
    start_compiled,
    step_compiled,
)
from lgprjax.runtime.control.gnss_senses import Attitude, Place
from lgprjax.runtime.control.senses import Sensed
from lgprjax.runtime.control.setup import TICK_S, Loaded

_SEARCH_TICKS = 25
_NOTHING = TickResult(*[math.nan] * len(TickResult._fields))


class Ordered(NamedTuple):
    """What modes and watches say to a tick; see ``Orders``."""

    steering_engaged: bool
    speed_engaged: bool
    stop: bool
    speed_cap_mps: float
    set_speed_mps: float
    front_rad: float
    age_s: float
    yaw_rate_radps: float


class Pilot:
    """Navigation and autopilot of one vehicle.

    Args:
        loaded: from ``load``.
        control, sensors: of the configuration.

    Attributes:
        result: of the last tick; all NaN before there is a pose.
        route: number of the chosen one.
        on_route: the planner has a place on it.
        code: of the plan, or of the last search for a place.
    """

    def __init__(self, loaded: Loaded, control: ControlTable, sensors: SensorsTable) -> None:
        self._setup, self._routes = loaded.setup, loaded.routes
        self._fusion, self._sensors = control.fusion, sensors
        self._state: OnboardState | None = None
        self._searched = 0
        self.result = _NOTHING
        self.route = next(number for number, route in enumerate(loaded.routes) if route.path is not None)
        self.on_route = False
        self.code = PlanCode.LOST

    @property
    def started(self) -> bool:
        """There is a pose."""
        return self._state is not None

    @property
    def path(self) -> RoutePath:
        """The chosen route."""
        path = self._routes[self.route].path
        assert path is not None
        return path

    def warm_up(self) -> None:
        """Compile for every shape of route."""
        numbers = as_vector(TickNumbers(*[0.0] * len(TickNumbers._fields))._replace(step_s=TICK_S))
        state = start_compiled(self._setup, np.zeros(3, np.float32), np.float32(0.0), np.float32(0.0))
        for route in self._routes:
            if route.path is None:
                continue
            # Each after each: what one of them gives is not in every detail what another gives.
            for _ in range(2):
                for _ in range(2):
                    state, row = step_compiled(self._setup, route.path, state, numbers, fusion=self._fusion)
                state, found = acquire_compiled(self._setup, route.path, state, np.zeros(3, np.float32))
            jax.block_until_ready((row, found))

    def start(self, place: Place, attitude: Attitude, front_rad: float) -> None:
        """From the first position and heading."""
        model = self._setup.navigator.model
        cos, sin = math.cos(attitude.yaw_rad), math.sin(attitude.yaw_rad)
        ahead, left = float(model.gnss_x_m), float(model.gnss_y_m)
        x = place.x_m - cos * ahead + sin * left
        y = place.y_m - sin * ahead - cos * left
        pose = np.array([x, y, attitude.yaw_rad], np.float32)
        front = front_rad if math.isfinite(front_rad) else 0.0
        self._state = start_compiled(self._setup, pose, np.float32(0.0), np.float32(front))

    def choose(self, name: str) -> bool:
        """Another route by its name; whether it can be driven."""
        for number, route in enumerate(self._routes):
            if route.name == name and route.path is not None:
                self.route, self.on_route, self.code, self._searched = number, False, PlanCode.LOST, 0
                return True
        return False

    def step(self, sensed: Sensed, ordered: Ordered, now_ns: int) -> TickResult:
        """A tick; before there is a pose nothing is known."""
        if self._state is None:
            return self.result
        numbers = as_vector(self._numbers(sensed, ordered, now_ns))
        self._state, row = step_compiled(self._setup, self.path, self._state, numbers, fusion=self._fusion)
        self.result = TickResult(*np.asarray(row).tolist())
        if self.on_route:
            self.code = PlanCode(int(self.result.code))
            self.on_route = int(self.code) in FOLLOWED
        elif not ordered.steering_engaged:
            self._search()
        return self.result

    def leave(self) -> None:
        """Look for a place anew: the operator has driven."""
        self.on_route = False

    def _search(self) -> None:
        """For a place on the route, twice a second."""
        self._searched += 1
        if self._searched % _SEARCH_TICKS != 1:
            return
        here = self.result
        pose = np.array([here.x_m, here.y_m, here.yaw_rad], np.float32)
        self._state, row = acquire_compiled(self._setup, self.path, self._state, pose)
        # Taken whole: an element of a device array is a program of its own.
        self.code = PlanCode(int(np.asarray(row)[0]))
        self.on_route = self.code is PlanCode.FOLLOWING

    def _numbers(self, sensed: Sensed, ordered: Ordered, now_ns: int) -> TickNumbers:
        known = self._sensors
        place, attitude, fix = sensed.place, sensed.attitude, sensed.fix
        heading_rad2 = math.radians(known.heading_sigma_deg) ** 2
        # A heading that is off for a minute at a time is no better than one of it a tick of so much more noise.
        heading_rad2 += 2.0 * known.heading_slow_s / TICK_S * math.radians(known.heading_slow_deg) ** 2
        speed = max(abs(sensed.odometer_mps), 1.0) if math.isfinite(sensed.odometer_mps) else 1.0
        shared = 2.0 * known.fix_changes_m * math.radians(known.fix_heading_slow_deg) ** 2 / (speed * TICK_S)
        seen = {} if fix is None else self._fix_numbers(fix, now_ns, shared)
        return TickNumbers(
            step_s=sensed.step_s,
            yaw_rate_radps=ordered.yaw_rate_radps,
            gnss_valid=float(place is not None),
            gnss_x_m=0.0 if place is None else place.x_m,
            gnss_y_m=0.0 if place is None else place.y_m,
            gnss_m2=1.0 if place is None else place.sigma_m**2,
            gnss_age_s=0.0 if place is None else (now_ns - place.time_ns) / 1e9,
            heading_valid=float(attitude is not None),
            heading_rad=0.0 if attitude is None else attitude.yaw_rad,
            heading_rad2=heading_rad2,
            heading_age_s=0.0 if attitude is None else (now_ns - attitude.time_ns) / 1e9,
            odometer_valid=float(math.isfinite(sensed.odometer_mps)),
            odometer_mps=sensed.odometer_mps if math.isfinite(sensed.odometer_mps) else 0.0,
            odometer_m2ps2=known.odometer_sigma_mps**2,
            fix_valid=float(fix is not None),
            p_false=sensed.p_false,
            steering_engaged=float(ordered.steering_engaged),
            speed_engaged=float(ordered.speed_engaged),
            stop=float(ordered.stop),
            speed_cap_mps=ordered.speed_cap_mps,
            set_speed_mps=ordered.set_speed_mps,
            front_rad=ordered.front_rad,
            age_s=ordered.age_s,
            **{name: seen.get(name, 0.0) for name in TickNumbers._fields if name[:4] == "fix_" and name != "fix_valid"},
        )

    def _fix_numbers(self, fix: np.void, now_ns: int, shared_yaw_rad2: float) -> dict[str, float]:
        pose, covariance = fix["pose"], fix["covariance"]
        return {
            "fix_x_m": float(pose[0]),
            "fix_y_m": float(pose[1]),
            "fix_yaw_rad": float(pose[3]),
            "fix_xx": float(covariance[0, 0]),
            "fix_xy": float(covariance[0, 1]),
            "fix_yy": float(covariance[1, 1]),
            "fix_xyaw": float(covariance[0, 3]),
            "fix_yyaw": float(covariance[1, 3]),
            "fix_yawyaw": float(covariance[3, 3]) + shared_yaw_rad2,
            "fix_age_s": (now_ns - int(fix["scan_ns"])) / 1e9,
        }
