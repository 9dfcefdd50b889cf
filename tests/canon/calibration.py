"""A kit on its first day, calibrated by its prompts in lock step: the vehicle file that a crew has afterwards."""

import math
from pathlib import Path
from typing import NamedTuple

import pytest

from canon.commands import run
from canon.shared import shared_folder

TRUTH = {
    "steering.straight_potentiometer_v": 2.2,
    "steering.rear_ratio": 0.5,
    "steering.potentiometer_v_per_rad": -1.6,
    "steering.encoder_counts_per_rad": 9000.0,
    "steering.backlash_rad": math.radians(0.4),
    "steering.characteristic_speed_mps": 14.0,
    "steering.lag_s": 0.2,
    "steering.largest_wheel_rate_radps": 0.4,
    "steering.dead_band_rad": math.radians(0.3),
    "throttle.pre_tension": 0.15,
    "throttle.dead_zone": 0.04,
    "throttle.gain_mps2": 2.5,
    "throttle.lag_s": 0.5,
    "brake.pre_tension": 0.12,
    "brake.dead_zone": 0.05,
    "brake.gain_mps2": 5.0,
    "brake.lag_s": 0.3,
    "resistance.rolling_mps2": 0.2,
    "resistance.drag_per_s": 0.04,
}
"""Numbers of the simulated vehicle, by their paths in the vehicle file."""


class Kit(NamedTuple):
    """A simulated vehicle that nobody knows.

    Attributes:
        table: its numbers, see ``simulation.vehicle_logs.true_vehicle``.
        known: what the crew writes into the vehicle file by itself, beside lengths measured with a tape.
        wheelbase_m: by tape.
    """

    table: str
    wheelbase_m: float
    known: str = ""


# Three turns of the steering wheel from lock to lock: a palm tree of seven arcs, the least.
SHORT = Kit(
    """wheelbase_m = 3.4
largest_angle_deg = 32.0
characteristic_speed_mps = 14.0
rear = 0.5
lag_s = 0.2
rate_radps = 0.4
delay_s = 0.08
dead_band_deg = 0.3
backlash_deg = 0.4
potentiometer_straight_v = 2.2
potentiometer_per_rad_v = [-1.6]
encoder_counts_per_rad = 9000.0
lock_to_lock_turns = 3.0
throttle = [0.15, 0.04, 2.5, 0.5]
brake = [0.12, 0.05, 5.0, 0.3]
rolling_mps2 = 0.2
drag_per_s = 0.04
""",
    3.4,
)

ARRAY_X_M = 6.2

_FILE = """schema = "lgprjax.vehicle"
schema_version = "1.5"
name = "kit"
steering_kind = "counter_steer"
[chassis]
wheelbase_m = {wheelbase_m}
[array]
x_m = {ARRAY_X_M}
height_m = 0.3
[navigation]
gnss_x_m = 1.0
gnss_y_m = 0.0
gnss_error_sigma_m = 0.05
{known}"""

LINES = """name = "kit"
mode = "record"
vehicle = "kit.vehicle.toml"
cache = "cache"
[ports]
drive_by_wire = { url = "/dev/null" }
controller = { url = "/dev/null" }
gnss = { url = "/dev/null" }
[sensors]
gnss_delay_s = 0.03
[recording]
folder = "runs"
[display]
port = 0
[simulation]
length_m = 60.0
"""


class Calibrated(NamedTuple):
    """A calibrated vehicle file, and the folder of its drive logs and pictures."""

    vehicle: Path
    folder: Path


def write_kit(folder: Path, kit: Kit = SHORT, script: str = "") -> Path:
    """What a crew begins with: some lengths by tape, and the connections. Returns the vehicle file."""
    text = f"{LINES}{script}[simulation.vehicle]\n{kit.table}"
    (folder / "kit.run.toml").write_text(text, encoding="utf-8")
    path = folder / "kit.vehicle.toml"
    path.write_text(_FILE.format(wheelbase_m=kit.wheelbase_m, known=kit.known, ARRAY_X_M=ARRAY_X_M), encoding="utf-8")
    return path


def calibrated(factory: pytest.TempPathFactory) -> Calibrated:
    """The short kit after all steps; made once a session. Not to be changed."""

    def make(folder: Path) -> None:
        done = run("calibrate", write_kit(folder), "--simulate")
        assert done.status == 0, (done.out[-2000:], done.err[-2000:])

    folder = shared_folder(factory, "calibrated", make)
    return Calibrated(folder / "kit.vehicle.toml", folder / "calibration" / "kit")
