"""Offline verbs start where the modules of Unix are missing, as on Windows."""

import subprocess
import sys
from pathlib import Path

_PACKAGE = Path(__file__).parents[1] / "lgprjax"
_UNIX = ("fcntl", "termios", "resource", "tty", "pty", "grp", "pwd")
_OFFLINE = (
    "batch",
    "cli",
    "formats",
    "mapping",
    "recordings",
    "registration",
    "report",
    "scene",
    "simulation",
    "tuning",
)
_ON_BOARD = ("worker", "lock_step")  # a worker process; a part of `lgprjax run`
_PROGRAM = """
import importlib, sys
for name in sys.argv[1].split():
    sys.modules[name] = None
for name in sys.argv[2].split():
    importlib.import_module(name)
from lgprjax.files import file_hash
from lgprjax.machine import peak_rss_mb
assert peak_rss_mb() > 0.0
print("imported")
from lgprjax.cli import main
main(["check", "nowhere.drive.h5"])
"""


def test_offline_verbs_need_no_module_of_unix(tmp_path: Path) -> None:
    modules = [
        ".".join(("lgprjax", *path.relative_to(_PACKAGE).with_suffix("").parts)).removesuffix(".__init__")
        for room in _OFFLINE
        for path in sorted((_PACKAGE / room).rglob("*.py"))
        if path.stem not in _ON_BOARD and "devices" not in path.parts
    ]
    assert len(modules) > 80
    run = subprocess.run(
        [sys.executable, "-c", _PROGRAM, " ".join(_UNIX), " ".join(modules)],
        capture_output=True,
        text=True,
        cwd=tmp_path,
        check=False,
    )
    assert run.stdout.strip().splitlines()[:1] == ["imported"], run.stderr
    assert run.returncode == 1, run.stderr
    assert "nowhere.drive.h5" in run.stdout
