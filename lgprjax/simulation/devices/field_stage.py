"""The simulated devices of a skid-steer vehicle with its tool in a field."""

import math
from collections import deque
from collections.abc import Iterable
from pathlib import Path
from typing import Literal, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
from jaxtyping import Array, Float, Int, PRNGKeyArray
from pydantic import Field

from lgprjax.frames import LocalFrame
from lgprjax.scene.plant import (
    SkidPlant,
    SkidPlantState,
    SkidSensors,
    SkidSensorState,
    default_skid_plant,
    default_skid_sensors,
    init_skid_plant,
    init_skid_sensors,
    read_skid_sensors,
    step_skid_plant,
)
from lgprjax.simulation.devices.boxes import SkidActing, SkidBox, SkidCommandMessage, SkidMeasured
from lgprjax.simulation.devices.faults import FAULTS, RunningFaults, ScriptItem
from lgprjax.simulation.devices.sensors import GnssFix, InsReading, attitude_messages, position_message
from lgprjax.simulation.devices.stage import Stage, StageKind, StageSpec
from lgprjax.simulation.devices.vehicle import TruthRows
from lgprjax.vehicle.kinematics import VehiclePose, WheelSpeeds

# Specification of a run of the devices in a field.


class FieldSpec(StageSpec):
    """Specification of a run of the devices in a field; see ``StageSpec``. The script is the operator's.

    Attributes:
        anchor: latitude and longitude (degrees) and height of the plan's frame, the frame of poses.
        start: start pose of the reference point.
        track_m, gnss_x_m, gnss_y_m, threshold_mps: track width, antenna and control threshold of the true vehicle.
        wheel_scale: relative scale error of the tracks' sensors.
        seed: seed of slips and errors.
        host: task of the host; times of the script count from its readiness to drive, or from the start to record.
    """

    anchor: tuple[float, float, float]
    start: tuple[float, float, float]
    track_m: float = Field(gt=0.0)
    gnss_x_m: float = 0.0
    gnss_y_m: float = 0.0
    threshold_mps: float = Field(default=0.0, ge=0.0)
    wheel_scale: float = Field(default=0.02, gt=-0.5, lt=0.5)
    seed: int = 2
    host: Literal["drive", "record"] = "drive"


# Faults of the simulated devices of a field: names and their parameters.

FIELD_LINES = ("drive_by_wire", "controller", "gnss")
_OF_EVERY_VEHICLE = (
    "gnss_off",
    "gnss_jump",
    "gnss_float",
    "ins_off",
    "ins_nan",
    "line_corrupt",
    "line_repeat",
    "line_silent",
    "bus_off",
    "override_stuck",
    "override_wire_cut",
    "estop_held",
    "supply_sag",
)
FIELD_FAULTS: dict[str, tuple[str, ...]] = {
    **{name: FAULTS[name] for name in _OF_EVERY_VEHICLE},
    "left_dead": (),
    "right_dead": (),
    "tool_stops": (),
    "tool_depth": ("m",),
}
"""Faults by name, with their required keys. ``left_dead``: dead sensor; ``tool_depth``: m deeper."""


# The skid-steer vehicle behind the devices: plant and navigation sensors stepped in one compiled call.

TICK_S = 0.01
_DELAY_SLOTS = 12


class FlailMoved(NamedTuple):
    """The vehicle at a tick's end, in the plan's frame, and its sensor readings.

    Attributes:
        x_m, y_m, yaw_rad, speed_mps: true pose and speed of the reference point.
        left_mps, right_mps: measured speeds of the tracks.
        gnss_east_m, gnss_north_m, gnss_sigma_m, gnss_age_s, gnss_valid: GNSS reading of the antenna.
        turn_rad, span_s, turn_valid: turn and time since the last delta heading of the INS.
    """

    x_m: float
    y_m: float
    yaw_rad: float
    speed_mps: float
    left_mps: float
    right_mps: float
    gnss_east_m: float
    gnss_north_m: float
    gnss_sigma_m: float
    gnss_age_s: float
    gnss_valid: float
    turn_rad: float
    span_s: float
    turn_valid: float


