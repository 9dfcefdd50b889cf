"""A kit without throttle and brake on the course in lock step: it engages, steers, and hands over while moving."""

import json
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from canon.course import make_steering_only
from canon.course_loop import OnboardLoop
from canon.course_moments import Moment, follow
from lgprjax.autopilot import EngagementInhibit, Mode
from lgprjax.autopilot.monitors import ABOVE_S, Watch
from lgprjax.navigation import Reason
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.modes import STEERING
from lgprjax.runtime.control.setup import Loaded, load
from lgprjax.runtime.words import ARRIVED, REFUSALS
from lgprjax.simulation.devices.world import CourseWorld

PRESS = {"do": "press", "for_s": 0.3}
DRIVE: list[dict[str, Any]] = [
    {"at_s": 0.2, "do": "drive", "speed_mps": 2.0},
    {"at_way_m": 6.0, **PRESS, "button": "steering"},
    {"at_way_m": 24.0, "do": "drive", "speed_mps": 4.0},
]
"""The operator drives on and engages the steering; nobody presses a cruise button."""


@pytest.fixture(scope="module")
def steering_only(config: RuntimeConfig, course_run: Path) -> RuntimeConfig:
    """The course's configuration with the same vehicle without pedals."""
    return config.model_copy(update={"vehicle": make_steering_only(course_run)})


@pytest.fixture(scope="module")
def kit(steering_only: RuntimeConfig) -> Loaded:
    """Its files."""
    return load(steering_only)


def beyond(way_m: float) -> Callable[[OnboardLoop], bool]:
    return lambda loop: loop.stage._known.last.travel_m > way_m


@pytest.fixture(scope="module")
def ways(world: CourseWorld, steering_only: RuntimeConfig, kit: Loaded) -> dict[float, Moment]:
    """A drive by its way: in the bend at two metres a second, and at four."""
    loop = OnboardLoop(world, steering_only, kit, DRIVE, [])
    found: dict[float, Moment] = {}
    for way_m in (12.0, 22.0, 70.0):
        assert loop.run(60.0, until=beyond(way_m)), way_m
        assert loop.mode is Mode.STEERING, loop.events
        found[way_m] = Moment(loop, (world, steering_only, kit))
        loop = found[way_m].copy()
    return found


def presses_nothing(loop: OnboardLoop) -> None:
    """No pedal in any command, no self test of a brake; nothing engaged after a hand-over; the light tells of it."""
    rows = np.array(loop.rows)
    assert set(rows["engage"].tolist()) <= {0, STEERING}
    assert (rows["command"][:, 1:] == 0.0).all()
    assert not loop.stage.drive_box._tested
    told = [json.loads(event) for _, event in loop.events]
    assert not {"STOP_CONTROLLED", "ENGAGE_SPEED", "LOCK_SPEED"} & {
        act for each in told for act in each.get("actions", ())
    }
    engaged = np.flatnonzero(rows["engage"])
    assert (np.diff(engaged) == 1).all()


def hand_over_s(loop: OnboardLoop, first: int) -> float:
    """Seconds from a row to the first that is not engaged; nothing is engaged from then on."""
    rows = np.array(loop.rows[first:])
    free = np.flatnonzero(rows["engage"] == 0)
    if not free.size:
        return math.inf
    assert (rows["engage"][free[0] :] == 0).all()
    return (loop.times_ns[first + int(free[0])] - loop.times_ns[first - 1]) / 1e9


def off_m(loop: OnboardLoop, low_m: float, high_m: float) -> np.ndarray:
    """True offsets between two ways, metre by metre: at two speeds a way counts alike."""
    truth = loop.stage.truth.arrays()
    way = np.cumsum(truth["speed_mps"] * np.gradient(truth["mono_ns"] / 1e9))
    return np.asarray(np.interp(np.arange(low_m, high_m, 0.1), way, truth["cross_m"]))


def test_it_engages_and_steers_as_closely_as_the_kit_with_pedals(
    ways: dict[float, Moment], moments: dict[str, Moment]
) -> None:
    only, both = (off_m(of.loop, 14.0, 69.0) for of in (ways[70.0], moments["fast"]))
    rms_m, usual_m = (float(np.sqrt(np.mean(each**2))) for each in (only, both))
    assert 0.0 < rms_m < max(1.25 * usual_m, usual_m + 0.01), (rms_m, usual_m)
    assert np.abs(only).max() < 0.3048
    presses_nothing(ways[70.0].loop)


