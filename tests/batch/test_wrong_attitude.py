"""A log whose INS is wrong and sure of itself: the ground says so, and no fix believes what it contradicts."""

import numpy as np
import pytest

from generated import Site
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


@pytest.mark.parametrize(
    ("height_m", "heading_deg", "roll_deg"), [(0.0, 0.0, 0.0), (0.2, -6.0, 4.0), (-0.2, 6.0, -4.0), (0.0, 12.0, 0.0)]
)
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
    print(
        f"ok {ok.mean():.3f}, later {late[travel_m > 4.0].mean():.3f}, heading {heading:.2f}, roll {roll:.2f} degrees"
    )
    assert late[travel_m > 4.0].mean() >= 0.9
    assert np.max(np.hypot(error[ok, 0], error[ok, 1])) < 0.3
    assert np.mean(np.abs(error[ok, 2:]) > 4.0 * sigma[ok, 2:]) <= 1e-3
    assert max(heading, roll) <= 1.0
