"""Records: goals met in the right direction, tables that hold every figure, JSON that any reader takes."""

import json

import pytest

from benchmarks import Record, markdown_table, records_as_json, text_table

HIGHER = Record("success", 99.2, "%", "higher", 99.0, "912 problems")
LOWER = Record("single", 0.51, "ms", "lower", 0.5)
TOLD = Record("swarm | ring", 3.1, "ms", "lower")


@pytest.mark.parametrize(
    ("record", "met"),
    [
        (HIGHER, True),
        (LOWER, False),
        (TOLD, None),
        (Record("on the goal", 0.5, "ms", "lower", 0.5), True),
        (Record("just below", 98.99, "%", "higher", 99.0), False),
        (Record("nothing ran", float("nan"), "ms", "lower", 1.0), False),
        (Record("nothing ran", float("nan"), "%", "higher", 1.0), False),
    ],
)
def test_met_follows_the_direction(record: Record, met: bool | None) -> None:
    assert record.met is met


def test_text_table_aligns_its_columns() -> None:
    lines = text_table([HIGHER, LOWER, TOLD]).splitlines()
    starts = {line.index(unit) for line, unit in zip(lines, ("unit", "%", "ms", "ms"), strict=True)}
    assert len(starts) == 1
    assert lines[1].split() == ["success", "99.2", "%", "≥", "99", "yes", "912", "problems"]
    assert lines[2].split() == ["single", "0.51", "ms", "≤", "0.5", "no"]


def test_markdown_table_escapes_what_would_break_a_row() -> None:
    lines = markdown_table([HIGHER, TOLD]).splitlines()
    assert lines[1] == "| --- | --- | --- | --- | --- | --- |"
    assert lines[3] == "| swarm \\| ring | 3.1 | ms |  |  |  |"


def test_json_keeps_the_fields_and_writes_null_for_no_number() -> None:
    rows = json.loads(records_as_json([LOWER, Record("none", float("nan"), "ms", "lower", 1.0)]))
    assert rows[0] == {
        **{"key": "single", "value": 0.51, "unit": "ms", "direction": "lower", "goal": 0.5, "note": ""},
        "met": False,
    }
    assert rows[1]["value"] is None
    assert rows[1]["met"] is False
