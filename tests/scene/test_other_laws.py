"""Laws that are not the filter's: ground slips downhill, GNSS lies in bursts and tails, the base stays off."""

import jax
import jax.numpy as jnp
import numpy as np

from lgprjax.scene.other_laws import OtherLaws, draw_other_laws, init_law_state, read_other_sensors, step_other_plant
from lgprjax.scene.plant import (
    default_skid_plant,
    default_skid_sensors,
    init_skid_plant,
    init_skid_sensors,
)
from lgprjax.vehicle.kinematics import VehiclePose, WheelSpeeds

TICK_S, SECONDS = 0.02, 400.0
PLANT = default_skid_plant(track_m=1.1)
SENSORS = default_skid_sensors(tick_s=TICK_S, gnss_x_m=0.2, gnss_y_m=0.0)
ZERO = jnp.float32(0.0)


def drive(laws: OtherLaws, wheel_mps: float, tool_on: float = 0.0) -> dict[str, np.ndarray]:
    """A vehicle that starts eastwards at the origin, and what its sensors say, for ``SECONDS``."""
    told: dict[str, np.ndarray] = jax.tree.map(np.asarray, _drive(laws, jnp.float32(wheel_mps), jnp.float32(tool_on)))
    return told


@jax.jit
def _drive(laws, wheel_mps, tool_on):  # type: ignore[no-untyped-def]

    def tick(carried, number):  # type: ignore[no-untyped-def]
        plant, held, sensors, key = carried
        key, one, other = jax.random.split(key, 3)
        plant = step_other_plant(laws, PLANT, plant, WheelSpeeds(wheel_mps, wheel_mps), tool_on, one, TICK_S)
        held, sensors, readings = read_other_sensors(laws, held, SENSORS, sensors, plant, number, other, TICK_S)
        told = {"x": plant.pose.x_m, "y": plant.pose.y_m, "yaw": plant.pose.yaw_rad, "slip": plant.slip}
        return (plant, held, sensors, key), told | readings._asdict()

    plant = init_skid_plant(PLANT, VehiclePose(ZERO, ZERO, ZERO), jax.random.key(1), delay_slots=10)
    start = plant, init_law_state(), init_skid_sensors(SENSORS, ZERO, jax.random.key(2)), jax.random.key(3)
    return jax.lax.scan(tick, start, jnp.arange(1, round(SECONDS / TICK_S)))[1]


_draw = jax.jit(jax.vmap(lambda key: draw_other_laws(key)))


def level(**changed: jax.Array) -> OtherLaws:
    """Laws of level ground without stones, and what is changed of them."""
    laws: OtherLaws = jax.tree.map(lambda leaf: leaf[0], _draw(jax.random.split(jax.random.key(0), 400)))
    flat = laws._replace(slope=jnp.zeros_like(laws.slope), stone_yaw_rad=ZERO, stone_m=ZERO, slip_load=ZERO)
    return flat._replace(**changed)


def test_a_vehicle_crabs_and_slips_downhill() -> None:
    # A plane that rises to the north: one wave so long that it has one slope, and firm soil.
    tilt = {
        "wave_radpm": jnp.zeros((6, 2)).at[:, 1].set(1e-6), "wave_phase": jnp.zeros(6),
        "slope": jnp.full(6, 0.02), "crab": jnp.float32(0.1), "slip_bank": ZERO, "loose": jnp.float32(1.0),
    }  # fmt: skip
    crabbed = drive(level(**tilt), 0.03)
    way_m = crabbed["x"][-1]
    # Rise 0.12 a metre to the left: 0.1 of it a metre of way to the right.
    np.testing.assert_allclose(crabbed["y"][-1], -0.1 * 0.12 * way_m, rtol=0.02)
    np.testing.assert_allclose(crabbed["yaw"][-1], 0.0, atol=1e-5)
    level_m = drive(level(), 0.03)["x"][-1]
    loaded_m = drive(level(slip_load=jnp.float32(0.03), loose=jnp.float32(1.0)), 0.03, tool_on=1.0)["x"][-1]
    np.testing.assert_allclose(loaded_m / level_m, 0.97, atol=1e-3)


def test_gnss_lies_as_its_laws_say_and_does_not_tell() -> None:
    base = jnp.asarray([0.06, -0.05], jnp.float32)
    laws = level(base_m=base, burst_m=ZERO, tail_m=jnp.float32(0.008), mount_m=jnp.zeros(2), jitter_s=ZERO)
    told = drive(laws, 0.0)
    at = told["gnss_m"][told["gnss_valid"]] - np.array([0.2, 0.0])
    np.testing.assert_allclose(np.median(at, axis=0), base, atol=2e-3)
    spread = np.abs(at - np.median(at, axis=0))
    # Student's t of three degrees: of 800 numbers some beyond five times its scale, where a normal one has none.
    assert 2 <= np.count_nonzero(spread > 5.0 * 0.008) < 60
    bursts = drive(laws._replace(burst_m=jnp.float32(0.1), burst_every_s=jnp.float32(60.0)), 0.0)
    off = np.hypot(*(bursts["gnss_m"][bursts["gnss_valid"]] - np.array([0.2, 0.0]) - np.asarray(base)).T)
    assert 0.01 < np.mean(off > 0.05) < 0.5
    assert set(np.unique(bursts["gnss_sigma_m"])) == {np.float32(0.02)}


def test_the_ins_drifts_as_it_warms_up() -> None:
    laws = level(warm_radps=jnp.float32(1e-4), warm_s=jnp.float32(100.0), day_radps=ZERO)
    told = drive(laws, 0.0)
    turned = float(told["turn_rad"][told["turn_valid"]].sum())
    # The integral of a drift that fades; the rest is noise of 30 microradians a tenth of a second.
    assert abs(turned - 1e-4 * 100.0 * (1.0 - np.exp(-4.0))) < 4.0 * 3e-5 * np.sqrt(4000)


def test_every_field_draws_its_own_numbers_within_their_range() -> None:
    drawn = _draw(jax.random.split(jax.random.key(5), 400))
    base = np.hypot(*np.asarray(drawn.base_m).T)
    assert base.max() <= 0.1 + 1e-6
    # Evenly over a disc: half of them beyond 0.71 of its radius.
    assert 0.4 < np.mean(base > 0.0707) < 0.6
    assert np.asarray(drawn.crab).min() >= 0.0
    assert len(np.unique(np.asarray(drawn.burst_s))) > 390
