"""Places of the route at the vehicle, of which the operator chooses one where the route passes more than once."""

import re
from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.navigation import RoutePath

_SAME_M, APART_M, _AHEAD_M = 15.0, 2.0, 60.0
"""Largest distance of a known place from its last position, least excess distance of other places, and distance shown
ahead, m."""


class Place(NamedTuple):
    """A place of a route: its number in the search, metres from the route's start, 1 along the route or -1 against."""

    number: int
    at_m: float
    travel: int

    @property
    def words(self) -> str:
        """Name of the place for operator, request and recording."""
        return f"{self.at_m:.1f} m {'along' if self.travel > 0 else 'against'}"

    @classmethod
    def of_words(cls, words: str) -> "Place | None":
        """The place of a name; ``None`` if it is none."""
        found = re.fullmatch(r"(\d{1,7}\.\d) m (along|against)", words)
        return None if found is None else cls(-1, float(found[1]), 1 if found[2] == "along" else -1)


def same_place(places: Sequence[Place], known: Place | None) -> Place | None:
    """The one of several places that is a known one, whose vehicle has moved a little; ``None`` in doubt."""
    alike = [place for place in places if known is not None and place.travel == known.travel]
    away = sorted((abs(place.at_m - known.at_m), place) for place in alike) if known is not None else []
    if not away or away[0][0] > _SAME_M or (len(away) > 1 and away[1][0] - away[0][0] < APART_M):
        return None
    return away[0][1]


class RouteLine(NamedTuple):
    """A route as points from its start: metres, and x and y."""

    at_m: Float[np.ndarray, " point"]
    points_m: Float[np.ndarray, "point 2"]

    def ahead(self, place: Place) -> dict[str, Any]:
        """Distance to go from a place, and where it leads."""
        length_m = float(self.at_m[-1])
        at = place.at_m + place.travel * np.arange(0.0, _AHEAD_M + 1.0, 2.0)
        rows = np.searchsorted(self.at_m, at[(at >= 0.0) & (at <= length_m)]).clip(0, len(self.at_m) - 1)
        to_go_m = length_m - place.at_m if place.travel > 0 else place.at_m
        return {"to_go_m": to_go_m, "ahead": self.points_m[rows].round(2).tolist()}


def line_of(path: RoutePath | None) -> RouteLine | None:
    """A route as points; ``None`` of one that cannot be driven."""
    if path is None:
        return None
    legs = [np.asarray(each, np.float64) for each in (path.legs.rows, path.legs.length_m, path.legs.spacing_m)]
    at, points, start_m = [], [], 0.0
    for rows, length_m, spacing_m in zip(*(each[: int(path.leg_count)] for each in legs), strict=True):
        count = round(length_m / spacing_m) + 1
        at.append(start_m + spacing_m * np.arange(count))
        points.append(rows[1 : count + 1, :2])
        start_m += length_m
    return RouteLine(np.concatenate(at), np.concatenate(points))


def starts_of(path: RoutePath | None) -> Float[np.ndarray, " leg"]:
    """Metres from a route's start to the start of each leg."""
    lengths = np.zeros(1) if path is None else np.asarray(path.legs.length_m, np.float64)
    return np.concatenate([[0.0], np.cumsum(lengths)])
