"""Faults of the navigation, each put into a drawn drive: told in time, with the reaction it asks for."""

from collections.abc import Callable
from math import erfc
from types import SimpleNamespace
from typing import Any, NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Float

from lgprjax.navigation.counter_steer_filter import FilterInfo, FilterState, init_filter, step_filter
from lgprjax.navigation.counter_steer_model import RATE_BIAS, SPEED, YAW, NavEstimate, position_sigma_m
from lgprjax.navigation.health import (
    Health,
    HealthRules,
    HealthState,
    Reaction,
    Reason,
    health_rules,
    init_health,
    step_health,
)
from lgprjax.navigation.observations import MotionInput, Observations, default_rules, no_observations
from lgprjax.vehicle import VehiclePose
from model_drives import SPEED_MPS, TICK_S, Drawn, draw_drive, stacked, usual_model

_SECONDS, _ONSET_S = 34.0, 18.0
_MODEL = usual_model(gnss_error_sigma_m=0.03, gnss_error_s=60.0)
_RISK = 1e-4
_RULES = health_rules(gnss_period_s=0.1, heading_period_s=0.05, odometer_period_s=0.05, lgpr_period_s=0.2, risk=_RISK)
_GATES = default_rules()


_Fault = Callable[[Any], None]
"""Changes a drive in place, from the onset on."""


class _Case(NamedTuple):
    """A fault, what must be told of it and how soon, and the reaction to it."""

    name: str
    fault: _Fault
    reasons: Reason
    within_s: float
    reaction: Reaction
    onset_s: float = _ONSET_S


_TIME_S = TICK_S * np.arange(1, round(_SECONDS / TICK_S) + 1)
_AFTER = _TIME_S > _ONSET_S + 1e-6
_FIRST = int(np.argmax(_AFTER))
_LATE = slice(_FIRST, None)


def _plain(drawn: Drawn) -> SimpleNamespace:
    """What a drive gives the filter and the health, as arrays that may be changed."""
    slots = {
        name: SimpleNamespace(**{field: np.array(values) for field, values in slot._asdict().items()})
        for name, slot in drawn.observations._asdict().items()
    }
    # A match belongs to a scan: between scans there is none.
    p_false = np.where(slots["lgpr"].valid, 1e-9, np.nan)
    return SimpleNamespace(**slots, step_s=np.array(drawn.motions.step_s), p_false=p_false, turned_rad=0.0)


def _given(drawn: Drawn, plain: SimpleNamespace) -> Drawn:
    slots = {name: slot._replace(**vars(getattr(plain, name))) for name, slot in drawn.observations._asdict().items()}
    return drawn._replace(
        motions=drawn.motions._replace(step_s=plain.step_s), observations=drawn.observations._replace(**slots)
    )


def _silent(*sources: str) -> _Fault:
    def fault(drive: Any) -> None:
        for source in sources:
            getattr(drive, source).valid[_LATE] = False

    return fault


def _stuck(drive: Any) -> None:
    last = int(np.flatnonzero(drive.gnss.valid[:_FIRST])[-1])
    drive.gnss.x_m[_LATE], drive.gnss.y_m[_LATE] = drive.gnss.x_m[last], drive.gnss.y_m[last]


def _shifted(source: str, x_m: float, y_m: float | np.ndarray) -> _Fault:
    def fault(drive: Any) -> None:
        getattr(drive, source).x_m[_LATE] += np.float32(x_m)
        getattr(drive, source).y_m[_LATE] += np.asarray(y_m, np.float32)

    return fault


def _coarse(sigma_m: float, *, without_lgpr: bool = False, faded: bool = False) -> _Fault:
    def fault(drive: Any) -> None:
        rng = np.random.default_rng(3)
        for values in (drive.gnss.x_m, drive.gnss.y_m):
            values[_LATE] += (sigma_m * rng.normal(size=_TIME_S.size)).astype(np.float32)[_LATE]
        drive.gnss.covariance[_LATE] = sigma_m**2 * np.eye(2)
        drive.lgpr.valid[_LATE] &= not without_lgpr
        if faded:
            _fading(drive)

    return fault


