"""Options of a search that several verbs share, checked in one place."""

from typing import TYPE_CHECKING

import numpy as np

from lgprjax.cli.errors import UsageError

if TYPE_CHECKING:
    from lgprjax.formats import MapFile


def check_search(search_m: float, window_m: float, time_scale: float | str) -> None:
    """Raise ``UsageError`` on a length or a scale that no search can have."""
    for name, value, least in (("--search-m", search_m, 1e-3), ("--window-m", window_m, 0.0)):
        if not (np.isfinite(value) and least <= value <= 1e4):
            raise UsageError(f"{name}: expected a length in metres, found {value:g}")
    if not isinstance(time_scale, str) and not 0.5 <= time_scale <= 2.0:
        raise UsageError(f"--time-scale: expected auto or 0.5 to 2, found {time_scale:g}")


def check_region(search_m: float, source: "MapFile") -> None:
    """Raise ``UsageError`` on a region no wider than a match itself: no room for rivals that a fix is measured by."""
    least_m = 0.9 * source.description.settings.wavelength_m
    if search_m < least_m:
        raise UsageError(f"--search-m: expected {least_m:.2g} or more on this map, found {search_m:g}")
