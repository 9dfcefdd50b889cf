"""The control loop without clock, ports or files: records of a tick in, records out. Replay runs the same code.

Order of a tick: messages are taken, the watches judge them, the modes change, the compiled step decides, the command is
sent, and its findings go to the modes in the same tick, so that no command is engaged against a finding. Specifics of a
vehicle are behind ``VehicleKind``.
"""

import json
import math
from collections.abc import Sequence
from typing import Any, TypeAlias

from lgprjax.autopilot import Action, Check, EngagementInhibit, Event, Mode, inhibit_of
from lgprjax.autopilot.monitors import FINDINGS, Watch
from lgprjax.coverage.field import HIGHEST_LEVEL
from lgprjax.coverage.resume import RoutePlace
from lgprjax.errors import InputError
from lgprjax.run_records import Record, RecordKind, Source
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.counter_steer import CounterSteer
from lgprjax.runtime.control.manoeuvre import LoadedManoeuvre, ManoeuvreKind, load_manoeuvre
from lgprjax.runtime.control.modes import CUT, PEDALS, STEERING, CheckItem, ModeChange, ModeKeeper, SystemChecks
from lgprjax.runtime.control.setup import Loaded, load
from lgprjax.runtime.control.skid.setup import SkidLoaded, load_skid
from lgprjax.runtime.control.skid.vehicle import SkidSteerVehicle
from lgprjax.runtime.control.vehicle_kind import (
    Operator,
    OutgoingFrame,
    Processes,
    ReportedState,
    Seen,
    VehicleKind,
    VehicleStatus,
    Wish,
    events_of,
)
from lgprjax.runtime.words import ARRIVED, FAULTS, REFUSALS, cause_words, causes_of
from lgprjax.wire import Frame, Sender, decode

# The vehicle that a configuration is about.

AnyLoaded: TypeAlias = Loaded | SkidLoaded | LoadedManoeuvre


def load_vehicle(
    config: RuntimeConfig, place: RoutePlace | None = None, anchor: Sequence[float] | None = None
) -> AnyLoaded:
    """The files of a configuration: of a field if it has one, else of a course.

    Args:
        config: configuration of the run.
        place, anchor: place and anchor on a field after a relaunch, see ``load_skid``.

    Raises:
        InputError: a file cannot be used.
    """
    if not config.commands:
        raise InputError(config.file, "mode", "drive", f"{config.mode}: such a run has no commands")
    if config.mode == "calibrate":
        return load_manoeuvre(config)
    return load(config) if config.coverage is None else load_skid(config, place, anchor)


def make_kind(config: RuntimeConfig, loaded: AnyLoaded) -> VehicleKind:
    """The vehicle for a control loop.

    Raises:
        InputError: the vehicle file lacks a number.
    """
    if isinstance(loaded, LoadedManoeuvre):
        return ManoeuvreKind(config, loaded)
    return CounterSteer(config, loaded) if isinstance(loaded, Loaded) else SkidSteerVehicle(config, loaded)


OF_NAVIGATION = (
    EngagementInhibit.SOURCE_MISSING,
    EngagementInhibit.HEALTH,
    EngagementInhibit.NO_PATH,
    EngagementInhibit.OFF_ROUTE,
    EngagementInhibit.WRONG_HEADING,
)
"""Inhibits that a vehicle may explain better."""


# Ticks that began more than a period late. Fault 26.

_TICK_NS = 20_000_000
_MOST, _WINDOW = 3, 50


class LateTicks:
    """Late ticks of the last second.

    Attributes:
        last_ns: start of the last tick; 0 before the first.
    """

    def __init__(self) -> None:
        self.last_ns = 0
        self._late: list[int] = []

    def count(self, tick: int, now_ns: int) -> None:
        """Count a tick at its start."""
        if self.last_ns and now_ns - self.last_ns > 2 * _TICK_NS:
            self._late.append(tick)
        self.last_ns = now_ns
        self._late = [late for late in self._late if late > tick - _WINDOW]

    @property
    def too_many(self) -> bool:
        """Whether the loop misses its period too often."""
        return len(self._late) >= _MOST


