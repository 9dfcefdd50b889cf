"""Coverage process: maintains the worked map from the control loop's rows, the tool's shape, and the marked corners.

It is outside the control loop: its results do not affect driving, and may be late. After a restart it resumes the map
of the last second; the recorder keeps the record itself.
"""

import csv
import json
import math
import signal
import time
from contextlib import suppress
from dataclasses import asdict
from typing import Any

import jax.numpy as jnp
import numpy as np

from lgprjax.coverage import CellGrid, CellState, Pattern, ToolMoment, cell_states, grid_of_field, inside_cells
from lgprjax.coverage.field import Field, offered_levels
from lgprjax.coverage.resume import place_of_tool
from lgprjax.coverage.shape import claimed_shape
from lgprjax.formats import read_cover_plan, read_vehicle
from lgprjax.recordings.vehicles import tool_of
from lgprjax.run_records import COVER, Record, RecordKind, Source, StopBits, ToolBits, pack, unpack
from lgprjax.runtime.choices import Choices
from lgprjax.runtime.control.skid.setup import PROGRESS_FILE, load_skid
from lgprjax.runtime.coverage.overview import plan_overview
from lgprjax.runtime.coverage.worked_map import OpenMap, WorkedMap, worked_runs
from lgprjax.runtime.process import ProcessStage, Started

CORNERS_FILE = "corners.csv"
"""File in the run's folder with the marked corners, in order."""
_COLUMNS = ("latitude_deg", "longitude_deg", "sigma_m", "height_m")
_IDLE_S = 0.02
_TELL_S, _SHAPE_S = 1.0, 0.2
_MOST_BLOCKS = 300
_SHARE = 4 << 10  # bytes of rows


