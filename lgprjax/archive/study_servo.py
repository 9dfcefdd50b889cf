"""Study of the steering servo: lag, delay, dead band and rate from its commands and what the wheels did."""

from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float

from lgprjax.archive.study_parts import (
    Figure,
    LoggedDrive,
    Outcome,
    Task,
    fitting,
    front_angles,
    one_drive,
    refuse_options,
    rms,
    signal_of,
)
from lgprjax.archive.vehicles import servo_of
from lgprjax.formats import with_values
from lgprjax.tuning import DriveSignals
from lgprjax.tuning.servo_fit import ServoFit, fit_servo
from lgprjax.tuning.servo_model import servo_log, to_box, wheel_angles
from lgprjax.vehicle import Servo

_KEYS = ("lag_s", "delay_s", "dead_band_rad", "largest_wheel_rate_radps", "asymmetry")


class ServoStudy(NamedTuple):
    """For pictures: the drive, the wheel angles that were fitted, and the fit."""

    signals: DriveSignals
    measured_rad: Float[np.ndarray, " record"]
    fit: ServoFit


def study_servo(task: Task) -> Outcome:
    """Find the servo's numbers in ``steering``; its play and voltages are taken from the vehicle file.

    Wheel angles are those of the vehicle file's ``wheel_map`` at the potentiometer's values; without one, those of the
    wheel angle's own sensor.
    """
    refuse_options(task)
    drive = one_drive(task)
    signal_of(drive, "command_rad")
    measured, origin = front_angles(task, drive)
    with fitting(drive.path):
        fit = fit_servo(drive.signals, measured, _given(task))
    found = {f"steering.{key}": estimate for key, estimate in zip(_KEYS, fit[:5], strict=True)}
    left_deg = np.degrees(measured - fit.model_rad)
    figures = [
        Figure("wheel angle, measured less model, rms", rms(left_deg[np.isfinite(left_deg)]), "deg"),
        Figure("records that stand for one, residuals being correlated", fit.memory, ""),
        Figure("swarm's numbers against the gradient's, largest difference", fit.apart, "standard errors"),
    ]
    figures += [_judge(task, judge, fit) for judge in task.judges]
    agree = "agree" if fit.agree else "do NOT agree: the fit may not be the best one"
    notes = (
        f"wheel angles by {origin}; straight ahead they read {np.degrees(fit.zero_rad.value):.3f}°",
        f"play of {np.degrees(float(fit.servo.backlash_rad)):.2f}° taken as given",
        f"search by gradient and by particle swarm {agree}",
    )
    return Outcome({**found}, {}, tuple(figures), notes, ServoStudy(drive.signals, measured, fit))


def _given(task: Task) -> Servo:
    """Play and voltages of the file; what is sought stands for nothing."""
    sought = {f"steering.{key}": 0.0 for key in _KEYS} | {"steering.largest_wheel_rate_radps": 1.0}
    return servo_of(with_values(task.vehicle, sought, {}), task.study.vehicle)


def _judge(task: Task, judge: LoggedDrive, fit: ServoFit) -> Figure:
    """Wheel angles of another drive about this fit's model."""
    measured, _ = front_angles(task, judge)
    numbers = np.array([estimate.value for estimate in fit[:6]])
    with fitting(judge.path):
        log = servo_log(judge.signals, measured, fit.servo)
    model = np.asarray(wheel_angles(log, jnp.asarray(to_box(numbers), jnp.float32)), np.float64)
    left_deg = np.degrees((measured - model)[np.asarray(log.used)])
    return Figure(f"held out, {judge.path.name}: wheel angle less model, rms", rms(left_deg), "deg")