def level_event(asked: object) -> dict[str, Any]:
    """Recorded event of a requested confidence level for the page's map; it has no effect on control."""
    if isinstance(asked, float) and 0.5 < asked <= HIGHEST_LEVEL:
        return {"level": asked}
    return {"refused": "level", "why": f"above 0.5, {HIGHEST_LEVEL:g} at most"}


# JSON for pages, without NaN.


def finite_json(value: dict[str, Any]) -> bytes:
    """JSON of a table; non-finite numbers become null, others have four decimals."""
    return json.dumps(_finite(value)).encode()


def _finite(value: Any) -> Any:
    if isinstance(value, float):
        return round(value, 4) if math.isfinite(value) else None
    if isinstance(value, dict):
        return {name: _finite(inner) for name, inner in value.items()}
    if isinstance(value, list):
        return [_finite(inner) for inner in value]
    return value


_COMMAND_TTL_MS = 200
_LIGHT_TTL_MS = 500
_OLD_S = 0.5
_STATE_TICKS = 5
_WITH_REASONS = (Event.ERROR_RAISED, Event.HEALTH_STOP, Event.DRIVE_BY_WIRE_DIED)
_PRESSES = (Event.STEERING_BUTTON, Event.CRUISE_PLUS, Event.CRUISE_MINUS)
_UNCHECKED = (Mode.BOOT, Mode.CHECKS)
_TOLD = (Mode.ERROR, Mode.MANUAL, Mode.EMERGENCY_STOP)
"""Modes whose cause the page shows."""
_CONTROLLER = FINDINGS[Watch.CONTROLLER_SILENT].text
_OVERRIDE_UNREAD = {_CONTROLLER, FINDINGS[Watch.OVERRIDE_CONTACTS].text}
"""Findings for which the override button is assumed to be pressed."""