class Flail:
    """A simulated skid-steer vehicle, initially at standstill.

    Args:
        track_m: effective track width.
        gnss_x_m, gnss_y_m: antenna in the body.
        threshold_mps: control threshold; 0: none.
        start: pose of the reference point in the plan's frame.
        wheel_scale: relative scale error of the tracks' sensors.
        seed: seed of slips and errors.
    """

    def __init__(
        self,
        *,
        track_m: float,
        gnss_x_m: float,
        gnss_y_m: float,
        threshold_mps: float,
        start: tuple[float, float, float],
        wheel_scale: float,
        seed: int,
    ) -> None:
        plant = default_skid_plant(track_m=track_m)._replace(threshold_mps=jnp.float32(threshold_mps))
        sensors = default_skid_sensors(tick_s=TICK_S, gnss_x_m=gnss_x_m, gnss_y_m=gnss_y_m)
        # NumPy arrays, which a compiled function takes directly: transfers of each would cost as much as the call.
        self._fixed: tuple[SkidPlant, SkidSensors] = jax.tree.map(np.asarray, (plant, sensors))
        slips, errors, self._noise = jax.random.split(jax.random.key(seed), 3)
        pose = VehiclePose(*(jnp.float32(number) for number in start))
        self._plant = init_skid_plant(plant, pose, slips, delay_slots=_DELAY_SLOTS)
        drawn = init_skid_sensors(sensors, pose.yaw_rad, errors)
        self._sensors = drawn._replace(scale=jnp.float32(wheel_scale))
        self._tick = 0

    def step(self, left_mps: float, right_mps: float) -> FlailMoved:
        """The vehicle a tick later."""
        self._tick += 1
        told = np.array([left_mps, right_mps], np.float32)
        self._plant, self._sensors, row = _step(
            self._fixed, self._plant, self._sensors, told, self._noise, np.int32(self._tick)
        )
        return FlailMoved._make(np.asarray(row, np.float64).tolist())


@jax.jit
def _step(
    fixed: tuple[SkidPlant, SkidSensors],
    plant: SkidPlantState,
    sensors: SkidSensorState,
    told: Float[Array, "2"],
    noise: PRNGKeyArray,
    tick: Int[Array, ""],
) -> tuple[SkidPlantState, SkidSensorState, Float[Array, " number"]]:
    moves, reads = jax.random.split(jax.random.fold_in(noise, tick))
    plant = step_skid_plant(fixed[0], plant, WheelSpeeds(told[0], told[1]), moves, TICK_S)
    sensors, readings = read_skid_sensors(fixed[1], sensors, plant, tick, reads, TICK_S)
    row = [
        *plant.pose,
        plant.speed_mps,
        readings.left_mps,
        readings.right_mps,
        readings.gnss_m[0],
        readings.gnss_m[1],
        readings.gnss_sigma_m,
        readings.gnss_age_s,
        readings.gnss_valid,
        readings.turn_rad,
        readings.span_s,
        readings.turn_valid,
    ]
    return plant, sensors, jnp.stack([jnp.asarray(number).astype(jnp.float32) for number in row])


# The tool of the simulated flail: it takes a moment to come up to speed and to go down.

_RPM, _TURNS_RPM = 400.0, 360.0
_SPINS_UP_S = 0.15
_SINKS_MPS = 0.6
_RAISED_M = -0.1


class ToolState(NamedTuple):
    """Speed and depth of the tool; it is raised where the depth is negative."""

    rpm: float = 0.0
    depth_m: float = _RAISED_M

    @property
    def turns(self) -> bool:
        """Whether the tool is at its working speed."""
        return self.rpm >= _TURNS_RPM


def step_tool(state: ToolState, asked_m: float | None, faults: RunningFaults, step_s: float) -> ToolState:
    """The tool a step later; ``asked_m``: depth to turn at, ``None`` for off and raised."""
    rpm = 0.0 if asked_m is None or faults.has("tool_stops") else _RPM
    depth = _RAISED_M if asked_m is None else asked_m + faults.number("tool_depth", "m", 0.0)
    keep = math.exp(-step_s / _SPINS_UP_S)
    sunk = min(max(depth - state.depth_m, -_SINKS_MPS * step_s), _SINKS_MPS * step_s)
    return ToolState(rpm + keep * (state.rpm - rpm), state.depth_m + sunk)


# The truth of a run in a field: how the vehicle and its tool really went, tick by tick.

_COLUMNS = (
    "x_m",
    "y_m",
    "yaw_rad",
    "speed_mps",
    "turns",
    "depth_m",
    "engaged",
    "command_left_mps",
    "command_right_mps",
    "gnss_on",
)


class FieldTruth(TruthRows):
    """True motion of a vehicle and its tool."""

    def __init__(self) -> None:
        super().__init__(_COLUMNS)

    def add(
        self, time_ns: int, moved: FlailMoved, tool: ToolState, command: SkidCommandMessage, held: int, *, gnss_on: bool
    ) -> None:
        """A tick's row."""
        row = (
            moved.x_m,
            moved.y_m,
            moved.yaw_rad,
            moved.speed_mps,
            float(tool.turns),
            tool.depth_m,
            float(held),
            command.left_mps,
            command.right_mps,
            float(gnss_on),
        )
        self.add_row(time_ns, row)


