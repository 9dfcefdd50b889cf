"""Whether this machine keeps real time: measured, not guessed from its cores."""

import multiprocessing
import time
from multiprocessing.connection import Connection
from typing import NamedTuple

import numpy as np

_SECONDS, _PERIOD_S = 1.0, 0.02
_SIZE = 96
_UNITS = (30, 80, 110)
"""Work a period of control loop, registration and simulated devices, each on a process of its own, in products of two
matrices of 96 x 96: what the three take of a core in the quick start at 126 scans a second, measured beside it."""
_LATE_S = 0.06
"""A period begun later than this looks like a device that fails (its line counts as silent after 0.1 s)."""
_BEHIND = 0.02


class RealTime(NamedTuple):
    """What a second of work as on board found.

    Attributes:
        largest_late_s: by which a period began late at the worst.
        behind: share of the periods that began later than they should end.
    """

    largest_late_s: float
    behind: float

    @property
    def keeps(self) -> bool:
        """Whether the simulated devices and the runtime can run in real time now."""
        return self.largest_late_s < _LATE_S and self.behind < _BEHIND

    @property
    def line(self) -> str:
        """For a person."""
        found = f"{100.0 * self.behind:.0f} % of the periods were missed, {self.largest_late_s:.2f} s late at the worst"
        return f"this machine keeps real time ({found})" if self.keeps else f"this machine is too busy or slow: {found}"


def measure_real_time(seconds: float = _SECONDS) -> RealTime:
    """Run three processes with the work of a simulated run beside each other, and look how late they come."""
    context = multiprocessing.get_context("spawn")
    pipes = [context.Pipe() for _ in _UNITS]
    processes = [
        context.Process(target=_work, args=(units, seconds, far), daemon=True)
        for units, (_, far) in zip(_UNITS, pipes, strict=True)
    ]
    for process in processes:
        process.start()
    try:
        for near, _ in pipes:
            near.recv()
        begin_s = time.monotonic() + 0.05
        for near, _ in pipes:
            near.send(begin_s)
        found = [near.recv() for near, _ in pipes]
    finally:
        for process in processes:
            process.join(5.0)
            process.kill()
    late = np.concatenate(found)
    return RealTime(float(late.max()), float(np.mean(late > _PERIOD_S)))


def _work(units: int, seconds: float, pipe: Connection) -> None:
    """A process of the three: periods of fixed work, and how late each began."""
    left = np.random.default_rng(0).normal(size=(_SIZE, _SIZE)).astype(np.float32)
    _product(left)
    pipe.send("ready")
    due_s, late = float(pipe.recv()), []
    end_s = due_s + seconds
    while due_s < end_s:
        time.sleep(max(0.0, due_s - time.monotonic()))
        late.append(max(0.0, time.monotonic() - due_s))
        for _ in range(units):
            _product(left)
        due_s += _PERIOD_S
    pipe.send(np.array(late))


def _product(left: np.ndarray) -> None:
    # Row by row, so that no library spreads it over threads.
    for row in left:
        row @ left