def _scattered(sigma_m: float) -> _Fault:
    """More than the receiver states, without LGPR."""

    def fault(drive: Any) -> None:
        rng = np.random.default_rng(4)
        for values in (drive.gnss.x_m, drive.gnss.y_m):
            values[_LATE] += (sigma_m * rng.normal(size=_TIME_S.size)).astype(np.float32)[_LATE]
        drive.lgpr.valid[_LATE] = False

    return fault


def _heading(change_rad: float) -> _Fault:
    def fault(drive: Any) -> None:
        drive.heading.yaw_rad[_LATE] += np.float32(change_rad)

    return fault


def _reversed_wheels(drive: Any) -> None:
    drive.odometer.speed_mps[_LATE] *= -1.0


def _step(step_s: float) -> _Fault:
    def fault(drive: Any) -> None:
        drive.step_s[_FIRST] = step_s

    return fault


def _backwards(drive: Any) -> None:
    drive.turned_rad = np.pi


def _fading(drive: Any) -> None:
    drive.p_false[_LATE] = np.where(drive.lgpr.valid[_LATE], 0.5, np.nan)


_EPOCH_S, _SCAN_S = 0.1, 0.2
_C, _D, _S = Reaction.CONTINUE, Reaction.DEGRADE, Reaction.STOP
_CASES = [
    _Case("nothing", lambda _: None, Reason(0), 0.0, _C),
    _Case("1_gnss_off", _silent("gnss"), Reason.GNSS_SILENT, 1.5 * _EPOCH_S, _C),
    _Case("1_gnss_off_without_lgpr", _silent("gnss", "lgpr"), Reason.GNSS_SILENT, 1.5 * _EPOCH_S, _C),
    _Case("2_gnss_stuck", _stuck, Reason.GNSS_STUCK, 1.0, _C),
    _Case("3_gnss_jumps_0.3_m", _shifted("gnss", 0.0, 0.3), Reason.GNSS_REJECTED, _EPOCH_S, _D),
    _Case("3_gnss_jumps_30_m", _shifted("gnss", -30.0, 0.0), Reason.GNSS_REJECTED, _EPOCH_S, _D),
    _Case("4_rtk_float", _coarse(0.4), Reason.GNSS_COARSE, _EPOCH_S, _C),
    _Case("4_rtk_float_faded", _coarse(0.4, faded=True), Reason.LGPR_FADED, 2.0, _D),
    _Case("4_single_without_lgpr", _coarse(2.0, without_lgpr=True), Reason.TOO_UNCERTAIN, 15.0, _S),
    _Case("4_gnss_scatters_without_lgpr", _scattered(0.04), Reason.GNSS_INCONSISTENT, 3.0, _D),
    _Case("5_gnss_drifts", _shifted("gnss", 0.0, 0.1 * (_TIME_S[_LATE] - _ONSET_S)), Reason.CONFLICT, 10.0, _D),
    _Case("7_clock_stands", _step(0.0), Reason.BAD_STEP, 0.0, _D),
    _Case("7_clock_leaps", _step(1.5), Reason.BAD_STEP, 0.0, _S),
    _Case("8_ins_not_a_number", _heading(np.nan), Reason.HEADING_SILENT, 0.2, _D),
    _Case("8_ins_bias_steps", _heading(0.1), Reason.HEADING_REJECTED, 0.2, _D),
    _Case("8_ins_off_without_lgpr", _silent("heading", "lgpr"), Reason.HEADING_LOST, 0.7, _S),
    _Case("9_starts_backwards", _backwards, Reason.HEADING_REJECTED, 2 * TICK_S, _S, onset_s=0.0),
    _Case("10_scans_missing", _silent("lgpr"), Reason.LGPR_SILENT, 3 * _SCAN_S, _C),
    _Case("10_scans_missing_rtk_float", _coarse(0.4, without_lgpr=True), Reason.LGPR_SILENT, 3 * _SCAN_S, _D),
    _Case("11_lgpr_at_a_wrong_place", _shifted("lgpr", 1.0, -1.5), Reason.LGPR_REJECTED, 1.0, _D),
    _Case("11_lgpr_stays_there", _shifted("lgpr", 1.0, -1.5), Reason.CONFLICT_LASTS, 11.0, _S),
    _Case("12_lgpr_fades", _fading, Reason.LGPR_FADED, 2.0, _C),
    _Case("13_gnss_and_lgpr_lost", _silent("gnss", "lgpr"), Reason.POSITION_LOST, 0.6, _S),
    _Case("14_encoder_off", _silent("odometer"), Reason.ODOMETER_SILENT, 0.5, _D),
    _Case("14_encoder_reversed", _reversed_wheels, Reason.ODOMETER_REJECTED, 0.5, _D),
    _Case("14_speed_unknown", _silent("odometer", "gnss", "lgpr"), Reason.SPEED_LOST, 3.0, _S),
]


