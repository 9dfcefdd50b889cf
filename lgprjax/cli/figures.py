"""Figures as JSON, for further computation."""

import json
from pathlib import Path

from lgprjax.formats import atomic_output


def write_figures(path: Path, figures: object, *, force: bool) -> None:
    """Write figures to a JSON file. Raises ``InputError`` if it exists (without ``force``) or cannot be written."""
    with atomic_output(path, force) as temporary:
        temporary.write_text(json.dumps(figures, indent=2) + "\n", encoding="utf-8")
