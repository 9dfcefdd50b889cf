"""Settings of patterns: each out of its range is refused by name."""

import math
from dataclasses import replace
from typing import Any, cast

import pytest

from lgprjax.coverage import PatternSettings
from lgprjax.errors import InputError

FLAIL = PatternSettings(
    tool_width_m=1.2, overlap=0.1, order="zamboni", smallest_radius_m=1.5, turning_room_m=8.0, tool_ahead_m=1.0
)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("tool_width_m", 0.0, "a width above zero"),
        ("overlap", 1.0, "a fraction from 0 to below 1"),
        ("overlap", -0.1, "a fraction from 0 to below 1"),
        ("smallest_radius_m", 0.0, "a radius above zero"),
        ("turning_room_m", -1.0, "a distance of 0 or more"),
        ("tool_ahead_m", math.nan, "a number"),
        ("heading_rad", math.inf, "an angle"),
    ],
)
def test_settings_out_of_their_range_are_refused(name: str, value: float, expected: str) -> None:
    with pytest.raises(InputError, match=f"pattern: {name}: expected {expected}"):
        replace(FLAIL, **cast(Any, {name: value}))