@jax.jit
def _run(
    motions: MotionInput, observations: Observations, p_false: jax.Array, turned_rad: jax.Array
) -> tuple[FilterState, FilterInfo, Health]:
    def one(
        motion: MotionInput, observed: Observations, chances: jax.Array, turned: jax.Array
    ) -> tuple[FilterState, FilterInfo, Health]:
        def step(
            carry: tuple[FilterState, HealthState], tick: tuple[MotionInput, Observations, jax.Array]
        ) -> tuple[tuple[FilterState, HealthState], tuple[FilterState, FilterInfo, Health]]:
            state, info = step_filter(_MODEL, _GATES, carry[0], tick[0], tick[1])
            health, told = step_health(
                _RULES, carry[1], state, info, tick[1], tick[2], jnp.float32(0.0), tick[0].step_s
            )
            return (state, health), (state, info, told)

        zero = jnp.zeros((), jnp.float32)
        start = init_filter(_MODEL, VehiclePose(zero, zero, turned), jnp.float32(SPEED_MPS))
        whole: tuple[FilterState, FilterInfo, Health] = jax.lax.scan(
            step, (start, init_health()), (motion, observed, chances)
        )[1]
        return whole

    return jax.vmap(one)(motions, observations, p_false, turned_rad)


class _Told(NamedTuple):
    """Of one case, by tick."""

    reasons: np.ndarray
    reaction: np.ndarray
    cap_mps: np.ndarray
    bounded: np.ndarray
    estimate: NavEstimate
    states: np.ndarray


@pytest.fixture(scope="module")
def told() -> dict[str, _Told]:
    drawn: Drawn = draw_drive(_MODEL, 5, seconds=_SECONDS)
    plain = [_plain(drawn) for _ in _CASES]
    for case, drive in zip(_CASES, plain, strict=True):
        case.fault(drive)
    motions, observations = stacked([_given(drawn, drive) for drive in plain])
    p_false, turned = ([getattr(drive, name) for drive in plain] for name in ("p_false", "turned_rad"))
    given = (jnp.asarray(np.stack(p_false), jnp.float32), jnp.asarray(turned, jnp.float32))
    state, _, health = jax.device_get(_run(motions, observations, *given))
    return {
        case.name: _Told(
            health.reasons[lane],
            health.reaction[lane],
            health.speed_cap_mps[lane],
            health.bounded[lane],
            jax.tree.map(lambda leaf, lane=lane: leaf[lane], state.estimate),
            drawn.states,
        )
        for lane, case in enumerate(_CASES)
    }


