"""The runner of validations: what there is, and which tests it need not repeat."""

import json
from pathlib import Path

import validation.__main__ as validations
from validation.__main__ import LONG, RUNTIME_TYPES, VALIDATIONS, results_in


def test_every_folder_is_a_validation() -> None:
    folders = {path.parent.name for path in (validations.ROOT / "validation").glob("*/test_*.py")}
    assert folders | {LONG, RUNTIME_TYPES} == VALIDATIONS.keys()


def test_the_last_whole_result_of_this_source_counts(tmp_path: Path) -> None:
    state = tmp_path / "worlds.jsonl"
    rows = [
        {"source": "now", "test": "a", "outcome": "failed", "seconds": 1.0},
        {"source": "now", "test": "a", "outcome": "passed", "seconds": 2.0},
        {"source": "before", "test": "b", "outcome": "passed", "seconds": 3.0},
        {"source": "now", "test": "c", "outcome": "passed", "seconds": 4.0},
    ]
    whole = "\n".join(json.dumps(row) for row in rows)
    # A run that was killed as it wrote, and the next one's first line.
    state.write_text(whole + json.dumps(rows[0])[:-9] + "\n" + json.dumps({**rows[0], "test": "d"}), encoding="utf-8")
    found = results_in(state, "now")
    assert {test: row["outcome"] for test, row in found.items()} == {"a": "passed", "d": "failed"}
    assert results_in(tmp_path / "none.jsonl", "now") == {}
