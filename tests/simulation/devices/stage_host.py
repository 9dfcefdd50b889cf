"""A host of the whole stage, in simulated time: commands at 50 Hz, everything that comes kept."""

import struct
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from lgprjax.frames import LocalFrame
from lgprjax.scene import SweepPlan
from lgprjax.simulation.devices.course_stage import CourseSpec, CourseStage
from lgprjax.simulation.devices.world import CourseWorld
from lgprjax.simulation.loop.off_road import OffRoad
from simulation.devices.host_frames import Status, Told, drive_command, host_frame, read_frame, read_status

FRAME = LocalFrame(latitude_deg=42.0, longitude_deg=-71.0, height_m=30.0)
COURSE = OffRoad(2, 60.0)
DRIVE_SEED = 102
BEGIN_NS = 7_000_000_000_000


def make_world(sweeps: SweepPlan | None = None) -> CourseWorld:
    """A course whose map's frame is the scene's."""
    return CourseWorld(replace(COURSE, sweeps=sweeps), FRAME, weather="clear", drive_seed=DRIVE_SEED)


class StageHost:
    """A stage and who commands it."""

    def __init__(self, world: CourseWorld, script: list[dict[str, Any]], faults: list[dict[str, Any]]) -> None:
        spec = CourseSpec(
            seed=COURSE.seed,
            length_m=COURSE.length_m,
            drive_seed=DRIVE_SEED,
            map="",
            ports="",
            truth="",
            script=script,
            faults=faults,
        )
        self.stage = CourseStage(spec, world, Path("spec.json"), BEGIN_NS)
        self.told: dict[str, list[bytes]] = {"drive_by_wire": [], "controller": [], "gnss": [], "radar": []}
        self.command: dict[str, float] = {"engage": 0}
        self.scans = False
        self._sequence = 0

    def run(self, seconds: float) -> None:
        """Let time pass."""
        stage = self.stage
        until_ns = stage.next_ns + round(1e9 * seconds)
        while stage.next_ns < until_ns:
            now_ns = stage.next_ns
            stage.receive("drive_by_wire", drive_command(self._sequence, now_ns, **self.command), now_ns)  # type: ignore[arg-type]
            self._sequence += 1
            tick = stage.tick()
            if self.scans:
                stage.render(tick)
            for line, data in stage.emit(stage.next_ns):
                self.told[line].append(data)

    def engage(self, **command: float) -> None:
        """Have the box hold steering and pedals at a command."""
        self.command = {"engage": 0}
        self.run(0.06)
        self.command = {"engage": 3, **command}

    def start_radar(self) -> None:
        """Have the radar scan, and the world rendered."""
        now_ns = self.stage.next_ns
        self.stage.receive("radar", host_frame(0x10, struct.pack("<BI", 1, 0), 0, now_ns), now_ns)
        self.scans = True

    def statuses(self) -> list[Status]:
        """All that the drive-by-wire box said."""
        return [read_status(data) for data in self.told["drive_by_wire"]]

    def frames(self, line: str, kind: int) -> list[Told]:
        """Frames of a kind on a line."""
        return [told for told in map(read_frame, self.told[line]) if told.kind == kind]

    def truth(self) -> dict[str, np.ndarray]:
        """How it truly was."""
        return self.stage.truth.arrays()
