"""Manoeuvres of a calibration that the software commands: steps and a sweep of the steering, steps of the pedals.

A kind of vehicle for the control loop, with the same modes, override and limiter as the others. It uses assumed limits
while the vehicle's own are open: small angles at standstill; wheels held straight while it drives, a speed confirmed by
positions, and a stretch of ground that it does not leave. Nothing here reads a clock.
"""

import math
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float

from lgprjax.autopilot import (
    Check,
    Command,
    Event,
    Limited,
    LimiterRules,
    LimiterState,
    PedalReading,
    PedalWatchState,
    init_limiter,
    init_wheel_sensors,
    limit_while_engaged,
    released,
    step_pedal_watch,
    step_wheel_sensors,
)
from lgprjax.autopilot.monitors import (
    FINDINGS,
    REFUSING,
    BoxState,
    Dwell,
    PedalBelief,
    PedalsBelief,
    Severity,
    Watch,
    WheelBelief,
    as_watch,
    counted_step_s,
    describe,
    severity_of,
    step_dwell,
)
from lgprjax.autopilot.operator_monitors import OperatorContact
from lgprjax.files import file_hash
from lgprjax.formats import VehicleFile, read_vehicle, with_values
from lgprjax.navigation import Reaction
from lgprjax.run_records import PLAN, Record, RecordKind
from lgprjax.runtime.config import CalibrationTable, RuntimeConfig
from lgprjax.runtime.control.compiled import as_vector, named_numbers
from lgprjax.runtime.control.manoeuvre_programs import LEAST_BRAKING_MPS2, PedalProgram, SteeringProgram
from lgprjax.runtime.control.modes import PEDALS, STEERING, CheckItem
from lgprjax.runtime.control.senses import NOTHING_SENSED, BoxStatus, LocalPosition, Senses, wheel_belief
from lgprjax.runtime.control.setup import TICK_S
from lgprjax.runtime.control.vehicle_kind import (
    LINE,
    Operator,
    OutgoingFrame,
    Processes,
    VehicleStatus,
    Wish,
    box_checks,
)
from lgprjax.runtime.control.watches import SentCommand, SharedWatches
from lgprjax.runtime.words import ARRIVED, limited_words

# Assumed limits, while the vehicle's own are open.

ASSUMED = {
    "steering.lag_s": 0.3,
    "steering.largest_wheel_rate_radps": 0.3,
    "steering.nominal_v": 24.0,
    "steering.stall_v": 10.0,
}
"""Numbers of a servo that no study has found yet; no limit depends on them."""
_LARGEST_SHARE = 0.8
"""Largest commanded share of the largest wheel angle."""
_RULES = LimiterRules(
    largest_front_rad=jnp.float32(0.0),
    # Faster than any servo of a heavy vehicle, so that its own rate shows.
    front_rate_radps=jnp.float32(2.0),
    throttle_rate_per_s=jnp.float32(1.0),
    brake_rate_per_s=jnp.float32(4.0),
    oldest_s=jnp.float32(0.2),
    default_brake=jnp.float32(0.5),
    release_rate_radps=jnp.float32(0.1),
)
_ENGAGE_MPS = 0.3
"""Faster than that a manoeuvre is not engaged: it begins at standstill."""
_WALKING_MPS = 2.0
_RUN_S = 12.0
"""A run takes at most the way of so long at the highest speed."""
_PEDAL = PedalBelief(pre_tension=0.0, dead_zone=0.0, gain_mps2=1.0, lag_s=1.0)
_PEDALS = PedalsBelief(_PEDAL, _PEDAL, rolling_mps2=0.0, drag_per_s=0.0)
"""Placeholder numbers, not found by a study; no finding depends on them without a trusted speed."""

# The compiled part: the limiter, which follows the wheels while nothing is engaged.


class _Numbers(NamedTuple):
    """Plain numbers into the compiled limiter."""

    front_rad: float
    throttle: float
    brake: float
    age_s: float
    step_s: float
    measured_rad: float
    engaged: float
    largest_rad: float


@jax.jit
def _limited(
    state: LimiterState[Command], numbers: Float[Array, " number"]
) -> tuple[LimiterState[Command], Float[Array, " result"]]:
    told, yes = named_numbers(_Numbers, numbers)
    state, bits = limit_while_engaged(
        _RULES._replace(largest_front_rad=told.largest_rad),
        state,
        Command(told.front_rad, told.throttle, told.brake),
        told.age_s,
        told.step_s,
        yes.engaged,
        released(told.measured_rad),
    )
    return state, jnp.stack([*state.last, bits.astype(jnp.float32)])


