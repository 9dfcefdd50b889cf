"""Written drives against what was simulated: heights, sigmas, provenance, and sweeps calibrated by hand in float64."""

from pathlib import Path

import numpy as np
import pytest

from lgprjax.formats import DriveLog, SweepRecording, TraceRecording, check_file
from lgprjax.scene import (
    Day,
    DrivePlan,
    GroundConfig,
    NavigationErrors,
    SimulatedDrive,
    make_ground,
    simulate_drive,
)
from lgprjax.simulation import (
    SITE_FRAME,
    PlannedSite,
    describe_drive,
    plan_drive,
    plan_site,
    read_site,
    write_drive,
    write_site,
)
from refusals import refused

# Array, ground and sweeps have the shapes of tests/scene/short_drives: one program for all.
SITE = """
name = "hilly"
seed = 8
latitude_deg = 47.0
longitude_deg = 11.0
height_m = 600.0
[ground]
length_m = 12
stones_per_m2 = 3
trees_per_100m = 0
[road]
grade_rms = 0.05
bank_rms_deg = 1
arcs = [[12, 0.01]]
[radar]
recording = "RECORDING"
SWEEPS
[array]
channels = 3
pitch_m = 0.2
[navigation.gap]
outages_s = [[0.2, 0.6]]
velocity_walk = 0.5
heading_sigma_deg = 0.4
height_sigma_m = 0.2
[faults.broken]
dead_channels = [2]
gain_drift = 0.3
phase_drift_rad = 0.5
[[drive]]
name = "there"
day = "clear"
navigation = "gap"
faults = "FAULTS"
height_sigma_m = 0.03
stop_m = 4
[[drive]]
name = "back"
direction = -1
other_ground = 21
start_m = 6
stop_m = 9
"""


def planned(folder: Path, recording: str, faults: str = "usual") -> PlannedSite:
    path = folder / "hilly.toml"
    sweeps = "sweeps = {adc_bits = 20}" if recording == "sweeps" else ""
    path.write_text(SITE.replace("RECORDING", recording).replace("SWEEPS", sweeps).replace("FAULTS", faults))
    return plan_site(read_site(path), path)


@pytest.fixture(scope="module")
def traces(tmp_path_factory: pytest.TempPathFactory) -> tuple[PlannedSite, dict[str, Path]]:
    folder = tmp_path_factory.mktemp("traces")
    plan = planned(folder, "traces")
    return plan, write_site(plan, folder / "out")


@pytest.fixture(scope="module")
def there(traces: tuple[PlannedSite, dict[str, Path]]) -> SimulatedDrive:
    scene = traces[0].scene
    return plan_drive(scene, scene.site.drives[0])


def test_logs_are_valid_and_as_planned(traces: tuple[PlannedSite, dict[str, Path]]) -> None:
    plan, paths = traces
    assert list(paths) == ["there", "back"]
    for entry in plan.drives:
        path = paths[entry.drive.name]
        assert check_file(path) == []
        with DriveLog.open(path) as log:
            assert (log.scans, log.channels) == (entry.scans, 3)
            recording = log.description.recording
            assert isinstance(recording, TraceRecording)
            assert recording.centre_frequency_hz == 250e6
            provenance = log.description.provenance
            assert provenance["drive_seed"] == entry.drive.seed
            day = provenance["day"]
            assert isinstance(day, dict)
            assert day["seed"] == entry.drive.day.seed
            ground = 21 if entry.drive.name == "back" else 8
            due = {"name": "hilly", "seed": 8, "day": entry.drive.day_name, "ground_seed": ground}
            assert provenance["site"] == due


def test_heights_are_the_roads_and_the_springs_do_not_count(
    traces: tuple[PlannedSite, dict[str, Path]], there: SimulatedDrive
) -> None:
    with DriveLog.open(traces[1]["there"]) as log:
        truth, navigation = log.description.truth, log.description.navigation
        assert log.description.provenance["synthetic"] is True
    assert truth is not None
    # Within 4 m the Earth's curvature is a micrometre: height above the ellipsoid is the anchor's plus up.
    np.testing.assert_allclose(truth.height_m, 600.0 + there.ground_up_m, atol=1e-5)
    assert np.ptp(there.ground_up_m) > 0.005
    bounce = there.navigation_springs_m
    assert bounce.std() > 0.01
    wrong = navigation.height_m - 600.0 - there.navigation_up_m
    assert wrong.std() > 0.01
    np.testing.assert_allclose(wrong + bounce, there.navigation.pose[:, 2], atol=1e-5)


def test_springs_do_not_count_however_few_scans_there_are() -> None:
    plan = DrivePlan(0.0, 50.0, speed_mps=10.0, scan_rate_hz=2.0, height_sigma_m=0.05)
    errors = NavigationErrors(height_sigma_m=0.0)
    drive = simulate_drive(make_ground(1, GroundConfig(length_m=60.0)), plan, Day(), 1, errors=errors)
    track = describe_drive("few", drive).navigation
    _, _, up = SITE_FRAME.to_local(track.latitude_deg, track.longitude_deg, track.height_m)
    np.testing.assert_allclose(up, drive.navigation_up_m, atol=1e-5)