class CoverageProcess:
    """The process's state and its loop.

    Args:
        started: arguments of the process.

    Raises:
        InputError: vehicle file or plan cannot be used.
    """

    def __init__(self, started: Started) -> None:
        assert started.config.coverage is not None
        self._started, self._table = started, started.config.coverage
        self._cover, self._worked = started.ring("cover"), started.ring("worked")
        self._kept = started.rings / "worked.npz"
        self._reported_s, self._reported_moments, self._shaped_s = 0.0, -1, 0.0
        self._ended = False
        self._worked_row: np.void | None = None
        self._newest: np.void | None = None
        self._level = Choices(started.rings).level or self._table.level
        signal.signal(signal.SIGTERM, self._end)
        started.beat(ProcessStage.WARMING)
        self._pattern: Pattern | None = None
        self._overview: dict[str, Any] | None = None
        self._map = self._open() if self._table.plan is None else self._open_field(self._table.plan)
        self._map.warm_up()
        self._shape(np.zeros(1, COVER)[0])
        with suppress(OSError, ValueError, KeyError), np.load(self._kept) as kept:
            self._map.take_up(CellGrid(**json.loads(str(kept["grid"]))), kept["probability"])

    def run(self) -> None:
        """Until SIGTERM."""
        while not self._ended:
            self._started.beat(ProcessStage.READY)
            # A few at a time: falling behind must not look like a hang.
            messages = self._cover.take(_SHARE)
            for message in messages:
                with suppress(ValueError):
                    self._take(unpack(message))
            self._tell()
            if not messages:
                time.sleep(_IDLE_S)

    def _open(self) -> OpenMap:
        """The map of ground without a plan."""
        path = self._started.config.path(self._started.config.vehicle)
        self._tool = tool_of(read_vehicle(path), path)
        return OpenMap(self._table.cell_m, self._tool, self._table.shared_sigma_m)

    def _open_field(self, plan: str) -> WorkedMap:
        config = self._started.config
        loaded = load_skid(config)
        field, self._tool = Field(loaded.perimeter_m), loaded.setup.tool
        grid = grid_of_field(field, self._table.cell_m, self._tool.width_m)
        self._inside = inside_cells(field, grid)
        self._pattern = loaded.pattern
        self._overview = plan_overview(read_cover_plan(config.path(plan)), self._table.speed_mps)
        opened = WorkedMap(grid, self._tool, self._table.shared_sigma_m)
        if loaded.taken_up is not None:
            with suppress(ValueError):
                opened.take_up(loaded.taken_up.grid, loaded.taken_up.probability)
        return opened

    def _take(self, record: Record) -> None:
        if record.kind is RecordKind.COVER:
            self._newest = cover = np.frombuffer(record.payload, COVER)[0]
            self._map.take(cover, record.mono_ns)
            if int(cover["tool"]) & ToolBits.COUNTS and int(cover["line"]) >= 0:
                self._worked_row = cover
        elif record.kind is RecordKind.CORNER:
            self._keep_corner(json.loads(record.payload))
        elif record.kind is RecordKind.EVENT and "level" in (told := json.loads(record.payload)):
            # The answer to a button: at once.
            self._level, self._reported_moments, self._reported_s, self._shaped_s = float(told["level"]), -1, 0.0, 0.0

    def _keep_corner(self, corner: dict[str, Any]) -> None:
        path = self._started.folder / CORNERS_FILE
        fresh = not path.exists()
        with path.open("a", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, _COLUMNS, extrasaction="ignore", lineterminator="\n")
            if fresh:
                writer.writeheader()
            writer.writerow(corner)

    def _tell(self) -> None:
        """Send to the display: the shape five times per second, the map once per second if something is new."""
        now_s = time.monotonic()
        held = self._map
        if self._newest is not None and now_s - self._shaped_s >= _SHAPE_S:
            self._shaped_s = now_s
            self._put(self._shape(self._newest))
        if now_s - self._reported_s < _TELL_S or held.moments == self._reported_moments:
            return
        self._reported_s, self._reported_moments = now_s, held.moments
        probability, grid = held.probability(), held.grid
        fresh = self._kept.with_name(f"{self._kept.name}.new")
        with suppress(OSError):
            with fresh.open("wb") as file:
                np.savez(file, probability=probability, grid=json.dumps(asdict(grid)))
            fresh.replace(self._kept)
        self._keep_place()
        worked = cell_states(probability, self._level) == CellState.PROCESSED
        inside = np.ones_like(worked) if self._pattern is None else self._inside
        side, runs = worked_runs(worked, inside, _MOST_BLOCKS)
        map_message: dict[str, Any] = {
            "east_m": grid.east_m,
            "north_m": grid.north_m,
            "block_m": side * grid.cell_m,
            "runs": runs,
            "level": self._level,
            "levels": offered_levels(self._table.level),
            "worked_m2": round(float(np.count_nonzero(worked & inside)) * grid.cell_m2, 2),
            "full": held.full,
            "plan": self._overview,
        }
        if self._pattern is not None:
            map_message["field_m2"] = round(float(np.count_nonzero(inside)) * grid.cell_m2, 2)
        self._put(map_message)

    def _shape(self, cover: np.void) -> dict[str, Any]:
        """The tool and its shape at the level, in body axes, for the errors of a row."""
        tool, known = self._tool, not int(cover["stop"]) & StopBits.HEADING
        x, y, yaw, covariance = (jnp.asarray(cover[name], jnp.float32) for name in ToolMoment._fields[:-1])
        moment = ToolMoment(x, y, yaw, covariance, jnp.asarray(known))
        shape = claimed_shape(tool, moment, jnp.float32(self._level), jnp.float32(self._table.shared_sigma_m))
        border = np.asarray(shape.border_m, np.float64)
        return {
            "shape": np.round(border, 3).tolist() if known and np.isfinite(border).all() else [],
            "tool": [tool.ahead_m, tool.left_m, 0.5 * tool.length_m, 0.5 * tool.width_m],
            "pass_m": [round(float(each), 3) for each in (shape.right_m, shape.left_m)] if known else [0.0, 0.0],
            "level": self._level,
            "sigma_m": _largest_sigma_m(np.asarray(cover["covariance"], np.float64), self._table.shared_sigma_m),
        }

    def _put(self, message: dict[str, Any]) -> None:
        payload = json.dumps(message).encode()
        self._worked.put(pack(Record(RecordKind.WORKED, Source.COVERAGE, 0, time.monotonic_ns(), payload)))

    def _keep_place(self) -> None:
        """The newest place that counted, for a control loop that is relaunched."""
        cover, pattern = self._worked_row, self._pattern
        if cover is None or pattern is None or not int(cover["line"]) < len(pattern.lines):
            return
        pose = (float(cover["x_m"]), float(cover["y_m"]), float(cover["yaw_rad"]))
        place = place_of_tool(pattern, self._tool, int(cover["line"]), pose)
        path = self._started.folder / PROGRESS_FILE
        fresh = path.with_name(f"{path.name}.new")
        with suppress(OSError):
            fresh.write_text(json.dumps({"line": place.line, "along_m": place.along_m}), encoding="utf-8")
            fresh.replace(path)

    def _end(self, *_: object) -> None:
        self._ended = True


def _largest_sigma_m(covariance: np.ndarray, shared_m: float) -> float | None:
    """Standard deviation of the position's larger axis, with the shared error, m; ``None`` if not finite."""
    place = covariance[:2, :2]
    if not np.isfinite(place).all():
        return None
    return round(math.sqrt(max(float(np.linalg.eigvalsh(place)[1]), 0.0) + shared_m**2), 4)


def run(started: Started) -> None:
    """The process."""
    CoverageProcess(started).run()
