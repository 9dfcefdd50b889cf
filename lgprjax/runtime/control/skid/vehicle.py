"""The skid-steer vehicle in the control loop: a field worked along its plan, by RTK GNSS, INS and wheels."""

import math
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np

from lgprjax.autopilot import Check, Event, Mode
from lgprjax.autopilot.limiter import SkidLimited
from lgprjax.autopilot.monitors import FINDINGS, REFUSING, Severity, Watch, describe, severity_of
from lgprjax.autopilot.skid_step import OFF_LINE_M, SkidState
from lgprjax.navigation import Reaction, Reason
from lgprjax.run_records import COVER, SKID_PLAN, Record, RecordKind, StopBits, ToolBits
from lgprjax.runtime.config import CoverageTable, RuntimeConfig
from lgprjax.runtime.control.compiled import as_vector
from lgprjax.runtime.control.modes import CUT, PEDALS, STEERING, CheckItem
from lgprjax.runtime.control.setup import TICK_S
from lgprjax.runtime.control.skid.compiled import (
    SkidNumbers,
    SkidResult,
    start_skid_compiled,
    step_skid_compiled,
)
from lgprjax.runtime.control.skid.senses import SkidSensed, SkidSenses
from lgprjax.runtime.control.skid.setup import SkidLoaded, corner_obstacle, corner_row
from lgprjax.runtime.control.skid.watches import (
    DRIVE,
    SKID_FINDINGS,
    SkidFound,
    SkidSent,
    SkidWatched,
    SkidWatches,
    ToolBelief,
    ToolReading,
    depth_right,
    stops_of,
)
from lgprjax.runtime.control.vehicle_kind import (
    LINE,
    Operator,
    OutgoingFrame,
    Processes,
    VehicleStatus,
    Wish,
    box_checks,
)
from lgprjax.runtime.gnss import Quality
from lgprjax.runtime.words import ARRIVED, limited_words, reason_words, whole

# Display data of a skid-steer vehicle: field, swaths, tool and GNSS.

_MOST_POINTS = 1500
_PATH_TICKS = 100
_TRAIL_STEP_M = 0.5


def add_to_trail(trail: list[list[float]], x_m: float, y_m: float) -> None:
    """The way driven so far, for the page: a point each half metre, the last ones."""
    if math.isfinite(x_m) and (not trail or math.hypot(x_m - trail[-1][0], y_m - trail[-1][1]) >= _TRAIL_STEP_M):
        trail.append([round(x_m, 2), round(y_m, 2)])
        del trail[:-_MOST_POINTS]


class FieldPanel:
    """Keeps display data in addition to the tick's numbers.

    Args:
        loaded: files from ``load_skid``.
    """

    def __init__(self, loaded: SkidLoaded) -> None:
        self._loaded = loaded
        rows = np.asarray(loaded.route.rows, np.float64)[: int(loaded.route.count), :2]
        few = rows[np.unique(np.linspace(0, len(rows) - 1, _MOST_POINTS).astype(int))]
        # Without a plan: the way driven.
        self._points = [] if loaded.name is None else [[round(float(x), 2), round(float(y), 2)] for x, y in few]
        self._perimeter = [[round(float(x), 2), round(float(y), 2)] for x, y in loaded.perimeter_m]
        parts = () if loaded.ground is None else loaded.ground.polygons_m
        self._fence = [np.round(ring, 2).tolist() for part in parts for ring in part]
        self._path_tick: int | None = None

    def state(
        self, tick: int, result: SkidResult, sensed: SkidSensed, sent: SkidSent, reading: ToolReading | None
    ) -> dict[str, Any]:
        """Display state of a tick, in addition to the modes."""
        belief, line = self._loaded.belief, whole(result.line, -1)
        if self._loaded.name is None:
            add_to_trail(self._points, result.x_m, result.y_m)
        state: dict[str, Any] = {
            "route": self._loaded.name,
            "routes": [],
            "speed_mps": result.speed_mps,
            "cap_mps": float(self._loaded.setup.vehicle.largest_wheel_mps),
            "cross_track_m": result.cross_m,
            "to_go_m": result.to_go_m,
            "heading_error_deg": math.degrees(result.heading_error_rad),
            "sigma_along_m": result.sigma_m,
            "sigma_cross_m": result.sigma_m,
            "pose": [result.x_m, result.y_m, result.yaw_rad if result.heading_known > 0.5 else math.nan],
            "gnss_pose": [result.x_m, result.y_m, 0.0],
            "reaction": Reaction(int(result.reaction)).name if math.isfinite(result.reaction) else None,
            "field": {
                "perimeter": self._perimeter,
                "fence": self._fence,
                "line": line + 1 if line >= 0 else None,
                "lines": self._loaded.lines,
                "tool_width_m": self._loaded.setup.tool.width_m,
                "tool_ahead_m": self._loaded.setup.tool.ahead_m,
                "told_on": bool(sent.tool),
                "turns": None if reading is None else reading.turns,
                "depth_m": None if reading is None else reading.depth_m,
                "depth_right": None if reading is None else depth_right(belief, reading.depth_m),
                "depth_asked_m": belief.depth_m,
                "gnss": sensed.quality.name.lower(),
                "gnss_age_s": sensed.gnss_age_s,
                "heading_known": result.heading_known > 0.5,
                "sigma_heading_deg": math.degrees(math.sqrt(max(result.yawyaw, 0.0))),
            },
        }
        if self._path_tick is None or tick - self._path_tick >= _PATH_TICKS:
            self._path_tick = tick
            state["path"] = self._points
        return state


