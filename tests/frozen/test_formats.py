"""Files keep their structure: datasets, types, attributes, columns and keys, names and versions of their schemas."""

from pathlib import Path
from typing import Any

import pytest

from frozen.harness import read_json
from frozen.structure import FILES, messages_of, schema_digests, structure_of


@pytest.fixture(scope="module")
def held() -> dict[str, Any]:
    """Structures as they were."""
    found: dict[str, Any] = read_json("formats.json")
    return found


@pytest.mark.parametrize("kind", FILES)
def test_a_file_is_built_as_it_was(kind: str, made: Path, held: dict[str, Any]) -> None:
    assert structure_of(made / FILES[kind]) == held[kind]


def test_messages_are_of_the_same_types(made: Path) -> None:
    assert messages_of(made / "live.mcap") == read_json("messages.json")


def test_the_schema_is_the_same() -> None:
    assert schema_digests() == read_json("schemas.json")
