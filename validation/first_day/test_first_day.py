"""A first day with three vehicles far apart on a mile: everything that it needs is made by the verbs of the day."""

from collections.abc import Callable
from pathlib import Path

import pytest

from canon.calibration import Kit
from canon.first_day import first_day, wrong_fixes
from lgprjax.config import TableKey
from lgprjax.files import load_toml
from lgprjax.formats import read_vehicle
from lgprjax.simulation.vehicle_logs import true_vehicle

RecordProperty = Callable[[str, object], None]
_MILE_M = 1609.0

KITS = {
    # A heavy truck: slow servo, little torque, much play.
    "truck": Kit(
        """wheelbase_m = 4.4
largest_angle_deg = 28.0
characteristic_speed_mps = 25.0
rear = 0.66
lag_s = 0.3
rate_radps = 0.35
delay_s = 0.1
dead_band_deg = 0.5
backlash_deg = 0.8
asymmetry = 0.08
potentiometer_straight_v = 2.6
potentiometer_per_rad_v = [1.7, 0.0, -0.25]
encoder_counts_per_rad = 15000.0
lock_to_lock_turns = 6.0
throttle = [0.22, 0.07, 1.8, 1.0]
brake = [0.2, 0.08, 4.5, 0.4]
rolling_mps2 = 0.2
drag_per_s = 0.02
""",
        4.4,
    ),
    # A quick buggy: short, strong, and it slips.
    "buggy": Kit(
        """wheelbase_m = 2.6
largest_angle_deg = 36.0
characteristic_speed_mps = 11.0
rear = 0.4
lag_s = 0.08
rate_radps = 0.9
delay_s = 0.04
dead_band_deg = 0.1
backlash_deg = 0.2
potentiometer_straight_v = 2.1
potentiometer_per_rad_v = [-1.4, 0.08]
encoder_counts_per_rad = -8000.0
lock_to_lock_turns = 3.0
throttle = [0.06, 0.03, 4.5, 0.3]
brake = [0.08, 0.04, 7.5, 0.2]
rolling_mps2 = 0.25
drag_per_s = 0.06
""",
        2.6,
    ),
    # A pickup: its rear wheels do not steer, and its crew knows that.
    "pickup": Kit(
        """wheelbase_m = 3.2
largest_angle_deg = 33.0
characteristic_speed_mps = 18.0
rear = 0.0
lag_s = 0.15
rate_radps = 0.6
delay_s = 0.07
dead_band_deg = 0.2
backlash_deg = 0.5
potentiometer_straight_v = 2.4
potentiometer_per_rad_v = [2.1]
encoder_counts_per_rad = 11000.0
lock_to_lock_turns = 3.5
throttle = [0.12, 0.05, 3.2, 0.6]
brake = [0.15, 0.06, 6.5, 0.25]
rolling_mps2 = 0.15
drag_per_s = 0.03
""",
        3.2,
        "[steering]\nrear_ratio = 0.0\n",
    ),
}


@pytest.mark.parametrize("name", list(KITS))
def test_a_first_day(name: str, tmp_path: Path, record_property: RecordProperty) -> None:
    kit = KITS[name]
    day = first_day(tmp_path, kit, _MILE_M)
    inside, of = intervals(day.folder, kit)
    wrong, fixes = wrong_fixes(day.folder, "evening")
    for what, figure in (
        ("numbers_inside", f"{inside} of {of}"),
        ("rtk_rms_m", round(day.rtk.rms_m, 4)),
        ("lgpr_rms_m", round(day.lgpr.rms_m, 4)),
        ("lgpr_largest_m", round(day.lgpr.largest_m, 4)),
        ("engaged_m", round(day.lgpr.metres, 0)),
        ("wrong_fixes", f"{wrong} of {fixes}"),
    ):
        record_property(what, figure)
    assert day.rtk.rms_m <= 0.10
    assert day.lgpr.rms_m <= 0.14
    assert wrong == 0
    assert inside >= 0.8 * of


def intervals(folder: Path, kit: Kit) -> tuple[int, int]:
    """Numbers of the vehicle file whose interval has the truth, and how many there are."""
    path = folder / "truth.toml"
    path.write_text(kit.table, encoding="utf-8")
    true = true_vehicle(load_toml(path), TableKey(path), 6.2)
    assert isinstance(true.rear, float)
    truth = {
        "steering.straight_potentiometer_v": true.potentiometer_straight_v,
        "steering.rear_ratio": true.rear,
        "steering.potentiometer_v_per_rad": true.potentiometer_per_rad_v[0],
        "steering.encoder_counts_per_rad": true.encoder_counts_per_rad,
        "steering.backlash_rad": true.backlash_rad,
        "steering.characteristic_speed_mps": true.characteristic_speed_mps,
        "steering.lag_s": true.lag_s,
        "steering.largest_wheel_rate_radps": true.rate_radps,
        "steering.dead_band_rad": true.dead_band_rad,
        "steering.asymmetry": true.asymmetry,
        "resistance.rolling_mps2": true.rolling_mps2,
        "resistance.drag_per_s": true.drag_per_s,
    }
    for pedal, numbers in (("throttle", true.throttle), ("brake", true.brake)):
        keys = ("pre_tension", "dead_zone", "gain_mps2", "lag_s")
        truth |= {f"{pedal}.{key}": number for key, number in zip(keys, numbers, strict=True)}
    found = read_vehicle(folder / "kit.vehicle.toml").found
    judged = [path for path in truth if path in found]
    inside = [path for path in judged if float(found[path].low) <= truth[path] <= float(found[path].high)]  # type: ignore[arg-type]
    return len(inside), len(judged)
