"""Swaths of gaps drawn by kind: how much longer they are than area by spacing, and than a bound."""

from collections.abc import Callable

import numpy as np
import pytest

from validation.fields.drawn_gaps import KINDS
from validation.fields.gap_plans import MOST_OVER_BOUND, MOST_RATIO, drawn_lengths


@pytest.mark.parametrize("kind", KINDS)
def test_swaths_of_many_drawn(kind: str, record_property: Callable[[str, object], None]) -> None:
    found = drawn_lengths(kind, range(100, 106), 50.0, 40.0)
    (median, over), (worst, worst_over) = np.median(found[:, :2], axis=0), found[:, :2].max(axis=0)
    record_property(
        kind,
        f"{median:.2f} ({worst:.2f} at most) of area by spacing, {over:.2f} ({worst_over:.2f}) of the bound; "
        f"{found[:, 2].sum():.0f} lines, way {found[:, 3].sum():.0f} m",
    )
    assert median <= MOST_RATIO[kind]
    assert over <= MOST_OVER_BOUND[kind]


def test_swaths_of_a_hectare_with_26_regions(record_property: Callable[[str, object], None]) -> None:
    found = drawn_lengths("rectangles", range(3), 100.0, 100.0)
    record_property("of area by spacing, of the bound, lines, way m", np.round(found, 2).tolist())
    assert np.all(found[:, 0] <= 1.4)
    assert np.all(found[:, 1] <= 1.3)
