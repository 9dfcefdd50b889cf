"""Drives and fixes as tables: moments in UTC, units in the names."""

from pathlib import Path

import h5py
import numpy as np
import pandas as pd

from formats.mcap_sample import SCANS, curved_description, write_curved
from formats.samples import make_track
from lgprjax.formats import (
    OdometryTrack,
    VehicleLog,
    read_drive_frames,
    read_fixes_frame,
    write_fixes,
    write_vehicle_log,
)
from refusals import refused


def test_a_drive_as_tables(tmp_path: Path) -> None:
    _, valid = write_curved(tmp_path / "a.drive.h5")
    frames, due = read_drive_frames(tmp_path / "a.drive.h5"), curved_description()
    begin = pd.Timestamp("2024-05-01T12:00:00.25Z")
    for table in frames:
        assert table is not None or table is frames.plan
        if table is not None:
            assert table.index.name == "time_utc"
            index = pd.DatetimeIndex(table.index)
            assert str(index.tz) == "UTC"
            np.testing.assert_allclose((index - begin).total_seconds(), table["time_s"], atol=1e-9)
            assert table.attrs["name"] == "a curved drive"
    assert frames.plan is None
    pose = ("latitude_deg", "longitude_deg", "height_m", "heading_deg", "roll_deg")
    sigmas = ("sigma_east_m", "sigma_north_m", "sigma_height_m", "sigma_heading_deg", "sigma_roll_deg")
    assert list(frames.navigation) == ["time_s", *pose, *sigmas]
    np.testing.assert_array_equal(frames.navigation["heading_deg"], due.navigation.heading_deg)
    np.testing.assert_array_equal(frames.odometry["distance_m"], due.odometry.distance_m)
    np.testing.assert_array_equal(frames.scans["scan"], np.arange(SCANS))
    np.testing.assert_array_equal(frames.scans["valid_channels"], valid.sum(axis=1))
    assert frames.truth is not None
    assert "sigma_east_m" not in frames.truth
    assert frames.vehicle is not None
    assert list(frames.vehicle["mode"]) == [0, 1, 1]
    # What an index of moments is for: tables of different rates side by side.
    joined = pd.merge_asof(frames.scans, frames.odometry[["distance_m"]], left_index=True, right_index=True)
    assert len(joined) == SCANS
    assert joined["distance_m"].notna().all()


def test_a_drive_without_radar_and_one_without_a_mask(tmp_path: Path) -> None:
    track, odometry = make_track(), OdometryTrack(np.arange(2.0), np.arange(2.0))
    log = VehicleLog("b", "2024-05-01T12:00:00Z", track, odometry, None, None, None, {})
    write_vehicle_log(tmp_path / "b.drive.h5", log)
    frames = read_drive_frames(tmp_path / "b.drive.h5")
    assert len(frames.scans) == 0
    assert (frames.truth, frames.vehicle) == (None, None)
    assert len(frames.navigation) == 5
    write_curved(tmp_path / "a.drive.h5")
    with h5py.File(tmp_path / "a.drive.h5", "r+") as store:
        del store["/radar/valid"]
    assert set(read_drive_frames(tmp_path / "a.drive.h5").scans["valid_channels"]) == {3}


def test_fixes_by_moment(tmp_path: Path) -> None:
    names = ("latitude_deg", "longitude_deg", "height_m", "heading_deg", "roll_deg", "sigma_along_m", "sigma_cross_m")
    numbers = {name: np.arange(3.0) for name in (*names, "correlation", "margin")}
    numbers["correlation"] = np.array([0.5, 0.6, 0.7])
    columns = {"scan": np.arange(3), "time_s": np.array([0.0, 0.125, 0.25]), **numbers}
    table = pd.DataFrame({**columns, "overlap_channels": 3, "code": "ok"})
    paths = tmp_path / "a.fixes.csv", tmp_path / "a.fixes.h5"
    write_fixes(*paths, table, attributes={"t0_utc": "2024-05-01T23:59:59.875Z", "name": "a"})
    frame = read_fixes_frame(paths[1])
    assert [str(each) for each in frame.index] == [
        "2024-05-01 23:59:59.875000+00:00",
        "2024-05-02 00:00:00+00:00",
        "2024-05-02 00:00:00.125000+00:00",
    ]
    assert frame.attrs["name"] == "a"
    assert list(frame["correlation"].loc["2024-05-02"]) == [0.6, 0.7]
    with refused("@t0_utc", file="a.fixes.csv"):
        read_fixes_frame(paths[0])
