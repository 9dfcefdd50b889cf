"""Options of a search that several verbs share: checked in one place, told in the same words."""

from collections.abc import Mapping
from contextlib import nullcontext
from typing import TYPE_CHECKING

import numpy as np

from lgprjax.cli.errors import UsageError
from lgprjax.cli.progress import working

if TYPE_CHECKING:
    from lgprjax.archive import HeldGround
    from lgprjax.formats import MapFile
    from lgprjax.registration import RegisterOptions

_MOST_POINTS = 400
"""Of the search lattice to a side; memory and time grow with the square."""


def check_search(search_m: float | None, window_m: float | None, time_scale: float | str, risk: float) -> None:
    """Raise ``UsageError`` on a length, a scale or a risk that no search can have."""
    for name, value, least in (("--search-m", search_m, 1e-3), ("--window-m", window_m, 0.0)):
        if value is not None and not (np.isfinite(value) and least <= value <= 1e4):
            raise UsageError(f"{name}: expected a length in metres, found {value:g}")
    if not isinstance(time_scale, str) and not 0.5 <= time_scale <= 2.0:
        raise UsageError(f"--time-scale: expected auto or 0.5 to 2, found {time_scale:g}")
    if not 1e-9 <= risk <= 0.01:
        raise UsageError(f"--risk: expected a probability of 1e-9 to 0.01, found {risk:g}")


def check_region(search_m: float | None, source: "MapFile") -> None:
    """Raise ``UsageError`` on a region no wider than a match itself, which leaves no room for rivals that a fix is
    measured by, and on one whose lattice does not fit into memory."""
    from lgprjax.archive import lattice_points

    if search_m is None:
        return
    least_m = 0.9 * source.description.settings.wavelength_m
    if search_m < least_m:
        raise UsageError(f"--search-m: expected {least_m:.2g} or more on this map, found {search_m:g}")
    points = lattice_points(source, search_m)
    if points > _MOST_POINTS:
        most_m = search_m * _MOST_POINTS / points
        expected = f"at most about {most_m:.2g} on this map, {_MOST_POINTS} lattice points to a side"
        raise UsageError(f"--search-m: expected {expected}, found {search_m:g}, {points} points")


def hold_ground(source: "MapFile", options: "RegisterOptions") -> "HeldGround":
    """The map's ground for a search; says so where its noise floor has to be measured first."""
    from lgprjax.archive import MEASURING, HeldGround

    with working(MEASURING) if source.chance is None else nullcontext():
        return HeldGround(source, options)


def search_in_words(settings: Mapping[str, object]) -> str:
    """The search that drives were registered with, for a page: a line from the settings (``settings_of``)."""
    from lgprjax.registration import LADDER_M, PIECE_M

    search_m, window_m, scale = settings["search_m"], settings["window_m"], settings["time_scale"]
    lengths = ", ".join(f"{length:g}" for length in LADDER_M[1:])
    region = "within what the log states of its own position (2.5 m where it states nothing)"
    windows = f"the shortest window that reaches the risk, of a single scan, {lengths} m"
    parts = [
        f"Search: {region if search_m is None else f'{search_m:g} m to each side of the prior'}",
        windows if window_m is None else f"windows of {window_m:g} m" if window_m else "single scans",
        "time scale found along the drive" if scale is None else f"time scale {scale:g}",
    ]
    # Records of an older version in the same folder know of no risk.
    risk = settings.get("risk")
    judged = "fixed thresholds" if risk is None else f"risk {risk:g} in each {PIECE_M:g} m of travel"
    return "; ".join([*parts, "thresholds of one's own drives" if settings["own_thresholds"] else judged]) + "."
