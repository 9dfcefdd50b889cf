"""The control loop of a run that only records: it shows what arrives, and sends nothing.

Same interface as ``ControlCore``, without modes, vehicle or commands. Nothing here reads a clock.
"""

import json
import math
from collections import deque
from collections.abc import Sequence
from typing import Any

from lgprjax.frames import LocalFrame
from lgprjax.run_records import Record, RecordKind, Source
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.cart import COVER_TICKS, CartPilot
from lgprjax.runtime.control.core import finite_json, level_event
from lgprjax.runtime.control.senses import GnssSenses, LocalAttitude, LocalPosition
from lgprjax.wire import decode

STATE_TICKS = 5
_RATE_NS = 2_000_000_000
_SILENT_NS = 1_000_000_000
_TRAIL_STEP_M, _MOST_TRAIL = 0.5, 2000
_MOVING_MPS, _NEW_SHARE = 0.3, 0.2
_LINES = {
    Source.RADAR: "radar",
    Source.GNSS: "gnss",
    Source.DRIVE_BY_WIRE: "drive_by_wire",
    Source.CONTROLLER: "controller",
}


class _LineRate:
    """Messages of a line in the last two seconds."""

    def __init__(self) -> None:
        self.count = 0
        self._times: deque[int] = deque()

    def take(self, mono_ns: int) -> None:
        self.count += 1
        self._times.append(mono_ns)

    def state(self, now_ns: int) -> dict[str, Any]:
        """State for the page: messages per second, age of the newest, total number."""
        newest_ns = self._times[-1] if self._times else None
        while self._times and now_ns - self._times[0] > _RATE_NS:
            self._times.popleft()
        age_s = math.nan if newest_ns is None else (now_ns - newest_ns) / 1e9
        if newest_ns is not None and not self._times:
            # The newest is kept, because its age is shown.
            self._times.append(newest_ns)
        fresh = sum(1 for time_ns in self._times if now_ns - time_ns <= _RATE_NS)
        return {"rate_hz": fresh / (_RATE_NS / 1e9), "age_s": age_s, "messages": self.count}


