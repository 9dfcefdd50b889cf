"""The drives file: what is wrong is one line that names the key; degrees are radians."""

from pathlib import Path

import numpy as np
import pytest

from lgprjax.errors import InputError
from lgprjax.simulation import is_vehicle_plan, read_vehicle_plan

_DRIVES = """
kind = "vehicle_drives"
seed = 3
[vehicle]
rear = 0.55
[[drive]]
name = "standing"
manoeuvre = "standing"
pause_s = 1.5
[[drive]]
name = "straight"
manoeuvre = "straight"
length_m = 90
speed_mps = 3
weave_deg = 0.5
"""


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("pause_s = 1.5", "pause = 1.5", "drive[1].pause: expected a key, perhaps pause_s"),
        ("pause_s = 1.5", "pause_s = 0", "drive[1].pause_s: expected a number from 0.5 to 120, found 0"),
        ('"standing"\npause', '"spinning"\npause', "drive[1].manoeuvre: expected a manoeuvre"),
        ("length_m = 90\n", "", "drive[2].length_m: expected a value, found none"),
        ("weave_deg = 0.5", "weave_deg = 50", "drive[2].weave_deg: expected a number from 0 to 11"),
        ("rear = 0.55", "rear = 55.0", "vehicle.rear: expected a number from 0 to 1, found 55"),
        ("seed = 3", "seed = -3", "seed: expected a whole number from 0, found -3"),
        ('name = "straight"', 'name = "standing"', "drive[2].name: expected a name that no other drive has"),
        ("[vehicle]", "[sensors]\nrecord_hz = 30.0\n[vehicle]", "sensors.record_hz: expected a record_hz of 100"),
        ("[vehicle]", "[sensors]\noutlier_share = 2.0\n[vehicle]", "sensors.outlier_share: expected a number from 0"),
    ],
)
def test_a_bad_drives_file_is_one_line(tmp_path: Path, old: str, new: str, words: str) -> None:
    assert old in _DRIVES
    path = tmp_path / "drives.toml"
    path.write_text(_DRIVES.replace(old, new, 1))
    with pytest.raises(InputError) as error:
        read_vehicle_plan(path)
    line = str(error.value)
    assert words in line
    assert "\n" not in line


def test_a_drives_file_in_degrees_is_one_in_radians(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(_DRIVES)
    degrees = read_vehicle_plan(path).drives[1].manoeuvre
    path.write_text(_DRIVES.replace("weave_deg = 0.5", f"weave_rad = {float(np.radians(0.5))!r}"))
    np.testing.assert_allclose(read_vehicle_plan(path).drives[1].manoeuvre.wanted_rad, degrees.wanted_rad, atol=1e-12)


def test_a_drives_file_is_told_from_a_site_file(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(_DRIVES)
    assert is_vehicle_plan(path)
    assert not is_vehicle_plan(Path(__file__).parents[2] / "sites" / "village.toml")


def test_seeds_go_by_the_name(tmp_path: Path) -> None:
    path = tmp_path / "drives.toml"
    path.write_text(_DRIVES)
    standing, straight = read_vehicle_plan(path).drives
    assert standing.seed != straight.seed
    path.write_text(_DRIVES.replace('"standing"\nmanoeuvre', '"first"\nmanoeuvre'))
    assert read_vehicle_plan(path).drives[1].seed == straight.seed
