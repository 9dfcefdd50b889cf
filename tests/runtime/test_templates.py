"""The templates of a radar driver, a drive-by-wire box and a controller, as somebody would run them, on real ports."""

import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from lgprjax.formats import SweepRecording, complex_rows
from lgprjax.run_records import Source
from lgprjax.runtime.port import Port
from lgprjax.runtime.registration.scans import RadarSelf, SweepDescription
from lgprjax.wire import Frame, Sender, draw_session
from runtime.swept_log import write_swept_log

ROOT = Path(__file__).resolve().parents[2]
TEMPLATES = ROOT / "onboard" / "templates"
_CHANNELS, _STEPS, _SCANS = 3, 21, 40


class Host:
    """The runtime's end of a line to a template."""

    def __init__(self, process: subprocess.Popen[str], line: str) -> None:
        self.process = process
        assert process.stdout is not None
        self.port: Port[Frame] = Port.frames(Source[line.upper()], process.stdout.readline().strip(), 921600, line)
        self._sender = Sender(draw_session())
        self.frames: list[Frame] = []

    def send(self, name: str, ttl_ms: int = 0, **fields: float) -> None:
        self.port.write(self._sender.frame(name, fields, mode=3, mono_ns=time.monotonic_ns(), ttl_ms=ttl_ms))

    def until(
        self, holds: Callable[[Frame], bool], seconds: float = 30.0, every: Callable[[], Any] = lambda: None
    ) -> Frame:
        """The first frame for which something holds; ``every`` is called every 20 ms meanwhile."""
        end_s = time.monotonic() + seconds
        while time.monotonic() < end_s:
            every()
            came = [arrival.item for arrival in self.port.take()]
            self.frames += came
            for frame in came:
                if holds(frame):
                    return frame
            time.sleep(0.02)
        raise AssertionError(f"not within {seconds} s; last: {[(f.name, f.fields) for f in self.frames[-3:]]}"[:2000])


@contextmanager
def started(template: str, line: str, *arguments: str) -> Iterator[Host]:
    """A template in a process of its own, and the host connected to it."""
    command = [sys.executable, str(TEMPLATES / template), "0", *arguments]
    with ExitStack() as held:
        process = held.enter_context(
            subprocess.Popen(command, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
        )
        held.callback(process.kill)
        host = Host(process, line)
        held.callback(host.port.close)
        yield host


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, np.ndarray]:
    """A drive log of sweeps, and what is in it: channels, then the calibration channel."""
    rng = np.random.default_rng(3)
    rows = (rng.normal(size=(_SCANS, _CHANNELS + 1, _STEPS, 2)) @ [1.0, 1.0j]).astype(np.complex64)
    recording = SweepRecording(
        1e8 + 5e6 * np.arange(_STEPS), rows[0, :-1] * 0.1, rows[0, -1] + 3.0, group_delay_ns=12.0
    )
    path = tmp_path_factory.mktemp("swept") / "swept.drive.h5"
    write_swept_log(path, rows[:, :-1], rows[:, -1], recording)
    return path, rows


def test_a_radar_driver_describes_itself_and_streams_its_sweeps(recorded: tuple[Path, np.ndarray]) -> None:
    path, rows = recorded
    with started("radar_driver.py", "radar", str(path)) as host:
        said = RadarSelf()

        def complete(frame: Frame) -> bool:
            if frame.name != "radar_health":
                said.take(frame)
            return said.complete

        host.until(complete)
        assert said.description == SweepDescription(_CHANNELS, _STEPS, 1e8, 5e6, 12.0, 0.007937)
        assert said.lookup is not None
        np.testing.assert_array_equal(said.lookup.sweeps, rows[0, :-1] * np.float32(0.1))
        assert not any(frame.name == "radar_sweep" for frame in host.frames)
        host.send("radar_command", action=1, scan_period_us=0)
        host.until(lambda frame: frame.name == "radar_sweep" and frame.number("scan") == 30)
        sweeps = [frame for frame in host.frames if frame.name == "radar_sweep"]
        assert [int(frame.number("scan")) for frame in sweeps[:31]] == list(range(31))
        for frame, wanted in zip(sweeps, rows, strict=False):
            np.testing.assert_array_equal(complex_rows(frame), wanted)
            assert int(frame.number("valid")) == (1 << _CHANNELS) - 1
        steps_us = np.diff([frame.stamp_us for frame in sweeps])
        assert np.abs(steps_us - 1e6 / 126.0).max() <= 1.0
        host.send("radar_command", action=0, scan_period_us=0)
        host.until(lambda frame: frame.name == "radar_health" and frame.number("state") == 0)


def test_a_drive_by_wire_box_obeys_and_goes_to_its_defaults() -> None:
    with started("drive_by_wire_box.py", "drive_by_wire") as host:

        def command(engage: int, **numbers: float) -> None:
            fields = {"front_rad": 0.0, "throttle": 0.0, "brake": 0.0, **numbers}
            host.send("drive_command", 200, engage=engage, **fields)

        host.until(lambda frame: bool(int(frame.number("state")) & 1))
        host.send("drive_test", test=1)
        host.until(lambda frame: bool(int(frame.number("state")) & 128))
        # Engage without a command of engage 0 before it has no effect.
        for _ in range(5):
            command(3, throttle=0.5)
            time.sleep(0.02)
        assert not int(host.until(lambda _: True).number("engaged"))
        host.until(lambda frame: not int(frame.number("state")) & 1, every=lambda: command(0))
        moving = host.until(
            lambda frame: frame.number("speed_mps") > 0.3 and frame.number("potentiometer_v") > 2.6,
            every=lambda: command(3, throttle=0.5, front_rad=0.3),
        )
        assert int(moving.number("engaged")) == 3
        # Nobody speaks to it any more: defaults, and the brake because it rolls.
        alone = host.until(lambda frame: bool(int(frame.number("state")) & 1) and frame.number("brake") > 0.4)
        assert int(alone.number("engaged")) == 0
        assert alone.number("throttle") == 0.0
        host.until(lambda frame: frame.number("speed_mps") == 0.0)
        host.until(lambda frame: int(frame.number("engaged")) == 4, every=lambda: command(4))


def test_a_controller_tells_its_buttons_and_shows_its_light() -> None:
    with started("controller.py", "controller") as host:
        host.until(lambda frame: int(frame.number("buttons")) == 2)
        assert host.process.stdin is not None
        assert host.process.stdout is not None
        host.process.stdin.write("steering 0.3\n")
        host.process.stdin.flush()
        host.until(lambda frame: int(frame.number("buttons")) == 2 | 8)
        host.until(lambda frame: int(frame.number("buttons")) == 2)
        host.process.stdin.write("override 0.3\n")
        host.process.stdin.flush()
        host.until(lambda frame: int(frame.number("buttons")) == 1)
        host.send("controller_light", 500, light=1)
        assert host.process.stdout.readline().strip() != ""
