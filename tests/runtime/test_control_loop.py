"""The control process's loop: its tick's time against that of the messages it takes; what outlives its death."""

import json
import time
from collections import deque
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from lgprjax.run_records import Record, RecordKind, Source, pack, unpack
from lgprjax.runtime.choices import Choices
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.core import ControlCore
from lgprjax.runtime.control.counter_steer import CounterSteer
from lgprjax.runtime.control.program import Control
from lgprjax.runtime.control.setup import Loaded
from lgprjax.runtime.port import Arrival


def process(rings: Path, *, after_death: bool, requests: list[bytes]) -> tuple[Any, deque[bytes]]:
    """A control process without ports, and what it records."""
    control: Any = Control.__new__(Control)
    log: deque[bytes] = deque()
    waiting = [requests, []]
    control._ports, control._onward, control._port_of, control._view = [], {}, {}, None
    control._incoming = [SimpleNamespace(take=lambda: waiting.pop(0) if waiting else [])]
    control._log, control._state = SimpleNamespace(lost=0, put=log.append), SimpleNamespace(put=lambda _: True)
    control._started = SimpleNamespace(beat=lambda _: None, after_death=after_death)
    control._notifier = SimpleNamespace(watchdog=lambda: None)
    control._choices = Choices(rings)
    control._ended = False
    return control, log


def few_ticks(control: Any, core: ControlCore) -> None:
    """Let it run until its sixth tick."""
    step = core.step

    def ending(tick: int, now_ns: int, came: list[Record]) -> list[Record]:
        control._ended = tick == 6
        return step(tick, now_ns, came)

    core.step = ending  # type: ignore[method-assign]
    control._port_of = {source: SimpleNamespace(write=lambda _: None) for source in Source}
    control._loop(core, collects=False)


def test_a_relaunched_control_process_has_the_route_that_was_selected(
    config: RuntimeConfig, loaded: Loaded, tmp_path: Path
) -> None:
    two = loaded._replace(routes=[*loaded.routes, loaded.routes[0]._replace(name="second.route.toml")])
    asked = json.dumps({"select_route": "second.route.toml"}).encode()
    request = pack(Record(RecordKind.REQUEST, Source.DISPLAY, 0, time.monotonic_ns(), asked))
    for after_death, requests in ((False, [request]), (True, [])):
        core = ControlCore(config, two, session=78, after_death=after_death)
        control, log = process(tmp_path, after_death=after_death, requests=requests)
        few_ticks(control, core)
        assert isinstance(core.kind, CounterSteer)
        assert core.kind.pilot.route == 1
        told = [unpack(data) for data in log]
        # In the recording, too: a replay selects it again.
        assert [record.tick for record in told if record.kind is RecordKind.REQUEST] == [1]
        routes = [json.loads(record.payload) for record in told if record.kind is RecordKind.EVENT]
        assert {"route": "second.route.toml"} in routes


def test_a_control_process_that_begins_a_run_has_its_first_route(
    config: RuntimeConfig, loaded: Loaded, tmp_path: Path
) -> None:
    two = loaded._replace(routes=[*loaded.routes, loaded.routes[0]._replace(name="second.route.toml")])
    core = ControlCore(config, two, session=78, after_death=True)
    control, _ = process(tmp_path, after_death=True, requests=[])
    few_ticks(control, core)
    assert isinstance(core.kind, CounterSteer)
    assert core.kind.pilot.route == 0


def test_no_message_is_younger_than_its_tick(tmp_path: Path) -> None:
    """Whatever comes between waking and taking: a negative age would be a silent line."""
    seen: list[tuple[int, list[int]]] = []
    control, _ = process(tmp_path, after_death=False, requests=[])
    control._incoming = []

    def take() -> list[Arrival[bytes]]:
        # Preempted here, while the port's own thread goes on receiving.
        time.sleep(0.002)
        return [Arrival(time.monotonic_ns(), b"$")]

    def step(tick: int, now_ns: int, came: list[Record]) -> list[Record]:
        seen.append((now_ns, [record.mono_ns for record in came]))
        control._ended = tick == 5
        return []

    control._ports = [SimpleNamespace(source=1, take=take, take_refused=list)]
    control._loop(SimpleNamespace(step=step, unrecorded=0), collects=False)
    assert len(seen) == 5
    assert all(came and max(came) <= now_ns for now_ns, came in seen)
