"""The operator's hands and what navigation loses at several moments of a drive, and a drive to the route's end."""

from collections.abc import Callable
from typing import Any

import pytest

from canon.course_loop import OnboardLoop
from canon.course_moments import Moment, follow, goes_on, stops
from lgprjax.autopilot import Mode
from lgprjax.autopilot.monitors import Watch
from lgprjax.navigation import PlanCode, Reason

STEER: dict[str, Any] = {"do": "press", "button": "steering", "for_s": 0.3}
EACH = pytest.mark.parametrize("moment", ["straight", "bend", "fast"])


def lose_fixes(loop: OnboardLoop) -> None:
    loop._lost = lambda _: True


def misplace(east_m: float) -> Callable[[OnboardLoop], None]:
    def change(loop: OnboardLoop) -> None:
        loop._wrong = lambda _: (east_m, 0.0)

    return change


def test_engaged_again_soon_after_the_override_the_plan_is_followed_to_its_end(moments: dict[str, Moment]) -> None:
    drive = {"do": "drive", "speed_mps": 4.0}
    after = follow(moments["fast"], 0.12, script=[{"do": "press", "button": "override", "for_s": 0.06}, drive])
    again = follow(Moment(after.loop, moments["fast"].shared), 0.5, script=[drive, STEER])
    assert again.mode(Mode.STEERING) <= 0.3, again.told
    lock = {"do": "press", "button": "plus", "for_s": 0.3}
    ended = follow(Moment(again.loop, moments["fast"].shared), 45.0, script=[lock])
    assert any("STOP_CONTROLLED" in event and "ROUTE_OFF" in event for _, event in ended.loop.events), ended.told
    assert PlanCode.DONE in {PlanCode(int(row["code"])) for row in ended.loop.rows[ended.first :]}


@EACH
def test_override_and_emergency_stop_act_at_once(moments: dict[str, Moment], moment: str) -> None:
    after = follow(moments[moment], 1.5, script=[{"do": "press", "button": "override", "for_s": 0.5}])
    assert after.mode(Mode.MANUAL) <= 0.1
    assert after.engaged(0) <= 0.1
    assert after.loop.mode is Mode.READY
    after = follow(moments[moment], 3.5, script=[{"do": "press", "button": "estop", "for_s": 4.0}])
    assert after.engaged(4) <= 0.1
    assert after.speed_at(3.5) < 0.1


@EACH
def test_without_scans_the_vehicle_goes_on_as_its_sigma_allows_and_without_gnss_too_it_stops(
    moments: dict[str, Moment], moment: str
) -> None:
    after = follow(moments[moment], 6.0, change=lose_fixes)
    assert after.reason(Reason.LGPR_SILENT) <= 1.7
    assert goes_on(after), after.told
    excess_m = max(float(after.last["sigma_cross_m"]) - 0.1, 1e-6)
    assert float(after.last["wanted_mps"]) <= 2.0 * 0.05 / excess_m + 0.02
    after = follow(moments[moment], 9.0, faults=[{"kind": "gnss_off"}], change=lose_fixes)
    assert after.reason(Reason.POSITION_LOST) <= 1.7
    assert stops(after), after.told
    assert after.largest_off_m < 0.3048


@EACH
def test_fixes_of_a_wrong_place_do_not_move_the_vehicle(moments: dict[str, Moment], moment: str) -> None:
    after = follow(moments[moment], 6.0, change=misplace(1.5))
    assert after.reason(Reason.LGPR_REJECTED | Reason.CONFLICT) <= 1.0
    assert after.largest_off_m < 0.3048, after.told
    assert goes_on(after) or stops(after)


@EACH
def test_with_a_dead_odometer_a_controlled_stop_brakes_until_the_vehicle_stands(
    moments: dict[str, Moment], moment: str
) -> None:
    faults = [{"kind": "odometer_dead"}]
    driven = follow(moments[moment], 1.5, faults=faults)
    assert goes_on(driven), driven.told
    gone = [*faults, {"kind": "gnss_off"}]
    after = follow(Moment(driven.loop, moments[moment].shared), 12.0, faults=gone, change=lose_fixes)
    assert after.watch(Watch.SPEED_UNKNOWN) < 2.0
    assert max(float(row["command"][2]) for row in after.loop.rows[after.first :]) > 0.1
    assert after.speed_at(12.0) < 0.1, after.told
