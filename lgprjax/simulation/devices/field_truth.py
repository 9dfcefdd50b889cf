"""The truth of a run in a field: how the vehicle and its tool really went, tick by tick."""

from pathlib import Path

import numpy as np

from lgprjax.simulation.devices.flail import FlailMoved
from lgprjax.simulation.devices.flail_tool import ToolState
from lgprjax.simulation.devices.skid_box import SkidCommand
from lgprjax.simulation.devices.truth import write_truth

_COLUMNS = (
    "x_m",
    "y_m",
    "yaw_rad",
    "speed_mps",
    "turns",
    "depth_m",
    "engaged",
    "command_left_mps",
    "command_right_mps",
    "gnss_on",
)


class FieldTruth:
    """Rows of a run, each of a tick's end."""

    def __init__(self) -> None:
        self._times: list[int] = []
        self._rows: list[tuple[float, ...]] = []

    def add(
        self, time_ns: int, moved: FlailMoved, tool: ToolState, command: SkidCommand, held: int, *, gnss_on: bool
    ) -> None:
        """A tick's row."""
        self._times.append(time_ns)
        self._rows.append(
            (
                moved.x_m,
                moved.y_m,
                moved.yaw_rad,
                moved.speed_mps,
                float(tool.turns),
                tool.depth_m,
                float(held),
                command.left_mps,
                command.right_mps,
                float(gnss_on),
            )
        )

    def arrays(self) -> dict[str, np.ndarray]:
        """Everything by name: the columns and ``mono_ns``."""
        table = np.array(self._rows, np.float64).reshape(-1, len(_COLUMNS))
        columns: dict[str, np.ndarray] = dict(zip(_COLUMNS, table.T, strict=True))
        return {"mono_ns": np.array(self._times, np.int64), **columns}

    def write(self, path: Path, figures: dict[str, float]) -> None:
        """Write a ``.npz`` of the arrays and of figures of the run.

        Raises:
            InputError: it cannot be written.
        """
        write_truth(path, self.arrays(), figures)
