"""A toy process of the runtime: beats, and misbehaves when told. Only the standard library: it starts in no time.

Called with NAME RINGS RUN [--after-death]. SIGUSR1: it loops and beats no more. SIGUSR2: it takes memory without end.
SIGALRM: it exits with 7. Files of the run folder: NAME.fails holds an exit status that it ends with at once; NAME.deaf
makes it ignore SIGTERM; ``placed`` lets it die with its parent.
"""

import os
import resource
import signal
import struct
import sys
import time
from pathlib import Path

NAME, RINGS, RUN = sys.argv[1], Path(sys.argv[2]), Path(sys.argv[3])
ROW = ("control", "registration", "recorder", "display", "monitor", "coverage").index(NAME)


def note(file: str, *words: object) -> None:
    """A line in a file of the run folder."""
    with (RUN / file).open("a") as lines:
        lines.write(" ".join(str(word) for word in (NAME, *words)) + "\n")


def beat(count: int) -> None:
    """The row as the table of heartbeats has it: u64 time in ns, u32 stage, u32 pid, u32 count, u32 0."""
    with (RINGS / "heartbeats").open("r+b", buffering=0) as table:
        table.seek(24 * ROW)
        table.write(struct.pack("<QIIII", time.monotonic_ns(), 2, os.getpid(), count, 0))


def spin(*_: object) -> None:
    """A busy loop."""
    while True:
        pass


def hog(*_: object) -> None:
    """Memory without end, up to a limit that stands for the machine's."""
    resource.setrlimit(resource.RLIMIT_AS, (128 << 20, 128 << 20))
    taken = []
    while True:
        taken.append(bytearray(4 << 20))


def end(*_: object) -> None:
    """The orderly end."""
    note("ends", "ended")
    sys.exit(0)


if (RUN / "placed").exists():
    from lgprjax.runtime.service import die_with_parent

    die_with_parent(NAME)
note("starts", os.getpid(), "--after-death" in sys.argv)
if (RUN / f"{NAME}.fails").exists():
    sys.exit(int((RUN / f"{NAME}.fails").read_text()))
signal.signal(signal.SIGTERM, signal.SIG_IGN if (RUN / f"{NAME}.deaf").exists() else end)
signal.signal(signal.SIGUSR1, spin)
signal.signal(signal.SIGUSR2, hog)
signal.signal(signal.SIGALRM, lambda *_: sys.exit(7))
notifier = None
if NAME == "control":
    from lgprjax.runtime.service import Notifier

    notifier = Notifier()
elif "NOTIFY_SOCKET" in os.environ:
    note("speakers", "could feed the watchdog")
for tick in range(1, 1 << 30):
    beat(tick)
    if notifier is not None:
        notifier.watchdog()
    time.sleep(0.02)
