"""Hand carts with GNSS alone: turns along arcs and on the spot, drop-outs, and the ground that is claimed."""

from collections.abc import Callable

import numpy as np
import pytest

from lgprjax.coverage import Tool
from lgprjax.navigation import SmoothedCart
from navigation.cart_drives import CartDrives, draw_cart_drives
from navigation.test_cart import MODEL, RUNS, SECONDS, judge, smoothed
from true_cells import claims_and_truth

TOOL = Tool(1.0, 0.3, 0.6, 0.0)


def claims(drives: CartDrives, found: SmoothedCart) -> np.ndarray:
    """Cells claimed, true and worked at 0.95 and 0.996 of three drives, held to their levels.

    The tool works all along, and counts where the heading is known.
    """
    always = np.ones(drives.truth.shape[1], bool)
    pose, covariance, known = (np.asarray(each) for each in found)
    counts: np.ndarray = np.sum(
        [claims_and_truth(TOOL, pose[run], covariance[run], known[run], drives.truth[run], always) for run in range(3)],
        axis=0,
    )
    for level, (claimed, true, worked) in zip((0.95, 0.996), counts, strict=True):
        assert true >= level * claimed
        assert claimed > 0.3 * worked
    return counts


@pytest.mark.parametrize(("on_the_spot", "off_s", "least"), [(False, 0.0, 0.7), (True, 0.0, 0.45), (False, 15.0, 0.45)])
def test_an_inch_and_a_degree(
    on_the_spot: bool, off_s: float, least: float, record_property: Callable[[str, object], None]
) -> None:
    drives = draw_cart_drives(runs=RUNS, seconds=SECONDS, seed=19, on_the_spot=on_the_spot, off_s=off_s)
    line = judge(drives, smoothed(MODEL, drives.fixes))
    assert line.known > least
    record_property("heading_deg", round(line.all.heading_deg, 2))
    record_property("heading_on_lines_deg", round(line.on_lines.heading_deg, 2))
    record_property("position_cm", round(100.0 * line.all.position_m, 1))
    record_property("nees", round(line.all.nees, 2))
    record_property("known_on_lines", round(line.known, 2))


@pytest.mark.parametrize("on_the_spot", [False, True])
def test_ground_claimed_was_passed(on_the_spot: bool, record_property: Callable[[str, object], None]) -> None:
    drives = draw_cart_drives(runs=RUNS, seconds=SECONDS, seed=23, on_the_spot=on_the_spot)
    counts = claims(drives, smoothed(MODEL, drives.fixes))
    for level, (claimed, true, worked) in zip((0.95, 0.996), counts, strict=True):
        record_property(f"{level:g}_true", round(true / claimed, 5))
        record_property(f"{level:g}_claimed_to_worked", round(claimed / worked, 3))
