"""What all studies share: a task, an outcome, and how a log that does not tell enough becomes one line."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.archive.vehicle_signals import SIGNAL_NAMES
from lgprjax.archive.vehicles import chassis_of
from lgprjax.errors import InputError
from lgprjax.formats import Study, VehicleFile, with_values
from lgprjax.tuning import DriveSignals, Estimate, NotExcitedError
from lgprjax.vehicle import Chassis


class LoggedDrive(NamedTuple):
    """A drive and its file."""

    path: Path
    signals: DriveSignals


class Task(NamedTuple):
    """What a study is to do: with which vehicle, on which drives, judged by which."""

    study: Study
    vehicle: VehicleFile
    drives: tuple[LoggedDrive, ...]
    judges: tuple[LoggedDrive, ...]


class Figure(NamedTuple):
    """A figure that says how well a fit holds."""

    name: str
    value: float
    unit: str


class Outcome(NamedTuple):
    """What a study found.

    Attributes:
        found: by path in the vehicle file, with intervals; a list for a key that is one.
        fixed: numbers of the vehicle file that were set and not measured, such as the knots of a map.
        figures: how well the fit holds, on its logs and on those held out.
        notes: what a reader must know, a line each.
        detail: fits and signals, for pictures; its type goes with the kind of study.
    """

    found: dict[str, Estimate | list[Estimate]]
    fixed: dict[str, Any]
    figures: tuple[Figure, ...]
    notes: tuple[str, ...]
    detail: Any


@contextmanager
def fitting(path: Path) -> Iterator[None]:
    """Turn a fit's refusal of a log into the one line that names the log.

    Raises:
        InputError: the log does not hold what the fit needs.
    """
    try:
        yield
    except NotExcitedError as error:
        raise InputError(path, error.what, error.expected, error.found) from None


def one_drive(task: Task) -> LoggedDrive:
    """The one log of a study that works on one.

    Raises:
        InputError: there are several.
    """
    if len(task.drives) != 1:
        raise InputError(
            task.study.file, "logs", f"one drive log for a study of {task.study.kind}", str(len(task.drives))
        )
    return task.drives[0]


def refuse_options(task: Task, known: tuple[str, ...] = ()) -> None:
    """Refuse options that the study does not have.

    Raises:
        InputError: there is one.
    """
    for name in task.study.options:
        if name not in known:
            expected = f"an option among {', '.join(known)}" if known else f"no options for {task.study.kind}"
            raise InputError(task.study.file, f"options.{name}", expected, "an unknown key")


def potentiometer_of(drive: LoggedDrive) -> Float[np.ndarray, " record"]:
    """The potentiometer's signal.

    Raises:
        InputError: the log has none.
    """
    return signal_of(drive, "potentiometer_v")


def signal_of(drive: LoggedDrive, name: str) -> Float[np.ndarray, " record"]:
    """A signal that a study cannot do without.

    Raises:
        InputError: the log has none.
    """
    values = getattr(drive.signals, name)
    if values is None:
        raise InputError(drive.path, f"/vehicle/{SIGNAL_NAMES[name]}", "a signal of the vehicle", "none")
    return np.asarray(values)


def front_angles(task: Task, drive: LoggedDrive) -> tuple[Float[np.ndarray, " record"], str]:
    """Front wheel angle at every record, and where it is from: the vehicle file's map, or the angle's own sensor.

    Beyond the map's ends there is no angle.

    Raises:
        InputError: the log lacks the signal.
    """
    held = task.vehicle.wheel_map
    if held is None:
        return signal_of(drive, "front_rad"), "the wheel angle's sensor"
    knots_v = held.first_v + held.step_v * np.arange(len(held.front_rad))
    front = np.interp(potentiometer_of(drive), knots_v, held.front_rad, left=np.nan, right=np.nan)
    return np.asarray(front), "wheel_map"


def fixed_records(signals: DriveSignals) -> DriveSignals:
    """The records with a position and a heading of their own: GNSS/INS is slower than the vehicle's signals."""
    fixed = np.isfinite(signals.east_m + signals.north_m + signals.yaw_rad)
    held = {name: values[fixed] for name, values in signals._asdict().items() if values is not None}
    return DriveSignals(**held)


def rms(values: Float[np.ndarray, " value"]) -> float:
    """Root of the mean square."""
    return float(np.sqrt(np.mean(values**2)))


def chassis_without_anchor(task: Task) -> Chassis:
    """The chassis for fits, which use no anchor: a vehicle that is still being calibrated has none yet.

    Where the file says nothing of the rear wheels they stand straight: a study of k starts there.

    Raises:
        InputError: another number that is needed is not in the vehicle file.
    """
    vehicle = task.vehicle
    if vehicle.pursuit.anchor_m is None:
        vehicle = with_values(vehicle, {"pursuit.anchor_m": 0.0}, {})
    if task.study.kind == "rear_ratio" and vehicle.steering.rear_ratio is None:
        vehicle = with_values(vehicle, {"steering.rear_ratio": 0.0}, {})
    return chassis_of(vehicle, task.study.vehicle)
