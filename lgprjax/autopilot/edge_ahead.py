"""Whether a stop from here would cross the fence (fault 36), asked each step.

Where the vehicle comes to rest is foretold: on along an arc for the time of reaction, then braked. At places along that
way the rectangle that holds reference point and tool, grown by a margin, must lie within the fence. It does so exactly
where no side of it crosses a side of the fence and one corner is inside.
"""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float

from lgprjax.autopilot.fence import vehicle_outline
from lgprjax.coverage.tool import Tool
from lgprjax.vehicle.arc import VehiclePose
from lgprjax.vehicle.skid_steer import WheelSpeeds, drive_skid_arc

_PLACES = 12


class StopRules(NamedTuple):
    """How the vehicle stops, as the foretelling believes it; float32 scalars.

    Attributes:
        reaction_s: until it begins to slow down: age of the pose, tick, delay and lag of the wheels.
        stop_mps2: deceleration of the faster wheel then.
        margin_m: that must be left to the fence, beside that of the pose's uncertainty.
        sigmas: of the position that count as uncertainty.
    """

    reaction_s: Float[Array, "..."]
    stop_mps2: Float[Array, "..."]
    margin_m: Float[Array, "..."]
    sigmas: Float[Array, "..."]


def edge_ahead(
    rules: StopRules,
    fence: Float[Array, "slot 2"],
    tool: Tool,
    track_m: Float[Array, ""],
    pose: VehiclePose,
    wheels: WheelSpeeds,
    sigma_m: Float[Array, ""],
) -> Bool[Array, ""]:
    """Whether reference point or tool would cross the fence before the vehicle stands, if it were stopped now.

    It is so, too, where they are beyond the fence already, and where anything is no number. One lane.

    Args:
        rules: how it stops.
        fence: from ``pad_fence``.
        tool: its rectangle.
        track_m: effective.
        pose: of the reference point.
        wheels: as commanded or as measured: their arc is held to the end.
        sigma_m: of the position.
    """
    fastest = jnp.maximum(jnp.abs(wheels.left_mps), jnp.abs(wheels.right_mps))
    # At the constant speed of the beginning the braked way takes half of its time.
    rolling_s = rules.reaction_s + 0.5 * fastest / rules.stop_mps2
    shares = jnp.linspace(0.0, 1.0, _PLACES, dtype=jnp.float32)
    reached = drive_skid_arc(pose, track_m, wheels, shares * rolling_s)
    front, rear, left, right = vehicle_outline(tool, rules.margin_m + rules.sigmas * sigma_m)
    ahead, aside = jnp.stack([front, rear, rear, front])[None], jnp.stack([left, left, right, right])[None]
    cos, sin = jnp.cos(reached.yaw_rad)[:, None], jnp.sin(reached.yaw_rad)[:, None]
    corners = jnp.stack(
        [reached.x_m[:, None] + cos * ahead - sin * aside, reached.y_m[:, None] + sin * ahead + cos * aside], axis=-1
    )
    within = _inside(fence, corners[:, 0]) & ~_sides_cross(fence, corners)
    return ~jnp.all(within & jnp.isfinite(corners).all((1, 2)))


def _inside(fence: Float[Array, "slot 2"], points: Float[Array, "place 2"]) -> Bool[Array, " place"]:
    """By the even-odd rule; sides of no length count nothing."""
    x, y = points[:, :1], points[:, 1:]
    start, end = fence[None], jnp.roll(fence, -1, axis=0)[None]
    spans = (start[..., 1] > y) != (end[..., 1] > y)
    rise = jnp.where(spans, end[..., 1] - start[..., 1], 1.0)
    crossing = start[..., 0] + (y - start[..., 1]) * (end[..., 0] - start[..., 0]) / rise
    return jnp.sum(spans & (x < crossing), axis=1) % 2 == 1


def _sides_cross(fence: Float[Array, "slot 2"], corners: Float[Array, "place 4 2"]) -> Bool[Array, " place"]:
    """Whether a side of a rectangle crosses or touches a side of the fence."""
    a, b = corners[:, :, None], jnp.roll(corners, -1, axis=1)[:, :, None]
    c, d = fence[None, None], jnp.roll(fence, -1, axis=0)[None, None]
    apart = (_beside(a, b, c) * _beside(a, b, d) > 0.0) | (_beside(c, d, a) * _beside(c, d, b) > 0.0)
    return jnp.any(~apart & jnp.any(c != d, axis=-1), axis=(1, 2))


def _beside(start: Float[Array, "..."], end: Float[Array, "..."], point: Float[Array, "..."]) -> Float[Array, "..."]:
    """Twice the area of the triangle: positive where the point is to the left of the way from start to end."""
    along, away = end - start, point - start
    return along[..., 0] * away[..., 1] - along[..., 1] * away[..., 0]
