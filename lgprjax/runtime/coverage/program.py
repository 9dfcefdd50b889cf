"""The coverage process: keeps the worked map from the control loop's rows, and the list of marked corners.

It is outside the control loop: its results do not affect driving, and may be late. After a restart it resumes the map
of the last second; the record itself is kept by the recorder.
"""

import csv
import json
import signal
import time
from contextlib import suppress
from typing import Any

import numpy as np

from lgprjax.coverage import CellState, cell_states, grid_of_field, inside_cells
from lgprjax.coverage.field import Field
from lgprjax.coverage.resume import place_of_tool
from lgprjax.formats import read_cover_plan
from lgprjax.run_records import COVER, Record, RecordKind, Source, ToolBits, pack, unpack
from lgprjax.runtime.control.skid.setup import PROGRESS_FILE, SkidLoaded, load_skid
from lgprjax.runtime.coverage.overview import plan_overview
from lgprjax.runtime.coverage.worked_map import WorkedMap, worked_runs
from lgprjax.runtime.process import ProcessStage, Started

CORNERS_FILE = "corners.csv"
"""In the run's folder: the marked corners, in order."""
_COLUMNS = ("latitude_deg", "longitude_deg", "sigma_m", "height_m")
_IDLE_S = 0.02
_TELL_S = 1.0
_MOST_BLOCKS = 300
_SHARE = 4 << 10  # bytes of rows


class CoverageProcess:
    """The process's state and its loop.

    Args:
        started: of the process.

    Raises:
        InputError: vehicle file or plan cannot be used.
    """

    def __init__(self, started: Started) -> None:
        assert started.config.coverage is not None
        self._started, self._table = started, started.config.coverage
        self._cover, self._worked = started.ring("cover"), started.ring("worked")
        self._kept = started.rings / "worked.npy"
        self._reported_s, self._reported_moments = 0.0, -1
        self._ended = False
        self._newest: np.void | None = None
        signal.signal(signal.SIGTERM, self._end)
        started.beat(ProcessStage.WARMING)
        loaded = load_skid(started.config)
        self._overview = None if loaded.name is None else self._look()
        self._map = None if loaded.name is None else self._open(loaded)

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

    def _open(self, loaded: SkidLoaded) -> WorkedMap:
        field, tool = Field(loaded.perimeter_m), loaded.setup.tool
        self._grid = grid_of_field(field, self._table.cell_m, tool.width_m)
        self._inside = inside_cells(field, self._grid)
        self._pattern, self._tool = loaded.pattern, tool
        opened = WorkedMap(self._grid, tool, self._table.shared_sigma_m)
        opened.warm_up()
        if loaded.taken_up is not None and loaded.taken_up.grid == self._grid:
            opened.take_up(loaded.taken_up.probability)
        with suppress(OSError, ValueError):
            opened.take_up(np.load(self._kept))
        return opened

    def _look(self) -> dict[str, Any]:
        assert self._table.plan is not None
        return plan_overview(read_cover_plan(self._started.config.path(self._table.plan)), self._table.speed_mps)

    def _take(self, record: Record) -> None:
        if record.kind is RecordKind.COVER and self._map is not None:
            cover = np.frombuffer(record.payload, COVER)[0]
            self._map.take(cover, record.mono_ns)
            if int(cover["tool"]) & ToolBits.COUNTS and int(cover["line"]) >= 0:
                self._newest = cover
        elif record.kind is RecordKind.CORNER:
            self._keep_corner(json.loads(record.payload))

    def _keep_corner(self, corner: dict[str, Any]) -> None:
        path = self._started.folder / CORNERS_FILE
        fresh = not path.exists()
        with path.open("a", encoding="utf-8", newline="") as file:
            writer = csv.DictWriter(file, _COLUMNS, extrasaction="ignore", lineterminator="\n")
            if fresh:
                writer.writeheader()
            writer.writerow(corner)

    def _tell(self) -> None:
        """To the display, once a second if something is new."""
        now_s = time.monotonic()
        held = self._map
        if held is None or now_s - self._reported_s < _TELL_S or held.moments == self._reported_moments:
            return
        self._reported_s, self._reported_moments = now_s, held.moments
        probability = held.probability()
        fresh = self._kept.with_name(f"{self._kept.name}.new")
        with suppress(OSError):
            with fresh.open("wb") as file:
                np.save(file, probability)
            fresh.replace(self._kept)
        self._keep_place()
        worked = cell_states(probability, self._table.level) == CellState.PROCESSED
        side, runs = worked_runs(worked, self._inside, _MOST_BLOCKS)
        grid = self._grid
        map_message = {
            "east_m": grid.east_m,
            "north_m": grid.north_m,
            "block_m": side * grid.cell_m,
            "runs": runs,
            "level": self._table.level,
            "worked_m2": round(float(np.count_nonzero(worked & self._inside)) * grid.cell_m2, 2),
            "field_m2": round(float(np.count_nonzero(self._inside)) * grid.cell_m2, 2),
            "plan": self._overview,
        }
        self._worked.put(
            pack(Record(RecordKind.WORKED, Source.COVERAGE, 0, time.monotonic_ns(), json.dumps(map_message).encode()))
        )

    def _keep_place(self) -> None:
        """The newest place that counted, for a control loop that is relaunched."""
        cover, pattern = self._newest, self._pattern
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


def run(started: Started) -> None:
    """The process."""
    CoverageProcess(started).run()
