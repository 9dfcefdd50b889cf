"""The truth of a run: how the vehicle really went, tick by tick."""

from pathlib import Path

import numpy as np
from jaxtyping import Float

from lgprjax.formats.atomic import atomic_output
from lgprjax.simulation.devices.drive_box import Command
from lgprjax.simulation.devices.trajectory import Sample
from lgprjax.simulation.devices.vehicle import Acting
from lgprjax.simulation.loop.tracking_error import cross_track_m

_COLUMNS = (
    "x_m",
    "y_m",
    "yaw_rad",
    "speed_mps",
    "front_rad",
    "rear_rad",
    "command_front_rad",
    "command_throttle",
    "command_brake",
    "engaged",
    "brake",
    "throttle",
)


class Truth:
    """Rows of a run, each of a tick's end.

    Args:
        rear_ratio: of the sound rear wheels.
        array_x_m: array ahead of the rear axle.
        baseline_m: true places of the baseline's anchor.
    """

    def __init__(self, rear_ratio: float, array_x_m: float, baseline_m: Float[np.ndarray, "point 2"]) -> None:
        self._ratio, self._array_x_m, self._baseline_m = rear_ratio, array_x_m, baseline_m
        self._times: list[int] = []
        self._rows: list[tuple[float, ...]] = []

    def add(self, time_ns: int, sample: Sample, acting: Acting, command: Command, held: int) -> None:
        """A tick's row."""
        sound = -self._ratio * sample.front_rad
        rear = sound if np.isnan(acting.rear_rad) else acting.rear_rad
        self._times.append(time_ns)
        self._rows.append(
            (
                sample.x_m,
                sample.y_m,
                sample.yaw_rad,
                sample.speed_mps,
                sample.front_rad,
                rear,
                command.front_rad,
                command.throttle,
                command.brake,
                float(held),
                acting.brake,
                acting.throttle,
            )
        )

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything by name: the columns, ``mono_ns``, ``cross_m`` of the array's centre, and ``baseline_m``."""
        table = np.array(self._rows, np.float64).reshape(-1, len(_COLUMNS))
        columns: dict[str, np.ndarray] = dict(zip(_COLUMNS, table.T, strict=True))
        columns["engaged"] = columns["engaged"].astype(np.uint8)
        yaw = columns["yaw_rad"]
        anchor = np.stack(
            [columns["x_m"] + self._array_x_m * np.cos(yaw), columns["y_m"] + self._array_x_m * np.sin(yaw)], axis=1
        )
        cross = cross_track_m(anchor, self._baseline_m)
        return {
            "mono_ns": np.array(self._times, np.int64),
            **columns,
            "cross_m": cross,
            "baseline_m": self._baseline_m,
        }

    def write(self, path: Path, figures: dict[str, float]) -> None:
        """Write a ``.npz`` of the arrays and of figures of the run.

        Raises:
            InputError: it cannot be written.
        """
        write_truth(path, self.arrays(), figures)


def write_truth(path: Path, arrays: dict[str, np.ndarray], figures: dict[str, float]) -> None:
    """Arrays by name, and figures as arrays of one number, as ``.npz``."""
    numbers = {name: np.asarray(value) for name, value in figures.items()}
    with atomic_output(path, force=True) as temporary, temporary.open("wb") as file:
        np.savez(file, allow_pickle=False, **arrays, **numbers)
