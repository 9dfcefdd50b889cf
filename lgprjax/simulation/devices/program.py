"""The devices in real time: the world ticks on one thread, the ports are served by another."""

import gc
import json
import os
import select
import signal
import socket
import sys
import threading
import time
import tty
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from pathlib import Path
from typing import Any

import jax

from lgprjax.formats import MapFile
from lgprjax.formats.store import atomic_output
from lgprjax.scene import SweepPlan
from lgprjax.simulation.devices.course_stage import CourseSpec, CourseStage
from lgprjax.simulation.devices.field_stage import FieldSpec, FieldStage
from lgprjax.simulation.devices.stage import Stage, StageSpec, read_spec
from lgprjax.simulation.devices.world import CourseWorld
from lgprjax.simulation.drives import SITE_FRAME
from lgprjax.simulation.loop.off_road import OffRoad

# The stage of a specification: a course with a radar, or a field with a tool.

StageMaker = Callable[[int], Stage[Any, Any]]
"""A stage that begins at a time of the world's clock."""


def open_spec(file: Path) -> tuple[StageSpec, StageMaker]:
    """Read a specification and select its stage.

    Raises:
        InputError: the specification cannot be used.
    """
    if _is_field(file):
        field = read_spec(file, FieldSpec)
        return field, lambda begin_ns: FieldStage(field, file, begin_ns)
    spec = read_spec(file, CourseSpec)
    local = SITE_FRAME
    if spec.map:
        with MapFile.open(spec.map) as opened:
            local = opened.description.frame
    sweeps = SweepPlan() if spec.recording == "sweeps" else None
    course = OffRoad(spec.seed, spec.length_m, spec.scan_share, sweeps=sweeps)
    world = CourseWorld(
        course,
        local,
        weather=spec.weather,
        drive_seed=spec.drive_seed,
        gain_drift=spec.gain_drift,
        level=bool(spec.manoeuvre),
        in_view=spec.in_view,
    )
    return spec, lambda begin_ns: CourseStage(spec, world, file, begin_ns)


def _is_field(file: Path) -> bool:
    """Whether a file specifies devices in a field; False if it cannot be read."""
    with suppress(OSError, ValueError):
        return "anchor" in json.loads(file.read_text(encoding="utf-8"))
    return False


# The devices' ports: pseudo-terminals and a listening socket, none of which can block the devices.

_SERIAL = ("drive_by_wire", "controller", "gnss")
_SERIAL_WAITS, _RADAR_WAITS = 4096, 1 << 18
_READ = 1 << 16


class _Outlet:
    """An output. Messages that the host does not read are dropped as a whole."""

    def __init__(self, most: int) -> None:
        self.waiting = bytearray()
        self.dropped = 0
        self._most = most

    def put(self, data: bytes) -> None:
        if len(self.waiting) + len(data) > self._most:
            self.dropped += 1
        else:
            self.waiting += data

    def flush(self, write: Callable[[bytes], int]) -> None:
        while self.waiting:
            try:
                sent = write(bytes(self.waiting))
            except BlockingIOError:
                return
            del self.waiting[:sent]


class Ports:
    """Three pseudo-terminals and a socket on the loopback.

    Args:
        renewed: function called when another host connects to the radar.
    """

    def __init__(self, renewed: Callable[[], None]) -> None:
        self._renewed = renewed
        self._masters: dict[int, str] = {}
        self._slaves: list[int] = []
        self._names: dict[str, str] = {}
        self._outlets = {line: _Outlet(_SERIAL_WAITS) for line in _SERIAL} | {"radar": _Outlet(_RADAR_WAITS)}
        for line in _SERIAL:
            # Keeps the slave open, so that the master survives when the host closes it.
            master, slave = os.openpty()
            tty.setraw(slave)
            os.set_blocking(master, False)
            self._masters[master] = line
            self._slaves.append(slave)
            self._names[line] = os.ttyname(slave)
        self._listener = socket.create_server(("127.0.0.1", 0))
        self._listener.setblocking(False)
        self._names["radar"] = f"socket://127.0.0.1:{self._listener.getsockname()[1]}"
        self._radar: socket.socket | None = None

    @property
    def dropped(self) -> int:
        """Messages that the host left unread."""
        return sum(outlet.dropped for outlet in self._outlets.values())

    def announce(self, path: Path) -> None:
        """Write the address of each line's port as JSON.

        Raises:
            InputError: the file cannot be written.
        """
        with atomic_output(path, force=True) as temporary:
            temporary.write_text(json.dumps(self._names), encoding="utf-8")

    def send(self, line: str, data: bytes) -> None:
        """A message to the host, where somebody listens."""
        if line != "radar" or self._radar is not None:
            self._outlets[line].put(data)

    def exchange(self, wait_s: float) -> list[tuple[str, bytes]]:
        """Write pending bytes, and read within ``wait_s``: (line, bytes)."""
        for master, line in self._masters.items():
            self._outlets[line].flush(partial(os.write, master))
        if self._radar is not None:
            try:
                self._outlets["radar"].flush(self._radar.send)
            except OSError:
                self._hang_up()
        sources: list[int | socket.socket] = [*self._masters, self._listener]
        if self._radar is not None:
            sources.append(self._radar)
        ready, _, _ = select.select(sources, [], [], wait_s)
        told = []
        for source in ready:
            if source is self._listener:
                self._accept()
            elif isinstance(source, int):
                told.append((self._masters[source], os.read(source, _READ)))
            elif source is self._radar:
                told += [("radar", data) for data in self._hear()]
        return told

    def close(self) -> None:
        """Close all ports."""
        self._hang_up()
        self._listener.close()
        for handle in (*self._masters, *self._slaves):
            os.close(handle)

    def _accept(self) -> None:
        """Another host takes the place of the one before."""
        try:
            radar, _ = self._listener.accept()
        except OSError:
            return
        self._hang_up()
        radar.setblocking(False)
        radar.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        self._radar = radar
        self._renewed()

    def _hear(self) -> list[bytes]:
        assert self._radar is not None
        try:
            data = self._radar.recv(_READ)
        except BlockingIOError:
            return []
        except OSError:
            data = b""
        if not data:
            self._hang_up()
            return []
        return [data]

    def _hang_up(self) -> None:
        if self._radar is not None:
            self._radar.close()
            self._radar = None
        self._outlets["radar"].waiting.clear()


