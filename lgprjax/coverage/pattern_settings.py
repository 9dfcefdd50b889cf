"""What a coverage pattern is made of: tool, overlap, order of the lines, the vehicle's circle and the room to turn."""

import math
from dataclasses import dataclass
from typing import Literal

from lgprjax.errors import InputError


@dataclass(frozen=True)
class PatternSettings:
    """Settings of a coverage pattern.

    Attributes:
        tool_width_m: across the line.
        overlap: least share of the tool's width that neighbouring lines both work, from 0 to below 1.
        order: of the lines: ``zamboni`` joins the first to the middle one and drifts on (MF section 2), all turns to
            one hand; ``boustrophedon`` takes each next to the last.
        smallest_radius_m: of the circles that the vehicle's reference point drives.
        turning_room_m: how far beyond the perimeter the reference point may go.
        tool_ahead_m: from the reference point to the tool's centre, forward; negative for a tool behind.
        tool_left_m: the same to the left.
        heading_rad: of the first line, counter-clockwise from east; ``None``: that of the field's first side.

    Raises:
        InputError: a value that is no number or out of its range.
    """

    tool_width_m: float
    overlap: float
    order: Literal["zamboni", "boustrophedon"]
    smallest_radius_m: float
    turning_room_m: float
    tool_ahead_m: float
    tool_left_m: float = 0.0
    heading_rad: float | None = None

    def __post_init__(self) -> None:
        if self.order not in ("zamboni", "boustrophedon"):
            raise InputError("pattern", "order", "zamboni or boustrophedon", str(self.order))
        ranges = (
            ("tool_width_m", "a width above zero", self.tool_width_m > 0.0),
            ("overlap", "a fraction from 0 to below 1", 0.0 <= self.overlap < 1.0),
            ("smallest_radius_m", "a radius above zero", self.smallest_radius_m > 0.0),
            ("turning_room_m", "a distance of 0 or more", self.turning_room_m >= 0.0),
            ("tool_ahead_m", "a number", True),
            ("tool_left_m", "a number", True),
            ("heading_rad", "an angle", True),
        )
        for name, expected, fits in ranges:
            value = getattr(self, name)
            if value is not None and not (fits and math.isfinite(value)):
                raise InputError("pattern", name, expected, f"{value:g}")
