"""Where a drive had no GNSS: silence and lost sureness, told from what stands in its log."""

import shutil
from pathlib import Path

import h5py
import numpy as np
import pytest

from canon.site import Site
from lgprjax.formats import DriveLog
from lgprjax.recordings.drives import gnss_gaps


@pytest.fixture
def edited(site: Site, tmp_path: Path) -> Path:
    path = tmp_path / "gap.drive.h5"
    shutil.copyfile(site.logs["live"], path)
    return path


def gaps_of(path: Path) -> tuple[np.ndarray, np.ndarray]:
    with DriveLog.open(path) as log:
        return log.scan_time_s, gnss_gaps(log)


def test_silence_is_a_gap_and_a_steady_drive_has_none(edited: Path) -> None:
    assert not gaps_of(edited)[1].any()
    with h5py.File(edited, "r+") as store:
        group = store["gnss_ins"]
        time_s = group["time_s"][()]
        keep = (time_s <= 1.0) | (time_s >= 2.5)
        for name in list(group):
            values = group[name][()][keep]
            group[name].resize(len(values), axis=0)
            group[name][...] = values
    time_s, found = gaps_of(edited)
    last, first = time_s[found][[0, -1]]
    assert last == pytest.approx(1.0, abs=0.11)
    assert first == pytest.approx(2.5, abs=0.11)
    assert found.sum() == np.sum((time_s >= last) & (time_s <= first))


def test_lost_sureness_is_a_gap(edited: Path) -> None:
    with h5py.File(edited, "r+") as store:
        group = store["gnss_ins"]
        time_s, sigma = group["time_s"][()], group["sigma_north_m"][()]
        inside = (time_s > 2.0) & (time_s < 4.0)
        group["sigma_north_m"][...] = np.where(inside, 4.0 * sigma, sigma)
    time_s, found = gaps_of(edited)
    clear = (np.abs(time_s - 2.0) > 0.2) & (np.abs(time_s - 4.0) > 0.2)
    np.testing.assert_array_equal(found[clear], ((time_s > 2.0) & (time_s < 4.0))[clear])
