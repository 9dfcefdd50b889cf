"""Hand carts with GNSS alone: turns along arcs and on the spot, drop-outs, and the ground that is claimed."""

from collections.abc import Callable

import numpy as np
import pytest

from lgprjax.coverage import Tool
from lgprjax.frames import along_cross
from lgprjax.navigation import SmoothedCart
from navigation.cart_drives import CartDrives, draw_cart_drives
from navigation.test_cart import MODEL, RUNS, SECONDS, judge, late_drives, live, smoothed, told
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


@pytest.mark.parametrize(
    ("fix_sigma_m", "seed", "on_the_spot", "off_s"),
    [
        (0.02, 19, False, 0.0),
        (0.02, 101, True, 0.0),
        (0.02, 2003, False, 15.0),
        (0.006, 40_009, False, 0.0),
        (0.03, 7, True, 15.0),
    ],
)
def test_live_and_a_few_seconds_late(
    fix_sigma_m: float, seed: int, on_the_spot: bool, off_s: float, record_property: Callable[[str, object], None]
) -> None:
    """Receivers, turns and seeds far apart: what is mapped is as good as what is smoothed, and as honest."""
    drives = draw_cart_drives(
        runs=RUNS, seconds=SECONDS, seed=seed, on_the_spot=on_the_spot, off_s=off_s, fix_sigma_m=fix_sigma_m
    )
    now, late, ticks = live(MODEL, drives)
    for name, drives_, found in (("live", drives, now), ("mapped", late_drives(drives, ticks), late)):
        line = told(drives_.truth, found, drives_.on_line)
        whole = told(drives_.truth, found, np.ones_like(drives_.on_line))
        yaw = drives_.truth[np.asarray(found.known) & drives_.on_line][:, 2]
        _, across = along_cross(line.error[:, 0], line.error[:, 1], yaw)
        far = float(np.mean(whole.error[:, 2] ** 2 > 16.0 * whole.covariance[:, 2, 2]))
        record_property(f"{name}_heading_deg", round(line.heading_deg, 2))
        record_property(f"{name}_position_cm", round(100.0 * line.position_m, 1))
        record_property(f"{name}_across_cm", round(100.0 * float(np.sqrt(np.mean(across**2))), 1))
        record_property(f"{name}_nees", round(whole.nees, 2))
        record_property(f"{name}_beyond_four_sigmas", round(far, 4))
        record_property(f"{name}_known_on_lines", round(float(np.mean(np.asarray(found.known)[drives_.on_line])), 2))
        if name == "mapped":
            assert 0.5 < whole.nees < 1.2
            assert far < 2e-3
            assert line.heading_deg < 1.2 * max(1.0, fix_sigma_m / 0.02)
            assert line.position_m < 0.0254 * max(1.0, fix_sigma_m / 0.02) * 1.1


@pytest.mark.parametrize("on_the_spot", [False, True])
def test_ground_claimed_was_passed(on_the_spot: bool, record_property: Callable[[str, object], None]) -> None:
    drives = draw_cart_drives(runs=RUNS, seconds=SECONDS, seed=23, on_the_spot=on_the_spot)
    counts = claims(drives, smoothed(MODEL, drives.fixes))
    for level, (claimed, true, worked) in zip((0.95, 0.996), counts, strict=True):
        record_property(f"{level:g}_true", round(true / claimed, 5))
        record_property(f"{level:g}_claimed_to_worked", round(claimed / worked, 3))


def test_live_a_few_seconds_late_it_is_an_inch_and_a_degree() -> None:
    """And of turns on the spot nothing is told, though the newest heading is wrong until the stop is noticed."""
    drives = draw_cart_drives(runs=12, seconds=250.0, seed=19, on_the_spot=True)
    now, late, ticks = live(MODEL, drives)
    line = judge(late_drives(drives, ticks), late)
    assert line.known > 0.4
    newest = told(drives.truth, now, np.ones_like(drives.on_line))
    assert np.mean(newest.error[:, 2] ** 2 > 16.0 * newest.covariance[:, 2, 2]) > 5e-3
    assert newest.heading_deg > 2.0 * line.all.heading_deg
