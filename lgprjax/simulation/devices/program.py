"""The devices in real time: the world ticks on one thread, the ports are served by another."""

import gc
import os
import signal
import sys
import threading
import time
from pathlib import Path

import jax

from lgprjax.simulation.devices.ports import Ports
from lgprjax.simulation.devices.stages import AnyStage, StageMaker, open_spec

_LOOK_S = 0.002
"""How often the ports are looked after."""
_LATE_S, _SKIPS_S = 0.005, 0.1
"""A tick that begins so late counts as late; so late, its scans are left out to catch up."""
_WARM_TICKS = 4
_PARENT_S = 0.25


class RealTime:
    """A stage against the computer's clock.

    Args:
        make: the stage that begins at a time.
        rate: world's seconds in one of the computer's.

    Raises:
        InputError: the spec cannot be used.
    """

    def __init__(self, make: StageMaker, rate: float) -> None:
        self._rate = rate
        _warm(make(0))
        gc.collect()
        gc.freeze()
        self._origin_ns = time.monotonic_ns()
        self.stage = make(self._origin_ns)
        self.ports = Ports(self.stage.renew)
        self._ends = threading.Event()
        self._late_ticks, self._skipped = 0, 0
        self._largest_late_s, self._render_s = 0.0, 0.0

    def run(self) -> dict[str, float]:
        """Run until ``end``; figures of the run."""
        began_s, cpu_s = time.monotonic(), time.process_time()
        server = threading.Thread(target=self._serve, name="ports")
        server.start()
        try:
            self._tick_on()
        finally:
            self._ends.set()
            server.join()
            self.ports.close()
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
        stage, parent, looked_s = self.stage, os.getppid(), 0.0
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
                if os.getppid() != parent:
                    self._ends.set()

    def _serve(self) -> None:
        try:
            while not self._ends.is_set():
                for line, data in self.stage.emit(self._now_ns()):
                    self.ports.send(line, data)
                for line, data in self.ports.exchange(_LOOK_S):
                    self.stage.receive(line, data, self._now_ns())
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
    opened = open_spec(file)
    real = RealTime(opened.make, opened.rate)
    for number in (signal.SIGTERM, signal.SIGINT):
        signal.signal(number, lambda *_: real.end())
    real.ports.announce(opened.ports)
    figures = real.run()
    real.stage.truth.write(opened.truth, figures)
    if figures["late_ticks"] or figures["skipped_scans"]:
        print(
            f"devices: {figures['late_ticks']:.0f} ticks were late, by {figures['largest_late_s']:.3f} s at most; "
            f"{figures['skipped_scans']:.0f} scans were left out",
            file=sys.stderr,
        )
    return 0


def _hold_xla_to_one() -> None:
    """Each call's work on the thread that calls: the vehicle's own programs need the other core."""
    jax.config.update("jax_platforms", "cpu")
    jax.config.update("jax_cpu_enable_async_dispatch", False)
    os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false"
    if sys.platform == "linux":
        # XLA makes as many threads as it sees CPUs: one is seen while it starts.
        allowed = os.sched_getaffinity(0)
        os.sched_setaffinity(0, {max(allowed)})
        jax.devices()
        os.sched_setaffinity(0, allowed)


def _warm(stage: AnyStage) -> None:
    """Compile and load whatever a run needs, on a stage that is thrown away."""
    stage.warm()
    for _ in range(_WARM_TICKS):
        stage.render(stage.tick())
        stage.emit(stage.next_ns)
