"""A kit calibrated by its prompts in lock step: the vehicle file that a crew has afterwards.

The whole first day, with the palm tree and the turning tests, is driven by ``make validation NAME=first_day``.
"""

import math
import re
import tomllib
from pathlib import Path
from typing import Any, NamedTuple

import pytest

from canon.commands import run
from canon.shared import shared_folder
from lgprjax.formats import flat_keys


class Kit(NamedTuple):
    """A simulated vehicle that nobody knows.

    Attributes:
        numbers: of it, see ``simulation.vehicle_plans.true_vehicle``.
        known: what the crew writes into the vehicle file by itself, beside lengths measured with a tape.
    """

    numbers: dict[str, Any]
    known: str = ""

    @property
    def table(self) -> str:
        """The numbers as TOML."""
        return "".join(f"{name} = {value}\n" for name, value in self.numbers.items())

    @property
    def truth(self) -> dict[str, float]:
        """Numbers that a calibration finds, by their paths in the vehicle file: none that the crew knows. Not the delay
        of the steering: that of the vehicle file is from the decision on, with the line to the box.
        """
        own, steering = self.numbers, "steering."
        found = {
            "straight_potentiometer_v": own["potentiometer_straight_v"],
            "rear_ratio": own["rear"],
            "potentiometer_v_per_rad": own["potentiometer_per_rad_v"][0],
            "encoder_counts_per_rad": own["encoder_counts_per_rad"],
            "backlash_rad": math.radians(own["backlash_deg"]),
            "characteristic_speed_mps": own["characteristic_speed_mps"],
            "lag_s": own["lag_s"],
            "largest_wheel_rate_radps": own["rate_radps"],
            "dead_band_rad": math.radians(own["dead_band_deg"]),
            "asymmetry": own.get("asymmetry", 0.0),
        }
        truth = {steering + name: float(value) for name, value in found.items()}
        for pedal in ("throttle", "brake"):
            names = ("pre_tension", "dead_zone", "gain_mps2", "lag_s")
            truth |= {f"{pedal}.{name}": value for name, value in zip(names, own[pedal], strict=True)}
        truth |= {f"resistance.{name}": own[name] for name in ("rolling_mps2", "drag_per_s")}
        stated = flat_keys(tomllib.loads(self.known))
        return {path: value for path, value in truth.items() if path not in stated}


# Three turns of the steering wheel from lock to lock: a palm tree of seven arcs, the least.
SHORT = Kit(
    {
        "wheelbase_m": 3.4,
        "largest_angle_deg": 32.0,
        "characteristic_speed_mps": 14.0,
        "rear": 0.5,
        "lag_s": 0.2,
        "rate_radps": 0.4,
        "delay_s": 0.08,
        "dead_band_deg": 0.3,
        "backlash_deg": 0.4,
        "potentiometer_straight_v": 2.2,
        "potentiometer_per_rad_v": [-1.6],
        "encoder_counts_per_rad": 9000.0,
        "lock_to_lock_turns": 3.0,
        "throttle": [0.15, 0.04, 2.5, 0.5],
        "brake": [0.12, 0.05, 5.0, 0.3],
        "rolling_mps2": 0.2,
        "drag_per_s": 0.04,
    }
)

# The same kit whose crew has driven palm tree and turning tests before: two minutes of simulation less.
DRIVEN_BEFORE = SHORT._replace(
    known=f"""[steering]
rear_ratio = 0.5
potentiometer_v_per_rad = -1.6
largest_wheel_angle_rad = 0.5585
characteristic_speed_mps = 14.0
[wheel_map]
first_v = 1.3
step_v = 0.9
front_rad = [{(2.2 - 1.3) / 1.6}, 0.0, {(2.2 - 3.1) / 1.6}]
"""
)

KIT_FILE = Path(__file__).with_name("kit.vehicle.toml")
"""The file of this kit after all steps: ``make validation NAME=long`` drives them, and compares."""

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
    told = _FILE.format(wheelbase_m=kit.numbers["wheelbase_m"], known=kit.known, ARRAY_X_M=ARRAY_X_M)
    path.write_text(told, encoding="utf-8")
    return path


def calibrated(factory: pytest.TempPathFactory, *, but_steering: bool = False) -> Calibrated:
    """The kit after all steps that were due; made once a session. Not to be changed.

    Args:
        factory: of the session.
        but_steering: all but the steering's steps were done before (``KIT_FILE``), which were then forgotten.
    """

    def make(folder: Path) -> None:
        vehicle = write_kit(folder, DRIVEN_BEFORE)
        if but_steering:
            vehicle.write_text(without_steering(KIT_FILE.read_text(encoding="utf-8")), encoding="utf-8")
        done = run("calibrate", vehicle, "--simulate")
        assert done.status == 0, (done.out[-2000:], done.err[-2000:])

    folder = shared_folder(factory, "calibrated_steering" if but_steering else "calibrated", make)
    return Calibrated(folder / "kit.vehicle.toml", folder / "calibration" / "kit")


def without_steering(text: str) -> str:
    """A vehicle file in which a number of the steering's steps is open again."""
    text = re.sub(r"^dead_band_rad = .*\n", "", text, flags=re.M)
    return re.sub(r'\[found."steering.dead_band_rad"\]\n(.+\n)+', "", text)
