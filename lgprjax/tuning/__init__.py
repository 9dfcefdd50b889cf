"""Calibrations and tunings of a vehicle on its logged drives: pure functions, each with the interval of what it found."""

from lgprjax.tuning.estimate import Estimate, NotExcited
from lgprjax.tuning.signals import DriveSignals

__all__ = ["DriveSignals", "Estimate", "NotExcited"]
