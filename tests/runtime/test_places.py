"""Routes that pass a place several times: the operator chooses, the choice is kept, nothing goes the wrong way.

Every place of both routes: ``validation/vehicles/test_rtk.py``.
"""

import json
from pathlib import Path

import pytest

from lgprjax.autopilot import Mode
from lgprjax.run_records import Record, RecordKind, Source
from lgprjax.runtime.choices import Choices
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.core import ControlCore
from lgprjax.runtime.control.places import Place, same_place
from lgprjax.simulation.devices.world import CourseWorld
from runtime.overlapping import LANE_M, Overlapping, drive_overlapping, of_shape


@pytest.mark.parametrize(
    ("shape", "number", "by_buttons"),
    [("out and back", 0, False), ("out and back", 1, True), ("eight", 1, False)],
    ids=["out", "back", "second passage"],
)
def test_the_chosen_place_is_driven_to_the_end_and_never_the_wrong_way(
    world: CourseWorld, config: RuntimeConfig, tmp_path: Path, shape: str, number: int, by_buttons: bool
) -> None:
    driven = drive_overlapping(world, of_shape(world, config, tmp_path, shape), number, by_buttons=by_buttons)
    driven.check()


def test_a_relaunched_control_process_begins_at_the_place_that_was_driven(
    world: CourseWorld, config: RuntimeConfig, tmp_path: Path
) -> None:
    made: Overlapping = of_shape(world, config, tmp_path, "eight")
    loop = made.loop(world)
    assert loop.run(30.0, until=lambda at: len(at.kind.pilot.places) == 3)
    rings, chosen = tmp_path / "rings", sorted(loop.kind.pilot.places, key=lambda place: place.at_m)[1]
    rings.mkdir()
    selected = Choices(rings)
    asked = json.dumps({"select_route": "lane.route.toml", "place": chosen.words}).encode()
    loop._came.append(Record(RecordKind.REQUEST, Source.DISPLAY, 0, loop._now_ns, asked))
    out: list[Record] = []
    step = loop.core.step

    def noted(tick: int, now_ns: int, came: list[Record]) -> list[Record]:
        found = step(tick, now_ns, came)
        out.extend(found)
        return found

    loop.core.step = noted  # type: ignore[method-assign]
    loop.run(4.0)
    for record in out:
        selected.keep([record])
    notes = [json.loads(record.payload) for record in out if record.kind is RecordKind.EVENT]
    assert {"route": "lane.route.toml", "place": chosen.words} in notes
    assert [note.keys() == {"place"} for note in notes].count(True) == 1

    # Of the new process, with the vehicle's lines as they are; what the old one knew is gone.
    again = selected.again()
    told = json.loads(again[0].payload)
    assert abs(float(told["place"].split()[0]) - loop.kind.pilot.place.at_m) < 4.0  # type: ignore[union-attr]
    loop.core = ControlCore(made.config, made.loaded, session=79, after_death=True)
    loop._came.extend(again)
    assert loop.run(8.0, until=lambda at: at.kind.pilot.on_route)
    place = loop.kind.pilot.place
    assert place is not None
    assert chosen.at_m - 1.0 < place.at_m < chosen.at_m + LANE_M
    assert loop.mode is Mode.ERROR


def test_a_known_place_is_taken_only_without_doubt() -> None:
    places = [Place(0, 12.0, 1), Place(1, 150.0, 1), Place(2, 12.4, -1)]
    assert same_place(places, Place(-1, 14.0, 1)) == places[0]
    assert same_place(places, Place(-1, 140.0, 1)) == places[1]
    assert same_place(places, Place(-1, 14.0, -1)) == places[2]
    assert same_place(places, Place(-1, 40.0, 1)) is None
    assert same_place(places, None) is None
    # To either side of a cusp.
    assert same_place([Place(0, 30.0, 1), Place(1, 31.0, 1)], Place(-1, 30.4, 1)) is None
    assert Place.of_words(places[2].words) == Place(-1, 12.4, -1)
    assert [Place.of_words(words) for words in ("", "12 m along", "12.0 m", "nan m along")] == [None] * 4
