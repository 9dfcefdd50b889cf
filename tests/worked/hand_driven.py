"""A field worked by remote control without a plan, in the closed loop: driven, recorded, and what was true."""

import json
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from canon.field import make_field
from canon.field_loop import FieldLoop
from drawn_field import write_cover_run
from lgprjax.coverage import CellGrid
from lgprjax.frames import LocalFrame, body_to_local
from lgprjax.runtime.config import RuntimeConfig, read_config
from lgprjax.runtime.control.program import header_record
from lgprjax.runtime.control.skid.setup import SkidLoaded, load_skid

DEPTH_M, SPACING_M = 0.15, 0.96


class HandDriven(NamedTuple):
    """Swaths to and fro; the run is in ``folder``/``name``."""

    config: RuntimeConfig
    loaded: SkidLoaded
    loop: FieldLoop
    run: Path
    anchor: LocalFrame

    def truth(self) -> tuple[Float[np.ndarray, "tick 3"], Bool[np.ndarray, " tick"]]:
        """True poses in the run's frame, and whether the tool worked."""
        told = self.loop.stage.truth.arrays()
        latitude, longitude, height = self.loop.stage._frame.to_geodetic(
            told["x_m"], told["y_m"], np.zeros_like(told["x_m"])
        )
        east, north, _ = self.anchor.to_local(latitude, longitude, height)
        works = (told["turns"] > 0.5) & (np.abs(told["depth_m"] - DEPTH_M) < 0.03)
        # The frames' anchors are metres apart: their axes differ by less than a microradian.
        return np.stack([east, north, told["yaw_rad"]], axis=1), works

    def middle_claimed(self, grid: CellGrid, claimed: Bool[np.ndarray, "north east"]) -> float:
        """Share of the way of the tool's middle, while it worked, that a map claims."""
        tool = self.loaded.setup.tool
        poses, works = self.truth()
        east, north, yaw = poses[works].T
        x, y = body_to_local(east, north, yaw, tool.ahead_m, tool.left_m)
        row = np.floor((y - grid.north_m) / grid.cell_m).astype(int)
        column = np.floor((x - grid.east_m) / grid.cell_m).astype(int)
        there = (row >= 0) & (row < grid.north_cells) & (column >= 0) & (column < grid.east_cells)
        return float(np.mean(there & claimed[np.where(there, row, 0), np.where(there, column, 0)]))


def drive_by_hand(
    folder: Path,
    *,
    swaths: int = 2,
    length_m: float = 6.0,
    speed_mps: float = 0.45,
    seed: int = 2,
    faults: list[dict[str, Any]] | None = None,
) -> HandDriven:
    """Straight to the first swath, then swaths to and fro at a set speed, with the tool on."""
    make_field(folder)
    config = read_config(folder / "corners.run.toml")
    loaded = load_skid(config)
    ends = (0.0, length_m)
    script: list[dict[str, Any]] = []
    for line in range(swaths):
        first, last = ends[line % 2], ends[(line + 1) % 2]
        y = 1.0 + line * SPACING_M
        script.append({"at_s": 0.2, "do": "drive_to", "x_m": first, "y_m": y, "speed_mps": 0.7})
        work = {"do": "work_to", "x_m": last, "y_m": y, "speed_mps": speed_mps, "tool_m": DEPTH_M}
        script.append({"at_s": 0.2, **work})
    loop = FieldLoop(config, loaded, (-6.0, 0.9, 0.0), script, faults or [], seed=seed)
    most_s = 60.0 + swaths * (length_m / speed_mps + 25.0)
    assert loop.run(most_s, until=lambda each: each.stage.operator.arrivals == len(script)), loop.events
    events = [json.loads(text) for _, text in loop.events]
    (anchor,) = (event["anchor"] for event in events if "anchor" in event)
    rows, times_ns = (np.array(part) for part in ([row for _, row in loop.covers], [at for at, _ in loop.covers]))
    header = header_record(config, loaded, 77, int(times_ns[0]), after_death=False)
    run = folder / "run"
    time_s = 1e-9 * (times_ns - times_ns[0])
    write_cover_run(run, rows, time_s, header=json.loads(header.payload), anchor=anchor, begin_s=float(seed))
    return HandDriven(config, loaded, loop, run, LocalFrame(*anchor))