# The operator of a skid-steer vehicle: drives it by remote control from place to place, and plays a script.

FIELD_SCRIPT: dict[str, tuple[str, ...]] = {
    "drive_to": ("x_m", "y_m", "speed_mps"),
    "work_to": ("x_m", "y_m", "speed_mps", "tool_m"),
    "stand": (),
    "press": ("button",),
    "brake_tap": (),
}
"""Items of a script, and their parameters. ``work_to`` is ``drive_to`` with the tool on, at a depth."""
_WAYS = ("drive_to", "work_to")
_SCRIPT_LASTS_S = {"press": 0.3, "brake_tap": 0.3}
FIELD_BUTTONS = ("steering", "plus", "minus", "override", "estop", "corner")

_THERE_M = 0.05
_WAITS_S = 2.0
_TURN_RADPS = 0.5
_AIMED_RAD = 0.1
_PER_RAD = 1.0
_TRACK_M = 1.1


class RemoteHands(NamedTuple):
    """Operator actions: the remote control, and pressed buttons."""

    remote: SkidActing
    buttons: frozenset[str]


class Teleoperator:
    """Drives by true pose: turns on the spot towards a place, then straight to it.

    Attributes:
        arrivals: places that were reached; the operator waits two seconds at each.
    """

    def __init__(self) -> None:
        self.arrivals = 0
        self._told: list[ScriptItem] = []
        self._waiting: list[ScriptItem] = []
        self._rest_s = 0.0

    def step(self, running: Iterable[ScriptItem], x_m: float, y_m: float, yaw_rad: float, step_s: float) -> RemoteHands:
        """Operator actions at a true pose of the reference point."""
        items = list(running)
        for item in items:
            if item.name == "stand" and item not in self._told:
                self._waiting = []
            if item.name in (*_WAYS, "stand") and item not in self._told:
                self._told.append(item)
                self._waiting += [item] if item.name in _WAYS else []
        self._rest_s = max(self._rest_s - step_s, 0.0)
        pressed = frozenset(str(item.numbers["button"]) for item in items if item.name == "press")
        pressed |= {"brake_tap"} if any(item.name == "brake_tap" for item in items) else set()
        return RemoteHands(self._drive(x_m, y_m, yaw_rad), pressed)

    def _drive(self, x_m: float, y_m: float, yaw_rad: float) -> SkidActing:
        stands = SkidActing(0.0, 0.0, None)
        if not self._waiting or self._rest_s > 0.0:
            return stands
        goal = self._waiting[0].numbers
        east, north = float(goal["x_m"]) - x_m, float(goal["y_m"]) - y_m
        distance = math.hypot(east, north)
        off = math.remainder(math.atan2(north, east) - yaw_rad, math.tau)
        # At its end a place that is abreast is passed.
        if distance < _THERE_M or (distance < 0.5 and abs(off) > 1.0):
            self._waiting.pop(0)
            self.arrivals += 1
            self._rest_s = _WAITS_S
            return stands
        aimed = abs(off) <= _AIMED_RAD or distance < 0.5
        speed = min(float(goal["speed_mps"]), 0.1 + distance) if aimed else 0.0
        turn = min(max(_PER_RAD * off, -_TURN_RADPS), _TURN_RADPS)
        tool_m = float(goal["tool_m"]) if aimed and "tool_m" in goal else None
        return SkidActing(speed - 0.5 * _TRACK_M * turn, speed + 0.5 * _TRACK_M * turn, tool_m)


_KIND = StageKind(FIELD_LINES, FIELD_SCRIPT, _SCRIPT_LASTS_S, FIELD_BUTTONS, FIELD_FAULTS)
_SUPPLY_V, _FLOAT_M = 24.0, 0.4


