"""The watches over drives of two minutes of a sound vehicle, and over each fault at moments of them."""

import math
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from typing import NamedTuple

import jax.numpy as jnp
import numpy as np
from jaxtyping import Bool, Float

from autopilot.watch_drives import CHUNK, TICK_S, TICKS, Row, Wrong, drives_with, healthy_drives, nothing_wrong
from autopilot.watch_loop import Watches, watch_row
from lgprjax.autopilot.monitors import Watch


class Case(NamedTuple):
    """A fault.

    Attributes:
        bit: that finds it, or any of several.
        within_s: of its onset.
        when: moments at which it shows at once.
        wrong: with the vehicle; None where only a reading is.
        heard: a reading made wrong, from itself and that at the onset.
    """

    bit: Watch
    within_s: float
    when: str
    wrong: Wrong | None = None
    heard: Callable[[Row, Row], Row] | None = None


SOUND = nothing_wrong()
CASES = {
    "potentiometer open": Case(
        Watch.POTENTIOMETER_RANGE, 0.1, "engaged", heard=lambda row, _: row._replace(potentiometer_v=5.5)
    ),
    "potentiometer shorted": Case(
        Watch.POTENTIOMETER_RANGE, 0.1, "engaged", heard=lambda row, _: row._replace(potentiometer_v=0.0)
    ),
    "potentiometer no number": Case(
        Watch.POTENTIOMETER_RANGE, 0.1, "engaged", heard=lambda row, _: row._replace(potentiometer_v=math.nan)
    ),
    "potentiometer stuck": Case(
        Watch.POTENTIOMETER_STUCK,
        0.1,
        "wheels turn",
        heard=lambda row, first: row._replace(potentiometer_v=first.potentiometer_v),
    ),
    "encoder off": Case(
        Watch.WHEEL_SENSORS_APART,
        0.2,
        "engaged",
        heard=lambda row, _: row._replace(encoder_counts=row.encoder_counts + 600.0),
    ),
    "servo stalled": Case(Watch.SERVO_WEAK, 0.8, "command turns", wrong=SOUND._replace(supply_v=jnp.float32(10.0))),
    "servo stalled for good": Case(
        Watch.SERVO_DEAD, 0.9, "command turns", wrong=SOUND._replace(supply_v=jnp.float32(10.0))
    ),
    "servo weak": Case(Watch.SERVO_WEAK, 0.8, "command turns", wrong=SOUND._replace(supply_v=jnp.float32(13.0))),
    "supply low": Case(
        Watch.SUPPLY_LOW,
        0.3,
        "engaged",
        wrong=SOUND._replace(supply_v=jnp.float32(13.0)),
        heard=lambda row, _: row._replace(supply_v=13.0),
    ),
    "servo runs away left": Case(
        Watch.STEERING_RUNAWAY, 0.12, "command rests", wrong=SOUND._replace(runaway_radps=jnp.float32(0.5))
    ),
    "servo runs away right": Case(
        Watch.STEERING_RUNAWAY, 0.1, "command rests", wrong=SOUND._replace(runaway_radps=jnp.float32(-1.0))
    ),
    "rear straight": Case(Watch.REAR_STUCK, 1.0, "bend", wrong=SOUND._replace(rear_share=jnp.float32(0.0))),
    "rear askew": Case(
        Watch.REAR_STUCK,
        1.0,
        "straight",
        wrong=SOUND._replace(rear_share=jnp.float32(0.0), rear_rad=jnp.float32(0.15)),
    ),
    "odometer dead": Case(
        Watch.ODOMETER_DEAD,
        0.1,
        "rolls",
        heard=lambda row, first: row._replace(odometer_m=first.odometer_m, speed_mps=0.0),
    ),
    "odometer dead at a walk": Case(
        Watch.ODOMETER_DEAD,
        1.0,
        "walks",
        heard=lambda row, first: row._replace(odometer_m=first.odometer_m, speed_mps=0.0),
    ),
    "odometer no number": Case(
        Watch.ODOMETER_DEAD, 0.1, "engaged", heard=lambda row, _: row._replace(odometer_m=math.nan)
    ),
    "odometer reversed": Case(
        Watch.ODOMETER_REVERSED,
        0.1,
        "rolls",
        heard=lambda row, first: row._replace(
            odometer_m=2.0 * first.odometer_m - row.odometer_m, speed_mps=-row.speed_mps
        ),
    ),
    "wheels slip": Case(
        Watch.ODOMETER_SLIPS,
        1.3,
        "rolls slower than 3 m/s",
        heard=lambda row, first: row._replace(
            odometer_m=row.odometer_m + 0.4 * (row.odometer_m - first.odometer_m), speed_mps=1.4 * row.speed_mps
        ),
    ),
    "throttle stuck": Case(
        Watch.THROTTLE_STUCK, 0.5, "little throttle", wrong=SOUND._replace(throttle_at=jnp.float32(0.7))
    ),
    "throttle stuck, position unseen": Case(
        Watch.THROTTLE_STUCK | Watch.BRAKE_DEAD,
        1.2,
        "little throttle",
        wrong=SOUND._replace(throttle_at=jnp.float32(0.9)),
        heard=lambda row, _: row._replace(throttle=row.sent_throttle),
    ),
    "throttle stuck and the speed rises": Case(
        Watch.SPEED_RISES, 1.6, "little throttle", wrong=SOUND._replace(throttle_at=jnp.float32(1.0))
    ),
    "throttle position no number": Case(
        Watch.PEDAL_UNREAD, 0.1, "engaged", heard=lambda row, _: row._replace(throttle=math.nan)
    ),
    "brake without pressure": Case(Watch.BRAKE_DEAD, 0.3, "brakes", wrong=SOUND._replace(brake_share=jnp.float32(0.0))),
    "brake with pressure and no effect": Case(
        Watch.BRAKE_DEAD,
        1.3,
        "brakes",
        wrong=SOUND._replace(brake_share=jnp.float32(0.0)),
        heard=lambda row, _: row._replace(brake=row.sent_brake),
    ),
    "gyro no number": Case(
        Watch.YAW_RATE_LOST, 0.1, "engaged", heard=lambda row, _: row._replace(yaw_rate_radps=math.nan)
    ),
}


