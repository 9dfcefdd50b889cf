"""The radar's line: what the radar is told before it scans, that it scans, and what it reports of itself."""

import json
import time
from typing import Any

from lgprjax.runtime.config import RadarTable
from lgprjax.runtime.link import Sender, draw_session
from lgprjax.runtime.port import Arrival, Port
from lgprjax.runtime.records import Kind, Record, Source, pack
from lgprjax.runtime.ring import Ring
from lgprjax.runtime.wire import Frame

_ASK_S, _TELL_S = 1.0, 1.0
_STOP, _START, _CALIBRATE, _LOOK_UP = range(4)
_IDLE, _SCANNING, _CALIBRATING, _LOOKING_UP, _FAILED = range(5)
ERRORS = {
    1: "radar: a channel is lost",
    2: "radar: too hot",
    4: "radar: its clock",
    8: "radar: switch matrix",
    16: "radar: calibration out of range",
}
"""Bits of ``radar_health.errors`` in words."""


class RadarLine:
    """The port and the radar's orders.

    A radar that scans already, as after a relaunch of this process, has been told what it is to be told.

    Args:
        port: of the line.
        table: of the configuration.
        log: ring to the recorder; control: ring to the control process.
    """

    def __init__(self, port: Port[Frame], table: RadarTable, log: Ring, control: Ring) -> None:
        self._port, self._table, self._log, self._control = port, table, log, control
        self._sender = Sender(draw_session())
        self._orders = [_CALIBRATE] * table.calibrate + [_LOOK_UP] * table.look_up
        self._sweeps = table.sweep is not None
        self._state: int | None = None
        self._began = False
        self._asked_s = self._told_s = 0.0
        self._errors = 0

    @property
    def preparing(self) -> bool:
        """It is still to calibrate or to look up before it scans."""
        return bool(self._orders) and self._state != _SCANNING

    def take(self, frame: Frame) -> None:
        """A frame that came."""
        if frame.name == "radar_scan":
            self._state = _SCANNING
        elif frame.name == "radar_health":
            self._take_health(int(frame.number("state")), int(frame.number("errors")))

    def arrivals(self) -> list[Arrival[Frame]]:
        """What came; what was refused is recorded."""
        came = self._port.take()
        for refused in self._port.take_refused():
            payload = bytes([refused.item.reason]) + refused.item.data
            self._log.put(pack(Record(Kind.REFUSED, Source.RADAR, 0, refused.mono_ns, payload)))
        return came

    def order(self) -> None:
        """Tell it what is next: sweep plan, calibration, look-up, then to scan; once a second until it does."""
        now_s = time.monotonic()
        if self._state == _SCANNING or now_s - self._asked_s <= _ASK_S:
            return
        # A radar that scans already must not be told to do anything else: it is heard first.
        unheard = self._state is None and (self._orders or self._sweeps)
        if unheard or self._state in (_CALIBRATING, _LOOKING_UP):
            return
        self._asked_s = now_s
        sweep = self._table.sweep
        if self._sweeps and sweep is not None:
            self._send("radar_sweep_plan", sweep.model_dump())
        action = self._orders[0] if self._orders else _START
        self._send("radar_command", {"action": action, "scan_period_us": self._table.scan_period_us})

    def close(self) -> None:
        """Have it stop, and close the line."""
        self._send("radar_command", {"action": _STOP, "scan_period_us": 0})
        self._port.close()

    def _take_health(self, state: int, errors: int) -> None:
        doing = {_CALIBRATING: _CALIBRATE, _LOOKING_UP: _LOOK_UP}.get(state)
        if self._orders and doing == self._orders[0]:
            self._began = True
        elif self._orders and self._began and state == _IDLE:
            # What it was doing it has done.
            self._orders, self._began, self._asked_s = self._orders[1:], False, 0.0
        self._state = state
        now_s = time.monotonic()
        if errors != self._errors or (errors and now_s - self._told_s > _TELL_S):
            self._errors, self._told_s = errors, now_s
            words = [text for bit, text in ERRORS.items() if errors & bit]
            told = json.dumps({"radar": words + ["radar has failed"] * (state == _FAILED)}).encode()
            self._control.put(pack(Record(Kind.EVENT, Source.REGISTRATION, 0, time.monotonic_ns(), told)))

    def _send(self, name: str, fields: dict[str, Any]) -> None:
        now_ns = time.monotonic_ns()
        frame = self._sender.frame(name, fields, mode=0, mono_ns=now_ns)
        self._port.write(frame)
        self._log.put(pack(Record(Kind.PORT_OUT, Source.RADAR, 0, now_ns, frame)))
