"""A recorded run as a time line in plain words: what happened, when, and why."""

import json
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from lgprjax.autopilot import Event, Mode
from lgprjax.formats import read_run
from lgprjax.run_records import PLAN, SKID_PLAN, Record, RecordKind, Source, unpack
from lgprjax.runtime.words import ARRIVED, EVENTS, cause_words

ENGAGED = (Mode.STEERING.name, Mode.SPEED.name)
_PRESSES = (Event.STEERING_BUTTON.name, Event.CRUISE_PLUS.name, Event.CRUISE_MINUS.name)
_SHOWN = {
    Event.CHECKS_PASSED.name,
    Event.SOURCE_MISSING.name,
    Event.REGISTRATION_DIED.name,
    Event.ERROR_CLEARED.name,
    Event.DRIVE_BY_WIRE_RELAUNCHED.name,
}
"""Events that are shown although they change no mode."""
_SLOWLY, _FREE = "speed limited: ", "speed no longer limited"


class TimelineEntry(NamedTuple):
    """An event of a run.

    Attributes:
        time_s: time since the first record of the run.
        kind: process, mode, error, check, refused, slow, stop, radar, route, arrived, or note.
        text: description with its cause.
        mode: mode of the autopilot from then on; empty before the first.
    """

    time_s: float
    kind: str
    text: str
    mode: str


class Timeline(NamedTuple):
    """A run's course.

    Attributes:
        entries: events in their order.
        seconds: time from the first to the last record.
        engaged: whether the autopilot drove at any time.
        arrived: whether it drove to the end of its route or plan.
        to_go_m: distance to that end at the last tick under autopilot; NaN if it never drove.
        end: reason of the recording's end; ``None`` if it was interrupted.
        only_recorded: whether the run was of mode record, without driving.
    """

    entries: tuple[TimelineEntry, ...]
    seconds: float
    engaged: bool
    arrived: bool
    to_go_m: float
    end: str | None
    only_recorded: bool = False

    @property
    def shortfall(self) -> str:
        """Reason why the autopilot did not engage and arrive, in one line; empty if it did."""
        if self.arrived or self.only_recorded:
            return ""
        last = next((each.text for each in reversed(self.entries) if each.kind in ("error", "stop", "check")), "")
        if not self.engaged:
            refused = next((each.text for each in reversed(self.entries) if each.kind == "refused"), "")
            return f"never engaged: {last or refused or 'the steering button was not pressed while READY'}"
        left = f"{self.to_go_m:.0f} m were left"
        taken = next((each for each in reversed(self.entries) if each.kind in ("error", "mode", "stop")), None)
        if taken is not None and taken.mode not in ENGAGED:
            return f"{left}: {taken.text}"
        slow = next((each.text for each in reversed(self.entries) if each.kind == "slow" and each.text != _FREE), "")
        return f"{left} when the time ran out" + (f"; last slowed: {slow.removeprefix(_SLOWLY)}" if slow else "")


def read_timeline(folder: str | Path) -> Timeline:
    """The time line of a recorded run.

    Args:
        folder: folder of the run.

    Raises:
        InputError: the folder holds no run.
    """
    run = read_run(folder)
    found = timeline_of(unpack(data) for _, data in run)
    return found._replace(end=run.summary.end)


def timeline_of(records: Iterable[Record]) -> Timeline:
    """The time line of records in the order of their arrival."""
    reader = _Reader()
    entries: list[TimelineEntry] = []
    for record in records:
        entries += reader.take(record)
    seconds = (reader.last_ns - reader.first_ns) / 1e9
    return Timeline(
        entries=tuple(entries),
        seconds=seconds,
        engaged=reader.engaged,
        arrived=reader.arrived,
        to_go_m=reader.to_go_m,
        end=None,
        only_recorded=reader.only_recorded,
    )