class Watched(NamedTuple):
    """States before every tick of the healthy drives, and the bits that they gave."""

    before: list[Watches]
    bits: list[Watch]


@cache
def watched(drives: int) -> Watched:
    """The healthy drives, watched."""
    before, bits = [], []
    state = Watches()
    for at, row in enumerate(healthy_drives(drives)[1]):
        state = state if at % TICKS else Watches()
        before.append(state)
        state, found = watch_row(state, row, at)
        bits.append(found)
    return Watched(before, bits)


def lasts(holds: Bool[np.ndarray, " tick"], before_s: float, after_s: float) -> Bool[np.ndarray, " tick"]:
    """Where something has held for so long and goes on to."""
    wide = np.ones_like(holds)
    for shift in range(-round(before_s / TICK_S), round(after_s / TICK_S) + 1):
        wide &= np.roll(holds, -shift)
    return wide


@cache
def moments(drives: int) -> dict[str, Bool[np.ndarray, " tick"]]:
    """Ticks at which each kind of fault shows, of those that a fault's drive fits behind."""
    rows = healthy_drives(drives)[1]
    column: dict[str, Float[np.ndarray, " tick"]] = {
        name: np.array([getattr(row, name) for row in rows]) for name in Row._fields
    }
    speed, sent = column["true_mps"], column["sent_rad"]
    fits = np.arange(drives * TICKS) % TICKS
    engaged = lasts(column["steering"] > 0.0, 1.0, 1.5) & (fits > 300) & (fits < TICKS - CHUNK - 80)
    pedals = engaged & lasts(column["pedals"] > 0.0, 2.5, 1.5)
    turned = np.abs(np.roll(sent, -12) - sent)
    return {
        "engaged": engaged,
        "wheels turn": engaged & (np.abs(np.roll(column["wheel_rad"], -4) - column["wheel_rad"]) > 0.035),
        "command turns": engaged & (turned > 0.11),
        "command rests": engaged & lasts(np.abs(np.roll(sent, 1) - sent) < 0.002, 0.3, 0.2),
        "bend": engaged & lasts((np.abs(column["wheel_rad"]) > 0.18) & (np.abs(speed) > 1.2), 0.0, 1.2),
        "straight": engaged & lasts((np.abs(column["wheel_rad"]) < 0.1) & (np.abs(speed) > 1.2), 0.0, 1.2),
        "rolls": engaged & (np.abs(speed) > 1.3),
        "walks": engaged & lasts((np.abs(speed) > 0.7) & (np.abs(speed) < 1.3), 0.2, 1.0),
        "rolls slower than 3 m/s": engaged & lasts((np.abs(speed) > 1.5) & (np.abs(speed) < 3.3), 0.2, 1.2),
        "little throttle": pedals & (column["sent_throttle"] < 0.3) & (speed > 1.0),
        "brakes": pedals & lasts(column["sent_brake"] > 0.25, 0.0, 0.5) & (speed > 1.0),
    }


def found_times_s(drives: int, case: Case, count: int) -> list[float]:
    """From the onset to the bit, at so many moments; infinite where it does not come."""
    choices = np.flatnonzero(moments(drives)[case.when])
    onsets = sorted(int(at) for at in np.random.default_rng(11).choice(choices, count, replace=False))
    healthy = healthy_drives(drives)[1]
    if case.wrong is not None:
        driven = drives_with(drives, case.wrong, onsets)
    else:
        driven = [healthy[at : at + CHUNK] for at in onsets]
    found_s = []
    for at, rows in zip(onsets, driven, strict=True):
        state, after_s = watched(drives).before[at], math.inf
        for tick, heard in enumerate(rows):
            row = case.heard(heard, rows[0]) if case.heard else heard
            state, bits = watch_row(state, row, at + tick)
            if bits & case.bit:
                after_s = (tick + 1) * TICK_S
                break
        found_s.append(after_s)
    return found_s


def check_sound_vehicle(drives: int) -> None:
    """Nothing is found of varied drives, but for the heading that has yet to be confirmed."""
    rows, bits = healthy_drives(drives)[1], watched(drives).bits
    assert set(bits) == {Watch(0), Watch.HEADING_UNCONFIRMED}
    assert {found for at, found in enumerate(bits) if at % TICKS > 300} == {Watch(0)}
    speeds, steering = [row.true_mps for row in rows], [row.steering for row in rows]
    assert min(speeds) < -1.0
    assert max(speeds) > 4.4
    assert sum(abs(speed) < 0.01 for speed in speeds) > 100 * drives
    assert max(abs(row.wheel_rad) for row in rows) > 0.3
    assert sum(now != then for then, now in pairwise(steering)) > 3 * drives
