"""The compiled step of a route's vehicle: its state, the chosen route, and the vehicle's place on it."""

import math
from typing import NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from lgprjax.autopilot import OnboardState
from lgprjax.navigation import PlanCode, RoutePath
from lgprjax.runtime.config import ControlTable, SensorsTable
from lgprjax.runtime.control.compiled import (
    FOLLOWED,
    FoundPlaces,
    TickNumbers,
    TickResult,
    acquire_compiled,
    as_vector,
    start_compiled,
    step_compiled,
)
from lgprjax.runtime.control.places import APART_M, Place, same_place, starts_of
from lgprjax.runtime.control.senses import LocalAttitude, LocalPosition, Sensed
from lgprjax.runtime.control.setup import TICK_S, Loaded

_SEARCH_TICKS = 25
_KEPT_M = 50.0
"""Way by hand after which one of several places is chosen again."""
_UNSURE_RAD = math.radians(5.0)
"""A heading that its receiver states less surely is none."""
_NOTHING = TickResult(*[math.nan] * len(TickResult._fields))


class Ordered(NamedTuple):
    """Orders of modes and watches to a tick; see ``Orders``."""

    steering_engaged: bool
    speed_engaged: bool
    stop: bool
    speed_cap_mps: float
    set_speed_mps: float
    front_rad: float
    age_s: float
    yaw_rate_radps: float
    torque_share: float


def is_sure(attitude: LocalAttitude | None) -> bool:
    """Whether a heading can be used."""
    return attitude is not None and not attitude.sigma_yaw_rad > _UNSURE_RAD