class _Reader:
    """State from record to record."""

    def __init__(self) -> None:
        self.first_ns = self.last_ns = 0
        self.engaged = self.arrived = self.only_recorded = False
        self.to_go_m = float("nan")
        self._mode = ""
        self._stopped_for = ""
        self._slow: tuple[str, ...] = ()
        self._radar: tuple[str, ...] = ()

    def take(self, record: Record) -> Iterator[TimelineEntry]:
        """Events of a record."""
        # Messages of other processes were made before the tick that they are recorded in.
        if not self.first_ns:
            self.first_ns = record.mono_ns
        self.last_ns = max(self.last_ns, record.mono_ns)
        if record.kind in (RecordKind.PLAN, RecordKind.SKID_PLAN):
            layout = PLAN if record.kind is RecordKind.PLAN else SKID_PLAN
            row = np.frombuffer(record.payload, layout)[0]
            if Mode(int(row["mode"])).name in ENGAGED and np.isfinite(row["to_go_m"]):
                self.to_go_m = float(row["to_go_m"])
        elif record.kind is RecordKind.HEADER:
            self.only_recorded |= json.loads(record.payload).get("mode") == "record"
        elif record.kind is RecordKind.EVENT:
            time_s = (record.mono_ns - self.first_ns) / 1e9
            for kind, text in self._words(record, json.loads(record.payload)):
                yield TimelineEntry(time_s, kind, text, self._mode)

    def _words(self, record: Record, told: dict[str, Any]) -> Iterator[tuple[str, str]]:
        if record.source is Source.SUPERVISOR:
            # The copy that the control loop took is left out.
            if record.tick == 0:
                yield from _process_words(told)
        elif record.source is Source.REGISTRATION:
            if "radar" in told and record.tick == 0 and tuple(told["radar"]) != self._radar:
                self._radar = tuple(told["radar"])
                yield "radar", "; ".join(self._radar) or "radar: no faults any more"
        elif "event" in told:
            yield from self._event_words(told)
        elif "slow" in told:
            slow = tuple(str(text) for text in told["slow"])
            if slow != self._slow:
                self._slow = slow
                yield "slow", f"{_SLOWLY}{'; '.join(slow)}" if slow else _FREE
        elif "check" in told:
            yield "check", f"system check {str(told['check']).lower().replace('_', ' ')}: {told['why']}"
        elif "refused" in told:
            yield "refused", f"{told['refused']} refused: {told['why']}"
        elif "route" in told:
            yield "route", f"route {told['route']} chosen{', at ' + told['place'] if 'place' in told else ''}"
        elif told.keys() == {"place"}:
            yield "route", f"on the route at {told['place']}, one of several places"
        elif "level" in told:
            yield "note", f"confidence of {100.0 * told['level']:g} % chosen"
        elif "corner" in told:
            yield "note", f"corner {told['corner']} marked"
        elif "compiled" in told:
            yield "note", f"a program was compiled while driving: {told['compiled']} in all"

    def _event_words(self, told: dict[str, Any]) -> Iterator[tuple[str, str]]:
        event, mode, why = str(told["event"]), str(told["mode"]), [str(text) for text in told.get("why", [])]
        actions = told.get("actions", [])
        known = Event.__members__.get(event)
        text = event.lower() if known is None else cause_words(known, "", why)
        before, self._mode = self._mode, mode
        if any(each in ARRIVED for each in why) and (mode in ENGAGED or before in ENGAGED):
            self.arrived = True
            yield "arrived", next(each for each in why if each in ARRIVED)
        if "STOP_CONTROLLED" in actions:
            self._stopped_for = text
            yield "stop", f"controlled stop: {text}"
        elif event in _PRESSES and list(actions) == ["WARN"]:
            yield "refused", f"{EVENTS[Event[event]]}, refused: {'; '.join(why) or 'no reason recorded'}"
        if mode != before:
            stopped = event == Event.STANDING.name and self._stopped_for
            self.engaged |= mode in ENGAGED
            kind = "error" if mode in (Mode.ERROR.name, Mode.EMERGENCY_STOP.name) else "mode"
            yield kind, f"{mode}: {f'stopped, {self._stopped_for}' if stopped else text}"
            self._stopped_for = "" if mode not in ENGAGED else self._stopped_for
        elif event in _SHOWN and not (event == Event.SOURCE_MISSING.name and mode in ENGAGED):
            # The condition for engaging is irrelevant while engaged: a missing source slows the vehicle, which is
            # shown.
            yield "note", text


def _process_words(told: dict[str, Any]) -> Iterator[tuple[str, str]]:
    for what, words in (("ready", "is ready"), ("died", "died"), ("left", "is not started again")):
        if what in told:
            why = f": {told['why']}" if told.get("why") else ""
            yield "process", f"{told[what]} {words}{why}"
