"""A log whose INS is wrong and sure of itself: the ground says so, and no fix believes what it contradicts."""

import re

import numpy as np
import pytest

from canon.site import Site, registered_once
from lgprjax.batch import RegisteredDrive, register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.registration import RegisterOptions, Track


def register_turned(site: Site, height_m: float, heading_deg: float, roll_deg: float) -> RegisteredDrive:
    """The live drive with so much added to its priors, heading told with 0.3 degrees."""

    def led_to(track: Track) -> Track:
        pose = track.pose.copy()
        pose[:, 2:] += np.array([height_m, np.radians(heading_deg), np.radians(roll_deg)])
        return track._replace(pose=pose, sigma_yaw_rad=np.full(len(pose), np.radians(0.3)))

    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        return register_log(source, log, RegisterOptions(search_m=1.5), led_to=led_to)


@pytest.mark.parametrize(("height_m", "heading_deg", "roll_deg"), [(0.2, -6.0, 4.0), (0.0, 12.0, 0.0)])
def test_an_attitude_that_is_wrong_is_found(site: Site, height_m: float, heading_deg: float, roll_deg: float) -> None:
    drive = register_turned(site, height_m, heading_deg, roll_deg)
    assert drive.truth is not None
    ok = drive.table["code"].to_numpy() == "ok"
    error = np.asarray(drive.fix.pose) - drive.truth
    error[:, 3] = np.mod(error[:, 3] + np.pi, 2.0 * np.pi) - np.pi
    sigma = np.sqrt(np.einsum("sii->si", np.asarray(drive.fix.covariance)))
    travel_m = np.abs(drive.track.travel_m - drive.track.travel_m[0])
    late = ok & (travel_m > 4.0)
    heading, roll = (np.degrees(np.sqrt(np.mean(error[late, axis] ** 2))) for axis in (3, 4))
    assert late[travel_m > 4.0].mean() >= 0.9
    assert np.max(np.hypot(error[ok, 0], error[ok, 1])) < 0.3
    assert np.mean(np.abs(error[ok, 2:]) > 4.0 * sigma[ok, 2:]) <= 1e-3
    assert max(heading, roll) <= 1.0


def test_an_odometer_that_miscounts_is_noticed(site: Site, tmp_path_factory: pytest.TempPathFactory) -> None:
    """By 3 %: the fixes tell it, travel is scaled back, and they are as good as with a true one."""

    def led_to(track: Track) -> Track:
        return track._replace(travel_m=0.97 * track.travel_m, speed_mps=0.97 * track.speed_mps)

    plain = registered_once(tmp_path_factory, site, "live")
    with MapFile.open(site.map) as source, DriveLog.open(site.logs["live"]) as log:
        drive = register_log(source, log, RegisterOptions(search_m=1.5), led_to=led_to)
    assert plain.travel_changed is None
    assert plain.truth is not None
    assert drive.travel_changed is not None
    (percent,) = re.findall(r"([\d.]+) %", drive.travel_changed)
    assert float(percent) == pytest.approx(3.0, abs=1.0)
    np.testing.assert_allclose(np.ptp(drive.track.travel_m), np.ptp(plain.track.travel_m), rtol=0.01)
    both = np.asarray((drive.table.code == "ok") & (plain.table.code == "ok"))
    assert both.mean() > np.mean(plain.table.code == "ok") - 0.01
    off_m, plain_off_m = (
        np.sqrt(np.mean(np.sum((np.asarray(each.fix.pose) - plain.truth)[both, :2] ** 2, axis=1)))
        for each in (drive, plain)
    )
    assert off_m < plain_off_m + 0.005