@pytest.mark.parametrize("case", _CASES[1:], ids=lambda case: case.name)
def test_fault_is_told_in_time_with_its_reaction(told: dict[str, _Told], case: _Case) -> None:
    of = told[case.name]
    before = (_TIME_S > 2.0) & (case.onset_s > _TIME_S)
    assert (of.reaction[before] == _C).all()
    hit = (of.reasons & case.reasons.value) != 0
    assert not hit[before].any()
    first = _TIME_S[np.argmax(hit & (case.onset_s < _TIME_S))]
    assert hit.any()
    # The tick in which it becomes true at the latest.
    assert first - case.onset_s <= case.within_s + TICK_S + 1e-6
    at = int(np.argmax(first - 1e-9 <= _TIME_S))
    assert of.reaction[at] == case.reaction
    assert of.cap_mps[at] == {_C: np.inf, _D: float(_RULES.degraded_mps), _S: 0.0}[case.reaction]


def test_sound_drive_goes_on_at_full_speed(told: dict[str, _Told]) -> None:
    of = told["nothing"]
    settled = _TIME_S > 2.0
    assert (of.reasons[settled] == 0).all()
    assert np.isinf(of.cap_mps[settled]).all()


@pytest.mark.parametrize(("period_s", "speed_mps"), [(0.143, 4.5), (1.0, 3.0)])
def test_a_fast_vehicle_between_two_positions_is_not_a_stuck_receiver(period_s: float, speed_mps: float) -> None:
    rules = health_rules(
        gnss_period_s=period_s, heading_period_s=TICK_S, odometer_period_s=TICK_S, lgpr_period_s=0.2, risk=_RISK
    )
    since_s = np.zeros(_SCANS)
    for tick in range(_SCANS):
        since = (since_s[tick - 1] if tick else 0.0) + TICK_S
        since_s[tick] = 0.0 if since >= period_s - 1e-9 else since
    # For the second half the receiver repeats itself.
    x_m = np.minimum(np.arange(_SCANS), _HALF) * TICK_S * speed_mps
    health = _judged(_SCANS, rules=rules, speed_mps=speed_mps, since_gnss_s=since_s, gnss_x_m=x_m)
    found = (np.asarray(health.reasons) & Reason.GNSS_STUCK.value) != 0
    assert not found[:_HALF].any()
    # Known at the second position that repeats the first one half a metre on.
    assert found[_HALF + 1 : _HALF + 1 + round((2.0 * period_s + 0.5 / speed_mps) / TICK_S) + 2].any()


def test_a_fault_of_gnss_costs_no_speed_while_lgpr_bounds_the_error(told: dict[str, _Told]) -> None:
    settled = _TIME_S > 2.0
    for name in ("1_gnss_off", "2_gnss_stuck", "4_rtk_float"):
        of = told[name]
        assert (of.reaction[settled] == _C).all()
        assert np.isinf(of.cap_mps[settled]).all()
        _, cross_m = position_sigma_m(of.estimate)
        assert float(np.asarray(cross_m)[settled].max()) < float(_RULES.free_cross_m)


def test_lgpr_bounds_no_error_while_gnss_contradicts_it(told: dict[str, _Told]) -> None:
    of = told["5_gnss_drifts"]
    conflict = (of.reasons & Reason.CONFLICT.value) != 0
    assert of.bounded[(_TIME_S > _ONSET_S - 2.0) & (_TIME_S < _ONSET_S)].all()
    assert conflict.any()
    assert not of.bounded[conflict].any()


def test_without_a_lock_a_fault_of_gnss_slows_down(told: dict[str, _Told]) -> None:
    lost = _TIME_S > _ONSET_S + 2.0
    for name in ("1_gnss_off_without_lgpr", "4_single_without_lgpr", "4_rtk_float_faded"):
        assert (told[name].reaction[lost] >= _D).all()
        assert (told[name].cap_mps[lost] <= _RULES.degraded_mps).all()


def test_rejected_gnss_does_not_move_the_estimate(told: dict[str, _Told]) -> None:
    after = (_TIME_S > _ONSET_S) & (_TIME_S < _ONSET_S + 10.0)
    for name in ("3_gnss_jumps_0.3_m", "3_gnss_jumps_30_m", "2_gnss_stuck"):
        away = np.asarray(told[name].estimate.mean - told["1_gnss_off"].estimate.mean)[after, :2]
        assert np.hypot(*away.T).max() < 0.1


