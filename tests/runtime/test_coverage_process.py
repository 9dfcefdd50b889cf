"""The coverage process: cells of the rows that count and of no others, corners in their file, a map after a death."""

import json
import math
import signal
import time
from collections.abc import Iterable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from canon.field import make_field
from lgprjax.coverage.pattern import driving_time_s
from lgprjax.coverage.resume import line_arcs_m, place_of_tool, resume_place
from lgprjax.formats.coverage_files import read_cover_plan
from lgprjax.formats.field_files import read_field
from lgprjax.run_records import COVER, Record, RecordKind, Source, StopBits, pack, unpack
from lgprjax.runtime.choices import Choices
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.skid.setup import load_skid, place_after_death
from lgprjax.runtime.coverage import program
from lgprjax.runtime.coverage.program import CoverageProcess
from lgprjax.runtime.coverage.worked_map import worked_runs
from lgprjax.runtime.process import RINGS, Started
from lgprjax.runtime.ring import Ring

SPEED_MPS = 0.5


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Field, plan and configuration."""
    made = tmp_path_factory.mktemp("field")
    make_field(made)
    return made


def cover_record(number: int, *, counts: bool, tick: int | None = None) -> bytes:
    """A moment of a line along the field's middle, eastwards; ``tick`` where it is not its number."""
    row = np.zeros((), COVER)
    row["x_m"], row["y_m"] = -1.5 + 0.1 * SPEED_MPS * number, 3.0
    row["covariance"] = np.diag([1e-4, 1e-4, 1e-6])
    row["speed_mps"], row["tool"] = SPEED_MPS, 15 if counts else 7
    at = number if tick is None else tick
    return pack(Record(RecordKind.COVER, Source.CONTROL, at, 1_000_000_000 + at * 100_000_000, row.tobytes()))


