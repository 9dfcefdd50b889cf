"""The compass direction of a road makes no difference: map and drive are turned together about a point of the road."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from canon.site import Site
from lgprjax.batch import register_log
from lgprjax.batch.register import true_errors
from lgprjax.formats import DriveLog, MapFile
from lgprjax.frames import LocalFrame
from lgprjax.mapping import build_map
from lgprjax.registration import RegisterOptions

_EAST_M, _NORTH_M = -4.4, 0.4
"""Prior of the live drive moved by this, before turning: farther than its region, along the road."""


def turned(source: Path, target: Path, angle_rad: float, moved_m: tuple[float, float] = (0.0, 0.0)) -> Path:
    """A copy of a drive log whose world is turned counterclockwise; its prior, not its truth, moved before that."""
    shutil.copyfile(source, target)
    cos, sin = np.cos(angle_rad), np.sin(angle_rad)
    with h5py.File(target, "r+") as store:
        frame = LocalFrame(42.0, -71.0, 0.0)
        for group, move_m in ((store["gnss_ins"], moved_m), (store["truth"], (0.0, 0.0))):
            east, north, up = frame.to_local(*(group[n][:] for n in ("latitude_deg", "longitude_deg", "height_m")))
            east, north = east + move_m[0], north + move_m[1]
            places = frame.to_geodetic(cos * east - sin * north, sin * east + cos * north, up)
            for name, values in zip(("latitude_deg", "longitude_deg"), places, strict=False):
                group[name][:] = values
            group["heading_deg"][:] = np.mod(group["heading_deg"][:] - np.degrees(angle_rad), 360.0)
    return target


@pytest.mark.parametrize("prior_m", [(0.0, 0.0), (_EAST_M, _NORTH_M)])
def test_a_road_to_the_north_east_is_registered_like_one_to_the_east(
    site: Site, tmp_path: Path, prior_m: tuple[float, float]
) -> None:
    found = []
    for name, angle_rad in (("east", 0.0), ("north_east", np.radians(45.0))):
        folder = tmp_path / name
        folder.mkdir()
        logs = [
            turned(site.logs[each], folder / f"{each}.drive.h5", angle_rad)
            for each in ("baseline_left", "baseline_right")
        ]
        live = turned(site.logs["live"], folder / "live.drive.h5", angle_rad, prior_m)
        build_map(logs, folder / "m.map.h5")
        with MapFile.open(folder / "m.map.h5") as source, DriveLog.open(live) as log:
            drive = register_log(source, log, RegisterOptions())
        ok = (drive.table["code"] == "ok").to_numpy()
        error_m = np.hypot(*np.asarray(true_errors(drive))[:, :2].T)
        found.append((ok, error_m))
    (ok, error_m), (turned_ok, turned_m) = found
    print(f"ok {ok.mean():.3f} {turned_ok.mean():.3f}; rms {np.sqrt(np.mean(error_m[ok] ** 2)):.4f} "
          f"{np.sqrt(np.mean(turned_m[turned_ok] ** 2)):.4f} m")  # fmt: skip
    assert ok.mean() > 0.9
    assert abs(turned_ok.mean() - ok.mean()) < 0.02
    both = ok & turned_ok
    assert np.max(turned_m[turned_ok]) < 0.3
    assert np.quantile(np.abs(turned_m - error_m)[both], 0.95) < 0.02
