"""The closed loop with fixes from an error model: tracking, what faults do to it, and how fast it runs many drives."""

from collections.abc import Callable
from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.navigation import Reason
from lgprjax.scene import SensorFaults, TrueVehicle, calibrated_fixes, no_faults
from lgprjax.simulation.loop import (
    LoopSpec,
    LoopTick,
    LoopVehicle,
    OffRoad,
    blank_sums,
    draw_course,
    loop_setup,
    route_of_road,
    run_lane,
    start_lanes,
)

_SPEC = LoopSpec()
_TICKS = 2400  # 114 s, half a kilometre
_FAULT_S = 40.0
_AT = round(_FAULT_S / _SPEC.tick_s)


class Driven(NamedTuple):
    """A drive's ticks."""

    tick: LoopTick

    def first(self, reason: Reason) -> float:
        """Seconds after the fault until a reason is told; infinite where it never is."""
        told = np.flatnonzero((self.tick.reasons[_AT:].astype(int) & int(reason)) > 0)
        return float(told[0]) * _SPEC.tick_s if len(told) else float("inf")

    def reaction_after(self, level: int) -> float:
        """Seconds after the fault until a reaction of this level."""
        told = np.flatnonzero(self.tick.reaction[_AT:] >= level)
        return float(told[0]) * _SPEC.tick_s if len(told) else float("inf")


Drive = Callable[..., Driven]


def test_a_delay_that_its_slots_do_not_hold_is_refused() -> None:
    course = draw_course(OffRoad(3, 60.0))
    slow = LoopVehicle(vehicle=TrueVehicle(delay_s=0.2))
    with pytest.raises(ValueError, match=r"delay_s .*0\.07937.* 5 delay_slots.* 0\.2"):
        loop_setup(_SPEC, slow, course.terrain)
    loop_setup(LoopSpec(delay_slots=13), slow, course.terrain)


@pytest.fixture(scope="module")
def drive() -> Drive:
    """Half a kilometre off road with RTK, by faults; one program for all."""
    bare, errors = draw_course(OffRoad(3, 560.0)), calibrated_fixes("clear")
    sound = loop_setup(_SPEC, LoopVehicle(gnss_slow_m=0.03), bare.terrain)
    route = route_of_road(bare, sound.autopilot.chassis, float(sound.set_speed_mps))

    def go(faults: SensorFaults, p_false: float | None = None) -> Driven:
        fixes_of = errors if p_false is None else errors._replace(p_false=jnp.float32(p_false))
        setup = sound._replace(faults=faults)
        keys = jax.random.split(jax.random.key(5), 1)
        state, fixes = jax.tree.map(lambda leaf: leaf[0], start_lanes(_SPEC, setup, bare, route, fixes_of, keys))
        *_, trace = run_lane(_SPEC, setup, route, fixes_of, state, fixes, blank_sums(), keys[0], _TICKS, traced=True)
        tick: LoopTick = jax.tree.map(np.asarray, trace)
        assert tick.engaged[_AT - 100], "the autopilot drives well before the fault"
        # Whatever happens, it keeps to its line and to the limiter's rate.
        assert np.abs(tick.offset_m[_AT:]).max() < 0.3048
        limit_rad = float(setup.autopilot.limiter.front_rate_radps) * _SPEC.tick_s
        assert np.abs(np.diff(tick.command_rad[tick.engaged])).max() <= limit_rad * 1.0001
        return Driven(tick)

    return go


def _from(start_s: float, stop_s: float = float("inf")) -> jax.Array:
    return jnp.asarray([start_s, stop_s], jnp.float32)


def test_a_sound_drive_tracks_within_decimetres(drive: Drive) -> None:
    driven = drive(no_faults())
    on = driven.tick.engaged.astype(bool)
    assert on.argmax() * _SPEC.tick_s < 15.0
    offset = driven.tick.offset_m[on]
    assert np.sqrt(np.mean(offset**2)) < 0.10
    assert np.abs(offset).max() < 0.3048
    assert driven.tick.reaction[on].max() < 2
    assert 0.3 < driven.tick.nees_position[on].mean() / 2.0 < 2.0
    # The throttle and the brake are never pressed together.
    assert not np.any((driven.tick.throttle > 0) & (driven.tick.brake > 0))


@pytest.mark.parametrize("size_m", [0.3, 30.0])
def test_a_jump_of_gnss_is_left_out_and_stops_the_vehicle_when_it_lasts(drive: Drive, size_m: float) -> None:
    faults = no_faults()._replace(
        gnss_jump_s=jnp.float32(_FAULT_S), gnss_jump_m=jnp.asarray([0.6 * size_m, 0.8 * size_m], jnp.float32)
    )
    driven = drive(faults)
    assert driven.first(Reason.GNSS_REJECTED) < 0.25  # an epoch of 1/7 s
    # Neither the estimate nor the vehicle follows it.
    assert np.abs(driven.tick.error_m[_AT:]).max() < 0.15
    # Two sources that each hold together and contradict each other: after ten seconds nobody can say who is right.
    assert 9.0 < driven.first(Reason.CONFLICT_LASTS) < 11.5
    assert driven.tick.speed_mps[-1] == pytest.approx(0.0, abs=0.05)


