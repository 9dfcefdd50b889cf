"""Where a recording goes on: what the run's folder holds when the recorder comes up."""

import json
import os
import platform
import shutil
import time
import uuid
from contextlib import suppress
from pathlib import Path
from typing import Any, NamedTuple

from lgprjax import __version__
from lgprjax.run_segment import OWN, read_head, scan_records, segments_of
from lgprjax.runtime.recorder_sync import sync_folder


class Resume(NamedTuple):
    """Where to go on.

    Attributes:
        run: UUID of the run, 16 bytes.
        segment, number: the next ones.
        positions: of the rings by origin, where the last record on the disk ended in each.
        dropped: messages by ring that the recording knows to be lost.
    """

    run: bytes
    segment: int
    number: int
    positions: dict[int, int]
    dropped: dict[str, int]


def resume(folder: Path) -> Resume:
    """What the disk says of the run in a folder; a new run where there is none.

    Only the last segment with records is read: what an earlier one holds was let go of by its ring long ago.

    Raises:
        OSError: the folder cannot be read.
    """
    files = segments_of(folder)
    heads = {segment: read_head(path)[0] for segment, path in files.items()}
    known = [head.run for head in heads.values() if head is not None]
    run = known[-1] if known else _run_told(folder) or uuid.uuid4().bytes
    found = Resume(run, max(files, default=-1) + 1, 0, {}, {})
    for segment in reversed(files):
        head = heads[segment]
        positions: dict[int, int] = {}
        dropped: dict[str, int] = {}
        number = -1 if head is None or head.run != run else head.number - 1
        seen = False
        for record in scan_records(files[segment], run):
            seen, number = True, max(number, record.number)
            if record.origin == OWN:
                dropped |= json.loads(record.data).get("dropped", {})
            else:
                positions[record.origin] = record.position
        found = found._replace(number=max(found.number, number + 1))
        if seen:
            return found._replace(positions=positions, dropped=dropped)
    return found


def tell_run(folder: Path, run: bytes, config: Path) -> None:
    """Put beside the segments what a reader needs: the configuration as it was read, and ``run.json``.

    ``run.json`` gains the two clocks of the computer each time that the recorder comes up.

    Raises:
        OSError: the disk refuses.
    """
    copy, told = folder / "config.toml", folder / "run.json"
    if not copy.exists():
        fresh = copy.with_suffix(".new")
        shutil.copyfile(config, fresh)
        _settle(fresh, copy)
    table: dict[str, Any] = {"uuid": str(uuid.UUID(bytes=run)), "lgprjax": __version__, "clocks": []}
    table |= {"python": platform.python_version(), "machine": platform.platform(), "config": str(config)}
    with suppress(OSError, ValueError, KeyError, TypeError):
        table["clocks"] = list(json.loads(told.read_text(encoding="utf-8"))["clocks"])
    table["clocks"].append({"utc_ns": time.time_ns(), "mono_ns": time.monotonic_ns()})
    fresh = told.with_suffix(".new")
    fresh.write_text(json.dumps(table, indent=1) + "\n", encoding="utf-8")
    _settle(fresh, told)


def _run_told(folder: Path) -> bytes | None:
    with suppress(OSError, ValueError, KeyError, TypeError):
        return uuid.UUID(json.loads((folder / "run.json").read_text(encoding="utf-8"))["uuid"]).bytes
    return None


def _settle(fresh: Path, target: Path) -> None:
    with fresh.open("rb") as file:
        os.fsync(file.fileno())
    fresh.rename(target)
    sync_folder(target.parent)