def test_lost_position_stops_the_vehicle_within_the_budget(told: dict[str, _Told]) -> None:
    of = told["13_gnss_and_lgpr_lost"]
    stop_s = _TIME_S[np.argmax((of.reaction == _S) & _AFTER)]
    # A ramp to 2 m/s² and down to standstill takes three seconds from 10 mph.
    _, cross_m = position_sigma_m(of.estimate)
    assert float(np.asarray(cross_m)[_AFTER & (stop_s + 3.0 >= _TIME_S)].max()) < 0.3
    assert (of.reaction[stop_s <= _TIME_S] == _S).all()


def test_slow_drift_is_told_before_it_has_led_far_astray(told: dict[str, _Told]) -> None:
    of = told["5_gnss_drifts"]
    first = int(np.argmax((of.reaction != _C) & _AFTER))
    away = np.asarray(of.estimate.mean, np.float64)[: first + 1, :2] - of.states[: first + 1, :2]
    assert np.hypot(*away.T)[_TIME_S[: first + 1] > 5.0].max() < 0.3


def _sound() -> tuple[FilterState, FilterInfo]:
    """A filter that has just accepted all sources."""
    state = init_filter(_MODEL, VehiclePose(*jnp.zeros(3, jnp.float32)), jnp.float32(0.0))
    gates = state.gates._replace(since_accepted_s=jnp.zeros(4), since_offered_s=jnp.zeros(4))
    covariance = jnp.diag(jnp.full(13, 1e-4, jnp.float32))
    yes, no = jnp.ones(4, bool), jnp.zeros(4, bool)
    estimate = NavEstimate(state.estimate.mean, covariance)
    return FilterState(estimate, gates), FilterInfo(jnp.ones(4), yes, yes, no)


def _judged(
    ticks: int,
    *,
    rules: HealthRules = _RULES,
    p_false: Float[np.ndarray, " tick"] | float = np.nan,
    left_m: Float[np.ndarray, " tick"] | float = 0.0,
    speed_mps: Float[np.ndarray, " tick"] | float = 0.0,
    since_gnss_s: Float[np.ndarray, " tick"] | float = 0.0,
    gnss_x_m: Float[np.ndarray, " tick"] | float | None = None,
    sound: tuple[FilterState, FilterInfo] | None = None,
) -> Health:
    """What is told tick after tick where the filter has just accepted all sources, but for what is given."""
    state, info = sound or _sound()
    columns = (p_false, left_m, speed_mps, since_gnss_s, 0.0 if gnss_x_m is None else gnss_x_m)
    given = [jnp.asarray(np.broadcast_to(column, ticks), jnp.float32) for column in columns]
    health: Health = _scanned(rules, state, info, jnp.asarray(gnss_x_m is not None), tuple(given))
    return health


@jax.jit
def _scanned(
    rules: HealthRules, state: FilterState, info: FilterInfo, repeats: jax.Array, given: tuple[jax.Array, ...]
) -> Health:
    def step(health: HealthState, now: tuple[jax.Array, ...]) -> tuple[HealthState, Health]:
        p_false, left_m, speed_mps, since_s, x_m = now
        mean = state.estimate.mean.at[SPEED].add(speed_mps)
        gates = state.gates._replace(since_offered_s=state.gates.since_offered_s.at[0].add(since_s))
        offered = since_s == 0.0
        observed = no_observations()
        gnss = observed.gnss._replace(x_m=x_m, y_m=0.0 * x_m, valid=repeats & offered)
        return step_health(
            rules,
            health,
            state._replace(estimate=state.estimate._replace(mean=mean), gates=gates),
            info._replace(offered=info.offered.at[0].set(info.offered[0] & offered)),
            observed._replace(gnss=gnss),
            p_false,
            left_m,
            jnp.float32(TICK_S),
        )

    told: Health = jax.lax.scan(step, init_health(), given)[1]
    return told