def test_sigmas_are_what_the_receiver_says(traces: tuple[PlannedSite, dict[str, Path]], there: SimulatedDrive) -> None:
    with DriveLog.open(traces[1]["there"]) as log:
        navigation = log.description.navigation
    assert there.navigation.sigma is not None
    assert navigation.sigma_east_m is not None
    assert navigation.sigma_heading_deg is not None
    assert navigation.sigma_height_m is not None
    assert navigation.sigma_roll_deg is not None
    np.testing.assert_allclose(navigation.sigma_east_m, there.navigation.sigma[:, 0])
    np.testing.assert_allclose(navigation.sigma_height_m[0], 0.2)
    np.testing.assert_allclose(navigation.sigma_heading_deg[0], 0.4)
    np.testing.assert_allclose(navigation.sigma_roll_deg, 0.1)
    out = (navigation.time_s > 0.3) & (navigation.time_s < 0.6)
    assert np.diff(navigation.sigma_east_m[out]).min() > 0.0  # it grows in the outage
    assert navigation.sigma_east_m[out].max() > 0.08
    np.testing.assert_allclose(navigation.sigma_east_m[~out & (navigation.time_s > 0.61)], 0.05)


def test_sweeps_hold_what_calibration_needs(tmp_path: Path) -> None:
    """Gains and delays are the simulated ones; a dead channel keeps the defaults; the surface comes when it should."""
    plan = planned(tmp_path, "sweeps", "broken")
    path = write_site(plan._replace(drives=plan.drives[:1]), tmp_path / "out")["there"]
    assert check_file(path) == []
    drive = plan_drive(plan.scene, plan.scene.site.drives[0])
    with DriveLog.open(path) as log:
        recording = log.description.recording
        assert isinstance(recording, SweepRecording)
        sweeps, calibration, _ = log.read_sweeps(0, log.scans)
        assert log.scans == plan.drives[0].scans
    assert recording.group_delay_ns == 6.0
    np.testing.assert_allclose(recording.frequencies_hz, np.arange(100e6, 401e6, 5e6))
    assert recording.channel_gain is not None
    assert recording.channel_delay_ns is not None
    assert (recording.channel_gain[2], recording.channel_delay_ns[2]) == (1.0, 0.0)
    alive = [0, 1]
    gain, delay = drive.response.gain[alive], drive.response.delay_ns[alive]
    np.testing.assert_allclose(recording.channel_gain[alive], gain / gain.mean(), atol=0.005)
    np.testing.assert_allclose(recording.channel_delay_ns[alive], delay - delay.mean(), atol=0.005)
    assert np.ptp(delay) > 0.01
    # The calibration channel hears the receiver alone: warmer by 30 % and half a radian at the end.
    turned = np.mean(calibration[-1].astype(np.complex128) / calibration[0])
    np.testing.assert_allclose(np.abs(turned), 1.3, rtol=0.01)
    np.testing.assert_allclose(np.angle(turned), 0.5, atol=0.01)
    empty = recording.lookup_sweeps.astype(np.complex128) / recording.lookup_calibration_sweep
    ground = sweeps.astype(np.complex128) / calibration[:, None] - empty[None]
    assert np.abs(ground[:, 2]).mean() < 0.1 * np.abs(ground[:, alive]).mean()
    # With the delay of the calibration path put back, the loudest arrival is the surface, 0.3 m below: 2 ns.
    time_ns = np.arange(-10.0, 20.0, 0.05)
    turn = np.exp(2e-9j * np.pi * np.outer(recording.frequencies_hz, time_ns - recording.group_delay_ns))
    loudest_ns = time_ns[np.argmax(np.abs(ground[:, alive] @ turn), axis=-1)]
    np.testing.assert_allclose(np.median(loudest_ns), 2 * 0.3 / 0.299792458, atol=0.4)


def test_a_drive_that_fails_leaves_nothing(there: SimulatedDrive, tmp_path: Path) -> None:
    def stop(scans: int) -> None:
        raise RuntimeError(f"after {scans}")

    with pytest.raises(RuntimeError):
        write_drive(tmp_path / "a.drive.h5", there, progress=stop)
    assert list(tmp_path.iterdir()) == []


def test_outputs_are_claimed_before_any_work(traces: tuple[PlannedSite, dict[str, Path]], tmp_path: Path) -> None:
    plan, _ = traces
    (tmp_path / "back.drive.h5").write_bytes(b"mine")
    with refused("output", "--force", file="back.drive.h5"):
        write_site(plan, tmp_path)
    assert [path.name for path in tmp_path.iterdir()] == ["back.drive.h5"]
    with refused("output", file="back.drive.h5"):
        write_site(plan, tmp_path / "back.drive.h5")
