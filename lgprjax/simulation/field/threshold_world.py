"""The vehicle of MF section 4: one that ignores small commands to turn, along one straight line, with three PIDs."""

import jax.numpy as jnp

from lgprjax.coverage.carrot import CarrotSettings
from lgprjax.simulation.field.field_world import FieldWorld, made_up_field_world

THRESHOLD_MPS = 0.3
"""Of the wheels' difference: the vehicle turns by 0.27 rad/s or not at all."""
_LATE_S = 0.4
_WHEEL_RATE_MPS2 = 2.0

PIDS = {
    "P 3, D 2": (1.2, 3.0, 0.0, 2.0),
    "P 4, D 2.5": (1.5, 4.0, 0.0, 2.5),
    "P 3, I 0.3, D 2": (1.2, 3.0, 0.3, 2.0),
}
"""Carrot's distance (m), P (1/m), I (1/m²) and D of three settings that track well where every command is obeyed."""


def threshold_world(pid: tuple[float, float, float, float], *, threshold_mps: float, believed_mps: float) -> FieldWorld:
    """A flail at 1 mph whose hydraulics are 0.4 s late and as slow again.

    Args:
        pid: one of ``PIDS``.
        threshold_mps: of the vehicle; 0 obeys everything.
        believed_mps: that is made up for; 0 makes up for nothing.
    """
    world, one = made_up_field_world(), jnp.float32
    carrot = CarrotSettings(*(one(value) for value in pid), *world.setup.carrot[len(pid) :])
    setup = world.setup._replace(
        carrot=carrot,
        limiter=world.setup.limiter._replace(wheel_rate_mps2=one(_WHEEL_RATE_MPS2)),
        threshold_mps=one(believed_mps),
    )
    plant = world.plant._replace(delay_s=one(_LATE_S), lag_s=one(_LATE_S), threshold_mps=one(threshold_mps))
    return world._replace(plant=plant, setup=setup)
