"""A made-up route for guidance: two lines and the arc between them, laid by plain geometry and not by a pattern."""

import jax.numpy as jnp
import numpy as np

from lgprjax.coverage.guidance import CoverRoute

LINE_M, RADIUS_M, SPACING_M = 20.0, 4.0, 0.05
ROWS = 2048


def made_route() -> CoverRoute:
    """East for 20 m, half a circle of 4 m to the left, west for 20 m; the tool on along the lines."""
    length_m = 2.0 * LINE_M + np.pi * RADIUS_M
    count = round(length_m / SPACING_M) + 1
    step_m = length_m / (count - 1)
    arc = step_m * np.arange(ROWS)
    turned = np.clip(arc - LINE_M, 0.0, np.pi * RADIUS_M)
    yaw = turned / RADIUS_M
    after = np.maximum(arc - LINE_M - np.pi * RADIUS_M, 0.0)
    x = np.minimum(arc, LINE_M) + RADIUS_M * np.sin(yaw) - after
    y = RADIUS_M * (1.0 - np.cos(yaw))
    curvature = np.append(np.diff(yaw) / step_m, 0.0)
    line = np.where(arc < LINE_M, 0, np.where(after > 0.0, 1, -1))
    line[count:] = -1
    rows = np.stack([x, y, yaw, curvature, line >= 0], axis=1)
    return CoverRoute(
        jnp.asarray(rows, jnp.float32),
        jnp.asarray(line, jnp.int32),
        jnp.float32(step_m),
        jnp.float32(length_m),
        jnp.int32(count),
    )