class ControlCore:
    """One run's control loop.

    Args:
        config: configuration of the run.
        loaded: files of the run.
        session: session number of the frames sent.
        after_death: see ``ModeKeeper``.

        Attributes:
        kind: kind of vehicle: senses, watches and decisions.
        modes: mode machine.
        processes: states of the other processes, from the supervisor.
        unrecorded: number of messages dropped on their way to the recorder, for the display.

    Raises:
        InputError: the vehicle file lacks a number.
    """

    def __init__(self, config: RuntimeConfig, loaded: AnyLoaded, *, session: int, after_death: bool) -> None:
        self.kind: VehicleKind = make_kind(config, loaded)
        self.modes = ModeKeeper(
            after_death=after_death,
            speed_step_mps=config.control.set_speed_step_mps,
            speed_control=self.kind.speed_control,
        )
        self.processes = Processes(config)
        self.unrecorded = 0
        self._after_death = after_death
        # The first command of a session releases the box's actuators. A power cut must persist, so it is learned first.
        self._box_unheard = after_death
        self._checks, self._late = SystemChecks(), LateTicks()
        # One numbering per line, one session per start.
        self._box, self._controller = Sender(session), Sender(session)
        self._told = ReportedState()
        self._tick = 0
        self._buttons: list[int] = []
        self._controller_ns: int | None = None
        self._monitor: dict[str, Any] = {}
        self._booted = False
        self._missing: list[str] = []
        self._progress = ""
        self._why: list[str] = []
        self._slow: list[str] = []
        self._cause = self._stop_cause = ""
        self._out: list[Record] = []

    def step(self, tick: int, now_ns: int, came: list[Record]) -> list[Record]:
        """Run a tick.

        Args:
            tick: number of the tick, from 1.
            now_ns: monotonic time, ns.
            came: messages since the last tick, in order.

        Returns:
            Records to send (PORT_OUT, PRIOR, COVER, STATE) and to record (PLAN, SKID_PLAN, EVENT), in order of
            creation.
        """
        self._tick, self._out = tick, []
        self._late.count(tick, now_ns)
        for record in came:
            self._take(record, now_ns)
        events = self.kind.update(self._operator(now_ns), now_ns)
        if not self._booted:
            self._booted = True
            self._tell(Event.BOOT_DONE, now_ns)
            if self._after_death:
                self._tell(Event.CONTROL_RELAUNCHED, now_ns)
        for event in events:
            # Before anything is engaged the cruise buttons choose between several places on the route.
            by = {Event.CRUISE_PLUS: 1, Event.CRUISE_MINUS: -1}.get(event, 0)
            request = self.kind.next_place(by) if by and not self.modes.engage & (STEERING | PEDALS) else None
            if request is not None:
                self._choose(request, now_ns)
                continue
            unread = [text for text in self.kind.warnings() if text in _OVERRIDE_UNREAD]
            self._tell(event, now_ns, why=unread if event is Event.OVERRIDE_ASSUMED else None)
        self._run_checks(now_ns)
        self._notice(self.kind.status(decided=False), now_ns)
        self.kind.step(self._wish(), now_ns)
        self._notice(self.kind.status(decided=True), now_ns)
        self._command(now_ns)
        self._tell_slow(now_ns)
        for kind, payload in self.kind.rows(now_ns, int(self.modes.mode)):
            self._out.append(Record(kind, Source.CONTROL, tick, now_ns, payload))
        for note in self.kind.notes():
            self._event(now_ns, note)
        if tick % _STATE_TICKS == 0:
            self._show(now_ns)
        return self._out

    def release(self, now_ns: int) -> Record:
        """The last command of all: nothing engaged, a cut power left cut."""
        frame = self._framed(self.kind.release(self.modes.engage & CUT), now_ns)
        return Record(RecordKind.PORT_OUT, Source.DRIVE_BY_WIRE, self._tick + 1, now_ns, frame)

    def _take(self, record: Record, now_ns: int) -> None:
        match record.kind:
            case RecordKind.PORT_IN if record.source is Source.CONTROLLER:
                self._controller_ns = record.mono_ns
                self._buttons.append(int(decode(record.payload).number("buttons")))
            case RecordKind.PORT_IN | RecordKind.FIX:
                self.kind.take(record, self._tick)
                if self._box_unheard and record.source is Source.DRIVE_BY_WIRE:
                    self._learn_cut(decode(record.payload))
            case RecordKind.EVENT:
                note = json.loads(record.payload)
                self._progress = str(note.get("progress", self._progress))
                for event in self.processes.take(note):
                    self._tell(event, now_ns)
            case RecordKind.MONITOR:
                self._monitor = json.loads(record.payload)
            case RecordKind.REQUEST:
                asked = json.loads(record.payload)
                if "select_level" in asked:
                    self._event(now_ns, level_event(asked["select_level"]))
                else:
                    self._choose(asked, now_ns)

    def _learn_cut(self, frame: Frame) -> None:
        """Power that the box keeps cut since before a relaunch stays cut."""
        if "engaged" in frame.fields:
            self._box_unheard = False
            self.modes.engage |= int(frame.number("engaged")) & CUT

    def _choose(self, request: dict[str, Any], now_ns: int) -> None:
        """Select another route, or another place on it: only while the operator drives."""
        name, place = str(request.get("select_route")), str(request.get("place", ""))
        if self.modes.engage & (STEERING | PEDALS):
            self._event(now_ns, {"refused": "route", "why": "routes are chosen only while the operator drives"})
        elif self.kind.choose(name, place):
            self._event(now_ns, {"route": name, **({"place": place} if place else {})})
        else:
            self._event(now_ns, {"refused": "route", "why": f"no drivable route: {name[:80]}"})

    def _operator(self, now_ns: int) -> Operator:
        statuses, self._buttons = tuple(self._buttons), []
        return Operator(statuses, self._controller_age_s(now_ns))

    def _controller_age_s(self, now_ns: int) -> float:
        return math.inf if self._controller_ns is None else (now_ns - self._controller_ns) / 1e9

    def _run_checks(self, now_ns: int) -> None:
        now_s = now_ns / 1e9
        if self.modes.checks_requested:
            self.modes.checks_requested = False
            self._checks.begin(now_s)
        verdict = self._checks.step(now_s, lambda: self.kind.checks(self.processes), starting=self.processes.starting)
        if verdict is True:
            self._tell(Event.CHECKS_PASSED, now_ns)
        elif isinstance(verdict, CheckItem):
            self._event(now_ns, {"check": verdict.check.name, "why": verdict.reason})
            self._tell(Event.CHECKS_FAILED, now_ns, check=verdict)
        if self._checks.brake_test_due(now_s):
            self._port_out(Source.DRIVE_BY_WIRE, self._framed(OutgoingFrame("drive_test", {"test": 1}), now_ns), now_ns)

    def _notice(self, status: VehicleStatus, now_ns: int) -> None:
        """Report changes to the mode machine."""
        modes = self.modes
        ages_s = {**status.ages_s, _CONTROLLER: self._controller_age_s(now_ns)}
        self._missing = [what for what, age_s in ages_s.items() if not age_s < _OLD_S]
        self._why = status.why
        seen = Seen(
            mode=modes.mode,
            place=modes.state.place,
            started=status.started,
            route=status.place,
            doubtful=status.doubtful,
            reaction=status.reaction,
            sources=not self._missing and not status.refuses,
            # Before the checks the checks themselves handle the box's line: they wait, and report what failed.
            line=status.line or modes.mode in _UNCHECKED,
            severity=status.severity,
            manual=status.manual,
            failed=status.failed or self._late.too_many,
            recorder_lost=self.processes.lost,
        )
        # Evaluated before the events, which may release what was engaged.
        emergency = status.emergency and bool(modes.engage & (STEERING | PEDALS | CUT))
        self._told, events = events_of(self._told, seen)
        for event in events:
            self._tell(event, now_ns, why=self._causes(event, status))
        if emergency:
            modes.cut()

    def _causes(self, event: Event, status: VehicleStatus) -> list[str] | None:
        """Why an event came about, in plain words, for the recording."""
        if event is Event.SOURCE_MISSING:
            return [*self._missing, *(status.why if status.refuses else [])]
        if event is Event.ROUTE_OFF:
            return [text for text in status.why if text in ARRIVED]
        if event not in _WITH_REASONS:
            return None
        lost = self.processes.warnings if event is Event.HEALTH_STOP and self.processes.lost else []
        late = ["the control loop is late: the computer is too busy"] if self._late.too_many else []
        return [*lost, *late, *(causes_of(event, status.why) if not late else [])]

    def _tell_slow(self, now_ns: int) -> None:
        """Record changes of the reasons for which the vehicle drives slowly, or its operator must."""
        process = ["the map of worked ground is not being updated"] if self.processes.slowly else []
        limited = self.modes.engage & (PEDALS if self.kind.speed_control else STEERING) and not self.modes.stopping
        slow = [*process, *self.kind.slow()] if limited else []
        if slow != self._slow:
            self._slow = slow
            self._event(now_ns, {"slow": slow})

    def _wish(self) -> Wish:
        modes = self.modes
        return Wish(
            bool(modes.engage & STEERING),
            bool(modes.engage & PEDALS),
            modes.stopping,
            self.processes.slowly,
            modes.set_speed_mps,
        )

    def _command(self, now_ns: int) -> None:
        if not self._box_unheard:
            self._port_out(Source.DRIVE_BY_WIRE, self._framed(self.kind.command(self.modes.engage), now_ns), now_ns)
        if self._tick % _STATE_TICKS == 0:
            light = {"light": int(self.modes.lit)}
            frame = self._controller.frame(
                "controller_light", light, mode=int(self.modes.mode), mono_ns=now_ns, ttl_ms=_LIGHT_TTL_MS
            )
            self._port_out(Source.CONTROLLER, frame, now_ns)

    def _show(self, now_ns: int) -> None:
        modes = self.modes
        state_json = {
            **self.kind.state(self._tick),
            "tick": self._tick,
            "time_s": now_ns / 1e9,
            "mode": modes.mode.name,
            "lit": modes.lit,
            "mode_since_s": now_ns / 1e9 - modes.since_s,
            "warnings": [*self.kind.warnings(), *self.processes.warnings, *self._monitor.get("warnings", [])],
            "refusal": inhibit_of(modes.state).name,
            "refusal_text": self._inhibit_text(),
            "faults": [str(fault.name).lower() for fault in modes.state.faults],
            "cause": self._cause if modes.mode in _TOLD else "",
            "slow": self._slow,
            "checks": [
                {"check": item.check.name, "good": item.good, "why": item.reason} for item in self._checks.items
            ],
            "set_speed_mps": modes.set_speed_mps if modes.engage & PEDALS else None,
            "override": modes.state.override_pressed,
            "estop": modes.state.estop_pressed,
            "processes": {name: "ready" if alive else "dead" for name, alive in self.processes.alive.items()},
            "monitor": self._monitor,
            "recording": {"lost": self.unrecorded},
            "progress": self._progress,
        }
        self._out.append(Record(RecordKind.STATE, Source.CONTROL, self._tick, now_ns, finite_json(state_json)))

    def _inhibit_text(self) -> str:
        """Why nothing is engaged: the present inhibit, else why the last press had no effect."""
        state = self.modes.state
        stands = inhibit_of(state)
        return self._refusal(stands if stands is not EngagementInhibit.NONE else state.inhibit)

    def _refusal(self, inhibit: EngagementInhibit) -> str:
        """An inhibit in plain words, with what is behind it now."""
        own = self.kind.inhibit_text() if inhibit in OF_NAVIGATION else ""
        if own:
            return own
        behind: list[str] = []
        if inhibit is EngagementInhibit.SOURCE_MISSING:
            behind = self._missing or self._why
        elif inhibit is EngagementInhibit.HEALTH:
            behind = self._why
        elif inhibit is EngagementInhibit.CHECKS:
            behind = [item.reason for item in self._checks.items if not item.good]
        elif inhibit is EngagementInhibit.NOT_READY:
            behind = [FAULTS[fault] for fault in self.modes.state.faults]
        text = REFUSALS[inhibit]
        return f"{text}: {'; '.join(behind)}" if behind else text

    def _tell(self, event: Event, now_ns: int, *, check: CheckItem | None = None, why: list[str] | None = None) -> None:
        before, check_reason = self.modes.mode, None if check is None else check.reason
        failed = Check.NONE if check is None else check.check
        happened: ModeChange | None = self.modes.tell(event, now_ns / 1e9, self.kind.lock_mps, check=failed)
        if happened is not None:
            cause = cause_words(event, check_reason or "", why or ())
            if Action.STOP_CONTROLLED.name in happened.actions:
                self._stop_cause = cause
            if self.modes.mode is not before:
                # A controlled stop ends standing, for the reason that it began for.
                stopped = event is Event.STANDING and self._stop_cause
                self._cause, self._stop_cause = (self._stop_cause if stopped else cause), ""
            if event in _PRESSES and happened.actions == (Action.WARN.name,):
                why = [self._refusal(self.modes.state.inhibit)]
            self._event(now_ns, {**happened._asdict(), **({"why": why} if why else {})})
        if event in (Event.OVERRIDE_PRESSED, Event.OVERRIDE_ASSUMED):
            self.kind.leave()

    def _event(self, now_ns: int, state_json: dict[str, Any]) -> None:
        self._out.append(Record(RecordKind.EVENT, Source.CONTROL, self._tick, now_ns, json.dumps(state_json).encode()))

    def _framed(self, frame: OutgoingFrame, now_ns: int) -> bytes:
        return self._box.frame(
            frame.name, frame.fields, mode=int(self.modes.mode), mono_ns=now_ns, ttl_ms=_COMMAND_TTL_MS
        )

    def _port_out(self, line: Source, frame: bytes, now_ns: int) -> None:
        self._out.append(Record(RecordKind.PORT_OUT, line, self._tick, now_ns, frame))
