"""Every benchmark starts and ends, on few repetitions, as a person starts it."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path

import pytest

from benchmarks.__main__ import _BENCHMARKS

ROOT = Path(__file__).resolve().parents[2]


@pytest.mark.parametrize("name", sorted(_BENCHMARKS))
def test_a_quick_run_ends_and_writes_its_figures(
    name: str, tmp_path: Path, record_property: Callable[[str, object], None]
) -> None:
    """What does not run is told and fails here; goals are not judged."""
    out, scratch = tmp_path / "figures.json", tmp_path / "scratch"
    scratch.mkdir()
    done = subprocess.run(
        [sys.executable, "-m", "benchmarks", name, "--quick", "--json", str(out)],
        cwd=ROOT,
        env={**os.environ, "TMPDIR": str(scratch)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stdout + done.stderr
    figures = json.loads(out.read_text(encoding="utf-8"))
    assert figures["not_measured"] == []
    assert figures["quick"] is True
    values = {record["key"]: record["value"] for record in figures["records"]}
    assert values
    assert any(value is not None for value in values.values())
    # Nothing of it is left.
    assert list(scratch.iterdir()) == []
    for key, value in values.items():
        record_property(key, value)
