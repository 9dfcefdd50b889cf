"""The contents of a recorded run except its scans, on the computer's clock."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from lgprjax.formats.run_log import RunReading, frame_name, frame_type, read_run_record
from lgprjax.run_records import FIX, SEARCHED, RecordKind, Source, fix_row, payload_type
from lgprjax.wire import Frame, decode

# Within this time a line reaches its least delay once; clocks drift far less than the delay varies.
_WINDOW_NS = 10_000_000_000


class RunSignals(NamedTuple):
    """A run without its samples. Times are monotonic, ns, and strictly rising.

    Attributes:
        scan_ns: time of each scan in the order of the recording, whether kept or not.
        scan_kept: whether its time rises, its shape is as in ``radar``, and the radar had not sent another description
            or look-up since.
        radar: ``radar_description`` or ``radar_sweep_description`` at the first scan, ``None`` if the radar never sent
            one.
        lookup: ``radar_lookup`` of a stepped-frequency radar at the first scan, ``None`` if it never sent one.
        box_ns, box: ``drive_status`` frames.
        pedals: throttle and brake of the box's command at each frame, found by its number; NaN if the command is not in
            the recording.
        travel_m: distance by the box, continued over its restarts.
        prior_ns, prior: valid ``prior`` payloads.
        plan_ns, plan: ``plan`` payloads.
        searched, searched_scan: ``searched`` payloads, and the number of each one's scan in the recording.
        found: ``fix`` payload of each.
    """

    scan_ns: Int[np.ndarray, " scan"]
    scan_kept: Bool[np.ndarray, " scan"]
    radar: np.void | None
    lookup: Frame | None
    box_ns: Int[np.ndarray, " box"]
    box: np.ndarray
    pedals: Float[np.ndarray, "box 2"]
    travel_m: Float[np.ndarray, " box"]
    prior_ns: Int[np.ndarray, " prior"]
    prior: np.ndarray
    plan_ns: Int[np.ndarray, " plan"]
    plan: np.ndarray
    searched: np.ndarray
    searched_scan: Int[np.ndarray, " searched"]
    found: np.ndarray


class RowGatherer:
    """Rows of one type and their times, gathered as bytes."""

    def __init__(self, kind: np.dtype[Any]) -> None:
        self._kind = kind
        self._rows, self._times = bytearray(), bytearray()

    def add(self, mono_ns: int, row: bytes) -> None:
        if len(row) >= self._kind.itemsize:
            self._rows += row[: self._kind.itemsize]
            self._times += mono_ns.to_bytes(8, "little")

    @property
    def rows(self) -> np.ndarray:
        return np.frombuffer(bytes(self._rows), self._kind)

    @property
    def times_ns(self) -> Int[np.ndarray, " row"]:
        return np.frombuffer(bytes(self._times), "<i8").astype(np.int64)


def signals_of_run(run: RunReading, *, own_lookup: bool = True) -> RunSignals:
    """Gather everything except the samples: some hundred bytes every hundredth of a second.

    Args:
        run: the run.
        own_lookup: whether scans of sweeps need the look-up that the radar sent; false where a calibration replaces it.
    """
    described = _SCANS if own_lookup else {name: told[:1] for name, told in _SCANS.items()}
    by_message = {name: RowGatherer(frame_type(name)) for name in ("radar_scan", "radar_sweep", "drive_status")}
    box, prior, plan = by_message["drive_status"], RowGatherer(payload_type("prior")), RowGatherer(payload_type("plan"))
    searches, said, taken = _Searches(), _Said(described), _TakenCommands()
    for _, data in run:
        record = read_run_record(data)
        if record is None:
            continue
        if record.kind is RecordKind.PORT_IN and record.source in (Source.RADAR, Source.DRIVE_BY_WIRE):
            name = frame_name(record.payload)
            rows = by_message.get(name or "")
            if name in ("radar_scan", "radar_sweep"):
                searches.scan(record.payload, name)
                said.scan(name)
            elif name == "drive_status":
                taken.status(record.payload)
            elif name in _TOLD:
                said.tell(name, decode(record.payload))
        elif record.kind is RecordKind.PORT_OUT and record.source is Source.DRIVE_BY_WIRE:
            rows = None
            if frame_name(record.payload) == "drive_command":
                taken.command(record.payload)
        elif record.source is Source.REGISTRATION and record.tick == 0:
            rows = None
            searches.take(record.kind, record.payload)
        else:
            rows = {RecordKind.PRIOR: prior, RecordKind.PLAN: plan}.get(record.kind)
        if rows is not None:
            rows.add(record.mono_ns, record.payload)
    form = "radar_scan" if said.first("radar_sweep_description") is None else "radar_sweep"
    scans, first = by_message[form], [frame for each in described[form] if (frame := said.first(each)) is not None]
    whole = len(first) == len(described[form])
    told = np.frombuffer(first[0].raw, frame_type(first[0].name), 1)[0] if whole else None
    scan_ns = device_times(scans.rows["session"], scans.rows["stamp_us"], scans.times_ns)
    box_ns = device_times(box.rows["session"], box.rows["stamp_us"], box.times_ns)
    travel_m = _joined(box.rows["session"], box.rows["odometer_m"])
    box_good = rising(box_ns, np.isfinite(travel_m))
    fixed = (prior.rows["valid"] != 0) & np.isfinite(prior.rows["pose"]).all(axis=1)
    for name in ("roll_rad", "sigma_yaw_rad", "yaw_rate_radps"):
        fixed &= np.isfinite(prior.rows[name])
    prior_good = rising(prior.rows["time_ns"], fixed)
    plan_good = rising(plan.times_ns, np.ones(len(plan.rows), bool))
    return RunSignals(
        scan_ns=scan_ns,
        scan_kept=rising(scan_ns, _as_told(scans.rows, told) & said.as_at_first(form)),
        radar=told,
        lookup=said.first("radar_lookup"),
        box_ns=box_ns[box_good],
        box=box.rows[box_good],
        pedals=np.array(taken.pedals, np.float64).reshape(-1, 2)[box_good],
        travel_m=travel_m[box_good],
        prior_ns=prior.rows["time_ns"][prior_good].astype(np.int64),
        prior=prior.rows[prior_good],
        plan_ns=plan.times_ns[plan_good],
        plan=plan.rows[plan_good],
        searched=np.frombuffer(b"".join(searches.given), SEARCHED),
        searched_scan=np.array(searches.scans, np.int64),
        found=np.array(searches.found, FIX),
    )


class _Searches:
    """Scans that were searched on board: the newest of its number in the recording is the one that was."""

    def __init__(self) -> None:
        self._newest: dict[int, int] = {}
        self._count = 0
        self.given: list[bytes] = []
        self.scans: list[int] = []
        self.found: list[np.void] = []

    def scan(self, frame: bytes, name: str) -> None:
        """A scan of the recording."""
        self._newest[int(np.frombuffer(frame, frame_type(name), 1)[0]["scan"])] = self._count
        self._count += 1

    def take(self, kind: RecordKind, payload: bytes) -> None:
        """A record of the registration; a fix follows what its search was given."""
        if kind is RecordKind.SEARCHED and len(payload) == SEARCHED.itemsize:
            self._held = np.frombuffer(payload, SEARCHED)[0]
        elif kind is RecordKind.FIX and self._held is not None:
            fix, at = fix_row(payload), self._newest.get(int(self._held["scan"]))
            if at is not None and int(fix["scan_ns"]) == int(self._held["scan_ns"]):
                self.given.append(self._held.tobytes())
                self.scans.append(at)
                self.found.append(fix)
            self._held = None

    _held: np.void | None = None


class _TakenCommands:
    """Pedals of the command that the box had taken when it sent a status: what the box says of itself, so that the
    delay of the line is not in the time at which a command acts.
    """

    def __init__(self) -> None:
        self._sent: dict[int, tuple[float, float]] = {}
        self.pedals: list[tuple[float, float]] = []

    def command(self, frame: bytes) -> None:
        """A command to the box; a number that comes again is that of a control process which was started anew."""
        sent = np.frombuffer(frame, _COMMAND, 1)[0]
        number = int(sent["sequence"])
        self._sent.pop(number, None)
        self._sent[number] = (float(sent["throttle"]), float(sent["brake"]))
        if len(self._sent) > _MOST_SENT:
            del self._sent[next(iter(self._sent))]

    def status(self, frame: bytes) -> None:
        """A status of the box."""
        taken = int(np.frombuffer(frame, _STATUS, 1)[0]["command_sequence"])
        self.pedals.append(self._sent.get(taken, (np.nan, np.nan)))


_COMMAND, _STATUS = frame_type("drive_command"), frame_type("drive_status")
_MOST_SENT = 64
"""Commands of about a second: the box takes none that is older."""


def scan_frames(run: RunReading, name: str = "radar_scan") -> Iterator[bytes]:
    """Frames of the scans, of the message ``name``, in the order of ``RunSignals.scan_ns``."""
    for _, data in run:
        record = read_run_record(data)
        if record is None or (record.kind, record.source) != (RecordKind.PORT_IN, Source.RADAR):
            continue
        if frame_name(record.payload) == name:
            yield record.payload


_SCANS = {"radar_scan": ("radar_description",), "radar_sweep": ("radar_sweep_description", "radar_lookup")}
"""Messages that describe a radar's scans, by the message of the scans."""
_TOLD = frozenset(name for told in _SCANS.values() for name in told)


