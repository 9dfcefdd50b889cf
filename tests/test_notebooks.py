"""The notebooks: short, with their outputs kept, each beside the same as a script.

One is run here, all of them by ``make validation NAME=notebooks``.
"""

import re
from pathlib import Path

import jupytext
import pytest

from canon.notebooks import ROOT, read_notebook, run_notebook

_NOTEBOOKS = sorted(path.stem for path in (ROOT / "notebooks").glob("*.ipynb"))
_ZOOMED = ("first_registration", "own_radar")


@pytest.mark.parametrize("name", _NOTEBOOKS)
def test_a_notebook_is_short_keeps_its_pictures_and_has_its_script_beside_it(name: str) -> None:
    book = read_notebook(name)
    script = jupytext.read(ROOT / "notebooks" / f"{name}.py")
    assert [(cell.cell_type, cell.source) for cell in script.cells] == [
        (cell.cell_type, cell.source) for cell in book.cells
    ]
    code = [cell for cell in book.cells if cell.cell_type == "code"]
    assert len(book.cells) <= 20
    assert max(len(cell.source.splitlines()) for cell in code) <= 35
    outputs = [output for cell in code for output in cell.outputs]
    assert any("image/png" in output.get("data", {}) for output in outputs)
    assert not [output for output in outputs if output.output_type == "error" or output.get("name") == "stderr"]
    assert [cell.execution_count for cell in code] == list(range(1, 1 + len(code)))
    # No one's folders, and public names only.
    source = "\n".join(cell.source for cell in book.cells)
    assert not re.search(r"[\"'(\s]/(home|tmp|work|root|Users)", source + str(outputs))
    assert not re.search(r"(import|\.) _", source)
    # ``lx`` is enough, but where files are made up that a person has.
    assert bool(re.search(r"from lgprjax", source)) == (name in ("coverage_record", "own_radar"))
    assert (name in _ZOOMED) == any(
        "<iframe srcdoc=" in output.get("data", {}).get("text/html", "") for output in outputs
    )
    assert (ROOT / "notebooks" / f"{name}.ipynb").stat().st_size < 1.5e6
    # Each has a test of what it finds.
    assert f'"{name}", tmp_path' in (ROOT / "validation/notebooks/test_notebooks.py").read_text(encoding="utf-8")


def test_the_faults_of_the_drive_are_found(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The cheapest: a kernel, a clone, what it prints."""
    _, printed = run_notebook("drive_health", tmp_path, monkeypatch)
    assert "sound: 1819 scans, 65 m: good" in printed
    for name in ("dropped_scans", "dead_channels", "odometer_scale"):
        assert f"faulty: bad: {name}" in printed
    assert "sound: bad" not in printed
