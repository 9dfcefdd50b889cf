"""Manoeuvres of a calibration that the software commands: steps and a sweep of the steering, steps of the pedals.

A kind of vehicle for the control loop, with the modes, the override and the limiter of every other one. It stands on
assumed limits while the vehicle's own are open: small angles at standstill; a throttle that begins at nothing, at most
2 m/s until the brake has been seen to act, and a stretch of ground that it does not leave. Nothing here reads a clock.
"""

import math
from enum import Enum, auto
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
    init_limiter,
    init_wheel_sensors,
    limit_command,
    step_wheel_sensors,
)
from lgprjax.autopilot.monitors import (
    REFUSING,
    BoxState,
    Dwell,
    Severity,
    Watch,
    WheelBelief,
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
from lgprjax.runtime.control.compiled import as_vector
from lgprjax.runtime.control.modes import PEDALS, STEERING, CheckItem
from lgprjax.runtime.control.senses import LocalPosition, Sensed, Senses, wheel_belief
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
"""Of the largest wheel angle, that is commanded."""
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
_UNPROVEN_MPS = 1.8
"""Speed at which the throttle is released while the brake has not been seen to act: the vehicle stays below 2 m/s."""
_WALKING_MPS, _OVER_MPS = 2.0, 1.0


# Steering: steps to either side, then a sweep of rising frequency.

_STEP_SHARES, _STEP_S = (0.17, 0.5, 1.0), 3.0
_SWEEP_SHARE, _SWEEP_S, _SWEEP_HZ = 0.35, 40.0, (0.05, 1.0)
_FIRST_S = 1.0


class SteeringProgram:
    """Front angles over the time since steering was engaged.

    Args:
        amplitude_rad: of the largest step.
    """

    def __init__(self, amplitude_rad: float) -> None:
        self._steps = [(_FIRST_S, 0.0)]
        for share in _STEP_SHARES:
            self._steps += [(_STEP_S, sign * share * amplitude_rad) for sign in (1.0, -1.0, 0.0)]
        self._steps_s = sum(lasts_s for lasts_s, _ in self._steps)
        self._sweep_rad = _SWEEP_SHARE * amplitude_rad
        self._time_s = 0.0

    @property
    def share(self) -> float:
        """Of the programme, that is done."""
        return min(self._time_s / (self._steps_s + _SWEEP_S + _STEP_S), 1.0)

    def restart(self) -> None:
        """From the beginning: half of a step says nothing."""
        self._time_s = 0.0

    def step(self, step_s: float) -> float:
        """The angle of this tick, rad."""
        time_s, self._time_s = self._time_s, self._time_s + step_s
        for lasts_s, angle in self._steps:
            if time_s < lasts_s:
                return angle
            time_s -= lasts_s
        if time_s >= _SWEEP_S:
            return 0.0
        low_hz, high_hz = _SWEEP_HZ
        turns = low_hz * time_s + 0.5 * (high_hz - low_hz) * time_s**2 / _SWEEP_S
        return self._sweep_rad * math.sin(math.tau * turns)


# Pedals: a throttle that rises until the vehicle moves, then runs from standstill to standstill.


class Phase(Enum):
    """Part of a run."""

    PROBE = auto()
    PRESS = auto()
    BACK = auto()
    COAST = auto()
    BRAKE = auto()
    EASE = auto()
    HALT = auto()
    REST = auto()


_PROBE_PER_S, _MOST_PROBE, _MOVES_MPS = 0.03, 0.6, 0.25
_THROTTLES = (0.12, 0.18, 0.28, 0.15, 0.24, 0.33, 0.1, 0.21, 0.3, 0.16, 0.26, 0.14)
"""Of each run, beyond the throttle at which the vehicle moved off."""
_BRAKES = (0.35, 0.5, 0.65, 0.42, 0.3, 0.58, 0.45, 0.33, 0.7, 0.38, 0.55, 0.48)
_BACK = 0.12
_HALT_BRAKE, _REST_BRAKE = 0.6, 0.4
_LASTS_S = {
    Phase.PRESS: 5.0,
    Phase.BACK: 1.5,
    Phase.COAST: 2.0,
    Phase.BRAKE: 0.7,
    Phase.EASE: 0.6,
    Phase.REST: 2.0,
}
_STANDS_MPS, _SLOW_MPS = 0.05, 0.6
_PROVEN_FROM_MPS, _LEAST_BRAKING_MPS2 = 1.0, 0.4
_UNBRAKED_S = 3.0


class PedalProgram:
    """Throttle and brake by what the vehicle does.

    Args:
        fastest_mps: speed at which the throttle is released once the brake has been seen to act.

    Attributes:
        runs: that are complete; -1 before the probe is.
        proven: the brake has been seen to act.
        trouble: why it cannot go on; empty if it can.
    """

    def __init__(self, fastest_mps: float) -> None:
        self.runs, self.proven, self.trouble = -1, False, ""
        self._fastest_mps = fastest_mps
        self._phase, self._time_s = Phase.REST, 0.0
        self._throttle, self._moved_at = 0.0, math.nan
        self._braked_mps, self._braked_s = 0.0, 0.0

    @property
    def share(self) -> float:
        """Of the runs, that are done."""
        return max(self.runs, 0) / len(_THROTTLES)

    @property
    def cap_mps(self) -> float:
        """Speed at which the throttle is released now."""
        return self._fastest_mps if self.proven else _UNPROVEN_MPS

    @property
    def between_runs(self) -> bool:
        """Whether the vehicle stands, and is to stand."""
        return self._phase is Phase.REST

    def restart(self) -> None:
        """The run begins again, from standstill."""
        self._go(Phase.REST)

    def step(self, speed_mps: float, step_s: float) -> tuple[float, float]:
        """Throttle and brake of this tick, 0 to 1.

        Args:
            speed_mps: forward, by the wheels.
            step_s: since the last tick.
        """
        self._time_s += step_s
        self._advance(speed_mps, step_s)
        run = min(max(self.runs, 0), len(_BRAKES) - 1)
        throttle = self._moved_at + _THROTTLES[run] if math.isfinite(self._moved_at) else 0.0
        brake = _BRAKES[run]
        return {
            Phase.PROBE: (self._throttle, 0.0),
            Phase.PRESS: (throttle, 0.0),
            Phase.BACK: (max(throttle - _BACK, 0.0), 0.0),
            Phase.COAST: (0.0, 0.0),
            Phase.BRAKE: (0.0, brake),
            Phase.EASE: (0.0, max(brake - _BACK, 0.0)),
            Phase.HALT: (0.0, _HALT_BRAKE),
            Phase.REST: (0.0, _REST_BRAKE),
        }[self._phase]

    def _advance(self, speed_mps: float, step_s: float) -> None:
        phase, over = self._phase, self._time_s >= _LASTS_S.get(self._phase, math.inf)
        if phase is Phase.REST and over:
            self._go(Phase.PRESS if math.isfinite(self._moved_at) else Phase.PROBE)
        elif phase is Phase.PROBE:
            self._throttle += _PROBE_PER_S * step_s
            if speed_mps > _MOVES_MPS:
                self._moved_at = self._throttle
                self._go(Phase.BRAKE)
            elif self._throttle > _MOST_PROBE:
                self.trouble = f"the vehicle does not move at a throttle of {_MOST_PROBE:g}"
        elif phase is Phase.PRESS and (over or speed_mps >= self.cap_mps):
            self._go(Phase.BACK)
        elif phase is Phase.BACK and (over or speed_mps >= self.cap_mps + 0.2):
            self._go(Phase.COAST)
        elif phase is Phase.COAST and (over or speed_mps < _SLOW_MPS or speed_mps >= self.cap_mps + 0.2):
            self._go(Phase.BRAKE)
        elif phase in (Phase.BRAKE, Phase.EASE, Phase.HALT):
            self._brake(speed_mps, step_s, over=over)

    def _brake(self, speed_mps: float, step_s: float, *, over: bool) -> None:
        if self._phase is Phase.BRAKE and self._braked_s == 0.0:
            self._braked_mps = speed_mps
        self._braked_s += step_s
        if speed_mps < _STANDS_MPS:
            seen = self._braked_mps > _PROVEN_FROM_MPS
            self.proven |= seen and self._braked_mps / self._braked_s > _LEAST_BRAKING_MPS2
            self.runs += 1
            self._go(Phase.REST)
        elif self._braked_s > _UNBRAKED_S and speed_mps > 0.5 * self._braked_mps:
            self.trouble = "the brake does not slow the vehicle"
        elif over and self._phase is not Phase.HALT:
            # A brake that has not been seen to act is not eased.
            self._go(Phase.EASE if self._phase is Phase.BRAKE and self.proven else Phase.HALT)

    def _go(self, phase: Phase) -> None:
        if phase in (Phase.PRESS, Phase.PROBE):
            self._braked_s = 0.0
        self._phase, self._time_s = phase, 0.0


# The compiled part: the limiter, which follows the wheels while nothing is engaged.


class _Numbers(NamedTuple):
    front_rad: float
    throttle: float
    brake: float
    age_s: float
    step_s: float
    measured_rad: float
    engaged: float
    largest_rad: float


@jax.jit
def _limited(state: LimiterState, numbers: Float[Array, " number"]) -> tuple[LimiterState, Float[Array, " result"]]:
    told = _Numbers(*numbers)
    measured = jnp.where(jnp.isfinite(told.measured_rad), told.measured_rad, 0.0)
    held = jax.tree.map(lambda on, off: jnp.where(told.engaged > 0.5, on, off), state, init_limiter(measured))
    wanted = Command(jnp.where(told.engaged > 0.5, told.front_rad, measured), told.throttle, told.brake)
    rules = _RULES._replace(largest_front_rad=jnp.where(told.engaged > 0.5, told.largest_rad, jnp.inf))
    state, command, bits = limit_command(rules, held, wanted, told.age_s, told.step_s)
    return state, jnp.stack([*command, bits.astype(jnp.float32)])


class LoadedManoeuvre(NamedTuple):
    """What a commanded manoeuvre needs of the files.

    Attributes:
        table: of the configuration.
        belief: the steering, in part assumed.
        hashes: of every file read, by its name in the configuration.
    """

    table: CalibrationTable
    belief: WheelBelief
    hashes: dict[str, str]


def load_manoeuvre(config: RuntimeConfig) -> LoadedManoeuvre:
    """Read the vehicle file of a commanded manoeuvre.

    Raises:
        InputError: it cannot be used, or does not know the front angle yet.
    """
    assert config.calibration is not None
    path = config.path(config.vehicle)
    vehicle = with_assumed(read_vehicle(path))
    return LoadedManoeuvre(config.calibration, wheel_belief(vehicle, path), {config.vehicle: file_hash(path)})


def with_assumed(vehicle: VehicleFile) -> VehicleFile:
    """A vehicle with assumed numbers of its servo where they are open."""
    table = vehicle.steering.model_dump()
    return with_values(vehicle, {path: value for path, value in ASSUMED.items() if table[path[9:]] is None}, {})


_NOTHING = Sensed(0.0, math.nan, None, None, None, math.nan, math.nan, False, None, False, math.inf)
_OLD_S, _PLACE_OLD_S = 0.1, 1.0
_OUT_RAD, _OUT_S = math.radians(6.0), 0.4
_OFF_M = 3.0


class ManoeuvreKind:
    """See ``VehicleKind``.

    Args:
        config: of the run.
        loaded: its files.

    Attributes:
        speed_control: the manoeuvre is one of the pedals; in one of the steering they are never engaged.
    """

    def __init__(self, config: RuntimeConfig, loaded: LoadedManoeuvre) -> None:
        table = loaded.table
        self._table, self._belief = table, loaded.belief
        self._largest_rad = min(table.amplitude_rad, _LARGEST_SHARE * loaded.belief.largest_rad)
        self.speed_control = self._moves = table.commands == "pedals"
        self._steering, self._pedals = SteeringProgram(self._largest_rad), PedalProgram(table.fastest_mps)
        self._senses = Senses(None, config.sensors)
        self._shared = SharedWatches(config.control, STEERING | PEDALS, tests_brake=self._moves)
        self._sensors, self._out = init_wheel_sensors(), Dwell()
        self._session = 0
        self._sensed, self._now_ns = _NOTHING, 0
        self._bits, self._front = Watch(0), math.nan
        self._sent = SentCommand(0.0, 0.0, 0.0, 0)
        self._limiter = init_limiter(jnp.float32(0.0))
        self._result = (0.0, 0.0, 0.0, 0.0)
        self._began: tuple[float, LocalPosition | None] | None = None

    @property
    def lock_mps(self) -> float:
        """Of no meaning: the programme decides on the speed."""
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
        steers = bool(self._sent.engage & STEERING)
        beyond = steers and not abs(self._front) < self._largest_rad + _OUT_RAD
        self._out = step_dwell(self._out, beyond, sensed.step_s, on_s=_OUT_S)
        if self._out.on:
            bits |= Watch.STEERING_RUNAWAY
        if self._sent.engage & PEDALS:
            bits |= self._pedal_findings(speed)
        found, events = self._shared.step(
            status_age_s=math.inf if wheels is None else sensed.wheels_age_s,
            box=(0, 0) if wheels is None else (wheels.bits("state"), wheels.bits("engaged")),
            engage=self._sent.engage,
            statuses=operator.statuses,
            controller_age_s=operator.age_s,
            hands=hands,
            speed_mps=speed,
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
        severity = severity_of(bits) if received else Severity.CONTINUE
        trouble = self._trouble
        ages_s = {"drive-by-wire box is silent": self._sensed.wheels_age_s if received else math.inf}
        if self._moves:
            ages_s["no position from GNSS"] = self._place_age_s
        ended = [ARRIVED[-1]] if self._done else []
        return VehicleStatus(
            received,
            Event.ROUTE_OFF if self._done or self._ground_used else Event.ROUTE_NEAR,
            False,
            int(Reaction.STOP if trouble else Reaction.CONTINUE),
            ages_s,
            not bits & LINE,
            severity,
            severity >= Severity.MANUAL and bool(bits & ~LINE),
            severity is Severity.EMERGENCY,
            bool(bits & REFUSING),
            bool(limited & Limited.MANUAL_REQUESTED),
            [*ended, *trouble, *describe(bits), *limited_words(limited)],
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
                "; ".join(describe(found & sensors)) or "no wheel angle",
            ),
            CheckItem(Check.STORAGE, not processes.silent("recorder"), "nothing is being recorded"),
        ]
        if self._moves:
            tested = wheels is not None and bool(wheels.bits("state") & BoxState.BRAKE_TESTED)
            items += [
                CheckItem(Check.GNSS_INS, self._place_age_s < _PLACE_OLD_S, "no position"),
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
        if wish.engaged and wish.stop:
            front, brake = self._result[0], _HALT_BRAKE
        elif wish.engaged and not self._moves:
            front = self._steering.step(step_s)
        elif wish.drives and wheels is not None:
            throttle, brake = self._pedals.step(wheels.number("speed_mps"), step_s)
        numbers = _Numbers(
            front,
            throttle,
            brake,
            self._sensed.wheels_age_s,
            self._sensed.step_s,
            self._front,
            float(wish.engaged),
            self._largest_rad,
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
        row["watch"], row["severity"] = int(self._bits), int(severity_of(self._bits))
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
        return [*describe(self._bits), *self._trouble]

    def inhibit_text(self) -> str:
        """Why the manoeuvre cannot be engaged."""
        if self._done:
            return ARRIVED[-1]
        if self._ground_used:
            return f"{self._table.area_m:g} m are used up: turn round by hand, and engage again"
        return "; ".join(self._trouble)

    def slow(self) -> list[str]:
        """Nothing."""
        return []

    def notes(self) -> list[dict[str, Any]]:
        """None."""
        return []

    def release(self, engage: int) -> OutgoingFrame:
        """The last command of all."""
        return OutgoingFrame("drive_command", SentCommand(self._sent.front_rad, 0.0, 0.0, engage)._asdict())

    def leave(self) -> None:
        """The operator drives: what was under way begins again, what is complete stays so."""
        if not self._done:
            self._steering.restart()
            self._pedals.restart()
        self._began = None

    def choose(self, name: str) -> bool:
        """There is no route."""
        del name
        return False

    @property
    def _share(self) -> float:
        return self._pedals.share if self._moves else self._steering.share

    @property
    def _done(self) -> bool:
        return self._share >= 1.0

    @property
    def _place_age_s(self) -> float:
        place = self._senses.place
        return math.inf if place is None else (self._now_ns - place.time_ns) / 1e9

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
    def _ground_used(self) -> bool:
        """Whether the next run might not fit on the ground that is left."""
        top = self._table.fastest_mps
        return self._moves and self._pedals.between_runs and self._gone_m > self._table.area_m - 12.0 * top

    @property
    def _trouble(self) -> list[str]:
        """What ends a manoeuvre by a stop."""
        wheels = self._sensed.wheels
        speed = math.nan if wheels is None else abs(wheels.number("speed_mps"))
        trouble = [self._pedals.trouble] if self._pedals.trouble else []
        if not self._moves:
            return [*trouble, "the vehicle moves"] if self._sent.engage & STEERING and speed > _WALKING_MPS else trouble
        if self._sent.engage & PEDALS:
            if self._gone_m > self._table.area_m + _OFF_M:
                trouble.append(f"more than {self._table.area_m:g} m from where the manoeuvre was engaged")
            if not self._place_age_s < _PLACE_OLD_S:
                trouble.append("no position from GNSS")
            if not math.isfinite(speed):
                trouble.append("speed unknown")
        return trouble

    def _pedal_findings(self, speed_mps: float) -> Watch:
        """A speed beyond all that was asked for, or a brake without effect: the box cuts the power and brakes."""
        found = Watch.SPEED_RISES if speed_mps > self._pedals.cap_mps + _OVER_MPS else Watch(0)
        return found | (Watch.BRAKE_DEAD if self._pedals.trouble.startswith("the brake") else Watch(0))
