"""Drives of made-up fields in closed loop, and their errors by NumPy."""

import jax
import numpy as np
from jaxtyping import Array, Bool, Float

from lgprjax.autopilot import pad_fence
from lgprjax.coverage import PatternSettings
from lgprjax.simulation.field_loop import FieldCourse, FieldLoopSpec, FieldMoment, FieldWorld, run_fields

INCH_M = 0.0254
SPEC = FieldLoopSpec(moments=4400)
FAR = pad_fence(np.array([[-60.0, -60.0], [180.0, -60.0], [180.0, 60.0], [-60.0, 60.0]]))


def settings(turning_room_m: float = 6.0) -> PatternSettings:
    return PatternSettings(1.2, 0.15, "boustrophedon", 1.5, turning_room_m, 1.2)


def driven(
    world: FieldWorld, course: FieldCourse, fence: Float[Array, "slot 2"], *, spec: FieldLoopSpec = SPEC, seed: int = 5
) -> FieldMoment:
    """Two lanes, as NumPy arrays."""
    kept = run_fields(spec, world, course.route, fence, jax.random.split(jax.random.key(seed), 2))
    return jax.tree.map(np.asarray, kept)  # type: ignore[no-any-return]


def errors(kept: FieldMoment) -> Float[np.ndarray, "moment lane 3"]:
    turned = np.angle(np.exp(1j * (np.asarray(kept.believed.yaw_rad, np.float64) - kept.yaw_rad)))
    return np.stack([kept.believed.x_m - kept.x_m, kept.believed.y_m - kept.y_m, turned], axis=-1)


def rms(values: Float[np.ndarray | Array, "..."]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def mean_nees(kept: FieldMoment, chosen: Bool[np.ndarray | Array, "moment lane"]) -> float:
    """Of x, y and yaw, a degree of freedom."""
    wrong, spread = errors(kept)[chosen], np.asarray(kept.covariance, np.float64)[chosen]
    return float(np.mean(np.einsum("ti,tij,tj->t", wrong, np.linalg.inv(spread), wrong)) / 3.0)
