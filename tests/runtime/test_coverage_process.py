"""The coverage process: cells of the rows that count and of no others, corners in their file, a map after a death."""

import json
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canon.field import make_field
from lgprjax.coverage.pattern import driving_time_s
from lgprjax.coverage.resume import line_arcs_m, place_of_tool, resume_place
from lgprjax.formats.coverage_files import read_cover_plan, read_field
from lgprjax.run_records import COVER, Record, RecordKind, Source, pack, unpack
from lgprjax.runtime.config import read_config
from lgprjax.runtime.control.skid.setup import load_skid, place_after_death
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


def cover_record(number: int, *, counts: bool) -> bytes:
    """A moment of a line along the field's middle, eastwards."""
    row = np.zeros((), COVER)
    row["x_m"], row["y_m"] = -1.5 + 0.1 * SPEED_MPS * number, 3.0
    row["covariance"] = np.diag([1e-4, 1e-4, 1e-6])
    row["speed_mps"], row["tool"] = SPEED_MPS, 15 if counts else 7
    return pack(Record(RecordKind.COVER, Source.CONTROL, number, 1_000_000_000 + number * 100_000_000, row.tobytes()))


def corner_record(number: int) -> bytes:
    corner = {
        "corner": number, "latitude_deg": 48.0 + 1e-4 * (number // 2), "longitude_deg": 11.0 + 1e-4 * (number % 2),
        "height_m": 500.0, "sigma_m": 0.02, "yaw_rad": 0.1,
    }  # fmt: skip
    return pack(Record(RecordKind.CORNER, Source.CONTROL, number, 5_000_000_000 + number, json.dumps(corner).encode()))


@contextmanager
def process(folder: Path, run: Path) -> Iterator[tuple[Ring, Ring]]:
    """The process at work on rings of its own."""
    rings = run / "rings"
    rings.mkdir(parents=True, exist_ok=True)
    cover, worked = (Ring.create(rings / name, RINGS[name]) for name in ("cover", "worked"))
    held = CoverageProcess(Started("coverage", read_config(folder / "small.run.toml"), rings, run, False))
    thread = threading.Thread(target=held.run)
    thread.start()
    try:
        yield cover, worked
    finally:
        held._end()
        thread.join(20.0)


def told(worked: Ring, until: float = 20.0) -> dict[str, Any]:
    """The newest map after the process has taken everything."""
    newest: dict[str, Any] = {}
    begun_s, quiet_s = time.monotonic(), time.monotonic()
    while time.monotonic() - begun_s < until and time.monotonic() - quiet_s < 2.5:
        message = worked.latest()
        if message is not None:
            newest, quiet_s = json.loads(unpack(message).payload), time.monotonic()
        time.sleep(0.05)
    return newest


def test_what_counts_is_worked_and_nothing_else(folder: Path, tmp_path: Path) -> None:
    with process(folder, tmp_path) as (cover, worked):
        for number in range(160):
            cover.put(cover_record(number, counts=False))
        shown = told(worked)
        assert shown["worked_m2"] == 0.0
        # The page shows what will be driven before it is.
        plan = read_cover_plan(folder / "small.cover.geojson").pattern
        first = plan.lines[0]
        assert len(shown["plan"]["swaths"]) == len(plan.lines)
        assert shown["plan"]["swaths"][0] == pytest.approx([*first.start_m, *first.end_m], abs=0.006)
        assert shown["plan"]["time_s"] == pytest.approx(driving_time_s(plan, SPEED_MPS), abs=1.0)
        for number in range(160, 320):
            moved = np.frombuffer(unpack(cover_record(number - 160, counts=True)).payload, COVER)[0]
            record = Record(
                RecordKind.COVER, Source.CONTROL, number, 1_000_000_000 + number * 100_000_000, moved.tobytes()
            )
            cover.put(pack(record))
        found = told(worked)
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
    # Another one takes the map up.
    with process(folder, tmp_path) as (cover, worked):
        cover.put(cover_record(400, counts=False))
        assert told(worked)["worked_m2"] == found["worked_m2"]
    # 8 m of way carry a tool of 1.2 m, its centre 1.2 m ahead; two sigmas of a side and the ends are not claimed.
    assert 6.0 * 1.1 < found["worked_m2"] < 8.1 * 1.2
    assert found["field_m2"] == pytest.approx(72.0, rel=0.01)


def test_nothing_is_claimed_across_rows_that_were_lost(folder: Path, tmp_path: Path) -> None:
    areas = []
    for name, lost in (("whole", range(0)), ("holed", range(70, 90))):
        with process(folder, tmp_path / name) as (cover, worked):
            for number in range(160):
                if number not in lost:
                    cover.put(cover_record(number, counts=True))
            areas.append(told(worked)["worked_m2"])
    # 1.05 m from row to row, of which the tool stood over 0.3 m; ends that are not claimed come on top.
    assert 0.75 * 1.1 < areas[0] - areas[1] < 1.1 * 1.2


def test_corners_make_a_file_that_a_plan_can_be_made_from(folder: Path, tmp_path: Path) -> None:
    with process(folder, tmp_path) as (cover, _):
        for number in (1, 2, 3):
            cover.put(corner_record(number))
        begun_s, file = time.monotonic(), tmp_path / "corners.csv"
        while time.monotonic() - begun_s < 10.0 and not (file.exists() and len(file.read_text().splitlines()) == 4):
            time.sleep(0.05)
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
