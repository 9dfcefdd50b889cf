"""Records: goals met in the right direction, tables that hold every figure, JSON that any reader takes."""

import json
from dataclasses import replace

from benchmarks import PeerResult, Record, markdown_table, records_as_json, text_table
from benchmarks.process import results_as_json

NAN = float("nan")
HIGHER = Record("success", 99.2, "%", "higher", 99.0, "912 problems")
LOWER = Record("single", 0.51, "ms", "lower", 0.5)
TOLD = Record("swarm | ring", 3.1, "ms", "lower")


def test_met_follows_the_direction() -> None:
    for record, met in (
        (HIGHER, True),
        (LOWER, False),
        (TOLD, None),
        (Record("on the goal", 0.5, "ms", "lower", 0.5), True),
        (Record("just below", 98.99, "%", "higher", 99.0), False),
        (Record("nothing ran", NAN, "ms", "lower", 1.0), False),
        (Record("nothing ran", NAN, "%", "higher", 1.0), False),
    ):
        assert record.met is met, record


def test_tables_hold_every_figure() -> None:
    lines = text_table([HIGHER, LOWER, TOLD]).splitlines()
    starts = {line.index(unit) for line, unit in zip(lines, ("unit", "%", "ms", "ms"), strict=True)}
    assert len(starts) == 1
    assert lines[1].split() == ["success", "99.2", "%", "≥", "99", "yes", "912", "problems"]
    assert lines[2].split() == ["single", "0.51", "ms", "≤", "0.5", "no"]
    # What would break a row is escaped.
    lines = markdown_table([HIGHER, TOLD, LOWER]).splitlines()
    assert lines[4] == "| single | 0.51 | ms | ≤ 0.5 | **no** |  |"
    assert lines[3] == "| swarm \\| ring | 3.1 | ms |  |  |  |"


def test_json_keeps_the_fields_and_writes_null_for_no_number() -> None:
    rows = json.loads(records_as_json([LOWER, Record("none", NAN, "ms", "lower", 1.0)]))
    fields = {"key": "single", "value": 0.51, "unit": "ms", "direction": "lower", "goal": 0.5, "note": ""}
    assert rows[0] == {**fields, "met": False}
    assert rows[1]["value"] is None
    assert rows[1]["met"] is False
    ran = PeerResult("a", "band 2x3", 4, 3, 0.01, 1.5, 0.5, 8, 0.0, 90.0, 1, 2)
    rows = json.loads(results_as_json([ran, replace(ran, single_ms=NAN, missing="no numba")]))
    assert [row["single_ms"] for row in rows] == [1.5, None]
    assert rows[1]["missing"] == "no numba"
