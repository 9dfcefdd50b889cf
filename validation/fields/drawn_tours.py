"""Plans of drawn fields, held against their ground."""

import numpy as np
import shapely
from jaxtyping import Float

from lgprjax.coverage import Outline, Pattern, check_drivable, lay_pattern
from lgprjax.coverage.ground import pose_on_line
from lgprjax.coverage.tour import plan_tour
from lgprjax.coverage.turns import poses_along
from validation.fields.random_fields import DrawnField


def corners_driven(pattern: Pattern, outline: Outline) -> Float[np.ndarray, "place 2"]:
    """Corners of the vehicle at every row of the route that is driven on board, by plain trigonometry."""
    route = lay_pattern(pattern)
    rows = np.asarray(route.rows, np.float64)[: int(route.count)]
    gears = np.ones(len(rows)) if route.legs is None else np.asarray(route.legs)[: len(rows), 0]
    yaw = rows[:, 2] + np.where(gears < 0.0, np.pi, 0.0)
    ahead, left = np.stack([np.cos(yaw), np.sin(yaw)], axis=1), np.stack([-np.sin(yaw), np.cos(yaw)], axis=1)
    ends = [(x, y) for x in (outline.front_m, outline.rear_m) for y in (outline.left_m, outline.right_m)]
    return np.concatenate([rows[:, :2] + x * ahead + y * left for x, y in ends])


def check_drawn(drawn: DrawnField, seed: int) -> list[Float[np.ndarray, "2 2"]]:
    """Lines of the plan of a drawn field; nothing is outside the ground."""
    tour = plan_tour(
        drawn.field, drawn.ground, drawn.keep_outs_m, drawn.settings, drawn.tool, drawn.outline, name=f"seed {seed}"
    )
    check_drivable(tour.pattern, drawn.ground, drawn.outline, name=f"seed {seed}")
    assert shapely.contains_xy(drawn.ground.shape, *corners_driven(tour.pattern, drawn.outline).T).all()
    for turn, line in zip(tour.pattern.turns, tour.pattern.lines[1:], strict=True):
        end = poses_along(turn.start, turn.pieces, np.array([turn.length_m]))[0]
        begin = pose_on_line(line, drawn.settings.tool_ahead_m, drawn.settings.tool_left_m)
        assert np.hypot(*(end - begin)[:2]) < 1e-6
    return [np.stack([line.start_m, line.end_m]) for line in tour.pattern.lines]