class LoadedManoeuvre(NamedTuple):
    """Contents of the files that a commanded manoeuvre needs.

    Attributes:
        table: calibration table of the configuration.
        belief: steering, in part assumed.
        hashes: hash of every file read, by its name in the configuration.
    """

    table: CalibrationTable
    belief: WheelBelief
    hashes: dict[str, str]


def load_manoeuvre(config: RuntimeConfig) -> LoadedManoeuvre:
    """Read the vehicle file of a commanded manoeuvre.

    Raises:
        InputError: the file cannot be used, or has no front angle yet.
    """
    assert config.calibration is not None
    path = config.path(config.vehicle)
    vehicle = with_assumed(read_vehicle(path))
    return LoadedManoeuvre(config.calibration, wheel_belief(vehicle, path), {config.vehicle: file_hash(path)})


def with_assumed(vehicle: VehicleFile) -> VehicleFile:
    """A vehicle with assumed numbers of its servo where they are open."""
    table = vehicle.steering.model_dump()
    return with_values(vehicle, {path: value for path, value in ASSUMED.items() if table[path[9:]] is None}, {})


_PLACE_OLD_S, _COARSE_M = 1.0, 0.5
"""Age, and error, up to which a position is used."""
_OUT_RAD, _STRAIGHT_RAD, _OUT_S = math.radians(6.0), math.radians(4.0), 0.4
"""Wheels beyond the largest command, and off straight while the vehicle is driven."""
_APART_M, _APART_SIGMAS, _APART_SHARE, _APART_S = 0.5, 3.0, 0.1, 0.2
"""Allowed difference of wheels and positions since a standstill, and the time after which it is reported: by then the
speed must count as unknown, or a vehicle with wheels apparently at standstill would be handed over, not stopped."""


class _Mark(NamedTuple):
    """The last standstill: number of runs completed, and position."""

    runs: int
    place: LocalPosition


