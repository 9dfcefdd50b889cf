"""Logged drives for the benchmark of a whole study, and what the study hands to its peers: plain arrays in a file."""

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from lgprjax.simulation import read_vehicle_plan, write_vehicle_logs

TUNING = Path(__file__).resolve().parents[1] / "tuning"
VEHICLE = TUNING / "tracking.vehicle.toml"
_DRIVES = TUNING / "tracking_drives.toml"
_SPEEDS_MPS = (2.235, 4.47, 1.5, 3.7, 3.0)
_RADII_M = ("[14, -12, 18]", "[-30, 26, -40]", "[-16, 20, -24]", "[25, -22, 30]")
_OFFSETS_M = (3.0, -3.0, 0.0, 1.5)
MOST_LOGS = len(_SPEEDS_MPS) * len(_RADII_M)


def simulate_logs(count: int, folder: Path) -> list[Path]:
    """Drives by the autopilot of the vehicle of ``tuning/tracking_drives.toml``, each of another speed or course.

    Args:
        count: up to ``MOST_LOGS``.
        folder: for the logs.
    """
    text = _DRIVES.read_text(encoding="utf-8").partition("[[drive]]")[0]
    for number in range(count):
        course, speed = divmod(number, len(_SPEEDS_MPS))
        mps = _SPEEDS_MPS[speed]
        ahead_m = float(np.interp(mps, [2.235, 4.47], [4.0, 6.0]))
        text += (
            f'[[drive]]\nname = "drive_{number:02d}"\nmanoeuvre = "tracking"\nspeed_mps = {mps}\n'
            f"radii_m = {_RADII_M[course]}\noffset_m = {_OFFSETS_M[course]}\nlead_in_s = 2.0\n"
            f"look_ahead_m = {ahead_m:.3f}\n\n"
        )
    plan = folder / "drives.toml"
    plan.write_text(text, encoding="utf-8")
    return sorted(write_vehicle_logs(read_vehicle_plan(plan), folder).values())


class TuningProblem(NamedTuple):
    """What the peers need of a study, and what it found.

    Attributes:
        command_rad, share, speed_mps, front_rad, yaw_rate_radps, front_used, yaw_used, placed: the drives, as
            ``LoopLogs``.
        value, width, wheelbase_m, backlash_rad: as ``LoopPrior``.
        found, sigma: numbers of the fit and their standard errors, in the order of its names.
        draws: of those numbers.
        believed: wheelbase, anchor, k, largest angle and V_CHAR of the law.
        ahead_m: look-ahead of the schedule found.
        speeds_mps, shares, offsets_m: of the trials.
        rows_0, rows_1: tables of their paths.
        paths: spacing, length and laps a metre of each.
        settings: steps, length of a step, weight of effort, steps of the longest delay.
        cost_m: of each draw by the study.
    """

    command_rad: Float[np.ndarray, "drive step"]
    share: Float[np.ndarray, "drive step"]
    speed_mps: Float[np.ndarray, "drive step"]
    front_rad: Float[np.ndarray, "drive step"]
    yaw_rate_radps: Float[np.ndarray, "drive step"]
    front_used: Bool[np.ndarray, "drive step"]
    yaw_used: Bool[np.ndarray, "drive step"]
    placed: Bool[np.ndarray, "drive step"]
    value: Float[np.ndarray, " number"]
    width: Float[np.ndarray, " number"]
    wheelbase_m: Float[np.ndarray, ""]
    backlash_rad: Float[np.ndarray, ""]
    found: Float[np.ndarray, " number"]
    sigma: Float[np.ndarray, " number"]
    draws: Float[np.ndarray, "draw number"]
    believed: Float[np.ndarray, " 5"]
    ahead_m: Float[np.ndarray, "speed share"]
    speeds_mps: Float[np.ndarray, " speed"]
    shares: Float[np.ndarray, " share"]
    offsets_m: Float[np.ndarray, " offset"]
    rows_0: Float[np.ndarray, "row 5"]
    rows_1: Float[np.ndarray, "row 5"]
    paths: Float[np.ndarray, "path 3"]
    settings: Float[np.ndarray, " 4"]
    cost_m: Float[np.ndarray, "draw speed share"]


def save_tuning(file: Path, problem: TuningProblem) -> None:
    """As npz."""
    fields: dict[str, Any] = problem._asdict()
    with file.open("wb") as out:
        np.savez(out, **fields)


def load_tuning(file: Path) -> TuningProblem:
    """From npz."""
    with np.load(file) as found:
        return TuningProblem(*(found[name] for name in TuningProblem._fields))
