"""Studies: calibrations and tunings of a vehicle on its logs, from a study file to a new vehicle file.

Not among the names of ``lgprjax.archive``: whoever registers drives need not wait for the tuners to be imported.
"""

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any, NamedTuple

from lgprjax.archive.study_fusion import study_fusion
from lgprjax.archive.study_look_ahead import study_look_ahead
from lgprjax.archive.study_parts import LoggedDrive, Outcome, Task
from lgprjax.archive.study_pedals import study_pedals
from lgprjax.archive.study_rear_ratio import study_rear_ratio
from lgprjax.archive.study_sensors import study_encoder, study_straight
from lgprjax.archive.study_servo import study_servo
from lgprjax.archive.study_wheel_angle import study_wheel_angle
from lgprjax.archive.study_yaw_gain import study_yaw_gain
from lgprjax.archive.vehicle_signals import signals_of
from lgprjax.errors import InputError
from lgprjax.formats import Found, Study, VehicleFile, VehicleLog, read_vehicle, require_serial_number, with_values
from lgprjax.tuning import Estimate


class FinishedStudy(NamedTuple):
    """What came of a study.

    Attributes:
        study: as its file says.
        outcome: what was found, and how well it holds.
        vehicle: the vehicle with the numbers found, ready to be written.
    """

    study: Study
    outcome: Outcome
    vehicle: VehicleFile


def run_study(study: Study) -> FinishedStudy:
    """Run a study; nothing is written.

    Raises:
        InputError: a file cannot be read, is about another vehicle, or does not hold what the fit needs.
    """
    vehicle = read_vehicle(study.vehicle)
    require_serial_number(vehicle, study.vehicle, study.serial_number, study.file, "serial_number")
    drives = _read_logs(study, vehicle, study.logs, "logs")
    judges = _read_logs(study, vehicle, study.held_out, "held_out")
    outcome = _RUN[study.kind](Task(study, vehicle, drives, judges))
    logs = ", ".join(path.name for path in study.logs) or "simulated"
    values: dict[str, Any] = dict(outcome.fixed)
    found: dict[str, Found] = {}
    for path, estimates in outcome.found.items():
        values[path], found[path] = _as_found(estimates, study.name, logs)
    return FinishedStudy(study, outcome, with_values(vehicle, values, found))


def _read_logs(study: Study, vehicle: VehicleFile, paths: Sequence[Path], key: str) -> tuple[LoggedDrive, ...]:
    if key == "logs" and not paths and study.kind != "look_ahead":
        raise InputError(study.file, key, "one drive log or more", "none")
    drives = []
    for path in paths:
        log = VehicleLog.open(path)
        require_serial_number(vehicle, study.vehicle, log.serial_number, path, "/vehicle@serial_number")
        drives.append(LoggedDrive(path, signals_of(log, str(path))))
    return tuple(drives)


def _as_found(estimates: Estimate | list[Estimate], study: str, logs: str) -> tuple[Any, Found]:
    if isinstance(estimates, Estimate):
        return estimates.value, Found(
            low=estimates.low, high=estimates.high, sigma=estimates.sigma, study=study, log=logs
        )
    low, high, sigma = ([getattr(e, name) for e in estimates] for name in ("low", "high", "sigma"))
    return [e.value for e in estimates], Found(low=low, high=high, sigma=sigma, study=study, log=logs)


_RUN: dict[str, Callable[[Task], Outcome]] = {
    "straight": study_straight,
    "encoder": study_encoder,
    "wheel_angle": study_wheel_angle,
    "rear_ratio": study_rear_ratio,
    "yaw_gain": study_yaw_gain,
    "servo": study_servo,
    "pedals": study_pedals,
    "look_ahead": study_look_ahead,
    "fusion": study_fusion,
}