class ManoeuvreKind:
    """See ``VehicleKind``.

    Args:
        config: of the run.
        loaded: its files.

    Attributes:
        speed_control: whether the manoeuvre commands the pedals; in manoeuvres of the steering they are never engaged.
    """

    def __init__(self, config: RuntimeConfig, loaded: LoadedManoeuvre) -> None:
        table = loaded.table
        self._table, self._belief = table, loaded.belief
        self._largest_rad = min(table.amplitude_rad, _LARGEST_SHARE * loaded.belief.largest_rad)
        self.speed_control = self._moves = table.commands == "pedals"
        self._steering, self._pedals = SteeringProgram(self._largest_rad), PedalProgram(table.fastest_mps)
        self._senses = Senses(None, config.sensors)
        slowly = {"fastest_engage_mps": min(config.control.fastest_engage_mps, _ENGAGE_MPS)}
        control = config.control.model_copy(update=slowly)
        self._shared = SharedWatches(control, STEERING | PEDALS, tests_brake=self._moves)
        self._sensors, self._out, self._widest_rad = init_wheel_sensors(), Dwell(), 0.0
        self._pedal = PedalWatchState()
        self._mark: _Mark | None = None
        self._way_m = self._apart_s = 0.0
        self._session = 0
        self._sensed, self._now_ns = NOTHING_SENSED, 0
        self._bits, self._front = Watch(0), math.nan
        self._sent = SentCommand(0.0, 0.0, 0.0, 0)
        self._limiter = init_limiter(released(jnp.float32(0.0)))
        self._result = (0.0, 0.0, 0.0, 0.0)
        self._began: tuple[float, LocalPosition | None] | None = None

    @property
    def lock_mps(self) -> float:
        """Unused, because the programme sets the speed."""
        return 0.0

    def warm_up(self) -> None:
        """Compile the limiter."""
        for _ in range(2):
            self._limiter, row = _limited(self._limiter, as_vector(_Numbers(*[0.0] * len(_Numbers._fields))))
        jax.block_until_ready(row)

    def take(self, record: Record, tick: int) -> None:
        """A message of the box or the GNSS/INS."""
        del tick
        self._senses.take(record)

    def update(self, operator: Operator, now_ns: int) -> list[Event]:
        """End of the messages."""
        self._now_ns = now_ns
        self._sensed = sensed = self._senses.end_tick(now_ns)
        wheels, bits, speed, hands = sensed.wheels, Watch(0), math.nan, OperatorContact(0.0, False)
        if wheels is not None:
            if wheels.frame.session != self._session:
                # A restarted box counts from zero.
                self._session, self._sensors, self._began = wheels.frame.session, init_wheel_sensors(), None
            speed = wheels.number("speed_mps")
            hands = OperatorContact(wheels.number("torque_nm"), sensed.foot_on_brake)
            self._sensors, angles, bits = step_wheel_sensors(
                self._belief,
                self._sensors,
                wheels.number("potentiometer_v"),
                wheels.number("encoder_counts"),
                sensed.step_s,
            )
            self._front = angles.front_rad
            if self._moves:
                bits |= self._pedal_findings(wheels, speed, sensed.step_s)
                self._compare(speed, sensed.step_s)
        bits |= self._wheel_findings(sensed.step_s)
        found, events = self._shared.step(
            status_age_s=math.inf if wheels is None else sensed.wheels_age_s,
            box=(0, 0) if wheels is None else (wheels.bits("state"), wheels.bits("engaged")),
            engage=self._sent.engage,
            statuses=operator.statuses,
            controller_age_s=operator.age_s,
            hands=hands,
            # If positions contradict the wheels, neither standstill nor motion is known.
            speed_mps=math.nan if self._apart_s else speed,
            step_s=sensed.step_s,
        )
        self._bits = bits | found
        return events

    def status(self, *, decided: bool) -> VehicleStatus:
        """Present status."""
        bits, received = self._bits, self._sensed.wheels is not None
        if not received:
            bits &= ~Watch.LINE_SILENT
        limited = Limited(int(self._result[3])) if decided else Limited(0)
        severity = severity_of(bits, FINDINGS) if received else Severity.CONTINUE
        trouble = self._trouble
        ages_s = {"drive-by-wire box is silent": self._sensed.wheels_age_s if received else math.inf}
        if self._moves:
            ages_s["no accurate position from GNSS"] = self._place_age_s
        ended = [ARRIVED[-1]] if self._done else []
        return VehicleStatus(
            started=received,
            place=Event.ROUTE_OFF if self._done else Event.ROUTE_NEAR,
            doubtful=False,
            reaction=int(Reaction.STOP if trouble else Reaction.CONTINUE),
            ages_s=ages_s,
            line=not bits & LINE,
            severity=severity,
            manual=severity >= Severity.MANUAL and bool(bits & ~LINE),
            emergency=severity is Severity.EMERGENCY,
            refuses=bool(bits & REFUSING),
            failed=bool(limited & Limited.MANUAL_REQUESTED),
            why=[*ended, *trouble, *describe(bits, FINDINGS), *limited_words(limited)],
        )

    def checks(self, processes: Processes) -> list[CheckItem]:
        """Present state of every system check; of the brake only where the vehicle is to move."""
        wheels, found = self._sensed.wheels, self._bits
        sensors = Watch.POTENTIOMETER_RANGE | Watch.POTENTIOMETER_STUCK | Watch.WHEEL_SENSORS_APART
        items = [
            *box_checks(found, received=wheels is not None),
            CheckItem(
                Check.STEERING_SENSORS,
                wheels is not None and math.isfinite(self._front) and not found & sensors,
                "; ".join(describe(found & sensors, FINDINGS)) or "no wheel angle",
            ),
            CheckItem(Check.STORAGE, not processes.silent("recorder"), "nothing is being recorded"),
        ]
        if self._moves:
            tested = wheels is not None and bool(wheels.bits("state") & BoxState.BRAKE_TESTED)
            items += [
                CheckItem(Check.GNSS_INS, self._place_age_s < _PLACE_OLD_S, "no accurate position"),
                CheckItem(Check.BRAKE, tested, "the braking test has not passed"),
            ]
        return items

    def step(self, wish: Wish, now_ns: int) -> None:
        """The programme, and the limiter."""
        del now_ns
        front, throttle, brake = 0.0, 0.0, 0.0
        step_s = min(max(self._sensed.step_s, 0.0), 2.0 * TICK_S)
        wheels = self._sensed.wheels
        if wish.engaged and self._began is None:
            self._began = (0.0 if wheels is None else wheels.number("odometer_m"), self._senses.place)
        if not wish.engaged:
            self._began = None
            self._steering.restart()
        elif not self._moves:
            front = self._steering.step(step_s)
        if wish.drives and wheels is not None:
            stop = wish.stop or self._apart_s > 0.0
            throttle, brake = self._pedals.step(wheels.number("speed_mps"), step_s, stop=stop)
        else:
            self._pedals.restart()
        numbers = _Numbers(
            front_rad=front,
            throttle=throttle,
            brake=brake,
            age_s=self._sensed.wheels_age_s,
            step_s=self._sensed.step_s,
            measured_rad=self._front,
            engaged=float(wish.engaged),
            largest_rad=self._largest_rad,
        )
        self._limiter, row = _limited(self._limiter, as_vector(numbers))
        front, throttle, brake, bits = np.asarray(row).tolist()
        self._result = (front, throttle, brake, bits)

    def command(self, engage: int) -> OutgoingFrame:
        """Command to send."""
        front, throttle, brake, _ = self._result
        if not engage & PEDALS:
            throttle = brake = 0.0
        self._sent = SentCommand(front, throttle, brake, engage)
        return OutgoingFrame("drive_command", self._sent._asdict())

    def rows(self, now_ns: int, mode: int) -> list[tuple[RecordKind, bytes]]:
        """The command, as a plan."""
        del now_ns
        row, wheels = np.zeros((), PLAN), self._sensed.wheels
        row["mode"], row["reaction"] = mode, int(Reaction.CONTINUE)
        for name in ("pose", "sigma_cross_m", "cross_track_m", "to_go_m", "wanted_mps"):
            row[name] = math.nan
        row["speed_mps"] = math.nan if wheels is None else wheels.number("speed_mps")
        row["front_rad"] = self._front
        row["limited"], row["engage"] = int(self._result[3]), self._sent.engage
        row["command"] = (self._sent.front_rad, self._sent.throttle, self._sent.brake)
        row["watch"], row["severity"] = int(self._bits), int(severity_of(self._bits, FINDINGS))
        return [(RecordKind.PLAN, row.tobytes())]

    def state(self, tick: int) -> dict[str, Any]:
        """State for the display."""
        wheels, place, attitude = self._sensed.wheels, self._senses.place, self._senses.attitude
        yaw = math.nan if attitude is None else attitude.yaw_rad
        state: dict[str, Any] = {
            "manoeuvre": self._table.step,
            "prompt": self._table.prompt,
            "share": self._share,
            "speed_mps": math.nan if wheels is None else wheels.number("speed_mps"),
            "cap_mps": self._pedals.cap_mps if self._moves else 0.0,
            "front_rad": self._sent.front_rad,
            "measured_rad": self._front,
            "throttle": self._sent.throttle,
            "brake": self._sent.brake,
            "pose": None if place is None else [place.x_m, place.y_m, yaw],
        }
        if tick % 100 == 0:
            state["path"] = []
        return state

    def warnings(self) -> list[str]:
        """Warnings to the operator."""
        return [*describe(self._bits, FINDINGS), *self._trouble]

    def inhibit_text(self) -> str:
        """Why the manoeuvre cannot be engaged."""
        if self._done:
            return ARRIVED[-1]
        return "; ".join(self._trouble)

    def slow(self) -> list[str]:
        """No reasons."""
        return []

    def notes(self) -> list[dict[str, Any]]:
        """None."""
        return []

    def release(self, engage: int) -> OutgoingFrame:
        """The last command of all."""
        return OutgoingFrame("drive_command", SentCommand(self._sent.front_rad, 0.0, 0.0, engage)._asdict())

    def leave(self) -> None:
        """The operator drives, and knows what was wrong: it is tried again, unless the brake has failed."""
        if not self._pedals.dead:
            self._pedals.trouble = ""

    def choose(self, name: str, place: str) -> bool:
        """There is no route."""
        del name, place
        return False

    def next_place(self, by: int) -> dict[str, str] | None:
        """There are no places."""
        del by
        return None

    @property
    def _share(self) -> float:
        return self._pedals.share if self._moves else self._steering.share

    @property
    def _done(self) -> bool:
        return self._share >= 1.0

    @property
    def _place_age_s(self) -> float:
        place = self._senses.place
        if place is None or not place.reported_m <= _COARSE_M:
            return math.inf
        return (self._now_ns - place.time_ns) / 1e9

    @property
    def _gone_m(self) -> float:
        """Way from where it was engaged, by wheels or by positions, whichever is the longer."""
        wheels, place = self._sensed.wheels, self._senses.place
        if self._began is None or wheels is None:
            return 0.0
        odometer_m, began = self._began
        way_m = abs(wheels.number("odometer_m") - odometer_m)
        if place is None or began is None:
            return way_m
        return max(way_m, math.hypot(place.x_m - began.x_m, place.y_m - began.y_m))

    @property
    def _trouble(self) -> list[str]:
        """Reasons that end a manoeuvre by a stop."""
        wheels = self._sensed.wheels
        speed, way = (
            (math.nan, math.nan) if wheels is None else (wheels.number("speed_mps"), wheels.number("odometer_m"))
        )
        trouble = [self._pedals.trouble] if self._pedals.trouble else []
        if self._sent.engage & STEERING and not self._moves and not abs(speed) <= _WALKING_MPS:
            trouble.append("the vehicle moves, or its speed is unknown")
        if self._sent.engage & PEDALS:
            # It must be able to stop there, and a run must fit before it begins.
            needs_m = speed * speed / (2.0 * LEAST_BRAKING_MPS2)
            needs_m = max(needs_m, _RUN_S * self._table.fastest_mps if self._pedals.between_runs else 0.0)
            if not math.isfinite(speed + way):
                trouble.append("speed unknown")
            elif self._gone_m + needs_m > self._table.area_m:
                trouble.append(f"the end of the {self._table.area_m:g} m is near: turn round by hand, and engage again")
            if not self._place_age_s < _PLACE_OLD_S:
                trouble.append("no accurate position from GNSS")
            if self._apart_s > _APART_S:
                trouble.append("wheels and GNSS give different speeds")
        return trouble

    def _wheel_findings(self, step_s: float) -> Watch:
        """Wheels outside what is commanded; those that were turned further when they were engaged may come back."""
        angle, engage = abs(self._front), self._sent.engage
        self._widest_rad = min(self._widest_rad, angle) if engage & STEERING else angle
        bound = max(self._largest_rad + _OUT_RAD, self._widest_rad + _STRAIGHT_RAD)
        beyond = bool(engage & STEERING) and not angle < (_STRAIGHT_RAD if engage & PEDALS else bound)
        self._out = step_dwell(self._out, beyond, counted_step_s(step_s), on_s=_OUT_S)
        return as_watch(self._out.on * Watch.STEERING_RUNAWAY)

    def _pedal_findings(self, wheels: BoxStatus, speed_mps: float, step_s: float) -> Watch:
        """Findings on pedals that differ from their commands. At a speed beyond all commands, or with an ineffective
        brake, the box cuts the power and brakes."""
        engaged = bool(self._sent.engage & PEDALS)
        self._pedal, found = step_pedal_watch(
            _PEDALS,
            self._pedal,
            engaged=engaged,
            command=PedalReading(self._sent.throttle, self._sent.brake),
            measured=PedalReading(wheels.number("throttle"), wheels.number("brake")),
            speed_mps=speed_mps,
            speed_trusted=False,
            step_s=step_s,
        )
        # A stop would hand over a vehicle at standstill, and a stuck throttle would drive it off.
        if engaged and (found & Watch.THROTTLE_STUCK or abs(speed_mps) > self._pedals.limit_mps):
            found |= Watch.SPEED_RISES
        return found | (Watch.BRAKE_DEAD if engaged and self._pedals.dead else Watch(0))

    def _compare(self, speed_mps: float, step_s: float) -> None:
        """The way by the wheels' speed since the last standstill against positions. Once they are apart they stay so
        until the pedals are released."""
        place = self._senses.place
        if not self._sent.engage & PEDALS or place is None:
            self._mark, self._apart_s = None, 0.0
            return
        if self._mark is None or self._mark.runs != self._pedals.runs:
            self._mark, self._way_m = _Mark(self._pedals.runs, place), 0.0
        self._way_m += speed_mps * step_s
        before, way_m = self._mark.place, abs(self._way_m)
        gone_m = math.hypot(place.x_m - before.x_m, place.y_m - before.y_m)
        bound_m = _APART_M + _APART_SIGMAS * max(place.reported_m, before.reported_m)
        bound_m += _APART_SHARE * max(gone_m, way_m) + abs(speed_mps) * (self._now_ns - place.time_ns) / 1e9
        if self._apart_s or not abs(gone_m - way_m) <= bound_m:
            self._apart_s += step_s
