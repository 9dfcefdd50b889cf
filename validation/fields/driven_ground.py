"""Free plans driven in closed loop: every corner of body and tool, by the true pose, stays on the ground declared safe.

Some of the plans have sides without room or keep-outs, so that turns pass walls at the plan's clearance.
"""

from typing import NamedTuple

import jax
import jax.numpy as jnp
import numpy as np
import shapely
from jaxtyping import Float

from lgprjax.autopilot.fence import fence_of_ground
from lgprjax.autopilot.skid_step import skid_setup
from lgprjax.coverage import (
    Outline,
    Pattern,
    PatternSettings,
    SafeGround,
    Tool,
    field_of_polygon,
    ground_of_sides,
    lay_pattern,
    outline_of,
)
from lgprjax.coverage.ground import rectangles
from lgprjax.coverage.pattern import driving_time_s
from lgprjax.coverage.tour import plan_tour
from lgprjax.navigation.skid_model import cautious_skid_model, default_skid_model
from lgprjax.simulation.field_loop import FieldLoopSpec, made_up_field_world, run_fields
from lgprjax.vehicle.kinematics import SkidSteer

_SPEED_MPS = 0.45
_GNSS_X_M = 0.2


class Driven(NamedTuple):
    """Drives of one plan.

    Attributes:
        least_m: of each lane, distance between the border of the ground and the nearest corner of body and tool while
            the computer drove; negative outside.
        share: of the way that was driven; 1 where the plan was driven to its end.
        edge: the vehicle stopped because a stop would have crossed the fence.
    """

    least_m: Float[np.ndarray, " lane"]
    share: Float[np.ndarray, " lane"]
    edge: np.ndarray

    def told(self) -> str:
        """One line."""
        return f"within {self.least_m} m, driven {self.share}, stopped at an edge {self.edge}"


class Flail(NamedTuple):
    """A vehicle as the planner and the world know it."""

    tool: Tool
    outline: Outline
    radius_m: float
    track_m: float


FLAIL = Flail(
    Tool(1.2, 0.3, 1.2, 0.0),
    outline_of(Tool(1.2, 0.3, 1.2, 0.0), Outline(1.4, -0.5, 0.65, -0.65), track_m=1.1),
    1.5,
    1.1,
)


def driven(pattern: Pattern, ground: SafeGround, flail: Flail, *, lanes: int, base_m: float | None = None) -> Driven:
    """Drives of a plan, by the filter's own laws or by others with a base that is off by so much at most."""
    one = jnp.float32
    world = made_up_field_world(set_speed_mps=_SPEED_MPS)
    model = default_skid_model if base_m is None else cautious_skid_model
    setup = skid_setup(
        SkidSteer(one(flail.track_m), one(0.9), one(0.8), one(flail.radius_m)),
        flail.tool,
        model(track_m=flail.track_m, gnss_x_m=_GNSS_X_M, gnss_y_m=0.0),
        depth_m=0.15,
        deepest_m=0.3,
        outline=flail.outline,
    )
    world = world._replace(
        setup=setup,
        plant=world.plant._replace(track_m=one(flail.track_m)),
        largest_base_m=None if base_m is None else one(base_m),
    )
    route = lay_pattern(pattern)
    cusps = sum(int(np.count_nonzero(np.diff(np.sign(turn.pieces[:, 0])))) + 1 for turn in pattern.turns)
    moments = int(10.0 * (1.1 * driving_time_s(pattern, _SPEED_MPS) + 3.0 * cusps + 50.0))
    keys = jax.random.split(jax.random.key(1), lanes)
    kept = run_fields(FieldLoopSpec(moments=moments), world, route, fence_of_ground(ground), keys)
    kept = jax.tree.map(np.asarray, kept)
    shape = ground.shape
    border = shape.boundary
    shapely.prepare(shape)
    found = []
    for lane in range(lanes):
        drives = kept.engaged[:, lane] & ~kept.done[:, lane]
        assert drives.any()
        poses = np.stack([kept.x_m[drives, lane], kept.y_m[drives, lane], kept.yaw_rad[drives, lane]], axis=1)
        corners = rectangles(poses.astype(np.float64), flail.outline).reshape(-1, 2)
        sides = np.where(shapely.contains_xy(shape, *corners.T), 1.0, -1.0)
        least_m = float(np.min(sides * shapely.distance(border, shapely.points(corners))))
        share = 1.0 - float(kept.to_go_m[drives, lane][-1]) / float(route.length_m)
        found.append((least_m, 1.0 if kept.done[-1, lane] else share, bool(kept.edge[:, lane].any())))
    return Driven(*(np.array(each) for each in zip(*found, strict=True)))


def box(length_m: float, width_m: float) -> tuple[Pattern, SafeGround]:
    """A rectangle of which two sides have no room outside."""
    corners = np.array([[0.0, 0.0], [length_m, 0.0], [length_m, width_m], [0.0, width_m]])
    field = field_of_polygon(corners, name="box")
    ground = ground_of_sides(field.perimeter_m, [0.0, 0.0, 6.0, 6.0], (), 0.25)
    settings = PatternSettings(FLAIL.tool.width_m, 0.2, "free", FLAIL.radius_m, 6.0, FLAIL.tool.ahead_m)
    return plan_tour(field, ground, (), settings, FLAIL.tool, FLAIL.outline, name="box").pattern, ground
