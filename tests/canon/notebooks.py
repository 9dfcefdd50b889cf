"""Notebooks as they are kept, and run from what a clone has."""

import os
import shutil
from pathlib import Path
from typing import Any

import nbformat
import pytest
from nbclient import NotebookClient

import lgprjax

ROOT = Path(__file__).parents[2]


def read_notebook(name: str) -> Any:
    """Its cells and kept outputs."""
    return nbformat.read(ROOT / "notebooks" / f"{name}.ipynb", as_version=4)  # type: ignore[no-untyped-call]


def run_notebook(name: str, clone: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Path, str]:
    """Run a notebook in a copy of what a clone has; the folder that it writes to, and what it printed."""
    # The kernel finds the package that these tests found, however it is installed.
    monkeypatch.setenv("PYTHONPATH", str(Path(lgprjax.__file__).parents[1]))
    if os.environ.get("LGPRJAX_TEST_CACHE"):
        monkeypatch.setenv("JAX_COMPILATION_CACHE_DIR", os.environ["LGPRJAX_TEST_CACHE"])
    for folder in ("notebooks", "tuning", "onboard"):
        shutil.copytree(ROOT / folder, clone / folder)
    book = read_notebook(name)
    NotebookClient(book, timeout=300, resources={"metadata": {"path": str(clone / "notebooks")}}).execute()
    printed = [output.get("text", "") for cell in book.cells for output in cell.get("outputs", [])]
    return clone / "out" / "notebooks" / name, "".join(printed)
