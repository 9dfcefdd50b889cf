"""Replay of a recorded run through the control loop: every sent frame must be reproduced to the bit."""

import json
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any, NamedTuple

from lgprjax import __version__
from lgprjax.coverage.resume import RoutePlace
from lgprjax.errors import InputError
from lgprjax.formats import read_run
from lgprjax.run_records import Record, RecordKind, Source, unpack
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.control.core import ControlCore, load_vehicle

_TAKEN = (RecordKind.PORT_IN, RecordKind.FIX, RecordKind.EVENT, RecordKind.MONITOR, RecordKind.REQUEST)


class Replayed(NamedTuple):
    """Result of a replay.

    Attributes:
        ticks: number of replayed ticks.
        frames: number of recorded frames sent in them.
        differing: number of these frames with differences.
        first: tick and line of the first difference; ``None`` without any.
        starts: number of starts of the control process.
        broken: tick after a gap of records at which the replay of a start ended early, or ``None``.
    """

    ticks: int
    frames: int
    differing: int
    first: tuple[int, str] | None
    starts: int
    broken: int | None


class _Tick(NamedTuple):
    number: int
    mono_ns: int
    came: list[Record]
    sent: list[Record]


def replay_run(folder: Path, progress: Callable[[int], None] = lambda _: None) -> Replayed:
    """Replay the run in a folder.

    Args:
        folder: folder of the run; its files (vehicle, map, routes) must be unchanged since the run.
        progress: function called for every tick.

    Raises:
        InputError: there is no run, or no control loop in it; it is of another version, or a file has changed.
    """
    totals = [0, 0, 0]
    first: tuple[int, str] | None = None
    starts, broken = 0, None
    for header, ticks in starts_of_run(folder):
        starts += 1
        core = _core(folder, header)
        expected = 1
        for tick in ticks:
            if tick.number != expected:
                broken = tick.number if broken is None else broken
                break
            expected += 1
            out = [
                record
                for record in core.step(tick.number, tick.mono_ns, tick.came)
                if record.kind is RecordKind.PORT_OUT
            ]
            totals[0] += 1
            totals[1] += len(tick.sent)
            for number, sent in enumerate(tick.sent):
                same = number < len(out) and out[number].payload == sent.payload and out[number].source is sent.source
                if not same:
                    totals[2] += 1
                    first = (tick.number, sent.source.name) if first is None else first
            progress(1)
    if not starts:
        raise InputError(folder, "segments", "a HEADER record of the control loop", "none")
    return Replayed(totals[0], totals[1], totals[2], first, starts, broken)


def starts_of_run(folder: Path) -> Iterator[tuple[dict[str, Any], Iterator[_Tick]]]:
    """Header and complete ticks of every start of the control process."""
    records = _records(folder)
    held: list[Record] = []

    def ticks() -> Iterator[_Tick]:
        now: _Tick | None = None
        for record in records:
            if record.kind is RecordKind.HEADER:
                held.append(record)
                break
            if record.kind is RecordKind.TICK:
                if now is not None:
                    yield now
                now = _Tick(record.tick, record.mono_ns, [], [])
            elif now is not None and record.tick == now.number:
                if record.kind is RecordKind.PORT_OUT:
                    now.sent.append(record)
                elif record.kind in _TAKEN and record.source is not Source.CONTROL:
                    now.came.append(record)
        # The very last tick is left out: a truncated recording may lack some of its records.

    for record in records:
        if record.kind is RecordKind.HEADER:
            held.append(record)
            break
    while held:
        header = json.loads(held.pop().payload)
        yield header, ticks()


def _records(folder: Path) -> Iterator[Record]:
    """Records of the control loop in order; the recording interleaves them with those of other processes."""
    for _, data in read_run(folder):
        record = unpack(data)
        of_control = record.tick > 0 or (record.kind is RecordKind.HEADER and record.source is Source.CONTROL)
        if of_control:
            yield record


def _core(folder: Path, header: dict[str, Any]) -> ControlCore:
    if header["version"] != __version__:
        raise InputError(folder, "version", f"a run of this version, {__version__}", str(header["version"]))
    config: RuntimeConfig = read_config(folder / "config.toml")
    config = config.model_copy(update={"file": Path(header["config"])})
    place = header.get("place")
    loaded = load_vehicle(
        config, None if place is None else RoutePlace(int(place[0]), float(place[1])), header.get("anchor")
    )
    for name, digest in header["hashes"].items():
        if loaded.hashes.get(name) != digest:
            raise InputError(
                config.path(name), "file", f"the file used in the run, {digest[:12]}...", "a changed or missing file"
            )
    return ControlCore(config, loaded, session=int(header["session"]), after_death=bool(header["after_death"]))
