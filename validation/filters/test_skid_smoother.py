"""Drop-outs of GNSS, short and long: what the smoothed estimate tells of them and of the area worked."""

from collections.abc import Callable

import numpy as np
import pytest

from lgprjax.coverage import Tool
from lgprjax.navigation import skid_pose_covariance
from navigation.test_skid_smoother import STEP_S, Smoothed, check_drop_outs, drawn, smoothed
from true_cells import claims_and_truth

TOOL = Tool(1.2, 0.3, 1.2, 0.0)


def worked_areas(of: Smoothed) -> dict[str, np.ndarray]:
    """Live and smoothed: cells claimed, true and worked at 0.95 and 0.996 of three drives, the tool on in lines."""
    truth = np.moveaxis(of.drives.truth, 0, 1)
    turn = np.abs(np.diff(np.unwrap(truth[..., 2], axis=1), axis=1, prepend=truth[:, :1, 2])) / STEP_S > 0.05
    on = np.asarray(of.found.info.heading_known) & ~turn
    areas = {}
    for name in ("filtered", "smoothed"):
        estimate = getattr(of.found, name)
        pose, covariance = np.asarray(estimate.mean[..., :3]), np.asarray(skid_pose_covariance(estimate))
        parts = [claims_and_truth(TOOL, pose[run], covariance[run], on[run], truth[run], on[run]) for run in range(3)]
        areas[name] = np.sum(parts, axis=0)
    return areas


def check_areas(areas: dict[str, np.ndarray]) -> None:
    """Claims are true to their level, and the smoothed ones larger."""
    for counts in areas.values():
        for level, (claimed, true, _) in zip((0.95, 0.996), counts, strict=True):
            assert true >= level * claimed
    share = {name: counts[:, 0] / counts[:, 2] for name, counts in areas.items()}
    assert np.all(share["smoothed"] > share["filtered"])


@pytest.mark.parametrize(("off_s", "every_s"), [(30.0, 90.0), (90.0, 180.0)])
def test_a_drop_out_is_told_by_the_fix_that_ends_it(
    off_s: float, every_s: float, record_property: Callable[[str, object], None]
) -> None:
    of = smoothed(drawn(off_s=off_s, every_s=every_s))
    check_drop_outs(of)
    areas = worked_areas(of)
    for name, counts in areas.items():
        for level, (claimed, true, worked) in zip((0.95, 0.996), counts, strict=True):
            record_property(f"{name}_{level:g}_claimed_to_worked", round(claimed / worked, 4))
            record_property(f"{name}_{level:g}_true", round(true / claimed, 5))
    check_areas(areas)
