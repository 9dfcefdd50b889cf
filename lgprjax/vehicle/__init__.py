"""Vehicles: steering geometry, motion, pursuit laws, actuators and sensors, rollouts along courses."""

from lgprjax.vehicle.arc import VehiclePose, body_point, drive_arc
from lgprjax.vehicle.chassis import (
    Chassis,
    MeasuredRear,
    ProportionalRear,
    Rear,
    Turn,
    rear_angle,
    turn_of,
    yaw_gain,
    zero_slip_point,
)
from lgprjax.vehicle.pursuit import Steering, reverse_look_ahead_m, steer_closed, steer_exact
from lgprjax.vehicle.servo import Servo, ServoState, ideal_servo, init_servo, step_servo, torque_share

__all__ = [
    "Chassis",
    "MeasuredRear",
    "ProportionalRear",
    "Rear",
    "Servo",
    "ServoState",
    "Steering",
    "Turn",
    "VehiclePose",
    "body_point",
    "drive_arc",
    "ideal_servo",
    "init_servo",
    "rear_angle",
    "reverse_look_ahead_m",
    "steer_closed",
    "steer_exact",
    "step_servo",
    "torque_share",
    "turn_of",
    "yaw_gain",
    "zero_slip_point",
]
