"""The tool that works the ground: its rectangle, and what is told of it ten times a second."""

from typing import NamedTuple

import jax.numpy as jnp
from jaxtyping import Array, Bool, Float


class Tool(NamedTuple):
    """The rectangle in which the tool works, in body axes. Plain numbers: they decide sizes of programs.

    Attributes:
        width_m: across the vehicle.
        length_m: along it. Where the tool moves farther than this between two moments, nothing is claimed between.
        ahead_m, left_m: of its centre from the vehicle's reference point.
    """

    width_m: float
    length_m: float
    ahead_m: float
    left_m: float


class ToolMoment(NamedTuple):
    """The vehicle's estimated pose and its tool at one moment; ten of them a second, or a leading axis of time.

    Attributes:
        x_m, y_m: reference point, east and north.
        yaw_rad: of the body, counter-clockwise from east.
        covariance: of x, y (m) and yaw (rad).
        on: told to work, measured to work, at the right depth. A moment that is missing is one that is not on.
    """

    x_m: Float[Array, "..."]
    y_m: Float[Array, "..."]
    yaw_rad: Float[Array, "..."]
    covariance: Float[Array, "... 3 3"]
    on: Bool[Array, "..."]


def tool_centre(
    tool: Tool, x_m: Float[Array, "..."], y_m: Float[Array, "..."], yaw_rad: Float[Array, "..."]
) -> tuple[Float[Array, "..."], Float[Array, "..."]]:
    """East and north of the tool's centre at poses of the reference point."""
    cos, sin = jnp.cos(yaw_rad), jnp.sin(yaw_rad)
    return x_m + cos * tool.ahead_m - sin * tool.left_m, y_m + sin * tool.ahead_m + cos * tool.left_m
