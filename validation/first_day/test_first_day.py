"""A first day with three vehicles far apart on a mile: everything that it needs is made by the verbs of the day."""

from collections.abc import Callable
from pathlib import Path

import pytest

from canon.calibration import SHORT, Kit
from canon.first_day import first_day, wrong_fixes
from lgprjax.formats import read_vehicle

RecordProperty = Callable[[str, object], None]
_MILE_M = 1609.0

_TRUCK = {
    "wheelbase_m": 4.4,
    "largest_angle_deg": 28.0,
    "characteristic_speed_mps": 25.0,
    "rear": 0.66,
    "lag_s": 0.3,
    "rate_radps": 0.35,
    "delay_s": 0.1,
    "dead_band_deg": 0.5,
    "backlash_deg": 0.8,
    "asymmetry": 0.08,
    "potentiometer_straight_v": 2.6,
    "potentiometer_per_rad_v": [1.7, 0.0, -0.25],
    "encoder_counts_per_rad": 15000.0,
    "lock_to_lock_turns": 6.0,
    "throttle": [0.22, 0.07, 1.8, 1.0],
    "brake": [0.2, 0.08, 4.5, 0.4],
    "drag_per_s": 0.02,
}
_BUGGY = {
    "wheelbase_m": 2.6,
    "largest_angle_deg": 36.0,
    "characteristic_speed_mps": 11.0,
    "rear": 0.4,
    "lag_s": 0.08,
    "rate_radps": 0.9,
    "delay_s": 0.04,
    "dead_band_deg": 0.1,
    "backlash_deg": 0.2,
    "potentiometer_straight_v": 2.1,
    "potentiometer_per_rad_v": [-1.4, 0.08],
    "encoder_counts_per_rad": -8000.0,
    "throttle": [0.06, 0.03, 4.5, 0.3],
    "brake": [0.08, 0.04, 7.5, 0.2],
    "rolling_mps2": 0.25,
    "drag_per_s": 0.06,
}
_PICKUP = {
    "wheelbase_m": 3.2,
    "largest_angle_deg": 33.0,
    "characteristic_speed_mps": 18.0,
    "rear": 0.0,
    "lag_s": 0.15,
    "rate_radps": 0.6,
    "delay_s": 0.07,
    "dead_band_deg": 0.2,
    "backlash_deg": 0.5,
    "potentiometer_straight_v": 2.4,
    "potentiometer_per_rad_v": [2.1],
    "encoder_counts_per_rad": 11000.0,
    "lock_to_lock_turns": 3.5,
    "throttle": [0.12, 0.05, 3.2, 0.6],
    "brake": [0.15, 0.06, 6.5, 0.25],
    "rolling_mps2": 0.15,
    "drag_per_s": 0.03,
}
KITS = {
    # A heavy truck: slow servo, little torque, much play.
    "truck": Kit({**SHORT.numbers, **_TRUCK}),
    # A quick buggy: short, strong, and it slips.
    "buggy": Kit({**SHORT.numbers, **_BUGGY}),
    # A pickup: its rear wheels do not steer, and its crew knows that.
    "pickup": Kit({**SHORT.numbers, **_PICKUP}, "[steering]\nrear_ratio = 0.0\n"),
}


@pytest.mark.parametrize("name", list(KITS))
def test_a_first_day(name: str, tmp_path: Path, record_property: RecordProperty) -> None:
    kit = KITS[name]
    day = first_day(tmp_path, kit, _MILE_M)
    outside, of = intervals(day.folder, kit)
    wrong, fixes = wrong_fixes(day.folder, "evening")
    for what, figure in (
        ("numbers_inside", f"{of - len(outside)} of {of}"),
        ("outside", ", ".join(outside)),
        ("rtk_rms_m", round(day.rtk.rms_m, 4)),
        ("lgpr_rms_m", round(day.lgpr.rms_m, 4)),
        ("lgpr_largest_m", round(day.lgpr.largest_m, 4)),
        ("engaged_m", round(day.lgpr.metres, 0)),
        ("wrong_fixes", f"{wrong} of {fixes}"),
    ):
        record_property(what, figure)
        print(name, what, figure)
    assert min(day.rtk.metres, day.lgpr.metres) > 0.95 * _MILE_M
    assert day.rtk.rms_m <= 0.10
    assert day.lgpr.rms_m <= 0.14
    assert wrong == 0
    # Of 20 intervals of 95 %, one is outside on average.
    assert len(outside) <= 2, outside


def intervals(folder: Path, kit: Kit) -> tuple[list[str], int]:
    """Numbers of the vehicle file whose interval has not the truth, and how many are judged."""
    found = read_vehicle(folder / "kit.vehicle.toml").found
    judged = {path: truth for path, truth in kit.truth.items() if path in found}
    outside = [
        path
        for path, truth in judged.items()
        if not float(found[path].low) <= truth <= float(found[path].high)  # type: ignore[arg-type]
    ]
    return outside, len(judged)
