"""The vehicle's body under the box's orders and the driver's hands: what acts, and what is measured of it."""

from typing import NamedTuple

import numpy as np

from lgprjax.scene.vehicle_drive import TrueVehicle
from lgprjax.simulation.devices.course_world import CourseWorld, Start
from lgprjax.simulation.devices.drive_box import Orders
from lgprjax.simulation.devices.driver import Hands
from lgprjax.simulation.devices.faults import Faults
from lgprjax.simulation.devices.trajectory import Sample
from lgprjax.simulation.devices.vehicle import Acting, Moved, Vehicle

_THROTTLE_LAG_S = 0.05


class Turned(NamedTuple):
    """A tick of the body: what acted, how the vehicle moved, and the sample at the end."""

    acting: Acting
    moved: Moved
    sample: Sample


class Body:
    """The vehicle with its actuators, ticking.

    Args:
        true: the vehicle.
        world: that it is in.
        start: where it stands.
        faults: that run.
        seed: of its sensors' errors.
    """

    def __init__(self, true: TrueVehicle, world: CourseWorld, start: Start, faults: Faults, seed: int) -> None:
        self._true, self._world, self._faults = true, world, faults
        self.vehicle = Vehicle(
            true, world.laid.terrain, tick_s=world.tick_s, start=start.pose, along_m=start.along_m, seed=seed
        )
        roll = world.roll(start.pose, start.along_m)
        still = dict.fromkeys(Sample._fields, 0.0)
        still |= dict(zip(("x_m", "y_m", "yaw_rad"), start.pose, strict=True))
        still |= {"roll_rad": roll, "along_m": start.along_m, "supply_v": true.nominal_v, "odometer_gain": 1.0}
        self.sample = Sample(**still)

    def step(self, orders: Orders, hands: Hands) -> Turned:
        """The body a tick later."""
        acting, pressure = self._acting(orders, hands)
        moved = self.vehicle.step(acting)
        before, true = self.sample, self._true
        gain = self._odometer_gain(moved)
        self.sample = Sample(
            x_m=moved.x_m,
            y_m=moved.y_m,
            yaw_rad=moved.yaw_rad,
            roll_rad=self._world.roll((moved.x_m, moved.y_m, moved.yaw_rad), moved.along_m),
            travel_m=moved.travel_m,
            along_m=moved.along_m,
            speed_mps=moved.speed_mps,
            front_rad=moved.front_rad,
            motor_rad=moved.motor_rad,
            throttle=self._lagged(before.throttle, acting.throttle, _THROTTLE_LAG_S),
            brake=self._lagged(before.brake, pressure, true.brake[3]),
            supply_v=self._supply(),
            odometer_m=before.odometer_m + gain * (moved.travel_m - before.travel_m),
            odometer_gain=gain,
            rate_bias_radps=moved.rate_bias_radps,
            heading_slow_rad=moved.heading_slow_rad,
        )
        return Turned(acting, moved, self.sample)

    def _acting(self, orders: Orders, hands: Hands) -> tuple[Acting, float]:
        """What acts, and the pressure asked of the brake's hydraulics: the parking lever has none."""
        faults = self._faults
        throttle = orders.throttle if orders.pedals else hands.throttle
        throttle = faults.number("throttle_stuck", "at", throttle)
        foot = hands.brake if hands.foot_on_brake else 0.0
        box = 0.0 if faults.has("brake_dead") else orders.brake
        # Who lets the box have the pedals has let go of the parking lever.
        lever = 0.0 if hands.foot_on_brake or orders.pedals else hands.brake
        acting = Acting(
            by_hand=not orders.steering,
            front_rad=orders.front_rad if orders.steering else hands.front_rad,
            throttle=0.0 if orders.cut else float(np.clip(throttle, 0.0, 1.0)),
            brake=float(np.clip(max(box, foot, lever), 0.0, 1.0)),
            supply_v=self._true.stall_v if faults.has("servo_stalled") else self._supply(),
            runaway_radps=faults.number("servo_runaway", "radps", 0.0),
            rear_rad=faults.number("rear_stuck", "rad", float("nan")),
        )
        return acting, max(box, foot)

    def _supply(self) -> float:
        weak = self._faults.number("servo_weak", "supply_v", self._true.nominal_v)
        return self._faults.number("supply_sag", "v", weak)

    def _odometer_gain(self, moved: Moved) -> float:
        faults = self._faults
        if faults.has("odometer_dead"):
            return 0.0
        sign = -1.0 if faults.has("odometer_reversed") else 1.0
        return sign * (1.0 + moved.odometer_scale) * (1.0 + faults.number("odometer_slip", "share", 0.0))

    def _lagged(self, before: float, wanted: float, lag_s: float) -> float:
        return wanted + float(np.exp(-self._world.tick_s / lag_s)) * (before - wanted)