def _reasons(health: Health) -> list[Reason]:
    return [Reason(int(each)) for each in health.reasons]


def _told_once(
    state: FilterState, info: FilterInfo, *, left_m: float = 0.0, rules: HealthRules = _RULES
) -> tuple[Reason, Reaction]:
    health = _judged(_SCANS, rules=rules, left_m=left_m, sound=(state, info))
    return Reason(int(health.reasons[0])), Reaction(int(health.reaction[0]))


def test_what_is_no_number_stops() -> None:
    sound, info = _sound()
    for state in (SPEED, YAW, RATE_BIAS):
        mean = sound.estimate.mean.at[state].set(jnp.nan)
        reasons, reaction = _told_once(sound._replace(estimate=sound.estimate._replace(mean=mean)), info)
        assert reasons & Reason.NON_FINITE
        assert reaction == _S


def test_path_behind_its_place_degrades_then_stops() -> None:
    assert _told_once(*_sound(), left_m=0.2) == (Reason(0), _C)
    assert _told_once(*_sound(), left_m=0.5) == (Reason.FRAME_BEHIND, _D)
    assert _told_once(*_sound(), left_m=1.5) == (Reason.FRAME_BEHIND | Reason.FRAME_FAR, _S)


def _by_chance(strength: Float[np.ndarray, " scan"], floor: float) -> Float[np.ndarray, " scan"]:
    """Probability that the best of 200 places of other ground, each from a normal noise floor, matches as well."""
    return np.array([-np.expm1(200.0 * np.log1p(-0.5 * erfc(each / floor / np.sqrt(2.0)))) for each in strength])


def _matched(p_false: Float[np.ndarray, " scan"], rules: HealthRules = _RULES) -> list[Reason]:
    """What is told of sound sensors tick after tick, a match each."""
    return _reasons(_judged(_SCANS, rules=rules, p_false=p_false))


_SCANS, _HALF = 200, 100
"""Ten seconds of ticks; five are more than twice the sliding share."""


def test_low_correlations_far_above_the_noise_floor_are_no_fading() -> None:
    rain = _by_chance(np.random.default_rng(1).uniform(0.2, 0.35, _SCANS), 0.03)
    assert rain.max() < 1e-8
    assert set(_matched(rain)) == {Reason(0)}


def test_high_correlations_within_the_noise_floor_are_fading() -> None:
    alike = _by_chance(np.random.default_rng(2).uniform(0.6, 0.9, _SCANS), 0.35)
    assert alike.min() > 0.5
    assert set(_matched(alike)) == {Reason.LGPR_FADED}


@pytest.mark.parametrize(("without", "faded"), [(2, False), (3, True)])
def test_ground_has_faded_when_more_scans_than_not_give_no_evidence(without: int, faded: bool) -> None:
    """Of every five scans so many; how probable the others are makes no difference, only on which side of the risk."""
    for good, bad in ((1e-30, 1.5e-4), (0.9e-4, 1.0)):
        told = _matched(np.where(np.arange(_SCANS) % 5 < 5 - without, good, bad))
        # Of a whole sliding share: nothing is known of the first scans but themselves.
        assert {bool(reasons & Reason.LGPR_FADED) for reasons in told[60:]} == {faded}


def test_fading_is_judged_by_the_risk_that_is_asked_for() -> None:
    chances = np.full(_SCANS, 1e-6)
    strict = _RULES._replace(risk=jnp.float32(1e-7))
    assert set(_matched(chances)) == {Reason(0)}
    assert set(_matched(chances, strict)) == {Reason.LGPR_FADED}


def test_ticks_without_a_match_neither_fade_nor_recover() -> None:
    nothing = np.full(_SCANS, np.nan)
    assert set(_matched(nothing)) == {Reason(0)}
    # One in ten has a scan: their share alone counts.
    sparse = np.where(np.arange(_SCANS) % 10 == 0, 1.0, np.nan)
    assert all(reasons & Reason.LGPR_FADED for reasons in _matched(sparse))