# The compiled step: its state, and the field.

_NOTHING = SkidResult(*[math.nan] * len(SkidResult._fields))


class SkidPilot:
    """Navigation and autopilot of one vehicle.

    Args:
        loaded: files from ``load_skid``.
        coverage: coverage table of the configuration.

    Attributes:
        result: result of the last tick; all NaN before there is a position.
    """

    def __init__(self, loaded: SkidLoaded, coverage: CoverageTable) -> None:
        self._loaded, self._guidance = loaded, coverage.guidance
        self._state: SkidState | None = None
        self.result = _NOTHING

    @property
    def started(self) -> bool:
        """Whether there is a pose, even without a heading."""
        return self._state is not None

    def warm_up(self) -> None:
        """Compile."""
        numbers = as_vector(SkidNumbers(*[0.0] * len(SkidNumbers._fields))._replace(step_s=TICK_S))
        state = start_skid_compiled(self._loaded.setup, np.float32(0.0), np.float32(0.0))
        # Every sequence of two: their outputs differ in detail.
        for _ in range(3):
            state, row = self._step(state, numbers)
        jax.block_until_ready(row)

    def step(self, sensed: SkidSensed, wish: Wish, cap_mps: float, now_ns: int) -> SkidResult:
        """Run a tick; without effect before there is a position.

        A NaN estimate is restarted once the operator drives.
        """
        if not wish.engaged and not math.isfinite(self.result.x_m):
            self._state = None
        if self._state is None:
            if sensed.place is None:
                return self.result
            x, y = np.float32(sensed.place.x_m), np.float32(sensed.place.y_m)
            self._state = start_skid_compiled(self._loaded.setup, x, y)
        self._state, row = self._step(self._state, as_vector(_numbers(sensed, wish, cap_mps, now_ns)))
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


# Rows of a skid-steer vehicle's tick: its decision, and ten times per second the state of its tool.


def skid_plan_row(
    result: SkidResult, sent: SkidSent, *, mode: int, bits: Watch, found: SkidFound, severity: Severity
) -> bytes:
    """``SKID_PLAN``; before there is a position navigation requests a stop."""
    row = np.zeros((), SKID_PLAN)
    row["mode"], row["reaction"] = mode, whole(result.reaction, int(Reaction.STOP))
    row["known"] = int(math.isfinite(result.x_m)) + 2 * int(result.heading_known > 0.5)
    row["reasons"], row["limited"] = whole(result.reasons), whole(result.limited)
    row["pose"] = (result.x_m, result.y_m, result.yaw_rad)
    row["sigma"] = [math.sqrt(max(number, 0.0)) for number in (result.xx, result.yy, result.yawyaw)]
    row["speed_mps"], row["cross_m"] = result.speed_mps, result.cross_m
    row["heading_error_rad"], row["to_go_m"] = result.heading_error_rad, result.to_go_m
    row["line"] = whole(result.line, -1)
    row["command"], row["tool"], row["depth_m"] = (sent.left_mps, sent.right_mps), sent.tool, sent.depth_m
    row["engage"], row["watch"], row["found"], row["severity"] = sent.engage, int(bits), int(found), int(severity)
    return row.tobytes()