def corner_record(number: int) -> bytes:
    corner = {
        "corner": number, "latitude_deg": 48.0 + 1e-4 * (number // 2), "longitude_deg": 11.0 + 1e-4 * (number % 2),
        "height_m": 500.0, "sigma_m": 0.02, "yaw_rad": 0.1,
    }  # fmt: skip
    return pack(Record(RecordKind.CORNER, Source.CONTROL, number, 5_000_000_000 + number, json.dumps(corner).encode()))


class Process:
    """The process at work on rings of its own, until it has nothing to do."""

    def __init__(
        self, folder: Path, run: Path, monkeypatch: pytest.MonkeyPatch, config: str = "small.run.toml"
    ) -> None:
        rings = run / "rings"
        rings.mkdir(parents=True, exist_ok=True)
        self.cover, self._worked = (Ring.create(rings / name, RINGS[name]) for name in ("cover", "worked"))
        monkeypatch.setattr(signal, "signal", lambda *_: None)
        self.shapes: list[dict[str, Any]] = []
        self._held = CoverageProcess(Started("coverage", read_config(folder / config), rings, run, False))
        # Told whenever there is something new, not once a second; idle, it ends.
        monkeypatch.setattr(program, "_TELL_S", 0.0)

        def end(_: float) -> None:
            self._held._ended = True

        clock = SimpleNamespace(monotonic=time.monotonic, monotonic_ns=time.monotonic_ns, sleep=end)
        monkeypatch.setattr(program, "time", clock)

    def told(self, records: Iterable[bytes]) -> dict[str, Any]:
        """The newest map after the process has taken these."""
        for record in records:
            assert self.cover.put(record)
        self._held._ended = False
        self._held.run()
        found = [json.loads(unpack(message).payload) for message in self._worked.take()]
        maps = [each for each in found if "shape" not in each]
        self.shapes = [each for each in found if "shape" in each]
        newest: dict[str, Any] = maps[-1]
        return newest


def test_what_counts_is_worked_and_nothing_else(folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    process = Process(folder, tmp_path, monkeypatch)
    shown = process.told(cover_record(number, counts=False) for number in range(160))
    assert shown["worked_m2"] == 0.0
    # The page shows what will be driven before it is.
    plan = read_cover_plan(folder / "small.cover.geojson").pattern
    first = plan.lines[0]
    assert len(shown["plan"]["swaths"]) == len(plan.lines)
    assert shown["plan"]["swaths"][0] == pytest.approx([*first.start_m, *first.end_m], abs=0.006)
    assert shown["plan"]["time_s"] == pytest.approx(driving_time_s(plan, SPEED_MPS), abs=1.0)
    found = process.told(cover_record(number, counts=True, tick=number + 160) for number in range(160))
    # 8 m of way carry a tool of 1.2 m, its centre 1.2 m ahead; two sigmas of a side and the ends are not claimed.
    assert 6.0 * 1.1 < found["worked_m2"] < 8.1 * 1.2
    assert found["field_m2"] == pytest.approx(72.0, rel=0.01)
    loaded = load_skid(read_config(folder / "small.run.toml"))
    assert loaded.pattern is not None
    # A control loop that is relaunched goes on a little before the newest place, not at the plan's start.
    place = place_after_death(tmp_path, loaded.pattern)
    newest = place_of_tool(loaded.pattern, loaded.setup.tool, 0, (-1.5 + 0.1 * SPEED_MPS * 159, 3.0, 0.0))
    assert place is not None
    assert place == resume_place(loaded.pattern, newest)
    assert place_after_death(tmp_path / "elsewhere", loaded.pattern) is None
    again = load_skid(read_config(folder / "small.run.toml"), place)
    begun_m = line_arcs_m(loaded.pattern)[place.line] + place.along_m
    assert float(loaded.route.length_m) - float(again.route.length_m) == pytest.approx(begun_m, abs=0.06)
    # Another process takes the map up.
    second = Process(folder, tmp_path, monkeypatch)
    assert second.told([cover_record(400, counts=False)])["worked_m2"] == found["worked_m2"]


def chosen(level: float) -> bytes:
    event = json.dumps({"level": level}).encode()
    return pack(Record(RecordKind.EVENT, Source.CONTROL, 3, 4_000_000_000, event))


def test_without_a_plan_the_ground_is_shown_at_the_level_chosen(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    process = Process(folder, tmp_path, monkeypatch, "corners.run.toml")
    rows = [cover_record(number, counts=True) for number in range(160)]
    usual = process.told(rows)
    assert 6.0 * 1.1 < usual["worked_m2"] < 8.1 * 1.2
    assert (usual["level"], usual["plan"], usual["full"]) == (0.95, None, False)
    assert "field_m2" not in usual
    (shape,) = process.shapes[-1:]
    # The map is told once a second, a chosen level at once; the area is less, and so is the tool's shape.
    monkeypatch.setattr(program, "_TELL_S", 60.0)
    surer = process.told([chosen(0.996)])
    assert surer["level"] == 0.996
    assert surer["worked_m2"] < usual["worked_m2"] - 0.5
    wide, narrow = (max(left for _, left in each["shape"] or [[0, 0]]) for each in (shape, process.shapes[-1]))
    assert 0.5 < wide < 0.6
    assert narrow < wide - 0.03
    # What it shows outlives it: the cells, and the level, which the control process has kept.
    Choices(tmp_path / "rings").keep([unpack(chosen(0.996))])
    again = Process(folder, tmp_path, monkeypatch, "corners.run.toml").told([cover_record(400, counts=False)])
    assert (again["level"], again["worked_m2"]) == (0.996, surer["worked_m2"])


def test_no_shape_is_shown_while_the_heading_is_unknown(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    process = Process(folder, tmp_path, monkeypatch, "corners.run.toml")
    record = unpack(cover_record(1, counts=False))
    row = np.frombuffer(record.payload, COVER)[0].copy()
    row["stop"] = StopBits.HEADING
    process.told([pack(record._replace(payload=row.tobytes()))])
    shape = process.shapes[-1]
    assert (shape["shape"], shape["pass_m"]) == ([], [0.0, 0.0])
    assert shape["sigma_m"] == pytest.approx(math.hypot(0.01, 0.05), abs=1e-4)


def test_nothing_is_claimed_across_rows_that_were_lost(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    areas = []
    for name, lost in (("whole", range(0)), ("holed", range(70, 90))):
        process = Process(folder, tmp_path / name, monkeypatch)
        kept = (cover_record(number, counts=True) for number in range(160) if number not in lost)
        areas.append(process.told(kept)["worked_m2"])
    # 1.05 m from row to row, of which the tool stood over 0.3 m; ends that are not claimed come on top.
    assert 0.75 * 1.1 < areas[0] - areas[1] < 1.1 * 1.2


def test_corners_make_a_file_that_a_plan_can_be_made_from(
    folder: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Process(folder, tmp_path, monkeypatch).told(corner_record(number) for number in (1, 2, 3))
    places = read_field(tmp_path)
    assert places.driven
    assert places.latitude_deg.tolist() == pytest.approx([48.0, 48.0001, 48.0001])


def test_blocks_of_the_picture_claim_no_more_than_the_cells() -> None:
    inside = np.zeros((7, 9), bool)
    inside[1:6, 1:8] = True
    worked = inside.copy()
    worked[3, 4] = False
    side, runs = worked_runs(worked, inside, 5)
    assert side == 2
    shown = np.zeros((4, 5), bool)
    for row, first, count in runs:
        shown[row, first : first + count] = True
    assert not shown[1, 2]
    assert shown[1, 1]
    assert worked_runs(worked, inside, 100)[0] == 1
    assert sum(count for _, _, count in worked_runs(worked, inside, 100)[1]) == worked.sum()
