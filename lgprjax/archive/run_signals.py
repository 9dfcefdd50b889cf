"""What a recorded run holds beside its scans, on the computer's clock."""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int, Integer

from lgprjax.formats.run_frames import frame_name, frame_type, header_type, payload_type, read_run_record
from lgprjax.formats.run_log import RunReading

# A line's delay is least once in so long; clocks drift far less than it varies meanwhile.
_WINDOW_NS = 10_000_000_000


class RunSignals(NamedTuple):
    """A run but for its samples. Times are monotonic, ns, and strictly rising.

    Attributes:
        scan_ns: of each scan in the order of the recording, whether kept or not.
        scan_kept: whether its time rises and it is as ``radar`` says.
        radar: ``radar_description``, ``None`` where the radar never told.
        box_ns, box: ``drive_status`` frames.
        travel_m: by the box, one distance over all its starts.
        prior_ns, prior: valid ``prior`` payloads.
        plan_ns, plan: ``plan`` payloads.
    """

    scan_ns: Int[np.ndarray, " scan"]
    scan_kept: Bool[np.ndarray, " scan"]
    radar: np.void | None
    box_ns: Int[np.ndarray, " box"]
    box: np.ndarray
    travel_m: Float[np.ndarray, " box"]
    prior_ns: Int[np.ndarray, " prior"]
    prior: np.ndarray
    plan_ns: Int[np.ndarray, " plan"]
    plan: np.ndarray


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


def signals_of_run(run: RunReading) -> RunSignals:
    """Gather everything but the samples: some hundred bytes a hundredth of a second."""
    scans, box = RowGatherer(frame_type("radar_scan")), RowGatherer(frame_type("drive_status"))
    prior, plan, radar = (
        RowGatherer(payload_type("prior")),
        RowGatherer(payload_type("plan")),
        RowGatherer(frame_type("radar_description")),
    )
    by_message = {"radar_scan": scans, "drive_status": box, "radar_description": radar}
    for _, data in run:
        record = read_run_record(data)
        if record is None:
            continue
        if record.kind == "port_in" and record.source in ("radar", "drive_by_wire"):
            rows = by_message.get(frame_name(record.payload) or "")
        else:
            rows = {"prior": prior, "plan": plan}.get(record.kind)
        if rows is not None:
            rows.add(record.mono_ns, record.payload)
    told = radar.rows[0] if len(radar.rows) else None
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
        scan_kept=rising(scan_ns, _as_told(scans.rows, told)),
        radar=told,
        box_ns=box_ns[box_good],
        box=box.rows[box_good],
        travel_m=travel_m[box_good],
        prior_ns=prior.rows["time_ns"][prior_good].astype(np.int64),
        prior=prior.rows[prior_good],
        plan_ns=plan.times_ns[plan_good],
        plan=plan.rows[plan_good],
    )


def scan_frames(run: RunReading) -> Iterator[bytes]:
    """Frames of the scans, in the order of ``RunSignals.scan_ns``."""
    for _, data in run:
        record = read_run_record(data)
        if record is None or (record.kind, record.source) != ("port_in", "radar"):
            continue
        if frame_name(record.payload) == "radar_scan":
            yield record.payload


def device_times(
    session: Integer[np.ndarray, " frame"],
    stamp_us: Integer[np.ndarray, " frame"],
    arrival_ns: Int[np.ndarray, " frame"],
) -> Int[np.ndarray, " frame"]:
    """Monotonic times of a device's stamps: behind their arrival by what a line held them up.

    The least difference between arrival and stamp within ten seconds is taken for the clocks' own; between such
    stretches it goes straight. What a line's fastest message takes cannot be told and remains.
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
        # About the first difference: a clock's own is too large for float64 to the nanosecond.
        base = apart[least[0]]
        clocks = base + np.interp(stamp_ns - stamp_ns[0], stamp_ns[least] - stamp_ns[0], apart[least] - base).astype(
            np.int64
        )
        times[own] = stamp_ns + np.minimum(clocks, apart)
    return times


def rising(times_ns: Int[np.ndarray, " row"], good: Bool[np.ndarray, " row"]) -> Bool[np.ndarray, " row"]:
    """The good rows whose time is after that of every good one before."""
    kept = np.zeros(len(times_ns), bool)
    chosen = np.flatnonzero(good)
    times = times_ns[chosen]
    kept[chosen[np.diff(np.maximum.accumulate(times), prepend=np.int64(-(2**62))) > 0]] = True
    return kept


def _as_told(scans: np.ndarray, radar: np.void | None) -> Bool[np.ndarray, " scan"]:
    if radar is None:
        return np.zeros(len(scans), bool)
    samples = scans["channels"].astype(np.int64) * scans["samples"]
    whole = scans["length"] == samples + frame_type("radar_scan").itemsize - header_type().itemsize
    return np.asarray((scans["channels"] == radar["channels"]) & (scans["samples"] == radar["samples"]) & whole)


def _joined(session: Integer[np.ndarray, " box"], odometer_m: Float[np.ndarray, " box"]) -> Float[np.ndarray, " box"]:
    """One distance over all starts of the box, which begins each at zero; NaN where it is none."""
    known = np.flatnonzero(np.isfinite(odometer_m))
    steps = np.diff(odometer_m[known], prepend=0.0)
    begins = np.flatnonzero(np.diff(session[known].astype(np.int64))) + 1
    # Between two starts nobody counted.
    steps[begins] = odometer_m[known[begins]]
    travel_m = np.full(len(odometer_m), np.nan)
    travel_m[known] = np.cumsum(steps)
    return travel_m
