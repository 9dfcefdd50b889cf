"""A drive-by-wire box on the line of the onboard runtime: a template.

    python onboard/templates/drive_by_wire_box.py 5002

``Vehicle`` stands for servo, throttle, brake and their sensors, here a bench without a vehicle: put your hardware's
calls into its methods. The rules around it are those of data_schema/wire.toml and belong on the box: it goes to its
defaults by itself when nobody speaks to it, and comes back only for a command with engage 0, then one with engage set.
A box that moves a vehicle runs this on a microcontroller of its own, with the emergency stop wired past it.
"""

import math
import sys
import time

from line import Line

STEERING, PEDALS, CUT = 1, 2, 4
DEFAULTS_ACT, BAD_FRAMES, BRAKE_TESTED = 1, 2, 128
SILENT_NS, DEFAULT_BRAKE = 200_000_000, 0.5
PERIOD_NS = 10_000_000


class Vehicle:
    """Actuators and sensors: a bench whose wheels follow at 0.5 rad/s and whose speed follows throttle and brake."""

    def __init__(self) -> None:
        self.front_rad = self.throttle = self.brake = self.speed_mps = self.odometer_m = 0.0

    def act(self, front_rad: float | None, throttle: float, brake: float, step_s: float) -> None:
        """Drive the actuators; ``front_rad`` None: the servo without torque."""
        if front_rad is not None:
            self.front_rad += max(-0.5 * step_s, min(0.5 * step_s, front_rad - self.front_rad))
        self.throttle, self.brake = throttle, brake
        self.speed_mps = max(0.0, self.speed_mps + (3.0 * throttle - 6.0 * brake - 0.1 * self.speed_mps) * step_s)
        self.odometer_m += self.speed_mps * step_s

    def brake_test(self) -> bool:
        """Standing: press the brake, and measure whether pressure builds up."""
        return self.speed_mps == 0.0

    def sensors(self) -> dict[str, float]:
        """Readings, as in drive_status."""
        return {
            "potentiometer_v": 2.5 + 1.5 * self.front_rad,
            "encoder_counts": round(20000.0 * self.front_rad),
            "supply_v": 24.0,
            "torque_nm": 0.0,
            "pedals": 0,
            "throttle": self.throttle,
            "brake": self.brake,
            "odometer_m": self.odometer_m,
            "speed_mps": self.speed_mps,
        }


class Box:
    """The rules: what is held engaged, and the defaults."""

    def __init__(self) -> None:
        self.engaged, self.defaults_act, self.tested = 0, True, False
        self.front_rad = self.throttle = self.brake = 0.0
        self.sequence = 0
        self._until_ns, self._last_ns = 0, 0
        self._had_pedals = False

    def command(self, fields: dict[str, float], sequence: int, ttl_ms: int, now_ns: int) -> None:
        """A drive_command that the line accepted."""
        numbers = [float(fields[name]) for name in ("front_rad", "throttle", "brake")]
        if not all(map(math.isfinite, numbers)):
            return
        self.sequence, self._until_ns, self._last_ns = sequence, now_ns + ttl_ms * 1_000_000, now_ns
        engage = int(fields["engage"])
        if engage & CUT:
            self.engaged, self.defaults_act = CUT, True
            return
        if engage == 0:
            self.defaults_act = False
        self.engaged = 0 if self.defaults_act else engage
        self._had_pedals = bool(self.engaged & PEDALS)
        self.front_rad, self.throttle, self.brake = numbers

    def step(self, vehicle: Vehicle, bad_in_a_row: int, now_ns: int, step_s: float) -> None:
        """Obey, or go to the defaults."""
        if now_ns > self._until_ns or bad_in_a_row >= 3:
            self.defaults_act = True
            self.engaged &= CUT
        rolls_on = self._had_pedals and now_ns - self._last_ns >= SILENT_NS and vehicle.speed_mps > 0.0
        if self.engaged & CUT or (self.defaults_act and rolls_on):
            vehicle.act(None, 0.0, DEFAULT_BRAKE, step_s)
        else:
            steers, drives = bool(self.engaged & STEERING), bool(self.engaged & PEDALS)
            vehicle.act(
                self.front_rad if steers else None,
                self.throttle if drives else 0.0,
                self.brake if drives else 0.0,
                step_s,
            )

    def state(self, bad_in_a_row: int) -> int:
        """Bits of drive_status.state."""
        return DEFAULTS_ACT * self.defaults_act | BAD_FRAMES * (bad_in_a_row >= 3) | BRAKE_TESTED * self.tested


def main() -> None:
    """Serve until Ctrl-C."""
    line, box, vehicle = Line("drive_by_wire", int(sys.argv[1])), Box(), Vehicle()
    due_ns = time.monotonic_ns()
    while True:
        for frame, arrival_ns in line.take():
            if frame.name == "drive_command":
                fields = {name: frame.number(name) for name in ("front_rad", "throttle", "brake", "engage")}
                box.command(fields, frame.sequence, frame.ttl_ms, arrival_ns)
            elif frame.name == "drive_test" and not box.engaged:
                box.tested = vehicle.brake_test()
        now_ns = time.monotonic_ns()
        if now_ns >= due_ns:
            due_ns = max(due_ns + PERIOD_NS, now_ns)
            box.step(vehicle, line.bad_in_a_row, now_ns, PERIOD_NS / 1e9)
            line.send(
                "drive_status",
                command_sequence=box.sequence,
                engaged=box.engaged,
                state=box.state(line.bad_in_a_row),
                refused=line.refused & 0xFFFF,
                **vehicle.sensors(),
            )
        time.sleep(0.001)


if __name__ == "__main__":
    main()
