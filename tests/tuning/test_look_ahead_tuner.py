"""The look-ahead found by gradient beside a brute-force search of 100,000 drives, at full and at reduced torque."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.tuning import TrialCourses, TunedLookAhead, TunedVehicle, judge, sweep_look_ahead, tune_look_ahead
from lgprjax.vehicle import Chassis, LookAhead, ProportionalRear, Servo, arc_course, line_course, look_ahead_m

SPEEDS = (1.5, 2.235, 4.47, 6.5, 8.0)


def vehicle(supply_v: float = 24.0, delay_s: float = 0.06) -> TunedVehicle:
    length, anchor, k, largest, characteristic = (jnp.float32(v) for v in (3.8, 6.5, 0.63, 0.52, 20.0))
    servo = Servo(*(jnp.float32(v) for v in (0.2, 0.5, delay_s, np.radians(0.2), np.radians(0.3), 0.0, 24.0, 10.0)))
    return TunedVehicle(
        Chassis(length, anchor, ProportionalRear(k), largest, characteristic), servo, jnp.float32(supply_v)
    )


@pytest.fixture(scope="module")
def trials() -> TrialCourses:
    """Line and arc, offsets 0 and ±3 m."""
    return TrialCourses((line_course(300.0), arc_course(25.0, 2 * np.pi)), SPEEDS)


@pytest.fixture(scope="module")
def tuned(trials: TrialCourses) -> dict[float, TunedLookAhead]:
    """At full torque, and with 16 V of 24, where 43 % of it are left."""
    return {volts: tune_look_ahead(vehicle(volts), trials) for volts in (24.0, 16.0)}


def cost_of(vehicle: TunedVehicle, trials: TrialCourses, schedule: LookAhead) -> jax.Array:
    """Mean cost over the speeds; infinite where a margin is missing."""
    judged = judge(vehicle, trials, schedule)
    enough = jnp.all(judged.margin_rad >= trials.least_margin_rad, axis=-1)
    return jnp.where(enough, jnp.mean(judged.cost_m, axis=-1), jnp.inf)


@pytest.mark.parametrize("volts", [24.0, pytest.param(16.0, marks=pytest.mark.campaign)])
def test_gradient_is_as_good_as_brute_force(
    trials: TrialCourses, tuned: dict[float, TunedLookAhead], volts: float
) -> None:
    """Within 2 % of the least cost of 3,600 schedules, each driven 30 times."""
    axes = (np.geomspace(0.8, 8, 12), np.geomspace(1.5, 18, 15), np.linspace(0.5, 3.5, 4), np.linspace(5.0, 10, 5))
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 4)
    costs = [
        np.asarray(
            cost_of(vehicle(volts), trials, LookAhead(*(jnp.asarray(part[:, i], jnp.float32) for i in range(4))))
        )
        for part in np.split(grid, 6)
    ]
    assert len(grid) * len(SPEEDS) * 3 * 2 >= 100_000
    least = float(np.min(np.concatenate(costs)))
    print(f"{volts} V: gradient {tuned[volts].cost_m:.4f} m, brute force {least:.4f} m")
    assert np.isfinite(least)
    assert tuned[volts].cost_m <= 1.02 * least


def test_less_torque_asks_for_a_longer_look_ahead(tuned: dict[float, TunedLookAhead]) -> None:
    """Found, not typed in: at every speed by a tenth or more."""
    full, weak = (
        np.asarray(look_ahead_m(tuned[volts].schedule, jnp.asarray(SPEEDS, jnp.float32))) for volts in (24.0, 16.0)
    )
    print("look-ahead at", SPEEDS, "m/s:", full, "and with reduced torque", weak)
    assert (weak > 1.1 * full).all()


def test_look_ahead_grows_with_speed_and_leaves_the_margin(
    trials: TrialCourses, tuned: dict[float, TunedLookAhead]
) -> None:
    for found in tuned.values():
        assert float(found.schedule.long_m) > 1.5 * float(found.schedule.short_m)
        assert (np.asarray(found.judged.margin_rad) >= trials.least_margin_rad).all()
        assert (np.asarray(found.judged.error_m) < 0.6).all()


def test_sweep_is_what_single_drives_are(trials: TrialCourses) -> None:
    """One place of the surface, judged by itself."""
    swept = sweep_look_ahead(vehicle(), trials, [2.0, 5.0, 9.0])
    zero = jnp.float32(0.0)
    alone = judge(vehicle(), trials, LookAhead(jnp.float32(5.0), jnp.float32(5.0), zero, zero))
    for field, single in zip(swept, alone, strict=True):
        np.testing.assert_allclose(np.asarray(field)[1], np.asarray(single), rtol=2e-3, atol=1e-5)


def test_what_cannot_be_tuned_is_refused(trials: TrialCourses) -> None:
    with pytest.raises(ValueError, match="two speeds"):
        tune_look_ahead(vehicle(), TrialCourses(trials.paths, (2.0,)))
    with pytest.raises(ValueError, match="phase margin"):
        tune_look_ahead(vehicle(), TrialCourses(trials.paths, SPEEDS, least_margin_rad=1.5))
    with pytest.raises(ValueError, match="delays of up to"):
        tune_look_ahead(vehicle(delay_s=0.3), trials)
