"""All watches over what the control loop hears, tick after tick, as the loop itself calls them."""

from typing import NamedTuple

from autopilot.watch_drives import TICK_S, Row, believed
from lgprjax.autopilot.chassis_monitors import (
    ChassisWatchState,
    PedalReading,
    PedalWatchState,
    ServoWatchState,
    WheelSensorState,
    step_chassis_watch,
    step_pedal_watch,
    step_servo_watch,
    step_wheel_sensors,
)
from lgprjax.autopilot.monitors import Watch, as_watch
from lgprjax.autopilot.position_monitors import (
    HeadingCheck,
    HeadingWatchState,
    MonitoredPosition,
    OdometerWatchState,
    step_heading_watch,
    step_odometer_watch,
)

ODOMETER = Watch.ODOMETER_DEAD | Watch.ODOMETER_REVERSED | Watch.ODOMETER_SLIPS
GNSS_LATE_TICKS = 2


class Watches(NamedTuple):
    """States of all, the last findings of the odometer's, and positions on their way."""

    sensors: WheelSensorState = WheelSensorState()
    servo: ServoWatchState = ServoWatchState()
    chassis: ChassisWatchState = ChassisWatchState()
    pedals: PedalWatchState = PedalWatchState()
    odometer: OdometerWatchState = OdometerWatchState()
    heading: HeadingWatchState = HeadingWatchState()
    odometer_bits: Watch = Watch(0)
    late: tuple[MonitoredPosition | None, ...] = ()


def watch_row(state: Watches, row: Row, tick: int) -> tuple[Watches, Watch]:
    """States and all findings after a tick."""
    wheel, chassis, pedals = believed()
    time_s = tick * TICK_S
    heard = MonitoredPosition(time_s, row.gnss_x_m, row.gnss_y_m, 0.01) if row.gnss_valid else None
    late = (*state.late[-GNSS_LATE_TICKS:], heard)
    position = late[0] if len(late) > GNSS_LATE_TICKS else None
    engaged = row.steering > 0.0
    sensors, angles, bits = step_wheel_sensors(wheel, state.sensors, row.potentiometer_v, row.encoder_counts, TICK_S)
    found = int(bits)
    servo, bits = step_servo_watch(
        wheel, state.servo, angles, row.supply_v, engaged=engaged, command_rad=row.sent_rad, step_s=TICK_S
    )
    found |= int(bits)
    trusted = not state.odometer_bits
    turning, bits = step_chassis_watch(
        chassis,
        state.chassis,
        front_rad=angles.front_rad,
        yaw_rate_radps=row.yaw_rate_radps,
        speed_mps=row.speed_mps,
        speed_trusted=trusted,
        step_s=TICK_S,
    )
    found |= int(bits)
    pedal, bits = step_pedal_watch(
        pedals,
        state.pedals,
        engaged=row.pedals > 0.0,
        command=PedalReading(row.sent_throttle, row.sent_brake),
        measured=PedalReading(row.throttle, row.brake),
        speed_mps=row.speed_mps,
        speed_trusted=trusted,
        step_s=TICK_S,
    )
    found |= int(bits)
    heading, bits = step_heading_watch(
        state.heading,
        time_s=time_s,
        odometer_m=row.odometer_m,
        heading_rad=row.heading_rad,
        position=position,
        fix_heading_rad=None,
    )
    found |= int(bits)
    odometer, bits = step_odometer_watch(
        state.odometer,
        time_s=time_s,
        odometer_m=row.odometer_m,
        speed_mps=row.speed_mps,
        heading_rad=row.heading_rad,
        heading_confirmed=heading.check is HeadingCheck.CONFIRMED,
        position=position,
        thrust_mps2=pedal.throttle.effect_mps2 if row.pedals > 0.0 else 0.0,
        step_s=TICK_S,
    )
    found |= int(bits)
    return Watches(
        sensors, servo, turning, pedal, odometer, heading, bits & ODOMETER if bits else bits, late
    ), as_watch(found)