class _Said:
    """The radar's descriptions of its scans, and the scans that agree with the description of the first one.

    A drive log has one description for all of its scans. A radar restarted with other settings, or with a new look-up,
    sends them before it continues; repeated identical descriptions change nothing.

    Args:
        described: messages that describe the scans, by the message of the scans.
    """

    def __init__(self, described: dict[str, tuple[str, ...]]) -> None:
        self._described = described
        self._first: dict[str, Frame] = {}
        self._now: dict[str, Frame] = {}
        self._settled: set[str] = set()
        self._as_at_first: dict[str, list[bool]] = {name: [] for name in _SCANS}

    def tell(self, name: str, frame: Frame) -> None:
        """A description, or a look-up; the newest before the first scan counts."""
        self._now[name] = frame
        if name not in self._settled:
            self._first[name] = frame

    def scan(self, name: str) -> None:
        """Add a scan; scans before the first description use that description."""
        told = [each for each in self._described[name] if each in self._now]
        self._settled.update(told)
        self._as_at_first[name].append(all(self._now[each].fields == self._first[each].fields for each in told))

    def first(self, name: str) -> Frame | None:
        """A message's description at the first scan; ``None`` if there is none."""
        return self._first.get(name)

    def as_at_first(self, name: str) -> Bool[np.ndarray, " scan"]:
        """Mask of a message's scans that agree with the description at the first scan."""
        return np.array(self._as_at_first[name], bool)