_LOOK_S = 0.002
"""Period at which the ports are served."""
_LATE_S, _SKIPS_S = 0.005, 0.1
"""A tick that begins so late counts as late; so late, its scans are left out to catch up."""
_WARM_TICKS = 4
_PARENT_S = 0.25


class RealTime:
    """A stage against the computer's clock.

    Args:
        make: the stage that begins at a time.
        rate: world's seconds in one of the computer's.
        parent: process without which the devices end.

    Raises:
        InputError: the spec cannot be used.
    """

    def __init__(self, make: StageMaker, rate: float, parent: int) -> None:
        self._rate, self._parent = rate, parent
        _warm(make(0))
        gc.collect()
        gc.freeze()
        self._origin_ns = time.monotonic_ns()
        self.stage = make(self._origin_ns)
        self.ports = Ports(self.stage.renew)
        self._ends = threading.Event()
        self._failure: BaseException | None = None
        self._late_ticks, self._skipped = 0, 0
        self._largest_late_s, self._render_s = 0.0, 0.0

    def run(self) -> dict[str, float]:
        """Run until ``end``; figures of the run. What ends the thread of the ports is raised here."""
        began_s, cpu_s = time.monotonic(), time.process_time()
        server = threading.Thread(target=self._serve, name="ports")
        server.start()
        try:
            self._tick_on()
        finally:
            self._ends.set()
            server.join()
            self.ports.close()
        if self._failure is not None:
            raise self._failure
        cpu_s = time.process_time() - cpu_s
        return {
            "cpu_s": cpu_s,
            "cpu_share": cpu_s / (time.monotonic() - began_s),
            "render_cpu_s": self._render_s,
            "late_ticks": self._late_ticks,
            "largest_late_s": self._largest_late_s,
            **{f"largest_{what}_late_s": late_s for what, late_s in self.stage.latest_s.items()},
            "skipped_scans": self._skipped,
            "unread_messages": self.ports.dropped,
        }

    def end(self) -> None:
        """Come to an end; from any thread or a signal's handler."""
        self._ends.set()

    def _now_ns(self) -> int:
        since_ns = time.monotonic_ns() - self._origin_ns
        return self._origin_ns + (since_ns if self._rate == 1.0 else round(self._rate * since_ns))

    def _tick_on(self) -> None:
        stage, looked_s = self.stage, 0.0
        while not self._ends.is_set():
            wait_s = 1e-9 * (stage.next_ns - self._now_ns()) / self._rate
            if wait_s > 0.0:
                time.sleep(wait_s)
            late_s = 1e-9 * (self._now_ns() - stage.next_ns)
            self._largest_late_s = max(self._largest_late_s, late_s)
            self._late_ticks += late_s > _LATE_S
            tick = stage.tick()
            if late_s > _SKIPS_S:
                self._skipped += stage.skip(tick)
            else:
                began_s = time.thread_time()
                stage.render(tick)
                self._render_s += time.thread_time() - began_s
            if time.monotonic() - looked_s > _PARENT_S:
                looked_s = time.monotonic()
                if os.getppid() != self._parent:
                    self._ends.set()

    def _serve(self) -> None:
        try:
            while not self._ends.is_set():
                for line, data in self.stage.emit(self._now_ns()):
                    self.ports.send(line, data)
                for line, data in self.ports.exchange(_LOOK_S):
                    self.stage.receive(line, data, self._now_ns())
        except BaseException as error:
            self._failure = error
        finally:
            # Without its ports the world has no use.
            self._ends.set()


def run_devices(file: Path) -> int:
    """Run the devices of a spec until SIGTERM or the parent's death, then write the truth; the exit status.

    Raises:
        InputError: the spec cannot be used, or an output not written.
    """
    _hold_xla_to_one()
    sys.setswitchinterval(0.0005)
    spec, make = open_spec(file)
    real = RealTime(make, spec.rate, spec.parent)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: real.end())
    real.ports.announce(Path(spec.ports))
    figures = real.run()
    real.stage.truth.write(Path(spec.truth), figures)
    if figures["late_ticks"] or figures["skipped_scans"]:
        print(
            f"devices: {figures['late_ticks']:.0f} ticks were late, by {figures['largest_late_s']:.3f} s at most; "
            f"{figures['skipped_scans']:.0f} scans were left out",
            file=sys.stderr,
        )
    return 0


def _hold_xla_to_one() -> None:
    """Run XLA on the calling thread, because the vehicle's own programs need the other core."""
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    os.environ.setdefault("XLA_FLAGS", "--xla_cpu_multi_thread_eigen=false")
    if sys.platform == "linux":
        # XLA starts one thread per visible CPU, so only one is visible while it starts.
        allowed = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {max(allowed)})
        jax.devices()
        os.sched_setaffinity(0, allowed)


def _warm(stage: Stage[Any, Any]) -> None:
    """Compile and load everything that a run needs, on a temporary stage."""
    stage.warm()
    for _ in range(_WARM_TICKS):
        stage.render(stage.tick())
        stage.emit(stage.next_ns)
