"""The skid-steer vehicle in the control loop: a field worked along its plan, by RTK GNSS, INS and wheels."""

import math
from typing import Any

from lgprjax.autopilot import Check, Event
from lgprjax.autopilot.skid_limiter import SkidLimited
from lgprjax.autopilot.watch_findings import REFUSING, Severity, Watch, describe
from lgprjax.navigation import Reaction, Reason
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.checks import CheckItem
from lgprjax.runtime.control.mode_keeper import CUT, PEDALS, STEERING
from lgprjax.runtime.control.processes import Processes
from lgprjax.runtime.control.rows import whole
from lgprjax.runtime.control.skid import findings
from lgprjax.runtime.control.skid.corners import corner_obstacle, corner_row
from lgprjax.runtime.control.skid.findings import Found, describe_found, severity_of_found
from lgprjax.runtime.control.skid.panel import FieldPanel
from lgprjax.runtime.control.skid.pilot import SkidPilot
from lgprjax.runtime.control.skid.rows import cover_row, skid_plan_row, tool_bits
from lgprjax.runtime.control.skid.senses import SkidSensed, SkidSenses
from lgprjax.runtime.control.skid.setup import SkidLoaded
from lgprjax.runtime.control.skid.watches import DRIVE, SkidSent, SkidWatched, SkidWatches
from lgprjax.runtime.control.vehicle_kind import Frame, Look, Operator, Wish
from lgprjax.runtime.gnss_samples import Quality
from lgprjax.runtime.records import Kind, Record

COVER_TICKS = 5
_DEGRADED_MPS = 0.2
_NEAR_M = 10.0
_TURNED_RAD = 1.6
_LINE = Watch.LINE_SILENT | Watch.BAD_FRAMES | Watch.BUS_OFF | Watch.DEFAULTS_ACT | Watch.SECOND_SENDER
_NOTHING = SkidSensed(0.0, math.nan, math.nan, None, None, None, math.inf, math.inf, math.inf, Quality.NONE)


