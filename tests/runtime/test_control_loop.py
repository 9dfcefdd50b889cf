"""The control process's loop: its tick's time against that of the messages it takes."""

import time
from collections import deque
from types import SimpleNamespace
from typing import Any

from lgprjax.run_records import Record
from lgprjax.runtime.control.program import Control
from lgprjax.runtime.port import Arrival


def test_no_message_is_younger_than_its_tick() -> None:
    """Whatever comes between waking and taking: a negative age would be a silent line."""
    seen: list[tuple[int, list[int]]] = []
    control: Any = Control.__new__(Control)

    def take() -> list[Arrival[bytes]]:
        # Preempted here, while the port's own thread goes on receiving.
        time.sleep(0.002)
        return [Arrival(time.monotonic_ns(), b"$")]

    def step(tick: int, now_ns: int, came: list[Record]) -> list[Record]:
        seen.append((now_ns, [record.mono_ns for record in came]))
        control._ended = tick == 5
        return []

    log: deque[bytes] = deque()
    control._ports = [SimpleNamespace(source=1, take=take, take_refused=list)]
    control._incoming, control._onward, control._port_of, control._view = [], {}, {}, None
    control._log = SimpleNamespace(lost=0, put=log.append)
    control._started = SimpleNamespace(beat=lambda _: None)
    control._notifier = SimpleNamespace(watchdog=lambda: None)
    control._ended = False
    control._loop(SimpleNamespace(step=step, unrecorded=0), collects=False)
    assert len(seen) == 5
    assert all(came and max(came) <= now_ns for now_ns, came in seen)