def test_a_frozen_receiver_is_reported_and_costs_nothing_while_lgpr_bounds_the_error(drive: Drive) -> None:
    driven = drive(no_faults()._replace(gnss_frozen_s=_from(_FAULT_S)))
    assert driven.first(Reason.GNSS_STUCK) < 1.0
    assert driven.reaction_after(1) == float("inf")
    assert np.abs(driven.tick.error_m[_AT:]).max() < 0.15


def test_a_slow_drift_degrades_and_then_stops(drive: Drive) -> None:
    drift = jnp.asarray([0.06, 0.08], jnp.float32)
    driven = drive(no_faults()._replace(gnss_drift_s=jnp.float32(_FAULT_S), gnss_drift_mps=drift))
    assert driven.reaction_after(1) < 10.0
    assert driven.reaction_after(1) < driven.reaction_after(2) < 25.0


def test_a_minute_without_radar_is_driven_on_rtk(drive: Drive) -> None:
    driven = drive(no_faults()._replace(lgpr_lost_s=_from(_FAULT_S, _FAULT_S + 60.0)))
    assert driven.first(Reason.LGPR_SILENT) < 2.0
    assert driven.reaction_after(2) == float("inf")
    gone = slice(_AT + 63, _AT + round(60.0 / _SPEC.tick_s))
    # RTK of 3 cm bounds the error: no reason to slow down, and no jolt when the radar is back.
    assert driven.tick.speed_mps[gone].mean() > 4.0
    assert driven.reaction_after(1) == float("inf")


def test_fading_ground_degrades(drive: Drive) -> None:
    faded = no_faults()._replace(lgpr_faded_s=_from(_FAULT_S, _FAULT_S + 20.0), lgpr_faded=jnp.float32(0.6))
    driven = drive(faded)
    assert driven.first(Reason.LGPR_FADED) < 2.5


def test_rain_that_leaves_the_evidence_is_engaged_and_driven_at_full_speed(drive: Drive) -> None:
    """Four tenths of the strength, 0.31, where the ground holds so much that this is still no chance."""
    rain = no_faults()._replace(lgpr_faded_s=_from(0.0), lgpr_faded=jnp.float32(0.4))
    driven = drive(rain, p_false=1e-30)
    on = driven.tick.engaged.astype(bool)
    assert on.argmax() * _SPEC.tick_s < 15.0
    assert not (driven.tick.reasons.astype(int) & int(Reason.LGPR_FADED)).any()
    assert driven.tick.speed_mps[_AT:].mean() > 4.0


def test_strong_matches_that_any_ground_would_give_are_no_fixes(drive: Drive) -> None:
    """Nine tenths of the strength of a clear day, 0.71, on ground that holds so little that this may well be chance."""
    alike = no_faults()._replace(lgpr_faded_s=_from(_FAULT_S), lgpr_faded=jnp.float32(0.9))
    driven = drive(alike, p_false=9e-5)
    assert driven.first(Reason.LGPR_FADED) < 2.5
    assert not driven.tick.fix[_AT:].any()
    assert driven.tick.speed_mps[_AT + 63 :].mean() > 4.0


def test_fixes_on_a_wrong_place_are_left_out(drive: Drive) -> None:
    wrong = no_faults()._replace(
        lgpr_wrong_s=_from(_FAULT_S, _FAULT_S + 5.0), lgpr_wrong_m=jnp.asarray([2.0, 2.0], jnp.float32)
    )
    driven = drive(wrong)
    assert driven.first(Reason.LGPR_REJECTED) < 1.0
    assert driven.tick.reaction[-10:].max() == 0


def test_with_neither_source_it_stops_while_it_knows_where_it_is(drive: Drive) -> None:
    driven = drive(no_faults()._replace(lgpr_lost_s=_from(_FAULT_S), gnss_lost_s=_from(_FAULT_S)))
    assert driven.first(Reason.POSITION_LOST) < 2.0
    stands = np.flatnonzero(np.abs(driven.tick.speed_mps[_AT:]) < 0.05)
    assert len(stands)
    assert driven.tick.sigma_cross_m[_AT + stands[0]] < 0.3


def test_slipping_wheels_do_not_lead_it_astray(drive: Drive) -> None:
    driven = drive(no_faults()._replace(slip_s=_from(_FAULT_S, _FAULT_S + 2.0), slip=jnp.float32(0.3)))
    assert driven.tick.reaction[-10:].max() == 0
