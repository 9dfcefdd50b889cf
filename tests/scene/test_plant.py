"""The vehicle of the closed loop against its own exact arcs, and what slopes do to it."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest

from lgprjax.scene import Plant, Terrain, TrueVehicle, init_plant, step_plant
from lgprjax.scene.plant import CORNERING_MPS2_PER_RAD, GRAVITY_MPS2
from lgprjax.scene.road import Waves
from lgprjax.scene.vehicle_drive import chassis_of, pedals_of, servo_of
from lgprjax.vehicle import VehiclePose

_STEP_S = 1.0 / 21.0


def _waves(value: float) -> Waves:
    """A function that is the same everywhere: a sine of no frequency at its crest."""
    return Waves(*(np.array([number], np.float32) for number in (value, 0.0, np.pi / 2)))


def _terrain(*, grade: float = 0.0, bank: float = 0.0, ruts: float = 0.0, direction: float = 1.0) -> Terrain:
    return Terrain(_waves(grade), _waves(bank), _waves(ruts), jnp.float32(direction))


def _drive(
    terrain: Terrain, front_rad: float, throttle: float, ticks: int, gear: float = 1.0, speed_mps: float = 4.0
) -> tuple[np.ndarray, np.ndarray]:
    """Poses and speeds after each tick."""
    true = TrueVehicle(delay_s=0.0)
    plant = Plant(chassis_of(true, 6.2), servo_of(true), pedals_of(true), jnp.float32(24.0))
    zero = jnp.float32(0.0)
    state = init_plant(VehiclePose(zero, zero, zero), jnp.float32(speed_mps), zero, delay_slots=1)
    commands = [jnp.float32(value) for value in (front_rad, throttle, 0.0, gear)]
    places, speeds = [], []
    for _ in range(ticks):
        state = _STEP(plant, terrain, state, *commands, _STEP_S)
        places.append([float(part) for part in state.pose])
        speeds.append(float(state.speed_mps))
    return np.array(places), np.array(speeds)


_STEP = jax.jit(step_plant, static_argnums=7)


def test_a_steady_turn_is_a_circle_of_the_geometry() -> None:
    front = 0.2
    places, speeds = _drive(_terrain(), front, 0.22, 900)
    late = places[500:]
    # Twice the area over the chord: the circle through three places of the rear axle.
    a, b, c = late[0, :2], late[60, :2], late[120, :2]
    sides = [np.hypot(*(p - q)) for p, q in ((a, b), (b, c), (a, c))]
    area = 0.5 * abs((b - a)[0] * (c - a)[1] - (b - a)[1] * (c - a)[0])
    radius = np.prod(sides) / (4.0 * area)
    play = 0.2 * np.pi / 180 + 0.15 * np.pi / 180  # what dead band and play leave of the command at most
    speed = speeds[500:].mean()
    gain = 1.0 / (1.0 + (speed / 20.0) ** 2)
    radii = []
    for angle in (front - play, front):
        front_tangent, rear_tangent = np.tan(angle), np.tan(0.63 * angle)
        curvature = gain * (front_tangent + rear_tangent) / 3.8
        radii.append(np.hypot(1.0, gain * rear_tangent) / curvature)
    assert radii[1] - 0.02 <= radius <= radii[0] + 0.02


def test_uphill_slows_by_gravity_and_downhill_is_the_other_direction() -> None:
    _, level = _drive(_terrain(), 0.0, 0.2, 42)
    _, uphill = _drive(_terrain(grade=0.05), 0.0, 0.2, 42)
    _, downhill = _drive(_terrain(grade=0.05, direction=-1.0), 0.0, 0.2, 42)
    lost = GRAVITY_MPS2 * 0.05 * 2.0  # over two seconds, less a little drag
    assert level[-1] - uphill[-1] == pytest.approx(lost, rel=0.08)
    assert downhill[-1] - level[-1] == pytest.approx(lost, rel=0.08)


def test_a_leaning_ground_makes_it_crab_downhill() -> None:
    places, _ = _drive(_terrain(bank=0.04), 0.0, 0.22, 84)
    way = places[-1, 0]
    assert places[-1, 1] == pytest.approx(-0.04 * GRAVITY_MPS2 / CORNERING_MPS2_PER_RAD * way, rel=0.02)
    assert places[-1, 2] == pytest.approx(0.0, abs=1e-6)


def test_ruts_turn_it_by_their_curvature() -> None:
    places, _ = _drive(_terrain(ruts=0.01), 0.0, 0.22, 84)
    way = np.hypot(*np.diff(places[:, :2], axis=0, prepend=0.0).T).sum()
    assert places[-1, 2] == pytest.approx(0.01 * way, rel=0.01)


def test_reverse_gear_drives_back() -> None:
    places, speeds = _drive(_terrain(), 0.0, 0.22, 42, gear=-1.0)
    assert places[-1, 0] < -5.0
    assert np.all(speeds < 0.0)