def test_reacquired_source_degrades() -> None:
    state, info = _sound()
    assert _told_once(state, info._replace(reacquired=info.reacquired.at[0].set(True))) == (Reason.REACQUIRED, _D)


@pytest.mark.parametrize(
    ("cross_m", "cap_mps", "reaction"),
    [(0.1, np.inf, _C), (0.11, 10.0, _D), (0.125, 4.0, _D), (0.15, 2.0, _D), (0.24, 5.0 / 7.0, _D), (0.26, 0.0, _S)],
)
@pytest.mark.parametrize("lacks", ["gnss", "lgpr"])
def test_the_cap_follows_the_sigma_across_whichever_source_bounds_it(
    lacks: str, cross_m: float, cap_mps: float, reaction: Reaction
) -> None:
    """By hand: 2 m/s times 5 cm over what exceeds 10 cm."""
    periods = {"gnss": 0.1, "lgpr": 0.2} | {lacks: float("inf")}
    rules = health_rules(
        gnss_period_s=periods["gnss"], heading_period_s=0.05, odometer_period_s=0.05, lgpr_period_s=periods["lgpr"],
        risk=_RISK,
    )  # fmt: skip
    state, info = _sound()
    covariance = state.estimate.covariance.at[1, 1].set(cross_m**2 * (1.0 - 1e-6))
    state = state._replace(estimate=state.estimate._replace(covariance=covariance))
    health = _judged(_SCANS, rules=rules, sound=(state, info))
    assert float(health.speed_cap_mps[-1]) == pytest.approx(cap_mps, rel=1e-3)
    assert int(health.reaction[-1]) == reaction


def test_without_radar_a_silent_receiver_stops_the_vehicle() -> None:
    never = float("inf")
    rules = health_rules(
        gnss_period_s=0.1, heading_period_s=0.05, odometer_period_s=0.05, lgpr_period_s=never, risk=_RISK
    )
    state, info = _sound()
    gone = jnp.asarray([0.6, 0.0, 0.0, 1e6])
    gates = state.gates._replace(since_offered_s=gone, since_accepted_s=gone)
    reasons, reaction = _told_once(state._replace(gates=gates), info, rules=rules)
    assert reasons == Reason.GNSS_SILENT | Reason.POSITION_LOST
    assert reaction == _S


def test_source_that_the_vehicle_lacks_is_not_missed() -> None:
    never = float("inf")
    rules = health_rules(
        gnss_period_s=never, heading_period_s=0.05, odometer_period_s=0.05, lgpr_period_s=0.2, risk=_RISK
    )
    state, info = _sound()
    silent = state.gates._replace(
        since_offered_s=jnp.asarray([1e6, 0.0, 0.0, 0.0]), since_accepted_s=jnp.asarray([1e6, 0.0, 0.0, 0.0])
    )
    assert _told_once(state._replace(gates=silent), info, rules=rules) == (Reason(0), _C)


def test_reason_is_held_and_then_let_go() -> None:
    told_for = sum(bool(each) for each in _reasons(_judged(_SCANS, left_m=np.where(np.arange(_SCANS) == 0, 0.5, 0.0))))
    # A second of ticks, and the one that saw it.
    assert told_for in (20, 21)


def test_one_match_told_again_at_standstill_is_no_lock() -> None:
    standing = np.repeat([0.0, 0.02], _HALF)
    assert not np.asarray(_judged(_SCANS, p_false=1e-9, speed_mps=standing).bounded).any()


def test_a_lock_of_a_drive_holds_while_the_vehicle_stands() -> None:
    found = np.asarray(_judged(_SCANS, p_false=1e-9, speed_mps=np.repeat([2.0, 0.0], _HALF)).bounded)
    assert found[_HALF - 1 :].all()
