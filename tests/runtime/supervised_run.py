"""A supervised run of toys in a process of its own, and what a test does with it.

As a program: ``python supervised_run.py CONFIG RINGS RUN``.
"""

import json
import os
import select
import signal
import subprocess
import sys
import time
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import TracebackType
from typing import Any, NamedTuple

from lgprjax.errors import InputError
from lgprjax.run_records import RecordKind, Source, unpack
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.ring import Ring
from lgprjax.runtime.supervisor import supervise

CONFIG = """
name = "toy"
vehicle = "toy.vehicle.toml"
map = "toy.map.h5"
routes = ["there"]
[ports]
drive_by_wire = {{ url = "{device}" }}
controller = {{ url = "/dev/null" }}
gnss = {{ url = "/dev/null" }}
radar = {{ url = "socket://127.0.0.1:9" }}
[supervision]
control_s = {silent_s}
others_s = {silent_s}
start_s = 20.0
{more}
"""
LIMIT_S = 20.0
"""What anything may take on a machine that does much else beside."""


def write_config(folder: Path, more: str = "", silent_s: float = 0.2) -> Path:
    """A configuration of toys; ``more`` begins in the table ``supervision``."""
    file = folder / "CONFIG.toml"
    file.write_text(CONFIG.format(device=folder / "ttyDRIVE", more=more, silent_s=silent_s), encoding="utf-8")
    return file


def toy_command(name: str, _: RuntimeConfig, rings: Path, run_folder: Path, after_death: bool) -> Sequence[str]:
    """The command line of a toy."""
    toy = Path(__file__).with_name("supervised_toy.py")
    extra = ("--after-death",) if after_death else ()
    # Without its packages Python starts in no time.
    return (sys.executable, "-S", str(toy), name, str(rings), str(run_folder), *extra)


class Note(NamedTuple):
    """A record of the ring of notes."""

    content: dict[str, Any]
    mono_ns: int


class SupervisedRun:
    """A run of toys; left, it is ended. ``silent_s``: a toy on a busy machine may well be silent for 0.2 s."""

    def __init__(
        self, folder: Path, more: str = "", environment: dict[str, str] | None = None, silent_s: float = 5.0
    ) -> None:
        self.run_folder = folder / "run"
        self.rings = folder / "rings"
        self.config = write_config(folder, more, silent_s)
        self.run_folder.mkdir(exist_ok=True)
        self.notes: list[Note] = []
        self._environment = environment or {}
        self._ring: Ring | None = None

    def start(self) -> "SupervisedRun":
        """Begin; does not wait for ready."""
        root = str(Path(__file__).parents[2])
        path = os.pathsep.join(part for part in (root, os.environ.get("PYTHONPATH", "")) if part)
        self.process = subprocess.Popen(
            [sys.executable, __file__, str(self.config), str(self.rings), str(self.run_folder)],
            env={**os.environ, "PYTHONPATH": path, **self._environment},
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        return self

    def wait_note(self, count: int = 1, after_ns: int = 0, **content: Any) -> Note:
        """The ``count``-th note with at least this content, of those after a time."""
        until_s = time.monotonic() + LIMIT_S
        while time.monotonic() < until_s:
            self._read_notes()
            found = [note for note in self.notes if content.items() <= note.content.items() and note.mono_ns > after_ns]
            if len(found) >= count:
                return found[count - 1]
            time.sleep(0.005)
        raise AssertionError(f"no {count} notes {content} among {self.notes}")

    def wait_ready(self) -> str:
        """The line that says so."""
        assert self.process.stdout is not None
        assert select.select([self.process.stdout], [], [], LIMIT_S)[0], "nothing was said"
        return self.process.stdout.readline().strip()

    def starts(self, name: str) -> list[tuple[int, bool]]:
        """Process number and whether after a death, for each start of a toy."""
        lines = [line.split() for line in self._lines("starts")]
        return [(int(pid), after == "True") for toy, pid, after in lines if toy == name]

    def ends(self) -> list[str]:
        """Names in the order of their orderly ends."""
        return [line.split()[0] for line in self._lines("ends")]

    def pids(self) -> list[int]:
        """Of all toys that ever were."""
        return [int(line.split()[1]) for line in self._lines("starts")]

    def end(self, by: int = signal.SIGTERM) -> tuple[int, str, str]:
        """End it; exit status and what it said."""
        self.process.send_signal(by)
        output, errors = self.process.communicate(timeout=LIMIT_S)
        return self.process.returncode, output, errors

    def __enter__(self) -> "SupervisedRun":
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        if self.process.poll() is None:
            self.end()
        for stream in (self.process.stdout, self.process.stderr):
            if stream is not None:
                stream.close()

    def _lines(self, file: str) -> list[str]:
        path = self.run_folder / file
        return path.read_text().splitlines() if path.exists() else []

    def _read_notes(self) -> None:
        if self._ring is None and (self.rings / "notes").exists():
            self._ring = Ring(self.rings / "notes")
        for message in self._ring.take() if self._ring is not None else []:
            record = unpack(message)
            assert (record.kind, record.source, record.tick) == (RecordKind.EVENT, Source.SUPERVISOR, 0)
            self.notes.append(Note(json.loads(record.payload), record.mono_ns))


def check_death(folder: Path, name: str, by: int, silent_s: float) -> tuple[float, str]:
    """A toy is signalled in a run with real time, as on a vehicle: told to all, started anew, gone.

    Returns:
        Seconds until it was found dead, and why.
    """
    with SupervisedRun(folder, "[control]\nrealtime_priority = 20", silent_s=silent_s).start() as run:
        run.wait_ready()
        before = run.starts(name)
        pid, began_ns = before[-1][0], time.monotonic_ns()
        os.kill(pid, by)
        died = run.wait_note(after_ns=began_ns, died=name)
        run.wait_note(after_ns=died.mono_ns, ready=name)
        starts = run.starts(name)
        log = [unpack(message) for message in Ring(run.rings / "supervisor_log").take()]
        status, _, errors = run.end()
    why = str(died.content["why"])
    assert starts[len(before)][1] is (name in ("control", "recorder"))
    assert not is_there(pid)
    # The recorder is told the same, and so is a person.
    assert (died.mono_ns, died.content) in [(record.mono_ns, json.loads(record.payload)) for record in log]
    assert any(name in line and why in line for line in errors.splitlines())
    assert status == 0
    return (died.mono_ns - began_ns) / 1e9, why


def is_there(pid: int) -> bool:
    """Whether a process exists and is not merely waiting to be reaped."""
    try:
        return Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split()[0] != "Z"
    except OSError:
        return False


def wait_gone(pids: Sequence[int], limit_s: float = LIMIT_S) -> list[int]:
    """Those that are still there after ``limit_s``."""
    until_s = time.monotonic() + limit_s
    while (left := [pid for pid in pids if is_there(pid)]) and time.monotonic() < until_s:
        time.sleep(0.01)
    return left


def main() -> int:
    """Supervise toys."""
    config, rings, run_folder = (Path(argument) for argument in sys.argv[1:4])
    # As real-time priority on a vehicle: what else a machine has to do is not what the tests measure.
    with suppress(PermissionError):
        os.nice(-15)
    try:
        return supervise(read_config(config), run_folder, rings, command=toy_command)
    except InputError as error:
        print(error, file=sys.stderr)
        return 1


if __name__ == "__main__":
    sys.exit(main())
