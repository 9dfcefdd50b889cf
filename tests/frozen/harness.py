"""What is frozen, and how it is looked at from outside: commands, and files.

``tests/frozen`` holds behaviour that a change of the package's inside must leave as it is. Its tests know the command
line and what stands in files, with one exception: ``autopilot_sequences`` uses what ``lgprjax.autopilot`` exports.
What is held stands in ``data/`` and is written again, after a change that is meant, by

    PYTHONPATH=.:tests python -m frozen.write [commands] [sequences] [fixes] [formats]

(recordings: see ``recordings``); the difference is read like any other.

What is compared number by number is computed by ``ONE_ARITHMETIC``, in processes of its own: with what newer processors
have beside, numbers are rounded otherwise, four in ten of the frames of a replay differ in their last bits, and sums
depend on the number of threads. So computed, the fixes of two runs, and the frames of a replay with NumPy's own choice
of instructions switched off, came out the same to the bit.
"""

import json
import os
import subprocess
import sys
from pathlib import Path
from typing import Any, NamedTuple

import lgprjax
from canon.arithmetic import ONE_ARITHMETIC

ROOT = Path(__file__).resolve().parents[2]
DATA = Path(__file__).parent / "data"
AS_DRIVEN = {**ONE_ARITHMETIC, "XLA_FLAGS": "--xla_cpu_max_isa=SSE4_2 --xla_cpu_multi_thread_eigen=false"}
"""Of the recordings that are replayed to the bit."""
_COMMANDS = """
import contextlib, io, json, os, sys
from pathlib import Path
from lgprjax.cli import main


def files():
    return {str(path): path.stat().st_mtime_ns for path in Path().rglob("*") if path.is_file()}


told = []
for words in json.load(sys.stdin):
    out, err, status, before = io.StringIO(), io.StringIO(), None, files()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(err):
        try:
            main(words)
        except SystemExit as stopped:
            status = stopped.code
    wrote = sorted(name for name, at in files().items() if before.get(name) != at)
    told.append({"status": status, "out": out.getvalue(), "err": err.getvalue(), "wrote": wrote})
json.dump(told, sys.stdout)
"""


class Done(NamedTuple):
    """A command's exit status and what it printed."""

    status: int
    out: str
    err: str


def run_commands(commands: list[list[str]], folder: Path) -> list[dict[str, Any]]:
    """Commands one after the other in a process and a folder of their own, by ``ONE_ARITHMETIC``.

    Of each: its status, what it printed (out, err), and the files that it wrote.
    """
    done = _start(["-c", _COMMANDS], folder, told=json.dumps(commands), **ONE_ARITHMETIC)
    assert done.status == 0, f"{done.out[-2000:]}\n{done.err[-4000:]}"
    told: list[dict[str, Any]] = json.loads(done.out)
    return told


def run_command(words: list[str], folder: Path, **environment: str) -> Done:
    """A command in a process and a folder of its own."""
    return _start(["-m", "lgprjax", *words], folder, **environment)


def _start(words: list[str], folder: Path, told: str = "", **environment: str) -> Done:
    # The package under test, wherever the tests were started and whichever folder the command is run in.
    package = str(Path(lgprjax.__file__).resolve().parents[1])
    done = subprocess.run(
        [sys.executable, *words],
        input=told,
        capture_output=True,
        text=True,
        timeout=1800.0,
        check=False,
        cwd=folder,
        env={**os.environ, "PYTHONPATH": package, "COLUMNS": "120", **environment},
    )
    return Done(done.returncode, done.stdout, done.stderr)


def read_json(name: str) -> Any:
    """A file of ``data/``."""
    return json.loads((DATA / name).read_text(encoding="utf-8"))


def write_json(name: str, value: object) -> None:
    """Write a file of ``data/``."""
    text = json.dumps(value, indent=1, ensure_ascii=False, sort_keys=True)
    (DATA / name).write_text(text + "\n", encoding="utf-8")
