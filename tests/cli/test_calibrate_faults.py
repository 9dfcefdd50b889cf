"""A calibration whose recordings were cut, whose radar is missing, whose operator presses override: nothing is lost."""

import shutil
from pathlib import Path

import numpy as np
import pytest

from canon.calibration import DRIVEN_BEFORE, KIT_FILE, calibrated, write_kit
from canon.commands import run, succeed
from lgprjax.formats import VehicleLog, read_run, read_vehicle
from lgprjax.run_records import RecordKind, unpack


@pytest.mark.parametrize(
    "step", ["steering", *(pytest.param(step, marks=pytest.mark.long) for step in ("straight", "half_turns", "pedals"))]
)
def test_what_was_recorded_before_a_power_cut_is_kept(
    tmp_path_factory: pytest.TempPathFactory, tmp_path: Path, step: str
) -> None:
    """The newest segment ends in the middle of a record; what comes before is a drive log like that of the whole."""
    kit = calibrated(tmp_path_factory, but_steering=step == "steering")
    (whole,) = kit.folder.glob(f"{step}-*")
    folder = tmp_path / whole.name
    shutil.copytree(whole, folder, ignore=shutil.ignore_patterns("*.h5", "*.npz"))
    segments = sorted(folder.glob("*.lgprun"))
    kept = max(len(segments) // 2, 1)
    for segment in segments[kept:]:
        segment.unlink()
    data = segments[kept - 1].read_bytes()
    segments[kept - 1].write_bytes(data[: len(data) * 3 // 5])
    succeed("recover", folder, "-o", tmp_path / "cut.drive.h5")
    found, due = (
        VehicleLog.open(tmp_path / "cut.drive.h5").vehicle,
        VehicleLog.open(kit.folder / f"{step}.drive.h5").vehicle,
    )
    assert found is not None
    assert due is not None
    records = len(found["time_s"])
    assert 200 < records < len(due["time_s"])
    for name in ("steering_potentiometer_v", "encoder_counts"):
        np.testing.assert_array_equal(found[name], due[name][:records])


def test_a_step_by_hand_needs_no_radar_and_goes_on_after_an_override(tmp_path: Path) -> None:
    script = 'script = [{ at_s = 20.0, do = "press", button = "override" }]\n'
    vehicle = write_kit(tmp_path, script=script)
    config = tmp_path / "kit.run.toml"
    unplugged = config.read_text(encoding="utf-8").replace("[sensors]", 'radar = { url = "/dev/absent" }\n[sensors]', 1)
    config.write_text(unplugged, encoding="utf-8")
    shutil.copy(KIT_FILE, vehicle)
    done = run("calibrate", vehicle, "--simulate", "--step", "half_turns")
    assert done.status == 0, (done.out[-500:], done.err[-500:])
    found = read_vehicle(vehicle).found["steering.encoder_counts_per_rad"]
    assert isinstance(found.low, float)
    assert isinstance(found.high, float)
    assert found.low <= DRIVEN_BEFORE.truth["steering.encoder_counts_per_rad"] <= found.high
    # Hands alone move the vehicle.
    (folder,) = (tmp_path / "calibration" / "kit").glob("half_turns-*")
    assert not [1 for _, data in read_run(folder) if unpack(data).kind is RecordKind.PORT_OUT]