class Pilot:
    """Navigation and autopilot of one vehicle.

    Args:
        loaded: files from ``load``.
        control, sensors: tables of the configuration.

        Attributes:
        result: result of the last tick; all NaN before there is a pose.
        route: number of the chosen route.
        on_route: whether the planner has a place on the route.
        code: code of the plan, or of the last search for a place.
        places: possible places of the vehicle on the route, from the last search.
        begun: place chosen from several, until it is recorded.
    """

    def __init__(self, loaded: Loaded, control: ControlTable, sensors: SensorsTable) -> None:
        self._setup, self._routes = loaded.setup, loaded.routes
        self._fusion, self._sensors = control.fusion, sensors
        self._coarse_m = float(loaded.setup.navigator.health.coarse_m)
        self._state: OnboardState | None = None
        self._searched = 0
        self.result = _NOTHING
        self.route = next(number for number, route in enumerate(loaded.routes) if route.path is not None)
        self.on_route = False
        self.code = PlanCode.LOST
        self.places: list[Place] = []
        self.begun: Place | None = None
        self._known: Place | None = None
        self._left_m = 0.0
        self._starts_m = [starts_of(route.path) for route in self._routes]

    @property
    def place(self) -> Place | None:
        """The place on the chosen route; ``None`` while unknown."""
        return self._known if self.on_route else None

    @property
    def started(self) -> bool:
        """Whether there is a pose."""
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
            # Every sequence of two: their outputs differ in detail.
            for _ in range(2):
                for _ in range(2):
                    state, row = step_compiled(self._setup, route.path, state, numbers, fusion=self._fusion)
                state, found = acquire_compiled(self._setup, route.path, state, np.zeros(3, np.float32), np.int32(-1))
            jax.block_until_ready((row, found))

    def start(self, place: LocalPosition, attitude: LocalAttitude, front_rad: float) -> None:
        """Start navigation from the first position and heading."""
        model = self._setup.navigator.model
        cos, sin = math.cos(attitude.yaw_rad), math.sin(attitude.yaw_rad)
        ahead, left = float(model.gnss_x_m), float(model.gnss_y_m)
        x = place.x_m - cos * ahead + sin * left
        y = place.y_m - sin * ahead - cos * left
        pose = np.array([x, y, attitude.yaw_rad], np.float32)
        front = front_rad if math.isfinite(front_rad) else 0.0
        self._state = start_compiled(self._setup, pose, np.float32(0.0), np.float32(front))

    def choose(self, name: str, place: str) -> bool:
        """Another route by its name, or another place on it; whether they can be driven."""
        known = Place.of_words(place)
        for number, route in enumerate(self._routes):
            if route.name == name and route.path is not None and (known is not None or not place):
                self.route, self._known, self._left_m = number, known, 0.0
                self.leave()
                return True
        return False

    def next_place(self, by: int) -> dict[str, str] | None:
        """The request for the next of several places; ``None`` where there are no others."""
        if len(self.places) < 2:
            return None
        places = sorted(self.places, key=lambda place: (place.at_m, place.travel))
        now = same_place(places, self.place)
        at = places.index(now) + by if now is not None else min(by, 0)
        return {"select_route": self._routes[self.route].name, "place": places[at % len(places)].words}

    def step(self, sensed: Sensed, ordered: Ordered, now_ns: int) -> TickResult:
        """Run a tick; without effect before there is a pose."""
        if self._state is None:
            return self.result
        numbers = as_vector(self._numbers(sensed, ordered, now_ns))
        self._state, row = step_compiled(self._setup, self.path, self._state, numbers, fusion=self._fusion)
        self.result = TickResult(*np.asarray(row).tolist())
        if self.on_route:
            self.code = PlanCode(int(self.result.code))
            self.on_route = int(self.code) in FOLLOWED
            self._known = self._place(-1, self.result.leg, self.result.arc_m, self.result.travel)
            self._left_m = 0.0
        elif self._known is not None and math.isfinite(self.result.speed_mps):
            # While the operator drives, the place moves with the vehicle; after a while it becomes unknown.
            way_m = self.result.speed_mps * sensed.step_s
            self._known = self._known._replace(at_m=self._known.at_m + self._known.travel * way_m)
            self._left_m += abs(way_m)
            self._known = self._known if self._left_m < _KEPT_M else None
        if not ordered.steering_engaged:
            self._search()
        return self.result

    def leave(self) -> None:
        """Search for a place again: the operator has driven. Until one is found the old plan is no reason to engage."""
        self.on_route, self.code, self._searched = False, PlanCode.LOST, 0

    def _search(self) -> None:
        """Search for a place on the route, twice a second."""
        self._searched += 1
        if self._searched % _SEARCH_TICKS != 1:
            return
        here = self.result
        pose = np.array([here.x_m, here.y_m, here.yaw_rad], np.float32)
        state, found = self._found(pose, -1)
        places = [self._place(number, *each) for number, each in enumerate(zip(*found[1:4], strict=True))]
        self.places = []
        for place in (each for each, possible in zip(places, found.possible, strict=True) if possible > 0.5):
            if all(abs(place.at_m - other.at_m) > APART_M for other in self.places):
                self.places.append(place)
        if self.on_route:
            return
        known = same_place(self.places, self._known) if found.code[0] == PlanCode.AMBIGUOUS else None
        if known is not None:
            state, found = self._found(pose, known.number)
            self.begun = known
        self._state, self.code = state, PlanCode(int(found.code[0]))
        self.on_route = self.code is PlanCode.FOLLOWING

    def _found(self, pose: Float[np.ndarray, " 3"], number: int) -> tuple[OnboardState, FoundPlaces]:
        assert self._state is not None
        state, row = acquire_compiled(self._setup, self.path, self._state, pose, np.int32(number))
        # Converted as a whole, because each element access on a device array is a separate program.
        return state, FoundPlaces(*np.asarray(row))

    def _place(self, number: int, leg: float, arc_m: float, travel: float) -> Place:
        return Place(number, float(self._starts_m[self.route][int(leg)] + arc_m), 1 if travel > 0.0 else -1)

    def _numbers(self, sensed: Sensed, ordered: Ordered, now_ns: int) -> TickNumbers:
        known = self._sensors
        place, fix = sensed.place, sensed.fix
        attitude = sensed.attitude if is_sure(sensed.attitude) else None
        stated_rad = 0.0 if attitude is None or not math.isfinite(attitude.sigma_yaw_rad) else attitude.sigma_yaw_rad
        heading_rad2 = math.radians(known.heading_sigma_deg) ** 2
        # What the receiver states is white and slow error together; more than is configured is taken to be slow.
        slow_rad2 = max(math.radians(known.heading_slow_deg) ** 2, stated_rad**2 - heading_rad2)
        # A heading error that lasts for a minute is modelled as this much more noise per tick.
        heading_rad2 += 2.0 * known.heading_slow_s / TICK_S * slow_rad2
        speed = max(abs(sensed.odometer_mps), 1.0) if math.isfinite(sensed.odometer_mps) else 1.0
        shared = 2.0 * known.fix_changes_m * math.radians(known.fix_heading_slow_deg) ** 2 / (speed * TICK_S)
        seen = {} if fix is None else self._fix_numbers(fix, now_ns, shared)
        return TickNumbers(
            step_s=sensed.step_s,
            yaw_rate_radps=ordered.yaw_rate_radps,
            gnss_valid=float(place is not None),
            gnss_x_m=0.0 if place is None else place.x_m,
            gnss_y_m=0.0 if place is None else place.y_m,
            gnss_m2=1.0 if place is None else self._sigma_m(place) ** 2,
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
            torque_share=ordered.torque_share,
            **{name: seen.get(name, 0.0) for name in TickNumbers._fields if name[:4] == "fix_" and name != "fix_valid"},
        )

    def _sigma_m(self, place: LocalPosition) -> float:
        """White error of a position; a fixed one whose receiver states a large error is not taken for fixed."""
        return place.reported_m if place.reported_m > self._coarse_m else place.sigma_m

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