class FieldStage(Stage[SkidBox, None]):
    """A skid-steer vehicle with its tool in a field; see ``Stage``.

    Args:
        spec: specification of the run.
        file: file of the specification, for messages.
        begin_ns: start time of the world.

    Raises:
        InputError: the spec's script or faults cannot be used.
    """

    truth: FieldTruth

    def __init__(self, spec: FieldSpec, file: Path, begin_ns: int) -> None:
        super().__init__(_KIND, spec, file, begin_ns, tick_ns=1e9 * TICK_S, box=SkidBox, seed=spec.seed)
        self._host = spec.host
        self.truth = FieldTruth()
        self._frame = LocalFrame(*spec.anchor)
        self._flail = Flail(
            track_m=spec.track_m,
            gnss_x_m=spec.gnss_x_m,
            gnss_y_m=spec.gnss_y_m,
            threshold_mps=spec.threshold_mps,
            start=spec.start,
            wheel_scale=spec.wheel_scale,
            seed=spec.seed,
        )
        self.moved = FlailMoved(*spec.start, *[0.0] * (len(FlailMoved._fields) - 3))
        self.tool, self.operator = ToolState(), Teleoperator()
        self._hands = RemoteHands(SkidActing(0.0, 0.0, None), frozenset())
        self._ins_yaw = float(self._rng.uniform(-math.pi, math.pi))
        self._left_m = self._right_m = 0.0
        self._travel_m = 0.0
        self._waiting: deque[tuple[str, int, bytes]] = deque(maxlen=64)

    def tick(self) -> None:
        """Move the vehicle by a tick, with the host's messages up to its start."""
        begin_ns, before = self.next_ns, self.moved
        with self._lock:
            box = self.drive_box
            running = self._begin_tick(self._travel_m, self.operator.arrivals)
            self._hands = self.operator.step(running, before.x_m, before.y_m, before.yaw_rad, TICK_S)
            supply_v = self.faults.number("supply_sag", "v", _SUPPLY_V)
            acting = box.acting(begin_ns, self._hands.remote, supply_v)
            command, held = box.command, box.held
        self.moved = moved = self._flail.step(acting.left_mps, acting.right_mps)
        self.tool = step_tool(self.tool, acting.tool_m, self.faults, TICK_S)
        self._travel_m += abs(moved.speed_mps) * TICK_S
        on = not self.faults.has("gnss_off")
        self.truth.add(self.next_ns, moved, self.tool, command, held, gnss_on=on)
        with self._lock:
            self._sense(moved, supply_v, gnss_on=on)

    @property
    def _host_ready(self) -> bool:
        return self._host == "record" or super()._host_ready

    @property
    def _buttons_held(self) -> frozenset[str]:
        return self._hands.buttons

    def _due(self, now_ns: int) -> list[tuple[str, bytes]]:
        told: list[tuple[str, bytes]] = []
        # Unknown data are not sent yet: a late world sends late, never wrong data.
        while self._waiting and self._waiting[0][1] <= now_ns:
            line, due_ns, data = self._waiting.popleft()
            if line == "drive_by_wire":
                self._note("status", now_ns - due_ns)
            told.append((line, data))
        return told

    def _sense(self, moved: FlailMoved, supply_v: float, *, gnss_on: bool) -> None:
        """Device messages at a tick's end."""
        end_ns = self.next_ns
        left_mps = 0.0 if self.faults.has("left_dead") else moved.left_mps
        right_mps = 0.0 if self.faults.has("right_dead") else moved.right_mps
        self._left_m += left_mps * TICK_S
        self._right_m += right_mps * TICK_S
        tool = self.tool
        measured = SkidMeasured(
            left_mps=left_mps,
            right_mps=right_mps,
            left_m=self._left_m,
            right_m=self._right_m,
            tool=tool.turns,
            tool_rpm=tool.rpm,
            depth_m=tool.depth_m,
            supply_v=supply_v,
        )
        self._waiting.append(("drive_by_wire", end_ns, self.drive_box.status(end_ns, measured)))
        if moved.turn_valid > 0.5:
            self._ins_yaw += moved.turn_rad
            if not self.faults.has("ins_off"):
                self._waiting.append(("gnss", end_ns, attitude_messages(self._clock, end_ns, self._attitude(moved))))
        if moved.gnss_valid > 0.5 and gnss_on:
            measured_ns = end_ns - round(1e9 * moved.gnss_age_s)
            self._waiting.append(("gnss", end_ns, position_message(self._clock, measured_ns, self._position(moved))))

    def _attitude(self, moved: FlailMoved) -> InsReading:
        return InsReading(
            0.0,
            self._heading_deg(self._ins_yaw),
            moved.turn_rad / moved.span_s,
            0.0,
            moved.speed_mps,
            not self.faults.has("ins_nan"),
        )

    def _position(self, moved: FlailMoved) -> GnssFix:
        loose = self.faults.has("gnss_float")
        jump = self.faults.pair("gnss_jump", "m")
        east, north = moved.gnss_east_m + jump[0], moved.gnss_north_m + jump[1]
        latitude, longitude, height = self._frame.to_geodetic(np.array([east]), np.array([north]), np.zeros(1))
        return GnssFix(
            latitude_deg=float(latitude[0]),
            longitude_deg=float(longitude[0]),
            height_m=float(height[0]),
            speed_mps=abs(moved.speed_mps),
            course_deg=self._heading_deg(moved.yaw_rad),
            sigma_m=_FLOAT_M if loose else moved.gnss_sigma_m,
            solution=1 if loose else 2,
        )

    def _heading_deg(self, yaw_rad: float) -> float:
        return float(self._frame.heading_of_yaw(np.array([yaw_rad]), np.array([self._frame.longitude_deg]))[0])
