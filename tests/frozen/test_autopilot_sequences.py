"""The limiters and the mode machine do what they did, over long seeded sequences."""

import pytest

from frozen.autopilot_sequences import sequences
from frozen.harness import read_json


@pytest.fixture(scope="module")
def found() -> dict[str, object]:
    """Digests of now."""
    return sequences()


@pytest.mark.parametrize("which", ["limiter", "skid_limiter", "modes"])
def test_the_same_sequence_comes_out(which: str, found: dict[str, object]) -> None:
    assert found[which] == read_json("sequences.json")[which]
