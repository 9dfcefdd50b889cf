"""The counter-steered vehicle in the control loop: driven along a route by LGPR, GNSS and INS."""

import math
from collections.abc import Sequence
from typing import Any, NamedTuple

import jax
import numpy as np
from jaxtyping import Float

from lgprjax.autopilot import Check, Event, Limited, OnboardState
from lgprjax.autopilot.monitors import REFUSING, SEVERITY, BoxState, Severity, Watch, describe
from lgprjax.navigation import OF_GNSS, OF_LGPR, PlanCode, Reaction, Reason, RoutePath
from lgprjax.registration import Code
from lgprjax.run_records import PLAN, POSE, PRIOR, Record, RecordKind, fix_row
from lgprjax.runtime.config import ControlTable, RuntimeConfig, SensorsTable
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
from lgprjax.runtime.control.modes import CUT, PEDALS, CheckItem
from lgprjax.runtime.control.places import APART_M, Place, line_of, same_place, starts_of
from lgprjax.runtime.control.senses import LocalAttitude, LocalPosition, Sensed, Senses
from lgprjax.runtime.control.setup import TICK_S, LaidRoute, Loaded
from lgprjax.runtime.control.vehicle_kind import (
    LINE,
    Operator,
    OutgoingFrame,
    Processes,
    VehicleStatus,
    Wish,
    box_checks,
)
from lgprjax.runtime.control.watches import SentCommand, Watched, Watches
from lgprjax.runtime.words import ARRIVED, limited_words, reason_words, whole

# The control loop's state for the display.


_OLD_TICKS = 25
"""Half a second: what the page shows of a scan is not older."""


class Panel:
    """Keeps display data in addition to the tick's numbers.

    Args:
        routes: of the configuration.
        lgpr: there is a map to match scans with.
    """

    def __init__(self, routes: list[LaidRoute], *, lgpr: bool = True) -> None:
        self._routes, self._lgpr = routes, lgpr
        self._listed = [
            {"name": route.name, "length_m": round(route.length_m, 1), "problem": route.problem or None}
            for route in routes
        ]
        self._lines = [line_of(route.path) for route in routes]
        self._codes: list[tuple[int, bool]] = []
        self._decided = self._searched = -_OLD_TICKS
        self._shown = -1
        self._path_tick = 0
        self.code: str | None = None
        self.correlation = math.nan

    def take_fix(self, tick: int, code: int, correlation: float) -> None:
        """Take a searched scan. Those between the stops of a search have no fix of their own, and say nothing new."""
        self._searched = tick
        if code != Code.NO_WINDOW:
            self._decided = tick
            self._codes.append((tick, code == Code.OK))
        elif tick - self._decided < _OLD_TICKS:
            return
        self.code, self.correlation = Code(code).name.lower(), correlation

    def state(self, tick: int, route: int, result: TickResult, places: Sequence[Place] = ()) -> dict[str, Any]:
        """Display state of a tick, in addition to the modes.

        Args:
            tick: its number.
            route: number of the chosen one.
            result: numbers of the step.
            places: where the operator chooses between several.
        """
        self._codes = [known for known in self._codes if known[0] > tick - 500]
        share = sum(good for _, good in self._codes) / len(self._codes) if self._codes else None
        old = tick - self._searched > _OLD_TICKS
        state: dict[str, Any] = {
            "route": self._routes[route].name,
            "routes": self._listed,
            "speed_mps": result.speed_mps,
            "cap_mps": result.cap_mps,
            "cross_track_m": result.offset_m,
            "to_go_m": result.to_go_m,
            "heading_error_deg": math.degrees(result.heading_error_rad),
            "lgpr": self._lgpr,
            "bounded_by": [
                name for name, flag in (("LGPR", result.bounded), ("GNSS", result.gnss_bounded)) if flag == 1.0
            ],
            "correlation": math.nan if old else self.correlation,
            "code": None if old else self.code,
            "ok_share": share,
            "sigma_along_m": result.sigma_along_m,
            "sigma_cross_m": result.sigma_cross_m,
            "pose": [result.x_m, result.y_m, result.yaw_rad],
            "gnss_pose": [result.reckoned_x_m, result.reckoned_y_m, result.reckoned_yaw_rad],
            "reaction": Reaction(int(result.reaction)).name if math.isfinite(result.reaction) else None,
            "reasons": reason_words(result.reasons),
            "front_rad": result.front_rad,
            "throttle": result.throttle,
            "brake": result.brake,
        }
        line = self._lines[route]
        if line is not None:
            # In the order along the route: a letter keeps its place while the vehicle moves.
            ordered = sorted(places, key=lambda place: (place.at_m, place.travel))
            state["places"] = [{"place": place.words, **line.ahead(place)} for place in ordered]
        if route != self._shown or tick - self._path_tick >= 100:
            self._shown, self._path_tick = route, tick
            state["path"] = self._routes[route].points
        return state