@pytest.mark.parametrize(
    ("item", "within_s", "event"),
    [
        ({**PRESS, "button": "override"}, 0.1, "OVERRIDE_PRESSED"),
        ({"do": "torque", "nm": 6.0, "for_s": 0.5}, 0.2, "STEERING_TORQUE"),
        ({"do": "brake_tap", "for_s": 0.9}, 0.7, "BRAKE_HELD"),
        ({"do": "brake_tap", "for_s": 0.3}, math.inf, ""),
        ({**PRESS, "button": "estop"}, 0.1, "ESTOP_PRESSED"),
    ],
)
def test_the_operator_takes_over(ways: dict[float, Moment], item: dict[str, Any], within_s: float, event: str) -> None:
    after = follow(ways[22.0], 1.5, script=[item])
    rows = np.array(after.loop.rows[after.first :])
    left = np.flatnonzero((rows["engage"] & STEERING) == 0)
    if not event:
        assert after.loop.mode is Mode.STEERING
        assert not left.size
        return
    assert (after.loop.times_ns[after.first + int(left[0])] - after.loop.times_ns[after.first - 1]) / 1e9 <= within_s
    assert ((rows["engage"][left[0] :] & STEERING) == 0).all()
    assert any(f'"{event}"' in told for _, told in after.loop.events[-6:])


def test_a_cruise_button_is_refused_with_a_reason_of_its_own(ways: dict[float, Moment]) -> None:
    for button in ("plus", "minus"):
        after = follow(ways[12.0], 0.5, script=[{**PRESS, "button": button}])
        assert after.loop.mode is Mode.STEERING
        assert after.loop.core.modes.state.inhibit is EngagementInhibit.NO_SPEED_CONTROL
        assert json.loads(after.loop.events[-1][1])["why"] == [REFUSALS[EngagementInhibit.NO_SPEED_CONTROL]]
        presses_nothing(after.loop)


def test_without_gnss_and_scans_it_hands_over_at_once_and_loudly(ways: dict[float, Moment]) -> None:
    def lose_fixes(loop: OnboardLoop) -> None:
        loop._lost = lambda _: True

    after = follow(ways[22.0], 3.0, faults=[{"kind": "gnss_off"}], change=lose_fixes)
    # The kit with pedals begins its controlled stop in the same tick.
    lost_s = after.reason(Reason.POSITION_LOST)
    assert lost_s <= 1.7
    assert hand_over_s(after.loop, after.first) == lost_s
    assert after.loop.mode is Mode.MANUAL
    assert after.loop.stage.controller.lit(after.loop._now_ns)
    presses_nothing(after.loop)
    # A press of the override acknowledges.
    after.loop.stage._pressed = lambda: 1  # type: ignore[method-assign]
    after.loop.run(0.3)
    after.loop.stage._pressed = lambda: 2  # type: ignore[method-assign]
    after.loop.run(0.3)
    assert not after.loop.stage.controller.lit(after.loop._now_ns)
    assert not after.loop.core.modes.engage


def test_above_the_limit_the_operator_is_told_to_slow_down_and_then_has_the_wheels(ways: dict[float, Moment]) -> None:
    """At a low supply it may be driven at 2 m/s; the operator goes on at four, or slows down in taps of the brake."""
    low = [{"kind": "servo_weak", "supply_v": 16.0, "for_s": 60.0}]
    fast = follow(ways[70.0], ABOVE_S + 2.0, faults=low)
    capped_s = fast.when(lambda row: float(row["wanted_mps"]) <= 2.0)
    assert capped_s < 1.0
    assert hand_over_s(fast.loop, fast.first) == pytest.approx(capped_s + ABOVE_S, abs=0.1)
    assert fast.watch(Watch.ABOVE_LIMIT) == pytest.approx(capped_s + ABOVE_S, abs=0.1)
    assert any('"slow": ["supply' in told for _, told in fast.loop.events)
    presses_nothing(fast.loop)
    slow = follow(ways[70.0], ABOVE_S + 4.0, faults=low, script=[{"do": "drive", "speed_mps": 1.7}])
    assert hand_over_s(slow.loop, slow.first) == math.inf, slow.told
    presses_nothing(slow.loop)


def test_its_limiter_lets_no_pedal_be_pressed(kit: Loaded) -> None:
    rules = kit.setup.autopilot.limiter
    assert kit.setup.autopilot.pedals is None
    assert [float(rule) for rule in (rules.throttle_rate_per_s, rules.brake_rate_per_s, rules.default_brake)] == [
        0.0
    ] * 3


def test_the_end_of_the_route_is_a_hand_over(ways: dict[float, Moment]) -> None:
    after = follow(ways[70.0], 60.0, script=[{"do": "drive", "speed_mps": 2.0}])
    assert after.loop.mode is Mode.MANUAL, after.told
    over = next(json.loads(told) for _, told in after.loop.events if '"MANUAL"' in told)
    assert (over["event"], over["why"]) == ("ROUTE_OFF", [ARRIVED[0]])
    assert after.speed_at(hand_over_s(after.loop, after.first)) > 1.0
    assert after.loop.stage.controller.lit(after.loop._now_ns)
    presses_nothing(after.loop)
