"""A hundred thousand malformed messages at a display that runs."""

from collections.abc import Callable
from pathlib import Path

from validation.damage.bombardment import check_malformed


def test_malformed_messages(tmp_path: Path, record_property: Callable[[str, object], None]) -> None:
    for name, value in check_malformed(tmp_path, 100_000)._asdict().items():
        record_property(name, value)
