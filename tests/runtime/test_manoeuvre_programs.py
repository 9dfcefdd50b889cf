"""What a commanded manoeuvre asks for, against vehicles of the tests' own: far apart, on slopes, without a brake."""

import math
from collections.abc import Callable
from itertools import groupby
from typing import NamedTuple

import numpy as np
import pytest

from lgprjax.runtime.control.manoeuvre_programs import PedalProgram, SteeringProgram
from pedalled_plant import PedalledPlant, PlantNumbers

TICK_S = 0.02
FASTEST_MPS = 3.5


class Tick(NamedTuple):
    """A tick: what was asked for, and the vehicle after it."""

    time_s: float
    throttle: float
    brake: float
    speed_mps: float
    way_m: float
    proven: bool
    runs: int


def driven(
    numbers: PlantNumbers,
    program: PedalProgram,
    seconds: float = 400.0,
    read: Callable[[float, float], float] = lambda speed, _: speed,
    plant: PedalledPlant | None = None,
) -> list[Tick]:
    """Drive until the programme is complete, or in trouble for five seconds; ``read``: speed as shown, by the time."""
    plant = PedalledPlant(numbers) if plant is None else plant
    ticks: list[Tick] = []
    left_s = 5.0
    while len(ticks) * TICK_S < seconds and program.share < 1.0 and left_s > 0.0:
        throttle, brake = program.step(read(plant.speed_mps, len(ticks) * TICK_S), TICK_S)
        plant.step(throttle, brake, TICK_S)
        left_s -= TICK_S if program.trouble else 0.0
        ticks.append(
            Tick(len(ticks) * TICK_S, throttle, brake, plant.speed_mps, plant.way_m, program.proven, program.runs)
        )
    return ticks


def runs_of(ticks: list[Tick]) -> dict[int, list[Tick]]:
    return {run: list(each) for run, each in groupby(ticks, lambda tick: tick.runs)}


def levels(values: list[float]) -> list[float]:
    """Different values that were held, in their order, without those of a ramp."""
    held = [(value, len(list(each))) for value, each in groupby(round(value, 4) for value in values)]
    return [value for value, count in held if value > 0.0 and count > 5]


VEHICLES = {
    "usual": PlantNumbers(),
    "strong": PlantNumbers(throttle_mps2=8.0),
    "quick": PlantNumbers(throttle_mps2=6.0, throttle_lag_s=0.2),
    "weak": PlantNumbers(throttle_from=0.25, throttle_mps2=1.2, throttle_lag_s=1.0),
    "soft ground": PlantNumbers(rolling_mps2=0.5),
    "soft brake": PlantNumbers(brake_mps2=2.0, brake_lag_s=0.5),
    "downhill": PlantNumbers(slope=-0.03),
    "slightly uphill": PlantNumbers(slope=0.01),
    "kerb": PlantNumbers(kerb_mps2=0.8),
}


def steering(amplitude_rad: float) -> tuple[SteeringProgram, np.ndarray, list[float]]:
    program = SteeringProgram(amplitude_rad)
    angles: list[float] = []
    shares: list[float] = []
    while program.share < 1.0:
        assert len(angles) < 100.0 / TICK_S
        shares.append(program.share)
        angles.append(program.step(TICK_S))
    return program, np.array(angles), shares


