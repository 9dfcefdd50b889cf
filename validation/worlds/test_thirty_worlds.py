"""What a registration with defaults only must show on worlds that nobody tuned to, and on two small ones.

The worlds are drawn far apart and committed; ``python -m validation.worlds.table`` prints all figures. The limits
are those that the project set itself before the worlds were drawn.
"""

import json
import os
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path

import pytest

from validation.worlds.figures import DayFigures, pooled_nees, world_figures
from validation.worlds.parameters import World, read_worlds
from validation.worlds.small import SMALL_WORLDS
from validation.worlds.table import NEES_DAYS, all_figures

ARRAY_CHANNELS = 6
# Share of scans that must be ok: all arrays together, and the worst of them.
ARRAY_SHARES = {
    "clear": (0.99, 0.95),
    "clear_beside": (0.99, 0.95),
    "snow": (0.99, 0.95),
    "rain": (0.95, 0.85),
    "gps_jump": (0.95, 0.0),
    "gps_jump_chords": (0.95, 0.0),
}
FEW_CHANNELS_SHARE = 0.80
Told = Callable[[str, object], None]


@pytest.fixture(scope="module")
def thirty(tmp_path_factory: pytest.TempPathFactory) -> list[DayFigures]:
    """Figures of all days of all worlds. Those of a validation stay, so that an interrupted one can be resumed."""
    state = os.environ.get("LGPRJAX_VALIDATION")
    folder = (
        tmp_path_factory.mktemp("worlds")
        if state is None
        else Path(state).with_suffix("") / os.environ["LGPRJAX_VALIDATION_SOURCE"]
    )
    folder.mkdir(parents=True, exist_ok=True)

    def file(number: int) -> Path:
        return folder / f"{number}.json"

    worlds = read_worlds()
    for rows in all_figures([world for world in worlds if not file(world.number).exists()]):
        part = file(rows[0].world).with_suffix(".part")
        part.write_text(json.dumps([asdict(row) for row in rows]), encoding="utf-8")
        part.replace(file(rows[0].world))
    known = [json.loads(file(world.number).read_text(encoding="utf-8")) for world in worlds]
    return [DayFigures(**row) for rows in known for row in rows]


def of_day(rows: list[DayFigures], day: str, few: bool) -> list[DayFigures]:
    """Worlds of arrays, or of few channels, mapped finely enough."""
    return [row for row in rows if row.day == day and not row.beyond and (row.channels < ARRAY_CHANNELS) == few]


@pytest.mark.parametrize("day", ARRAY_SHARES)
def test_arrays_are_located(thirty: list[DayFigures], day: str, record_property: Told) -> None:
    rows = of_day(thirty, day, few=False)
    assert len(rows) == 20
    together, worst = ARRAY_SHARES[day]
    share = sum(row.ok for row in rows) / sum(row.scans for row in rows)
    lowest = min(rows, key=lambda row: row.ok_share)
    record_property("ok_share", share)
    record_property("lowest_ok_share", lowest.ok_share)
    assert share >= together
    assert lowest.ok_share >= worst, f"world {lowest.world}"


@pytest.mark.parametrize("day", ["clear", "clear_beside", "snow", "rain"])
def test_few_channels_are_located(thirty: list[DayFigures], day: str, record_property: Told) -> None:
    rows = of_day(thirty, day, few=True)
    assert len(rows) == 10
    share = sum(row.ok for row in rows) / sum(row.scans for row in rows)
    record_property("ok_share", share)
    assert share >= FEW_CHANNELS_SHARE


def test_no_fix_is_wrong(thirty: list[DayFigures], record_property: Told) -> None:
    """On any day of any world, impostors, look-alikes and jumps of the GNSS among them, however coarse the map."""
    assert {row.world for row in thirty} == {world.number for world in read_worlds()}
    record_property("scans", sum(row.scans for row in thirty))
    record_property("wrong", sum(row.wrong for row in thirty))
    assert [(row.world, row.day, row.wrong) for row in thirty if row.wrong] == []


def test_errors_are_as_the_covariance_says(thirty: list[DayFigures], record_property: Told) -> None:
    own = [row for row in thirty if row.day in NEES_DAYS and not row.beyond]
    record_property("nees", pooled_nees(own).mean)
    assert 0.8 <= pooled_nees(own).mean <= 1.25
    outside = {}
    for number in sorted({row.world for row in own}):
        nees = pooled_nees([row for row in own if row.world == number])
        assert nees.pieces >= 50, f"world {number}"
        if not nees.low <= nees.mean <= nees.high:
            outside[number] = nees
    assert outside == {}


@pytest.mark.parametrize("world", SMALL_WORLDS, ids=["array", "two-channels"])
def test_a_small_world_is_located_and_its_impostor_is_not(world: World) -> None:
    rows = {row.day: row for row in world_figures(world, ["clear", "snow", "impostor"])}
    least = 0.9 if world.channels >= ARRAY_CHANNELS else FEW_CHANNELS_SHARE
    for day in ("clear", "snow"):
        assert rows[day].scans > 100
        assert rows[day].ok_share >= least, day
        assert rows[day].wrong == 0, day
    assert rows["impostor"].scans > 100
    assert rows["impostor"].ok == 0