class SkidSteerVehicle:
    """See ``VehicleKind``. Engaged with steering it is held, standing; with the speed it drives its plan.

    Args:
        config: of the run, with a table ``coverage``.
        loaded: its files.

    Attributes:
        pilot: navigation and autopilot; senses: what came.
    """

    def __init__(self, config: RuntimeConfig, loaded: SkidLoaded) -> None:
        assert config.coverage is not None
        self.senses = SkidSenses(loaded.frame, config.sensors)
        self.pilot = SkidPilot(loaded, config.coverage)
        self._loaded, self._lock_mps = loaded, config.coverage.speed_mps
        self._watches = SkidWatches(config.control, loaded.belief)
        self._panel = FieldPanel(loaded)
        self._sent = SkidSent(0.0, 0.0, 0, 0.0, 0)
        self._sensed = _NOTHING
        self._watched = SkidWatched(Watch(0), Found(0), Severity.CONTINUE, [], False, None)
        self._ticks, self._corners = 0, 0
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
        del tick  # nothing is told of single messages
        self.senses.take(record)

    def feel(self, operator: Operator, now_ns: int) -> list[Event]:
        """End of what came."""
        self._sensed = self.senses.end_tick(now_ns)
        self._watched = self._watches.step(self._sensed, self._sent, operator, cross_m=self.pilot.result.cross_m)
        return self._watched.events

    def look(self, *, decided: bool) -> Look:
        """As it is now."""
        result, sensed = self.pilot.result, self._sensed
        limited = SkidLimited(whole(result.limited)) if decided else SkidLimited(0)
        # Before the box was first heard its silence is the checks' affair.
        bits = self._watched.bits if sensed.box is not None else self._watched.bits & ~Watch.LINE_SILENT
        found = self._found()
        severity = (
            max(self._watched.severity, severity_of_found(found)) if sensed.box is not None else Severity.CONTINUE
        )
        return Look(
            self.pilot.started,
            self._place(),
            bool(found & Found.HEADING_UNKNOWN),
            whole(result.reaction, int(Reaction.STOP)),
            max(sensed.gnss_age_s - self._loaded.gnss_period_s, sensed.ins_age_s, sensed.box_age_s),
            not bits & _LINE,
            severity,
            severity >= Severity.MANUAL and bool(bits & ~_LINE),
            severity is Severity.EMERGENCY,
            bool(bits & REFUSING) or bool(found & findings.REFUSING),
            bool(limited & SkidLimited.MANUAL_REQUESTED),
            self._why(bits, found, limited),
        )

    def checks(self, processes: Processes) -> list[CheckItem]:
        """Every system check as it stands."""
        sensed, bits = self._sensed, self._watched.bits
        line = Watch.LINE_SILENT | Watch.BAD_FRAMES | Watch.BUS_OFF | Watch.ACTUATOR_FAULT
        second = bool(bits & Watch.SECOND_SENDER)
        unrecorded = processes.mandatory and (processes.silent("recorder") or processes.silent("coverage"))
        return [
            CheckItem(Check.SECOND_MASTER, not second, "another sender commands the drive-by-wire box"),
            CheckItem(
                Check.DRIVE_BY_WIRE,
                sensed.box is not None and not bits & line,
                "; ".join(describe(bits & line)) or "the drive-by-wire box is silent",
            ),
            CheckItem(Check.GNSS_INS, self.pilot.started and sensed.ins_age_s < 1.0, "no position, or no INS"),
            CheckItem(Check.STORAGE, not unrecorded, "nothing is being recorded"),
        ]

    def decide(self, wish: Wish, now_ns: int) -> None:
        """The compiled step."""
        slow = wish.slowly or self._watched.severity is Severity.DEGRADE
        self.pilot.step(self._sensed, wish, _DEGRADED_MPS if slow else math.inf, now_ns)

    def command(self, engage: int) -> Frame:
        """What is sent."""
        result = self.pilot.result
        numbers = (result.left_mps, result.right_mps, result.depth_m)
        held = DRIVE if engage & (STEERING | PEDALS) else 0
        if not held or not all(math.isfinite(number) for number in numbers):
            self._sent = SkidSent(0.0, 0.0, 0, 0.0, engage & CUT)
        else:
            self._sent = SkidSent(result.left_mps, result.right_mps, int(result.tool > 0.5), result.depth_m, held)
        return Frame("skid_command", self._sent._asdict())

    def rows(self, now_ns: int, mode: int) -> list[tuple[Kind, bytes]]:
        """What was decided, what the tool does, and a corner that was marked."""
        del now_ns  # rows hold for the tick that they are recorded with
        result, watched, found = self.pilot.result, self._watched, self._found()
        severity = max(watched.severity, severity_of_found(found))
        plan = skid_plan_row(result, self._sent, mode=mode, bits=watched.bits, found=found, severity=severity)
        rows = [(Kind.SKID_PLAN, plan)]
        self._ticks += 1
        if self.pilot.started and self._ticks % COVER_TICKS == 0:
            known = result.heading_known > 0.5
            tool = tool_bits(self._loaded.belief, self._sent, watched.reading, heading_known=known)
            cover = cover_row(result, self._sensed, watched.reading, tool, mode=mode, bits=watched.bits, found=found)
            rows.append((Kind.COVER, cover))
        return [*rows, *self._mark_corner()]

    def state(self, tick: int) -> dict[str, Any]:
        """What the display shows of it."""
        return self._panel.state(tick, self.pilot.result, self._sensed, self._sent, self._watched.reading)

    def warnings(self) -> list[str]:
        """What the operator should know."""
        return [*describe(self._watched.bits), *describe_found(self._found())]

    def refusal_text(self) -> str:
        """A heading that is not known, or no plan, is what he can do something about."""
        if self._loaded.name is None:
            return "no plan: mark three corners, then lgprjax cover plan"
        return findings.TEXT[Found.HEADING_UNKNOWN] if self._found() & Found.HEADING_UNKNOWN else ""

    def notes(self) -> list[dict[str, Any]]:
        """Corners, marked or refused."""
        notes, self._notes = self._notes, []
        return notes

    def release(self, engage: int) -> Frame:
        """The last command of all."""
        return Frame("skid_command", SkidSent(0.0, 0.0, 0, 0.0, engage)._asdict())

    def leave(self) -> None:
        """Engaged again, it goes on where it left its route."""

    def choose(self, name: str) -> bool:
        """There are no routes to choose from."""
        del name
        return False

    def _found(self) -> Found:
        """Findings of the watches and of the last step."""
        result, found = self.pilot.result, self._watched.found
        if not result.heading_known > 0.5:
            found |= Found.HEADING_UNKNOWN
        if result.edge > 0.5:
            found |= Found.EDGE
        return found | Found.UNCERTAIN if whole(result.reasons) & Reason.TOO_UNCERTAIN else found

    def _place(self) -> Event:
        result = self.pilot.result
        if self._loaded.name is None:
            return Event.ROUTE_GONE
        if result.done > 0.5 or not result.off_m <= _NEAR_M:
            return Event.ROUTE_OFF
        return Event.ROUTE_NEAR if abs(result.heading_error_rad) <= _TURNED_RAD else Event.ROUTE_WRONG_HEADING

    def _why(self, bits: Watch, found: Found, limited: SkidLimited) -> list[str]:
        result = self.pilot.result
        bad = limited & (SkidLimited.NOT_FINITE | SkidLimited.STALE | SkidLimited.MANUAL_REQUESTED)
        done = ["the plan is done"] if result.done > 0.5 else []
        reasons = [] if not math.isfinite(result.reasons) else list(Reason(int(result.reasons)))
        return [
            *done,
            *describe_found(found),
            *describe(bits),
            *(str(reason.name).lower().replace("_", " ") for reason in reasons),
            *(f"command: {str(bit.name).lower().replace('_', ' ')}" for bit in bad),
        ]

    def _mark_corner(self) -> list[tuple[Kind, bytes]]:
        if not self._watched.corner:
            return []
        obstacle = corner_obstacle(self.pilot.result, self._sensed.quality, engaged=bool(self._sent.engage))
        frame, place = self.senses.frame, self.senses.place
        if obstacle or frame is None or place is None:
            self._notes.append({"refused": "corner", "why": obstacle or "no position"})
            return []
        self._corners += 1
        self._notes.append({"corner": self._corners})
        return [(Kind.CORNER, corner_row(self._corners, self.pilot.result, frame, place.up_m))]