def tool_bits(belief: ToolBelief, sent: SkidSent, reading: ToolReading | None, *, heading_known: bool) -> ToolBits:
    """Bits of the tool; commanded on requires that the computer drives.

    Cells count by measurement: a tool that turns at its depth works the ground under any driver. While the computer
    drives, the tool must also be commanded on, because ground that it was to leave may have been left.
    """
    bits = ToolBits(0)
    if sent.tool and sent.engage & DRIVE:
        bits |= ToolBits.TOLD_ON
    if reading is not None and reading.turns:
        bits |= ToolBits.TURNS
    if reading is not None and depth_right(belief, reading.depth_m):
        bits |= ToolBits.DEPTH_RIGHT
    measured = ToolBits.TURNS | ToolBits.DEPTH_RIGHT
    right = measured | ToolBits.TOLD_ON if sent.engage & DRIVE else measured
    return bits | ToolBits.COUNTS if bits == right and heading_known else bits


def cover_row(
    result: SkidResult,
    sensed: SkidSensed,
    reading: ToolReading | None,
    tool: ToolBits,
    *,
    mode: int,
    bits: Watch,
    found: SkidFound,
) -> bytes:
    """``COVER``."""
    row = np.zeros((), COVER)
    row["x_m"], row["y_m"], row["yaw_rad"] = result.x_m, result.y_m, result.yaw_rad
    row["covariance"] = [
        [result.xx, result.xy, result.xyaw],
        [result.xy, result.yy, result.yyaw],
        [result.xyaw, result.yyaw, result.yawyaw],
    ]
    row["speed_mps"], row["left_mps"], row["right_mps"] = result.speed_mps, sensed.left_mps, sensed.right_mps
    row["tool"], row["depth_m"] = int(tool), math.nan if reading is None else reading.depth_m
    # Driven by hand the vehicle counts as on no line of the plan.
    row["mode"], row["line"] = mode, whole(result.line, -1) if mode == Mode.SPEED else -1
    row["stop"] = int(_stops(Mode(mode), bits, found))
    row["gnss_quality"] = int(sensed.quality)
    return row.tobytes()


def _stops(mode: Mode, bits: Watch, found: SkidFound) -> StopBits:
    stops = stops_of(found, bits)
    if mode in (Mode.MANUAL, Mode.EMERGENCY_STOP):
        return stops | StopBits.OPERATOR
    return stops | StopBits.COMPUTER if mode is Mode.ERROR else stops


COVER_TICKS = 5
_DEGRADED_MPS = 0.2
_WAITS = "position too uncertain to go on: waiting for GNSS"
_NEAR_M = 10.0
_GNSS_OFF_S = 1.6
"""Age from which GNSS counts as off, as on the page."""
_TURNED_RAD = 1.6
_VEHICLE_NOTHING = SkidSensed(
    step_s=0.0,
    left_mps=math.nan,
    right_mps=math.nan,
    place=None,
    turn=None,
    box=None,
    box_age_s=math.inf,
    gnss_age_s=math.inf,
    ins_age_s=math.inf,
    quality=Quality.NONE,
)