# The compiled step: its state, the chosen route, and the vehicle's place on it.

_SEARCH_TICKS = 25
_KEPT_M = 50.0
"""Way by hand after which a place of several is chosen anew."""
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


def _is_sure(attitude: LocalAttitude | None) -> bool:
    return attitude is not None and not attitude.sigma_yaw_rad > _UNSURE_RAD


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
        places: where the vehicle may be on the route, of the last search; begun: the one that was taken of several,
            until it is noted.
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
        """The place on the chosen route; ``None`` while it is not known."""
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
        """From the first position and heading."""
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
            # While the operator drives, the place goes on with the vehicle; after a while it is known no more.
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
        # Converted as a whole: each element access on a device array is a program of its own.
        return state, FoundPlaces(*np.asarray(row))

    def _place(self, number: int, leg: float, arc_m: float, travel: float) -> Place:
        return Place(number, float(self._starts_m[self.route][int(leg)] + arc_m), 1 if travel > 0.0 else -1)

    def _numbers(self, sensed: Sensed, ordered: Ordered, now_ns: int) -> TickNumbers:
        known = self._sensors
        place, fix = sensed.place, sensed.fix
        attitude = sensed.attitude if _is_sure(sensed.attitude) else None
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


# Rows of a tick for other processes: the prior for registration, the plan for the recording.


def prior_row(
    result: TickResult, now_ns: int, *, valid: bool, roll_rad: float, yaw_rate_radps: float, travel_m: float
) -> bytes:
    """``PRIOR``: from where the map is searched; without a yaw rate the vehicle is assumed not to turn."""
    row = np.zeros((), PRIOR)
    row["time_ns"], row["valid"] = now_ns, valid
    row["pose"] = (result.search_x_m, result.search_y_m, result.search_yaw_rad)
    row["roll_rad"], row["sigma_yaw_rad"] = roll_rad, result.reckoned_yaw_sigma_rad
    row["speed_mps"], row["travel_m"] = result.speed_mps, travel_m
    row["yaw_rate_radps"] = yaw_rate_radps if math.isfinite(yaw_rate_radps) else 0.0
    return row.tobytes()


def plan_row(result: TickResult, watched: Watched, sent: SentCommand, *, mode: int, code: PlanCode) -> bytes:
    """``PLAN``: decision of a tick; before there is a pose navigation requests a stop."""
    row = np.zeros((), PLAN)
    row["mode"], row["code"] = mode, int(code)
    row["reaction"] = whole(result.reaction, int(Reaction.STOP))
    row["reasons"], row["limited"] = whole(result.reasons), whole(result.limited)
    row["pose"] = (result.x_m, result.y_m, result.yaw_rad)
    row["sigma_cross_m"], row["speed_mps"] = result.sigma_cross_m, result.speed_mps
    row["wanted_mps"], row["cross_track_m"] = result.wanted_mps, result.offset_m
    row["to_go_m"], row["front_rad"] = result.to_go_m, watched.front_rad
    row["command"], row["engage"] = (sent.front_rad, sent.throttle, sent.brake), sent.engage
    row["watch"], row["severity"] = int(watched.bits), int(watched.severity)
    return row.tobytes()


