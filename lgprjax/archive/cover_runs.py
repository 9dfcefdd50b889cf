"""What a recorded run of a skid-steer vehicle tells of the field that it worked."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Int

from lgprjax.archive.run_signals import RowGatherer, rising
from lgprjax.errors import InputError
from lgprjax.files import file_hash
from lgprjax.formats.run_frames import payload_type, read_run_record
from lgprjax.formats.run_log import read_run
from lgprjax.run_segment import segments_of


class RunEvent(NamedTuple):
    """What a program on board told, and when."""

    utc_ns: int
    text: str


class CoverRun(NamedTuple):
    """A run as its record of coverage needs it.

    Attributes:
        name: of its folder.
        utc_ns: of each moment, by the computer on board, strictly rising.
        rows: ``cover`` payloads, one a moment.
        events: what the programs told, in order.
        provenance: UUID, whether it is complete, and each segment's SHA-256.
        plan_sha256: of the plan that it was driven by; ``None`` where the run does not tell.
    """

    name: str
    utc_ns: Int[np.ndarray, " moment"]
    rows: np.ndarray
    events: tuple[RunEvent, ...]
    provenance: dict[str, Any]
    plan_sha256: str | None


def read_cover_run(folder: str | Path) -> CoverRun:
    """Read a run; what is damaged or lost in it is left out, and its provenance says so.

    Args:
        folder: of the run.

    Raises:
        InputError: there is no run, no clock, or no moment of coverage in it.
    """
    reading = read_run(folder)
    clock = reading.clock
    if clock is None:
        raise InputError(reading.folder, "segments", "a whole head, or run.json", "neither")
    gathered = RowGatherer(payload_type("cover"))
    events, plan = [], None
    utc_of_mono_ns = clock[0] - clock[1]
    for _, data in reading:
        record = read_run_record(data)
        if record is None:
            continue
        if record.kind == "cover":
            gathered.add(record.mono_ns, record.payload)
        elif record.kind == "event":
            events.append(RunEvent(record.mono_ns + utc_of_mono_ns, _line(record.payload)))
        elif record.kind == "header" and plan is None:
            plan = _plan_of(record.payload)
    kept = rising(gathered.times_ns, np.ones(len(gathered.rows), bool))
    if not kept.any():
        expected = "records of what a tool worked (a run of a skid-steer vehicle with a plan)"
        raise InputError(reading.folder, "cover", expected, "none")
    found = reading.summary
    return CoverRun(
        name=reading.folder.resolve().name,
        utc_ns=gathered.times_ns[kept] + utc_of_mono_ns,
        rows=gathered.rows[kept],
        events=tuple(events),
        provenance={
            "run": str(found.run),
            "folder": reading.folder.resolve().name,
            "complete": found.complete,
            "segments": [
                {"file": path.name, "sha256": file_hash(path)} for path in segments_of(reading.folder).values()
            ],
        },
        plan_sha256=plan,
    )


def _line(payload: bytes) -> str:
    """JSON on one line; what is none is kept as text."""
    text = payload.decode("utf-8", "replace")
    try:
        return json.dumps(json.loads(text))
    except json.JSONDecodeError:
        return json.dumps(text)


def _plan_of(payload: bytes) -> str | None:
    try:
        header = json.loads(payload)
    except ValueError:
        return None
    told = header.get("plan_sha256") if isinstance(header, dict) else None
    return told if isinstance(told, str) else None
