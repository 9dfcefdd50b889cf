"""What an importer made up because no instrument recorded it: ``assumed`` in the provenance of a drive log."""

from collections.abc import Mapping
from typing import Literal

Quantity = Literal[
    "time",
    "speed",
    "odometry",
    "position",
    "place on the earth",
    "heading",
    "direction",
    "roll",
    "height",
    "position sigma",
    "heading sigma",
]
"""What may be assumed: the clock of the scans; the speed along the way; travel; the path; where on the earth the path
lies; the heading along it; which of its ends is the first; roll; height; and what positions and headings may be wrong
by."""

Assumed = dict[Quantity, str]
"""What stands in for each, in words."""


def assumed_of(provenance: Mapping[str, object]) -> dict[str, str]:
    """What a drive log, or a baseline of a map, says was assumed; nothing where it does not say."""
    found = provenance.get("assumed")
    # Recordings that were imported before this vocabulary hold numbers here.
    return {str(k): v for k, v in found.items() if isinstance(v, str)} if isinstance(found, dict) else {}


def assumed_in_words(assumed: Mapping[str, str]) -> str:
    """Each quantity with what stands in for it, in a line."""
    return ", ".join(f"{name} ({words})" for name, words in assumed.items())