_GOOD_M, _USABLE_M = 0.1, 0.5
"""Standard deviations up to which a position is given out as fixed, and as float."""
_DOUBTED = Reason.CONFLICT | Reason.CONFLICT_LASTS | Reason.REACQUIRED | Reason.NON_FINITE
_TICKS_HZ = 50


def quality_of(result: TickResult) -> int:
    """Quality of the corrected position, as in GGA; never better than what bounds its error.

    4: LGPR, or GNSS that nothing speaks against, bounds it to 0.1 m; 5: one of them bounds it to 0.5 m; 6: dead
    reckoning, or GNSS and LGPR contradict each other; 0: none.
    """
    numbers = (result.fused_x_m, result.fused_y_m, result.fused_yaw_rad, result.sigma_along_m, result.sigma_cross_m)
    if not all(math.isfinite(number) for number in numbers):
        return 0
    reasons, sigma_m = whole(result.reasons), max(result.sigma_along_m, result.sigma_cross_m)
    if reasons & (_DOUBTED | Reason.POSITION_LOST | Reason.HEADING_LOST) or not sigma_m <= _USABLE_M:
        return 6
    bounded = result.bounded == 1.0 or not reasons & OF_GNSS
    return 4 if bounded and sigma_m <= _GOOD_M else 5


def pose_row(result: TickResult, now_ns: int, height_m: float, antenna_m: tuple[float, float]) -> bytes:
    """``POSE``: the corrected position of the vehicle's GNSS antenna, for whoever would read a receiver.

    Args:
        result: of the tick; now_ns: its time.
        height_m: of the last position.
        antenna_m: forward and left of the rear axle.
    """
    row = np.zeros((), POSE)
    cos, sin = math.cos(result.fused_yaw_rad), math.sin(result.fused_yaw_rad)
    ahead, left = antenna_m
    row["time_ns"], row["quality"] = now_ns, quality_of(result)
    row["pose"] = (
        result.fused_x_m + cos * ahead - sin * left,
        result.fused_y_m + sin * ahead + cos * left,
        result.fused_yaw_rad,
    )
    row["height_m"], row["speed_mps"] = height_m, result.speed_mps
    row["sigma_along_m"], row["sigma_cross_m"] = result.sigma_along_m, result.sigma_cross_m
    return row.tobytes()


_OLD_NS = 300_000_000
_SCANS_NS = 200_000_000
_TRAVEL_OLD_S = 0.1
_SCANS = "no scans: radar, its connection or registration"
_PLACES = {
    PlanCode.FOLLOWING: Event.ROUTE_NEAR,
    PlanCode.AT_CUSP: Event.ROUTE_NEAR,
    PlanCode.DONE: Event.ROUTE_OFF,
    PlanCode.OFF_ROUTE: Event.ROUTE_OFF,
    PlanCode.AMBIGUOUS: Event.ROUTE_AMBIGUOUS,
    PlanCode.WRONG_HEADING: Event.ROUTE_WRONG_HEADING,
    PlanCode.LOST: Event.ROUTE_OFF,
    PlanCode.NON_FINITE: Event.ROUTE_OFF,
}


def degrading(result: TickResult) -> float:
    """The reasons that slow the vehicle down: without those of a source while the other one bounds the error."""
    excused = (OF_GNSS if result.bounded == 1.0 else 0) | (OF_LGPR if result.gnss_bounded == 1.0 else 0)
    return whole(result.reasons) & ~excused


_COUNTER_STEER_NOTHING = Sensed(0.0, math.nan, None, None, None, math.nan, math.nan, False, None, False, math.inf)