class RecordCore:
    """State of a recording run's lines.

    Args:
        config: configuration of a run without commands; with a table ``coverage`` it is of a hand cart.
        anchor: latitude, longitude and height of the frame of a dead process.

    Attributes:
        unrecorded: number of messages dropped on their way to the recorder.

    Raises:
        InputError: the vehicle file of a cart cannot be used.
    """

    def __init__(self, config: RuntimeConfig, anchor: Sequence[float] | None = None) -> None:
        self.unrecorded = 0
        self._gnss = GnssSenses(None if anchor is None else LocalFrame(*anchor), config.sensors)
        self._cart = None if config.coverage is None else CartPilot(config)
        self._unanchored = anchor is None
        self._lines = {
            source: _LineRate() for source, name in _LINES.items() if getattr(config.ports, name) is not None
        }
        self._calibration, self._progress = config.calibration, ""
        self._processes: dict[str, str] = {}
        self._monitor: dict[str, Any] = {}
        self._radar: list[str] = []
        self._scans = 0
        self._odometer_m: float | None = None
        self._travel_m = 0.0
        self._trail: list[list[float]] = []
        self._shown = 0
        self._speed_mps = math.nan
        self._before: LocalPosition | None = None

    def warm_up(self) -> None:
        """Compile what a cart needs."""
        if self._cart is not None:
            self._cart.warm_up()

    def step(self, tick: int, now_ns: int, came: list[Record]) -> list[Record]:
        """Run a tick: records since the last one in, a state for the page at 10 Hz out, and COVER rows of a cart.

        Args:
            tick: number of the tick, from 1.
            now_ns: monotonic time, ns.
            came: messages since the last tick, in order.
        """
        out: list[tuple[RecordKind, int, bytes]] = []
        for record in came:
            if record.kind is RecordKind.REQUEST:
                told = level_event(json.loads(record.payload).get("select_level"))
                out.append((RecordKind.EVENT, now_ns, json.dumps(told).encode()))
            self._take(record)
        place, frame = self._gnss.end_tick().place, self._gnss.frame
        if place is not None:
            self._move(place)
        if self._cart is not None:
            out += self._of_cart(self._cart, tick, now_ns, place, frame)
        if tick % STATE_TICKS == 0:
            out.append((RecordKind.STATE, now_ns, finite_json(self.state(tick, now_ns))))
        return [Record(kind, Source.CONTROL, tick, at_ns, payload) for kind, at_ns, payload in out]

    def _of_cart(
        self, cart: CartPilot, tick: int, now_ns: int, place: LocalPosition | None, frame: LocalFrame | None
    ) -> list[tuple[RecordKind, int, bytes]]:
        out: list[tuple[RecordKind, int, bytes]] = []
        if place is not None:
            cart.take(place)
        if self._unanchored and frame is not None:
            self._unanchored = False
            anchor = {"anchor": [frame.latitude_deg, frame.longitude_deg, frame.height_m]}
            out.append((RecordKind.EVENT, now_ns, json.dumps(anchor).encode()))
        row = cart.step(now_ns) if tick % COVER_TICKS == 0 else None
        return [*out, (RecordKind.COVER, *row)] if row is not None else out

    def state(self, tick: int, now_ns: int) -> dict[str, Any]:
        """State for the page and the terminal."""
        place, attitude = self._gnss.place, self._gnss.attitude
        lines = {_LINES[source]: rate.state(now_ns) for source, rate in self._lines.items()}
        recorder = self._processes.get("recorder")
        mode = "BOOT" if recorder is None else "RECORD" if recorder == "ready" else "RECORD_LOST"
        state: dict[str, Any] = {
            "tick": tick,
            "time_s": now_ns / 1e9,
            "mode": mode,
            "lines": lines,
            "scans": self._scans,
            "travel_m": self._travel_m,
            "odometer": self._odometer_m is not None,
            "speed_mps": self._speed_mps,
            "quality": None if place is None else place.quality.name,
            "sigma_m": math.nan if place is None else place.reported_m,
            "pose": self._pose(place, attitude),
            "heading": attitude is not None,
            "warnings": [*self._warnings(lines), *self._radar, *self._monitor.get("warnings", [])],
            "processes": self._processes,
            "monitor": self._monitor,
            "recording": {"lost": self.unrecorded},
        }
        if self._calibration is not None:
            state |= {"manoeuvre": self._calibration.step, "prompt": self._calibration.prompt}
            state["progress"] = self._progress
        if self._cart is not None:
            state |= self._cart.state(now_ns)
        if len(self._trail) != self._shown or tick % 100 == 0:
            self._shown = len(self._trail)
            state["path"] = self._trail
        return state

    def release(self, now_ns: int) -> None:
        """No effect, because nothing was commanded."""
        del now_ns

    @property
    def frame(self) -> LocalFrame | None:
        """Frame of the trail; ``None`` before the first position."""
        return self._gnss.frame

    def _take(self, record: Record) -> None:
        if record.kind is RecordKind.PORT_IN:
            if record.source in self._lines:
                self._lines[record.source].take(record.mono_ns)
            if record.source is Source.GNSS:
                self._gnss.take(record)
            elif record.source is Source.DRIVE_BY_WIRE:
                self._take_odometer(record.payload)
        elif record.kind is RecordKind.EVENT:
            self._take_note(json.loads(record.payload), record.mono_ns)
        elif record.kind is RecordKind.MONITOR:
            self._monitor = json.loads(record.payload)

    def _take_note(self, note: dict[str, Any], mono_ns: int) -> None:
        """A note of the supervisor on a process, or of the registration process on the radar."""
        self._progress = str(note.get("progress", self._progress))
        if "scans" in note:
            rate = self._lines.get(Source.RADAR)
            for _ in range(int(note["scans"]) if rate is not None else 0):
                assert rate is not None
                rate.take(mono_ns)
            self._scans += int(note["scans"])
        elif "radar" in note:
            self._radar = [str(text) for text in note["radar"]]
        for stage, word in (("ready", "ready"), ("died", "dead"), ("left", "dead")):
            if stage in note:
                self._processes[str(note[stage])] = word

    def _take_odometer(self, raw: bytes) -> None:
        frame = decode(raw)
        if "odometer_m" not in frame.fields:
            return
        now_m = float(frame.number("odometer_m"))
        if not math.isfinite(now_m):
            return
        # A box that started again counts from zero.
        step_m = 0.0 if self._odometer_m is None else now_m - self._odometer_m
        self._odometer_m = now_m
        if abs(step_m) < 1.0:
            self._travel_m += abs(step_m)

    def _move(self, place: LocalPosition) -> None:
        """Trail, speed and, without an odometer, travel."""
        before, self._before = self._before, place
        if before is not None and place.time_ns > before.time_ns:
            step_m = math.hypot(place.x_m - before.x_m, place.y_m - before.y_m)
            mps = step_m / ((place.time_ns - before.time_ns) / 1e9)
            # Centimetres of noise between positions a tenth of a second apart: the mean over about a second.
            known_mps = self._speed_mps if math.isfinite(self._speed_mps) else mps
            self._speed_mps = known_mps + _NEW_SHARE * (mps - known_mps)
            if self._odometer_m is None and self._speed_mps > _MOVING_MPS:
                self._travel_m += step_m
        last = self._trail[-1] if self._trail else None
        if last is None or math.hypot(place.x_m - last[0], place.y_m - last[1]) >= _TRAIL_STEP_M:
            self._trail.append([place.x_m, place.y_m])
            if len(self._trail) > _MOST_TRAIL:
                self._trail = self._trail[::2]

    def _pose(self, place: LocalPosition | None, attitude: LocalAttitude | None) -> list[float] | None:
        if place is None:
            return None
        yaw = math.nan
        if attitude is not None:
            yaw = attitude.yaw_rad
        elif len(self._trail) > 1:
            (x0, y0), (x1, y1) = self._trail[-2:]
            yaw = math.atan2(y1 - y0, x1 - x0)
        return [place.x_m, place.y_m, yaw if math.isfinite(yaw) else 0.0]

    def _warnings(self, lines: dict[str, dict[str, Any]]) -> list[str]:
        words = []
        for name, line in lines.items():
            if not line["messages"]:
                words.append(f"{name}: nothing received yet")
            elif line["age_s"] > _SILENT_NS / 1e9:
                words.append(f"{name}: silent for {line['age_s']:.0f} s")
        return words