@pytest.mark.parametrize("amplitude_rad", [0.05, 0.2, 0.4])
def test_steering_steps_to_either_side_then_sweeps(amplitude_rad: float) -> None:
    program, angles, shares = steering(amplitude_rad)
    assert len(angles) * TICK_S == pytest.approx(71.0, abs=0.1)
    assert np.abs(angles).max() == pytest.approx(amplitude_rad)
    assert shares == sorted(shares)
    assert shares[len(shares) // 2] == pytest.approx(0.5, abs=0.01)
    steps, sweep = angles[: round(28.0 / TICK_S)], angles[round(28.0 / TICK_S) : round(68.0 / TICK_S)]
    held = [(value, len(list(each)) * TICK_S) for value, each in groupby(steps)]
    expected = [0.0, *(side * share * amplitude_rad for share in (0.17, 0.5, 1.0) for side in (1.0, -1.0, 0.0))]
    assert [value for value, _ in held] == pytest.approx(expected)
    assert [seconds for _, seconds in held] == pytest.approx([1.0, *[3.0] * 9], abs=0.05)
    assert np.abs(sweep).max() == pytest.approx(0.35 * amplitude_rad, rel=0.01)
    # Turns of a phase of rising frequency: the integral from 0.05 to 1 Hz.
    crossings = np.flatnonzero(np.diff(np.sign(sweep)) != 0)
    assert len(crossings) == pytest.approx(2 * 0.5 * (0.05 + 1.0) * 40.0, abs=1)
    assert np.diff(crossings)[0] == pytest.approx(4.7 / TICK_S, rel=0.1)
    assert np.diff(crossings)[-1] == pytest.approx(0.5 / TICK_S, abs=1)
    assert (angles[round(68.0 / TICK_S) + 1 :] == 0.0).all()
    assert program.step(TICK_S) == 0.0


def test_interrupted_steering_begins_again_and_complete_steering_does_not() -> None:
    program = SteeringProgram(0.2)
    first = [program.step(TICK_S) for _ in range(300)]
    program.restart()
    assert program.share == 0.0
    assert [program.step(TICK_S) for _ in range(300)] == first
    whole, _, _ = steering(0.2)
    whole.restart()
    assert whole.share == 1.0
    assert whole.step(TICK_S) == 0.0


def test_limits_and_caps_of_speed() -> None:
    program = PedalProgram(FASTEST_MPS)
    assert (program.cap_mps, program.limit_mps) == (1.2, 2.0)
    driven(VEHICLES["usual"], program, 60.0)
    assert program.proven
    assert (program.cap_mps, program.limit_mps) == (FASTEST_MPS, FASTEST_MPS + 1.0)


def test_runs_differ_in_throttle_and_brake_each_with_a_step_back() -> None:
    program = PedalProgram(FASTEST_MPS)
    found = runs_of(driven(VEHICLES["usual"], program))
    moved_at = min(tick.throttle for tick in found[-1] if tick.speed_mps > 0.25 and tick.throttle > 0.0)
    above = []
    for run in range(12):
        pressed, braked = (levels([tick[column] for tick in found[run]]) for column in (1, 2))
        high, back = pressed
        above.append(high - moved_at)
        assert high - back == pytest.approx(0.12, abs=1e-3)
        assert braked[0] == 0.4
        hard, eased, *halt = braked[1:]
        assert hard - eased == pytest.approx(0.12, abs=1e-3)
        assert halt in ([], [0.6])
        assert 0.25 < hard <= 0.7
        # Two seconds of rest under the brake before each.
        rest = [tick for tick in found[run] if tick.brake == 0.4]
        assert len(rest) * TICK_S == pytest.approx(2.0, abs=0.1)
        assert all(tick.speed_mps > 0.05 or tick.brake > 0.0 or tick.throttle > 0.0 for tick in found[run])
    assert min(above) == pytest.approx(0.1, abs=0.01)
    assert max(above) == pytest.approx(0.33, abs=0.01)
    assert len(set(np.round(above, 3))) == 12
    assert len({levels([tick.brake for tick in found[run]])[1] for run in range(12)}) == 12
    assert max(tick.speed_mps for tick in found[5]) > FASTEST_MPS - 0.5


def test_parts_of_a_run_last_as_long_as_they_should() -> None:
    """By a vehicle too weak to reach any speed that would end them."""
    slow = PlantNumbers(throttle_mps2=1.5, rolling_mps2=0.05, drag_per_s=0.0)
    program = PedalProgram(8.0)
    run = runs_of(driven(slow, program))[0]
    parts = [(round(throttle, 3), round(brake, 3)) for _, throttle, brake, *_ in run]
    lasts = [(part, len(list(each)) * TICK_S) for part, each in groupby(parts)]
    seconds = [lasted for _, lasted in lasts]
    assert seconds[:6] == pytest.approx([2.0, 5.0, 1.5, 2.0, 0.7, 0.6], abs=0.05), lasts
    kinds = ["b" if brake else "t" if throttle else "-" for (throttle, brake), _ in lasts]
    assert "".join(kinds) == "btt-bbb"


@pytest.fixture(scope="module", params=VEHICLES, ids=str)
def whole(request: pytest.FixtureRequest) -> tuple[str, PedalProgram, list[Tick]]:
    """The whole programme on each vehicle."""
    program = PedalProgram(FASTEST_MPS)
    return request.param, program, driven(VEHICLES[request.param], program)


def test_a_sound_vehicle_is_driven_through_every_run(whole: tuple[str, PedalProgram, list[Tick]]) -> None:
    name, program, ticks = whole
    assert (program.share, program.trouble, program.dead, program.proven) == (1.0, "", False, True), name
    assert program.runs == 12
    assert sorted(runs_of(ticks)) == list(range(-2, 13))
    assert 80.0 < ticks[-1].time_s < 260.0
    # From standstill to standstill, forward.
    assert min(tick.speed_mps for tick in ticks) > -0.1
    for run, driving in runs_of(ticks).items():
        assert abs(driving[-1].speed_mps) < 0.06, run
        assert run == 12 or max(tick.speed_mps for tick in driving) > 0.25


def test_before_the_brake_is_proven_it_is_slower_than_two_metres_a_second(
    whole: tuple[str, PedalProgram, list[Tick]],
) -> None:
    name, _, ticks = whole
    unproven = [tick for tick in ticks if not tick.proven]
    assert max(tick.speed_mps for tick in unproven) < 2.0, name
    # Slow and rising at three hundredths a second, and all the way again from nothing.
    pressed = np.array([tick.throttle for tick in unproven])
    assert np.diff(pressed).max() <= 0.03 * TICK_S + 1e-9
    assert pressed.max() <= 0.6
    begins = next(tick.time_s for tick in unproven if tick.throttle > 0.0)
    assert begins == pytest.approx(2.0, abs=0.1)
    assert all(tick.brake == 0.4 for tick in unproven if tick.time_s < begins - TICK_S)
    # Never eased: the brake of the proof is the whole one.
    assert {tick.brake for tick in unproven} == {0.0, 0.4, 0.6}
    proof = [tick for tick in unproven if tick.runs == -1]
    assert 0.9 < max(tick.speed_mps for tick in proof) < 1.5
    # Not on ground that has already stopped it.
    assert next(tick.speed_mps for tick in proof if tick.brake == 0.6) > 0.5


def test_speeds_and_ways_of_the_runs_are_bounded(whole: tuple[str, PedalProgram, list[Tick]]) -> None:
    name, _, ticks = whole
    assert max(tick.speed_mps for tick in ticks) < FASTEST_MPS + 0.5, name
    for run, driving in runs_of(ticks).items():
        assert driving[-1].way_m - driving[0].way_m < 12.0 * FASTEST_MPS, run
        assert not any(tick.throttle > 0.0 and tick.brake > 0.0 for tick in driving)
        assert all(0.0 <= pedal <= 1.0 for tick in driving for pedal in (tick.throttle, tick.brake))


@pytest.mark.parametrize(
    ("numbers", "why", "dead"),
    [
        (PlantNumbers(brake_mps2=0.0), "the brake does not slow", True),
        (PlantNumbers(brake_mps2=0.0, rolling_mps2=0.3), "the brake has not been seen", False),
        (PlantNumbers(brake_mps2=1.3, slope=-0.03), "the brake has not been seen", False),
        # Ground that slows it more than a brake would: the proof is what comes on top.
        (PlantNumbers(brake_mps2=0.0, rolling_mps2=0.6), "the brake has not been seen", False),
        (PlantNumbers(brake_mps2=0.0, slope=-0.02, rolling_mps2=0.25), "the brake does not slow", True),
        (PlantNumbers(brake_mps2=0.6), "the brake has not been seen", False),
        (PlantNumbers(slope=0.04), "the vehicle rolls backward", False),
        (PlantNumbers(throttle_mps2=0.0), "the vehicle does not reach 0.25 m/s", False),
        (PlantNumbers(throttle_mps2=1.0, drag_per_s=0.5), "the vehicle does not reach 1.2 m/s", False),
    ],
)
def test_a_vehicle_that_is_not_sound_is_braked_and_told_of(numbers: PlantNumbers, why: str, dead: bool) -> None:
    program = PedalProgram(FASTEST_MPS)
    ticks = driven(numbers, program)
    assert program.trouble.startswith(why), program.trouble
    assert (program.dead, program.proven) == (dead, False)
    assert max(tick.speed_mps for tick in ticks) < 2.0
    assert min(tick.speed_mps for tick in ticks) > -0.35
    assert all((tick.throttle, tick.brake) == (0.0, 0.6) for tick in ticks[-200:])


def test_a_brake_that_fails_later_is_found_within_seconds() -> None:
    program, plant = PedalProgram(FASTEST_MPS), PedalledPlant(VEHICLES["usual"])
    driven(VEHICLES["usual"], program, 70.0, plant=plant)
    assert program.proven
    plant.numbers = PlantNumbers(brake_mps2=0.0, slope=-0.02)
    ticks = driven(plant.numbers, program, 60.0, plant=plant)
    assert program.dead
    # Trouble is followed for five seconds.
    braked = [tick.time_s for tick in ticks if tick.brake > 0.0 and tick.speed_mps > 1.0]
    assert 1.9 < ticks[-1].time_s - 5.0 - braked[0] < 4.1
    assert max(tick.speed_mps for tick in ticks) < FASTEST_MPS + 1.0


def test_the_throttle_at_a_kerb_is_not_what_the_runs_begin_at() -> None:
    program, free = PedalProgram(FASTEST_MPS), PedalProgram(FASTEST_MPS)
    kerb = runs_of(driven(VEHICLES["kerb"], program))
    level = runs_of(driven(VEHICLES["usual"], free))
    assert max(tick.throttle for tick in kerb[-2]) > max(tick.throttle for tick in level[-2]) + 0.1
    for run in range(12):
        assert levels([tick.throttle for tick in kerb[run]]) == pytest.approx(
            levels([tick.throttle for tick in level[run]]), abs=0.01
        )
    assert max(tick.speed_mps for tick in kerb[-2]) < 2.0


def test_a_speed_that_is_no_number_brakes_until_the_run_begins_again() -> None:
    for at_s in (1.0, 8.0, 22.0, 33.0, 40.0, 43.0):
        program, plant = PedalProgram(FASTEST_MPS), PedalledPlant(VEHICLES["usual"])
        driven(plant.numbers, program, at_s, plant=plant)
        runs = program.runs
        assert program.step(math.nan, TICK_S) == (0.0, 0.6)
        # Even when it is one again, and even at standstill.
        after = driven(plant.numbers, program, 8.0, plant=plant)
        assert all((tick.throttle, tick.brake) == (0.0, 0.6) for tick in after)
        assert plant.speed_mps == 0.0
        assert program.runs == runs
        program.restart()
        assert program.between_runs
        assert program.step(0.0, TICK_S) == (0.0, 0.4)
        again = driven(plant.numbers, program, plant=plant)
        assert program.share == 1.0
        assert max(tick.speed_mps for tick in again) < FASTEST_MPS + 0.5


def test_a_stop_is_braked_at_once_and_counts_no_run() -> None:
    for at_s in (5.0, 20.0, 31.0, 50.0, 55.0, 60.0, 64.0):
        program, plant = PedalProgram(FASTEST_MPS), PedalledPlant(VEHICLES["usual"])
        driven(plant.numbers, program, at_s, plant=plant)
        runs, speed = program.runs, plant.speed_mps
        for _ in range(300):
            assert program.step(plant.speed_mps, TICK_S, stop=True) == (0.0, 0.6)
            plant.step(0.0, 0.6, TICK_S)
            assert plant.speed_mps < speed + 0.5
        assert (program.runs, program.dead, program.trouble, plant.speed_mps) == (runs, False, "", 0.0)


def test_a_vehicle_that_a_run_does_not_move_ends_it() -> None:
    program, plant = PedalProgram(FASTEST_MPS), PedalledPlant(VEHICLES["usual"])
    driven(plant.numbers, program, 40.0, plant=plant)
    assert program.proven
    while not program.between_runs:
        driven(plant.numbers, program, TICK_S, plant=plant)
    runs = program.runs
    plant.numbers = PlantNumbers(throttle_mps2=0.0)
    ticks = driven(plant.numbers, program, plant=plant)
    pressed = max(tick.throttle for tick in ticks)
    assert program.trouble == f"the vehicle does not move at a throttle of {pressed:.2f}"
    assert (program.runs, program.between_runs) == (runs, False)
    assert len([tick for tick in ticks if tick.throttle > 0.0]) * TICK_S == pytest.approx(5.0, abs=0.1)


def test_a_speed_that_cannot_be_reached_is_given_up_in_time() -> None:
    program = PedalProgram(FASTEST_MPS)
    ticks = driven(PlantNumbers(throttle_mps2=1.0, drag_per_s=0.5), program)
    tried = [tick for tick in ticks if tick.runs == -1 and tick.throttle > 0.0]
    assert len(tried) * TICK_S == pytest.approx(35.0, abs=0.1)


def test_after_a_stop_a_vehicle_that_rolls_a_little_is_only_braked() -> None:
    program, plant = PedalProgram(FASTEST_MPS), PedalledPlant(VEHICLES["usual"])
    for _ in range(round(6.0 / TICK_S)):
        program.step(0.0, TICK_S, stop=True)
    program.restart()
    plant.speed_mps = 0.3
    driven(plant.numbers, program, 3.0, plant=plant)
    assert (program.dead, program.trouble) == (False, "")


def test_an_interrupted_probe_begins_at_nothing() -> None:
    """A parking brake that is released meanwhile lets the vehicle go."""
    program = PedalProgram(FASTEST_MPS)
    ticks = driven(PlantNumbers(kerb_mps2=9.0), program, 12.0)
    assert ticks[-1].throttle == pytest.approx(0.3, abs=0.01)
    program.restart()
    again = driven(VEHICLES["usual"], program, 2.2)
    assert again[-1].throttle < 0.01
    assert max(tick.throttle for tick in again) < 0.01


def test_it_waits_for_a_vehicle_that_still_rolls() -> None:
    program, plant = PedalProgram(FASTEST_MPS), PedalledPlant(PlantNumbers(brake_mps2=0.15))
    plant.speed_mps = 0.3
    ticks = driven(plant.numbers, program, 6.0, plant=plant)
    standing = next(tick.time_s for tick in ticks if tick.speed_mps < 0.05)
    pressing = next(tick.time_s for tick in ticks if tick.throttle > 0.0)
    assert pressing - standing == pytest.approx(2.0, abs=0.1)


def test_a_brake_that_does_not_hold_at_rest_has_failed() -> None:
    program, plant = PedalProgram(FASTEST_MPS), PedalledPlant(PlantNumbers(brake_mps2=0.0, slope=-0.05))
    driven(plant.numbers, program, 1.94, plant=plant)
    assert not program.dead
    driven(plant.numbers, program, 0.1, plant=plant)
    assert program.dead


@pytest.mark.parametrize("died", [False, True])
def test_a_stop_that_no_brake_makes_proves_none(died: bool) -> None:
    """An odometer that dies when the brake is pressed shows one."""
    program, plant = PedalProgram(FASTEST_MPS), PedalledPlant(VEHICLES["usual"])
    for _ in range(round(60.0 / TICK_S)):
        plant.step(*program.step(plant.speed_mps, TICK_S), TICK_S)
        if program.runs == -1 and plant.brake > 0.1 and plant.speed_mps > 0.5:
            break
    for _ in range(200):
        plant.step(*program.step(0.0 if died else plant.speed_mps, TICK_S), TICK_S)
    assert program.proven is not died


def test_the_share_is_that_of_the_runs() -> None:
    program = PedalProgram(FASTEST_MPS)
    shares = [program.share]
    plant = PedalledPlant(VEHICLES["usual"])
    while shares[-1] < 1.0 and len(shares) < 200:
        driven(plant.numbers, program, 1.0, plant=plant)
        shares.append(program.share)
    assert sorted(set(shares)) == pytest.approx(np.arange(13) / 12)
    assert shares == sorted(shares)
