"""The studies of ``tuning/`` as its README runs them: from made-up drives to a vehicle file that holds the truth."""

import re
import shutil
from pathlib import Path

import pytest

from lgprjax.formats import check_file, read_vehicle
from lgprjax.simulation import read_vehicle_plan
from studies.commands import run

_ROOT = Path(__file__).parents[2]


def test_each_study_goes_on_with_the_file_of_the_one_before(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    shutil.copytree(_ROOT / "tuning", tmp_path / "tuning")
    monkeypatch.chdir(tmp_path)
    loop, more = re.findall(
        r"^for study in (.+); do$", Path("tuning/README.md").read_text(encoding="utf-8"), re.MULTILINE
    )
    for drives in ("drives", "tracking_drives"):
        assert run("simulate", f"tuning/{drives}.toml", "-o", "out/drives") == 0
    for study in (*loop.split(), *more.split()):
        assert run("tune", f"tuning/{study}.toml", "-o", f"out/tuned/{study}") == 0, study

    (path,) = Path(f"out/tuned/{loop.split()[-1]}").glob("*.vehicle.toml")
    assert check_file(path) == []
    vehicle, plan = read_vehicle(path), read_vehicle_plan(tmp_path / "tuning" / "drives.toml")
    truth = {
        "steering.rear_ratio": ("k_ratio", plan.vehicle.rear),
        "steering.characteristic_speed_mps": ("yaw_gain", plan.vehicle.characteristic_speed_mps),
        "steering.potentiometer_v_per_rad": ("palm_tree_again", plan.vehicle.potentiometer_per_rad_v[0]),
        "steering.encoder_counts_per_rad": ("encoder", plan.vehicle.encoder_counts_per_rad),
        "steering.lag_s": ("servo", plan.vehicle.lag_s),
        "steering.delay_s": ("servo", plan.vehicle.delay_s),
        "navigation.yaw_rate_noise": ("fusion", plan.drives[-1].sensors.yaw_rate_noise),
    }
    for number, (study, true) in truth.items():
        found = vehicle.found[number]
        assert found.study == study
        assert isinstance(found.low, float)
        assert isinstance(found.high, float)
        assert isinstance(true, float)
        assert found.low < true < found.high, number
    # Nothing true to compare the look-ahead with; the straight potentiometer and the pedals have tests of their own.
    assert vehicle.pursuit.short_m is not None
    assert vehicle.pursuit.long_m is not None
    assert 0.0 < vehicle.pursuit.short_m < vehicle.pursuit.long_m
    assert {entry.study for entry in vehicle.found.values()} >= {"straight", "pedals"}