class CounterSteer:
    """See ``VehicleKind``.

    Args:
        config: of the run.
        loaded: its files.

    Attributes:
        pilot: navigation and autopilot; senses: messages received.
        speed_control: by the vehicle file.

    Raises:
        InputError: the vehicle file lacks a number.
    """

    def __init__(self, config: RuntimeConfig, loaded: Loaded) -> None:
        self.speed_control = loaded.vehicle.speed_control
        self.senses = Senses(loaded.frame, config.sensors, level=not config.map)
        self.pilot = Pilot(loaded, config.control, config.sensors)
        self._watches = Watches(config, loaded.vehicle)
        self._panel = Panel(loaded.routes, lgpr=bool(config.map))
        self._step_mps, self._slow_mps = config.control.set_speed_step_mps, config.control.slow_mps
        self._has_radar = config.ports.radar is not None
        self._sent = SentCommand(0.0, 0.0, 0.0, 0)
        self._antenna_m = (float(loaded.setup.navigator.model.gnss_x_m), float(loaded.setup.navigator.model.gnss_y_m))
        self._every = None if config.output is None else _TICKS_HZ // config.output.rate_hz
        self._ticks = 0
        # What a process before this one said of travel has nothing in common with what this one says.
        self._travel_lost = True
        self._fix_ns: int | None = None
        self._now_ns = 0
        self._sensed: Sensed = _COUNTER_STEER_NOTHING
        self._watched = Watched(Watch(0), Severity.CONTINUE, [], math.nan, 0.0, False)

    @property
    def lock_mps(self) -> float:
        """The present speed; a step of the buttons while standing."""
        speed = self.pilot.result.speed_mps
        return max(speed, self._step_mps) if math.isfinite(speed) else self._step_mps

    def warm_up(self) -> None:
        """Compile all that a tick may need."""
        self.pilot.warm_up()

    def take(self, record: Record, tick: int) -> None:
        """A message of the box or the GNSS/INS, or a fix."""
        self.senses.take(record)
        if record.kind is RecordKind.FIX:
            fix = fix_row(record.payload)
            self._fix_ns = record.mono_ns
            self._panel.take_fix(tick, int(fix["code"]), float(fix["correlation"]))

    def update(self, operator: Operator, now_ns: int) -> list[Event]:
        """End of the messages."""
        self._now_ns = now_ns
        self._sensed = sensed = self.senses.end_tick(now_ns)
        place, attitude = self.senses.place, self.senses.attitude
        self._watched = watched = self._watches.step(
            sensed,
            self._sent,
            now_ns,
            statuses=operator.statuses,
            controller_age_s=operator.age_s,
            heading_rad=math.nan if attitude is None or now_ns - attitude.time_ns > _OLD_NS else attitude.yaw_rad,
            cross_track_m=self.pilot.result.offset_m,
            estimated_mps=self.pilot.result.speed_mps,
            limit_mps=self.pilot.result.wanted_mps,
        )
        if not self.pilot.started and place is not None and attitude is not None and _is_sure(attitude):
            self.pilot.start(place, attitude, watched.front_rad)
        return watched.events

    def status(self, *, decided: bool) -> VehicleStatus:
        """Present status."""
        result, watched, wheels = self.pilot.result, self._watched, self._sensed.wheels
        limited = Limited(whole(result.limited) if decided else 0)
        # Before the box was first received the checks handle its silence.
        received = wheels is not None
        bits = watched.bits if received else watched.bits & ~Watch.LINE_SILENT
        severity = watched.severity if received else Severity.CONTINUE
        place, attitude = self.senses.place, self.senses.attitude
        ages = {
            # Where LGPR alone bounds the error, a position by GNSS is not needed.
            "no position from GNSS": 0.0 if result.bounded == 1.0 else self._age_s(place),
            "no heading": self._age_s(attitude),
            "drive-by-wire box is silent": self._sensed.wheels_age_s if received else math.inf,
        }
        done = [ARRIVED[0]] if self.pilot.code is PlanCode.DONE else []
        contradicted = bool(bits & Watch.HEADING_CONTRADICTED)
        return VehicleStatus(
            self.pilot.started,
            Event.ROUTE_WRONG_HEADING if contradicted else _PLACES[self.pilot.code],
            bool(bits & Watch.HEADING_UNCONFIRMED) or contradicted,
            whole(result.reaction, int(Reaction.STOP)),
            ages,
            not bits & LINE,
            severity,
            severity >= Severity.MANUAL and bool(bits & ~LINE),
            watched.severity is Severity.EMERGENCY,
            bool(bits & REFUSING),
            bool(limited & Limited.MANUAL_REQUESTED),
            [*done, *describe(watched.bits), *reason_words(result.reasons), *limited_words(limited)],
        )

    def checks(self, processes: Processes) -> list[CheckItem]:
        """Present state of every system check."""
        wheels, found = self._sensed.wheels, self._watched.bits
        state = BoxState.NO_POWER if wheels is None else BoxState(wheels.bits("state"))
        sensors = Watch.POTENTIOMETER_RANGE | Watch.POTENTIOMETER_STUCK | Watch.WHEEL_SENSORS_APART
        place, attitude = self.senses.place, self.senses.attitude
        here = self.pilot.started and place is not None and attitude is not None
        unrecorded = processes.silent("recorder") and processes.mandatory
        tested = CheckItem(Check.BRAKE, bool(state & BoxState.BRAKE_TESTED), "the braking test has not passed")
        lgpr = not processes.silent("registration")
        return [
            *box_checks(found, received=wheels is not None),
            CheckItem(
                Check.STEERING_SENSORS,
                wheels is not None and math.isfinite(self._watched.front_rad) and not found & sensors,
                "; ".join(describe(found & sensors)) or "no wheel angle",
            ),
            CheckItem(Check.GNSS_INS, here, "no position or no heading"),
            *([CheckItem(Check.LGPR, lgpr, "the registration process is not ready")] if self._has_radar else []),
            CheckItem(Check.STORAGE, not unrecorded, "nothing is being recorded"),
            *([tested] if self.speed_control else []),
        ]

    def step(self, wish: Wish, now_ns: int) -> None:
        """The compiled step."""
        watched, sensed = self._watched, self._sensed
        if not watched.speed_known:
            sensed = sensed._replace(odometer_mps=math.nan)
        slow = wish.slowly or watched.severity is Severity.DEGRADE or self._missed
        ordered = Ordered(
            wish.engaged,
            wish.drives,
            wish.stop,
            self._slow_mps if slow else math.inf,
            wish.set_speed_mps,
            watched.front_rad,
            sensed.wheels_age_s,
            watched.yaw_rate_radps,
            self._watches.torque_share,
        )
        self.pilot.step(sensed, ordered, now_ns)

    def command(self, engage: int) -> OutgoingFrame:
        """Command to send."""
        result = self.pilot.result
        numbers = (result.front_rad, result.throttle, result.brake)
        if not all(math.isfinite(number) for number in numbers):
            # Only before there is a pose, when nothing can be engaged.
            front = self._watched.front_rad if math.isfinite(self._watched.front_rad) else 0.0
            numbers, engage = (front, 0.0, 0.0), engage & CUT
        front, throttle, brake = numbers
        if not engage & PEDALS:
            throttle = brake = 0.0
        self._sent = SentCommand(front, throttle, brake, engage)
        return OutgoingFrame("drive_command", self._sent._asdict())

    def rows(self, now_ns: int, mode: int) -> list[tuple[RecordKind, bytes]]:
        """The prior for registration, and the plan."""
        result, attitude = self.pilot.result, self.senses.attitude
        rows: list[tuple[RecordKind, bytes]] = []
        self._travel_lost |= self._sensed.travel_lost
        # While the box is silent nobody knows how far the vehicle has gone: scans wait until its odometer is heard.
        if self.pilot.started and self._sensed.wheels_age_s <= _TRAVEL_OLD_S:
            prior = prior_row(
                result,
                now_ns,
                valid=not self._travel_lost,
                roll_rad=0.0 if attitude is None else attitude.roll_rad,
                yaw_rate_radps=self._sensed.yaw_rate_radps,
                travel_m=self.senses.travel_m,
            )
            rows.append((RecordKind.PRIOR, prior))
            self._travel_lost = False
        self._ticks += 1
        if self._every is not None and self._ticks % self._every == 0:
            height_m = math.nan if self.senses.place is None else self.senses.place.up_m
            rows.append((RecordKind.POSE, pose_row(result, now_ns, height_m, self._antenna_m)))
        return [*rows, (RecordKind.PLAN, plan_row(result, self._watched, self._sent, mode=mode, code=self.pilot.code))]

    def state(self, tick: int) -> dict[str, Any]:
        """State for the display."""
        taken = same_place(self._offered, self.pilot.place)
        return {
            **self._panel.state(tick, self.pilot.route, self.pilot.result, self._offered),
            "limit_mps": math.nan if self.speed_control else self.pilot.result.wanted_mps,
            "place": None if self.pilot.place is None else self.pilot.place.words,
            "taken": None if taken is None else taken.words,
            "look_ahead_m": self.pilot.result.look_ahead_m,
            "torque_share": self._watches.torque_share,
        }

    def warnings(self) -> list[str]:
        """Warnings to the operator."""
        return [*describe(self._watched.bits), *([_SCANS] if self._scans_missing else [])]

    def inhibit_text(self) -> str:
        """The text of the modes."""
        return ""

    def slow(self) -> list[str]:
        """What caps the speed: watches, health, missing scans."""
        result, watched = self.pilot.result, self._watched
        cause = watched.severity is Severity.DEGRADE
        words = describe(Watch(sum(bit for bit in watched.bits if SEVERITY[bit] is Severity.DEGRADE))) if cause else []
        words += [_SCANS] if self._missed else []
        return [*words, *(reason_words(degrading(result)) if result.reaction == Reaction.DEGRADE else [])]

    def notes(self) -> list[dict[str, Any]]:
        """The place on the route that was taken of several."""
        begun, self.pilot.begun = self.pilot.begun, None
        return [] if begun is None else [{"place": begun.words}]

    def release(self, engage: int) -> OutgoingFrame:
        """The last command of all."""
        return OutgoingFrame("drive_command", SentCommand(self._sent.front_rad, 0.0, 0.0, engage)._asdict())

    def leave(self) -> None:
        """The operator drives."""
        self.pilot.leave()

    def choose(self, name: str, place: str) -> bool:
        """Another route, or another place on it."""
        return self.pilot.choose(name, place)

    def next_place(self, by: int) -> dict[str, str] | None:
        """Of the places where the vehicle may be."""
        return self.pilot.next_place(by)

    @property
    def _offered(self) -> list[Place]:
        """Places to choose between: none while one is driven from."""
        return self.pilot.places if len(self.pilot.places) > 1 and not self._sent.engage else []

    def _age_s(self, sensed: LocalPosition | LocalAttitude | None) -> float:
        return math.inf if sensed is None else (self._now_ns - sensed.time_ns) / 1e9

    @property
    def _scans_missing(self) -> bool:
        """Whether no scan has been searched for a while: the radar, its line, or the registration process."""
        return self._fix_ns is not None and self._now_ns - self._fix_ns > _SCANS_NS

    @property
    def _missed(self) -> bool:
        """Whether scans are missing that nothing stands in for."""
        return self._scans_missing and self.pilot.result.gnss_bounded != 1.0
