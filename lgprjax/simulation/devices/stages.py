"""Stages for the devices' program: a course with a radar, or a field with a tool, as a spec asks for."""

from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple, Protocol

from lgprjax.formats import MapFile
from lgprjax.simulation.devices.field_stage import FieldStage, is_field_spec, read_field_spec
from lgprjax.simulation.devices.stage import Stage, read_spec
from lgprjax.simulation.devices.world import CourseWorld
from lgprjax.simulation.loop.off_road import OffRoad


class StageTruth(Protocol):
    """The truth of a run."""

    def write(self, path: Path, figures: dict[str, float]) -> None:
        """Write it with figures of the run."""


class AnyStage(Protocol):
    """Devices and their world; times are nanoseconds of the world's clock.

    Attributes:
        latest_s: how late what was sent at the worst, by its name.
    """

    latest_s: dict[str, float]

    @property
    def truth(self) -> StageTruth:
        """How it truly went."""

    @property
    def next_ns(self) -> int:
        """When the next tick begins."""

    def warm(self) -> None:
        """Make the first ticks compile whatever a run needs."""

    def tick(self) -> Any:
        """Move the vehicle by a tick."""

    def render(self, tick: Any) -> None:
        """Record a tick's scans."""

    def skip(self, tick: Any) -> int:
        """Leave a tick's scans out, and say how many they are."""

    def renew(self) -> None:
        """Another host has connected to the radar."""

    def receive(self, line: str, data: bytes, now_ns: int) -> None:
        """The host's bytes on a line."""

    def emit(self, now_ns: int) -> list[tuple[str, bytes]]:
        """What the devices send by now."""


StageMaker = Callable[[int], AnyStage]
"""A stage that begins at a time of the world's clock."""


class Opened(NamedTuple):
    """A spec, opened: its stage, the world's rate, and where addresses and truth go."""

    make: StageMaker
    rate: float
    ports: Path
    truth: Path


def open_spec(file: Path) -> Opened:
    """What a spec asks for.

    Raises:
        InputError: it cannot be used.
    """
    if is_field_spec(file):
        field = read_field_spec(file)
        ports, truth = Path(field.ports), Path(field.truth)
        return Opened(lambda begin_ns: FieldStage(field, file, begin_ns), field.rate, ports, truth)
    spec = read_spec(file)
    with MapFile.open(spec.map) as opened:
        local = opened.description.frame
    course = OffRoad(spec.seed, spec.length_m, spec.scan_share)
    world = CourseWorld(course, local, weather=spec.weather, drive_seed=spec.drive_seed)
    return Opened(lambda begin_ns: Stage(spec, world, file, begin_ns), spec.rate, Path(spec.ports), Path(spec.truth))