def device_times(
    session: Integer[np.ndarray, " frame"],
    stamp_us: Integer[np.ndarray, " frame"],
    arrival_ns: Int[np.ndarray, " frame"],
) -> Int[np.ndarray, " frame"]:
    """Monotonic times of a device's stamps: arrival minus the delay of the line.

    The least difference between arrival and stamp within ten seconds is taken as the offset of the clocks, interpolated
    linearly between such stretches. The delay of the fastest message cannot be observed and remains.
    """
    times = np.array(arrival_ns, np.int64)
    for each in np.unique(session):
        own = np.flatnonzero(session == each)
        stamp_ns = stamp_us[own].astype(np.int64) * 1000
        apart = arrival_ns[own] - stamp_ns
        window = (arrival_ns[own] - arrival_ns[own[0]]) // _WINDOW_NS
        order = np.lexsort((apart, window))
        least = order[np.unique(window[order], return_index=True)[1]]
        least = least[np.argsort(stamp_ns[least])]
        # Relative to the first difference: the offset of a clock is too large for float64 to the nanosecond.
        base = apart[least[0]]
        clocks = base + np.interp(stamp_ns - stamp_ns[0], stamp_ns[least] - stamp_ns[0], apart[least] - base).astype(
            np.int64
        )
        times[own] = stamp_ns + np.minimum(clocks, apart)
    return times


def rising(times_ns: Int[np.ndarray, " row"], good: Bool[np.ndarray, " row"]) -> Bool[np.ndarray, " row"]:
    """The good rows whose time is after that of all previous good rows."""
    kept = np.zeros(len(times_ns), bool)
    chosen = np.flatnonzero(good)
    times = times_ns[chosen]
    kept[chosen[np.diff(np.maximum.accumulate(times), prepend=np.int64(-(2**62))) > 0]] = True
    return kept


def _as_told(scans: np.ndarray, radar: np.void | None) -> Bool[np.ndarray, " scan"]:
    if radar is None:
        return np.zeros(len(scans), bool)
    assert scans.dtype.names is not None
    if "rows" in scans.dtype.names:
        return np.asarray((scans["rows"] == radar["channels"] + 1) & (scans["steps"] == radar["steps"]))
    return np.asarray((scans["channels"] == radar["channels"]) & (scans["samples"] == radar["samples"]))


def _joined(session: Integer[np.ndarray, " box"], odometer_m: Float[np.ndarray, " box"]) -> Float[np.ndarray, " box"]:
    """One distance over all starts of the box, each of which begins at zero; NaN where it is invalid."""
    known = np.flatnonzero(np.isfinite(odometer_m))
    steps = np.diff(odometer_m[known], prepend=0.0)
    begins = np.flatnonzero(np.diff(session[known].astype(np.int64))) + 1
    # Travel between two starts is unknown.
    steps[begins] = odometer_m[known[begins]]
    travel_m = np.full(len(odometer_m), np.nan)
    travel_m[known] = np.cumsum(steps)
    return travel_m
