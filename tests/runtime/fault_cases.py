"""The fault list of docs/onboard.md: what is injected, for how long it is followed, and what must hold."""

from collections.abc import Callable
from typing import Any, NamedTuple

from canon.course_moments import After, goes_on, hands_over, stops
from lgprjax.autopilot import Mode
from lgprjax.autopilot.monitors import Watch
from lgprjax.navigation import Reason


class Case(NamedTuple):
    """A fault and its reaction.

    Attributes:
        number: in the list.
        seconds: for which it is followed, no longer than its reaction takes.
    """

    number: int
    name: str
    faults: list[dict[str, Any]]
    seconds: float
    holds: Callable[[After], bool]


CASES = [
    Case(1, "antenna pulled", [{"kind": "gnss_off"}], 2.0,
         lambda a: a.reason(Reason.GNSS_SILENT) <= 0.25 and goes_on(a)),
    Case(2, "GNSS stuck", [{"kind": "gnss_stuck"}], 2.0,
         lambda a: a.reason(Reason.GNSS_STUCK) <= 1.0 and goes_on(a)),
    Case(3, "GNSS jumps 0.3 m", [{"kind": "gnss_jump", "m": [0.3, 0.0]}], 3.0, goes_on),
    Case(3, "GNSS jumps 3 m", [{"kind": "gnss_jump", "m": [0.0, 3.0]}], 2.0,
         lambda a: a.reason(Reason.GNSS_REJECTED) <= 0.25 and goes_on(a)),
    Case(7, "GNSS time steps back", [{"kind": "time_step", "s": -1.0}], 2.0, goes_on),
    Case(8, "INS off", [{"kind": "ins_off"}], 2.0,
         lambda a: a.reason(Reason.HEADING_SILENT) <= 0.3 and (goes_on(a) or stops(a))),
    Case(14, "odometer dead", [{"kind": "odometer_dead"}], 1.5,
         lambda a: a.watch(Watch.ODOMETER_DEAD) <= 0.6 and (goes_on(a) or stops(a))),
    Case(14, "odometer reversed", [{"kind": "odometer_reversed"}], 1.0,
         lambda a: a.watch(Watch.ODOMETER_REVERSED | Watch.ODOMETER_DEAD) <= 0.6),
    Case(14, "odometer slips", [{"kind": "odometer_slip", "share": 0.5}], 2.0,
         lambda a: a.watch(Watch.ODOMETER_SLIPS | Watch.ODOMETER_DEAD) <= 1.5),
    Case(15, "potentiometer open", [{"kind": "potentiometer_open"}], 0.5, hands_over(0.15)),
    Case(15, "potentiometer stuck", [{"kind": "potentiometer_stuck"}], 8.0,
         lambda a: a.mode(Mode.ERROR) < 8.0),
    Case(16, "encoder slips by a tooth", [{"kind": "encoder_offset", "counts": 1500}], 0.6, hands_over(0.3)),
    Case(17, "servo stalled", [{"kind": "servo_stalled"}], 10.0, lambda a: a.mode(Mode.ERROR) < 10.0),
    Case(17, "servo weak", [{"kind": "servo_weak", "supply_v": 12.5}], 1.0,
         lambda a: a.watch(Watch.SUPPLY_LOW | Watch.SERVO_WEAK) <= 0.5),
    Case(18, "steering runs away", [{"kind": "servo_runaway", "radps": 0.5}], 0.6, hands_over(0.35)),
    Case(19, "rear steering stuck", [{"kind": "rear_stuck", "rad": -0.15}], 8.0,
         lambda a: a.watch(Watch.REAR_STUCK) < 3.0 and stops(a)),
    Case(21, "throttle stuck open", [{"kind": "throttle_stuck", "at": 0.5}], 1.5,
         lambda a: a.watch(Watch.THROTTLE_STUCK) <= 0.7),
    Case(23, "frames corrupt", [{"kind": "line_corrupt", "line": "drive_by_wire"}], 0.6, hands_over(0.3)),
    Case(23, "counter repeats", [{"kind": "line_repeat", "line": "drive_by_wire"}], 0.6, hands_over(0.3)),
    Case(23, "bus off", [{"kind": "bus_off"}], 0.6, hands_over(0.3)),
    Case(24, "drive-by-wire silent", [{"kind": "line_silent", "line": "drive_by_wire"}], 0.6, hands_over(0.3)),
    Case(34, "override stuck", [{"kind": "override_stuck"}], 0.5, lambda a: a.mode(Mode.MANUAL) <= 0.1),
    Case(34, "override wire cut", [{"kind": "override_wire_cut"}], 0.5, lambda a: a.mode(Mode.MANUAL) <= 0.25),
    Case(34, "controller silent", [{"kind": "line_silent", "line": "controller"}], 0.5,
         lambda a: a.mode(Mode.MANUAL) <= 0.25),
    Case(38, "supply sags for 50 ms", [{"kind": "supply_sag", "v": 9.0, "for_s": 0.05}], 1.0, goes_on),
    Case(41, "second master", [{"kind": "second_master"}], 0.6, hands_over(0.3)),
]  # fmt: skip
"""Each reaction once."""

MORE_CASES = [
    Case(3, "GNSS jumps 30 m", [{"kind": "gnss_jump", "m": [30.0, 0.0]}], 5.0,
         lambda a: a.reason(Reason.GNSS_REJECTED) <= 0.25 and goes_on(a)),
    Case(7, "GNSS time steps forward", [{"kind": "time_step", "s": 5.0}], 4.0, goes_on),
    Case(8, "INS without numbers", [{"kind": "ins_nan"}], 4.0,
         lambda a: a.reason(Reason.HEADING_SILENT | Reason.HEADING_REJECTED) <= 0.3 and (goes_on(a) or stops(a))),
    Case(8, "INS stuck", [{"kind": "ins_stuck"}], 6.0, lambda a: goes_on(a) or stops(a)),
    Case(8, "INS biased", [{"kind": "ins_bias", "rad": 0.1, "radps": 0.02}], 6.0, lambda a: goes_on(a) or stops(a)),
    Case(15, "potentiometer short", [{"kind": "potentiometer_short"}], 2.0, hands_over(0.15)),
]  # fmt: skip
"""Further faults with the same reactions."""