class SkidSteerVehicle:
    """See ``VehicleKind``. Engaged with steering it is held at standstill; with speed it drives its plan.

    Args:
        config: configuration of the run, with a table ``coverage``.
        loaded: files of the run.

    Attributes:
        pilot: navigation and autopilot.
        senses: received messages.
        speed_control: always true, because the vehicle turns by its wheel speeds.
    """

    def __init__(self, config: RuntimeConfig, loaded: SkidLoaded) -> None:
        assert config.coverage is not None
        self.speed_control = True
        self.senses = SkidSenses(loaded.frame, config.sensors)
        self.pilot = SkidPilot(loaded, config.coverage)
        self._loaded, self._lock_mps = loaded, config.coverage.speed_mps
        self._watches = SkidWatches(config.control, loaded.belief)
        self._panel = FieldPanel(loaded)
        self._sent = SkidSent(0.0, 0.0, 0, 0.0, 0)
        self._sensed = _VEHICLE_NOTHING
        self._watched = SkidWatched(Watch(0), SkidFound(0), Severity.CONTINUE, [], False, None)
        self._ticks, self._corners = 0, 0
        self._unanchored = loaded.frame is None
        self._notes: list[dict[str, Any]] = []

    @property
    def lock_mps(self) -> float:
        """The plan's set speed, standing or not."""
        return self._lock_mps

    def warm_up(self) -> None:
        """Compile all that a tick may need."""
        self.pilot.warm_up()

    def take(self, record: Record, tick: int) -> None:
        """A message of the box or the GNSS/INS."""
        del tick  # single messages raise no events
        self.senses.take(record)

    def update(self, operator: Operator, now_ns: int) -> list[Event]:
        """End of the messages."""
        self._sensed = self.senses.end_tick(now_ns)
        result = self.pilot.result
        off_line = result.works > 0.5 and abs(result.cross_m) > OFF_LINE_M
        self._watched = self._watches.step(self._sensed, self._sent, operator, off_line=off_line)
        return self._watched.events

    def status(self, *, decided: bool) -> VehicleStatus:
        """Present status."""
        result, sensed = self.pilot.result, self._sensed
        limited = SkidLimited(whole(result.limited)) if decided else SkidLimited(0)
        # Before the box was first received the checks handle its silence.
        bits = self._watched.bits if sensed.box is not None else self._watched.bits & ~Watch.LINE_SILENT
        found = self._found()
        severity = (
            max(self._watched.severity, severity_of(found, SKID_FINDINGS))
            if sensed.box is not None
            else Severity.CONTINUE
        )
        return VehicleStatus(
            started=self.pilot.started,
            place=self._place(),
            doubtful=bool(found & SkidFound.HEADING_UNKNOWN),
            reaction=whole(result.reaction, int(Reaction.STOP)),
            ages_s={
                "no position from GNSS": sensed.gnss_age_s - self._loaded.gnss_period_s,
                "no heading from the INS": sensed.ins_age_s,
                "drive-by-wire box is silent": sensed.box_age_s,
            },
            line=not bits & LINE,
            severity=severity,
            manual=severity >= Severity.MANUAL and bool(bits & ~LINE),
            emergency=severity is Severity.EMERGENCY,
            refuses=bool(bits & REFUSING) or any(SKID_FINDINGS[bit].refuses for bit in found),
            failed=bool(limited & SkidLimited.MANUAL_REQUESTED),
            why=self._why(bits, found, limited),
        )

    def checks(self, processes: Processes) -> list[CheckItem]:
        """Present state of every system check."""
        sensed, bits = self._sensed, self._watched.bits
        unrecorded = processes.mandatory and (processes.silent("recorder") or processes.silent("coverage"))
        return [
            *box_checks(bits, received=sensed.box is not None),
            CheckItem(Check.GNSS_INS, self.pilot.started and sensed.ins_age_s < 1.0, "no position, or no INS"),
            CheckItem(Check.STORAGE, not unrecorded, "nothing is being recorded"),
        ]

    def step(self, wish: Wish, now_ns: int) -> None:
        """The compiled step."""
        slow = wish.slowly or self._watched.severity is Severity.DEGRADE
        self.pilot.step(self._sensed, wish, _DEGRADED_MPS if slow else math.inf, now_ns)

    def command(self, engage: int) -> OutgoingFrame:
        """Command to send."""
        result = self.pilot.result
        numbers = (result.left_mps, result.right_mps, result.depth_m)
        held = DRIVE if engage & (STEERING | PEDALS) else 0
        if not held or not all(math.isfinite(number) for number in numbers):
            self._sent = SkidSent(0.0, 0.0, 0, 0.0, engage & CUT)
        else:
            self._sent = SkidSent(result.left_mps, result.right_mps, int(result.tool > 0.5), result.depth_m, held)
        return OutgoingFrame("skid_command", self._sent._asdict())

    def rows(self, now_ns: int, mode: int) -> list[tuple[RecordKind, bytes]]:
        """The decision, the state of the tool, and a marked corner."""
        del now_ns  # rows are valid for the tick that they are recorded with
        result, watched, found = self.pilot.result, self._watched, self._found()
        severity = max(watched.severity, severity_of(found, SKID_FINDINGS))
        plan = skid_plan_row(result, self._sent, mode=mode, bits=watched.bits, found=found, severity=severity)
        rows = [(RecordKind.SKID_PLAN, plan)]
        self._ticks += 1
        if self.pilot.started and self._ticks % COVER_TICKS == 0:
            known = result.heading_known > 0.5
            tool = tool_bits(self._loaded.belief, self._sent, watched.reading, heading_known=known)
            cover = cover_row(result, self._sensed, watched.reading, tool, mode=mode, bits=watched.bits, found=found)
            rows.append((RecordKind.COVER, cover))
        return [*rows, *self._mark_corner()]

    def state(self, tick: int) -> dict[str, Any]:
        """State for the display."""
        return self._panel.state(tick, self.pilot.result, self._sensed, self._sent, self._watched.reading)

    def warnings(self) -> list[str]:
        """Warnings to the operator."""
        age_s = self._sensed.gnss_age_s
        # "No warnings" must not appear next to the page's own line on it; once health reports silence, there is a
        # warning.
        told = whole(self.pilot.result.reasons) & Reason.GNSS_SILENT
        off = [f"GNSS off for {age_s:.0f} s"] if _GNSS_OFF_S < age_s < math.inf and not told else []
        return [*describe(self._watched.bits, FINDINGS), *describe(self._found(), SKID_FINDINGS), *off]

    def inhibit_text(self) -> str:
        """An unknown heading, or a missing plan, which the operator can change."""
        if self._loaded.name is None:
            return "no plan: the ground is recorded while you drive"
        return SKID_FINDINGS[SkidFound.HEADING_UNKNOWN].text if self._found() & SkidFound.HEADING_UNKNOWN else ""

    def slow(self) -> list[str]:
        """Reasons of the speed cap: watches and health."""
        result, watched = self.pilot.result, self._watched
        cause = watched.severity is Severity.DEGRADE
        words = describe(watched.bits, FINDINGS) if cause else []
        if result.reaction != Reaction.DEGRADE:
            return words
        # The consequence for this vehicle comes first, because it is why the vehicle does not move.
        waits = bool(whole(result.reasons) & Reason.UNCERTAIN)
        others = reason_words(whole(result.reasons) & ~Reason.UNCERTAIN)
        return [*words, *([_WAITS] if waits else []), *others]

    def notes(self) -> list[dict[str, Any]]:
        """Corners, marked or refused; without a plan the frame of positions, once it is known."""
        notes, self._notes = self._notes, []
        frame = self.senses.frame
        if self._unanchored and frame is not None:
            self._unanchored = False
            notes.append({"anchor": [frame.latitude_deg, frame.longitude_deg, frame.height_m]})
        return notes

    def release(self, engage: int) -> OutgoingFrame:
        """The last command of all."""
        return OutgoingFrame("skid_command", SkidSent(0.0, 0.0, 0, 0.0, engage)._asdict())

    def leave(self) -> None:
        """Engaged again, it continues where it left its route."""

    def choose(self, name: str, place: str) -> bool:
        """There are no routes to select."""
        del name, place
        return False

    def next_place(self, by: int) -> dict[str, str] | None:
        """A plan has one place for a vehicle."""
        del by
        return None

    def _found(self) -> SkidFound:
        """Findings of the watches and of the last step."""
        result, found = self.pilot.result, self._watched.found
        if not result.heading_known > 0.5:
            found |= SkidFound.HEADING_UNKNOWN
        if result.edge > 0.5:
            found |= SkidFound.EDGE
        return found | SkidFound.UNCERTAIN if whole(result.reasons) & Reason.TOO_UNCERTAIN else found

    def _place(self) -> Event:
        result = self.pilot.result
        if self._loaded.name is None:
            return Event.ROUTE_GONE
        if result.done > 0.5 or not result.off_m <= _NEAR_M:
            return Event.ROUTE_OFF
        return Event.ROUTE_NEAR if abs(result.heading_error_rad) <= _TURNED_RAD else Event.ROUTE_WRONG_HEADING

    def _why(self, bits: Watch, found: SkidFound, limited: SkidLimited) -> list[str]:
        result = self.pilot.result
        done = [ARRIVED[1]] if result.done > 0.5 else []
        return [
            *done,
            *describe(found, SKID_FINDINGS),
            *describe(bits, FINDINGS),
            *reason_words(result.reasons),
            *limited_words(limited),
        ]

    def _mark_corner(self) -> list[tuple[RecordKind, bytes]]:
        if not self._watched.corner:
            return []
        obstacle = corner_obstacle(self.pilot.result, self._sensed.quality, engaged=bool(self._sent.engage))
        frame, place = self.senses.frame, self.senses.place
        if obstacle or frame is None or place is None:
            self._notes.append({"refused": "corner", "why": obstacle or "no position"})
            return []
        self._corners += 1
        self._notes.append({"corner": self._corners})
        return [(RecordKind.CORNER, corner_row(self._corners, self.pilot.result, frame, place.up_m))]
