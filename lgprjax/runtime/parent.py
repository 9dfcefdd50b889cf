"""A process of the runtime and its supervisor: none outlives it."""

import ctypes
import os
import signal
import sys

_PR_SET_PDEATHSIG = 1

SUPERVISOR = "LGPRJAX_SUPERVISOR"
"""Variable of the environment: process number of the supervisor that started this process."""


def die_with_parent(name: str) -> None:
    """Let the kernel end this process when its supervisor's main thread ends.

    The recorder is asked, so that it writes what waits; the others go at once: a silent line sets the actuators to
    their defaults.
    """
    after = signal.SIGTERM if name == "recorder" else signal.SIGKILL
    if sys.platform == "linux":
        ctypes.CDLL(None, use_errno=True).prctl(_PR_SET_PDEATHSIG, int(after), 0, 0, 0)
    supervisor = os.environ.get(SUPERVISOR)
    # It may have died before the kernel was told.
    if supervisor is not None and int(supervisor) != os.getppid():
        sys.exit(1)
