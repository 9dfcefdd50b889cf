"""Calibrations and tunings of a vehicle on its logged drives: pure functions, each with the interval of its find."""

from lgprjax.tuning.estimate import Estimate, NotExcitedError
from lgprjax.tuning.signals import DriveSignals

__all__ = ["DriveSignals", "Estimate", "NotExcitedError"]
