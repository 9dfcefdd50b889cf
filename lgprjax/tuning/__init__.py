"""Calibrations and tunings of a vehicle on its logged drives: pure functions, each with the interval of its find."""

from lgprjax.tuning.arcs import Arcs, choose_arcs, fit_arcs
from lgprjax.tuning.encoder import EncoderFit, fit_encoder, potentiometer_of_counts
from lgprjax.tuning.estimate import Estimate, NotExcitedError
from lgprjax.tuning.fix_error_fit import FixErrorFit, fit_fix_errors
from lgprjax.tuning.fusion_fit import NOISES, FusionFit, fit_fusion
from lgprjax.tuning.innovations_likelihood import NavigationDrives
from lgprjax.tuning.limit_cycle import LimitCycle, find_limit_cycle
from lgprjax.tuning.look_ahead_trials import Judged, Trials, TunedVehicle, judge, sweep_look_ahead
from lgprjax.tuning.look_ahead_tuner import GradientConfig, TunedLookAhead, cost_of, tune_look_ahead
from lgprjax.tuning.pauses import Pauses, find_pauses
from lgprjax.tuning.pedal_fit import PedalFit, PedalsFit, fit_pedals
from lgprjax.tuning.rear_map import RearComparison, RearMapFit, compare_rears, fit_rear_map
from lgprjax.tuning.rear_ratio import RearRatioFit, rear_ratio_by_angles, rear_ratio_by_heading
from lgprjax.tuning.robust import (
    RobustFit,
    combine,
    robust_fit,
    robust_line,
    robust_polynomial,
    student_95,
)
from lgprjax.tuning.servo_fit import ServoFit, fit_servo
from lgprjax.tuning.straight import StraightFit, fit_straight
from lgprjax.tuning.stretches import Stretches, StretchRules, find_stretches
from lgprjax.tuning.threshold_fit import ThresholdFit, fit_threshold
from lgprjax.tuning.wheel_angle import (
    SteeringMap,
    WheelAngleFit,
    fit_wheel_angle,
    front_angle,
    front_band,
    front_of_stretches,
)
from lgprjax.tuning.yaw_gain_fit import YawGainFit, fit_yaw_gain
from lgprjax.vehicle.signals import DriveSignals

__all__ = [
    "NOISES",
    "Arcs",
    "DriveSignals",
    "EncoderFit",
    "Estimate",
    "FixErrorFit",
    "FusionFit",
    "GradientConfig",
    "Judged",
    "LimitCycle",
    "NavigationDrives",
    "NotExcitedError",
    "Pauses",
    "PedalFit",
    "PedalsFit",
    "RearComparison",
    "RearMapFit",
    "RearRatioFit",
    "RobustFit",
    "ServoFit",
    "SteeringMap",
    "StraightFit",
    "StretchRules",
    "Stretches",
    "ThresholdFit",
    "Trials",
    "TunedLookAhead",
    "TunedVehicle",
    "WheelAngleFit",
    "YawGainFit",
    "choose_arcs",
    "combine",
    "compare_rears",
    "cost_of",
    "find_limit_cycle",
    "find_pauses",
    "find_stretches",
    "fit_arcs",
    "fit_encoder",
    "fit_fix_errors",
    "fit_fusion",
    "fit_pedals",
    "fit_rear_map",
    "fit_servo",
    "fit_straight",
    "fit_threshold",
    "fit_wheel_angle",
    "fit_yaw_gain",
    "front_angle",
    "front_band",
    "front_of_stretches",
    "judge",
    "potentiometer_of_counts",
    "rear_ratio_by_angles",
    "rear_ratio_by_heading",
    "robust_fit",
    "robust_line",
    "robust_polynomial",
    "student_95",
    "sweep_look_ahead",
    "tune_look_ahead",
]
