"""The plan view of a drive: along the road with a stated cross exaggeration, or on the map if the road bends."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.axes import Axes
from matplotlib.collections import PathCollection

from lgprjax.report.results import DriveResult
from lgprjax.report.style import BLUE, ERROR_MAP, INK, MUTED, exaggeration

# A road that leaves its axis by less than this share of its length is drawn along that axis.
_STRAIGHT = 0.15
_LEAST_HALF_WIDTH_M = 1.0
# White is error 0: it needs a ground that is not white.
_GROUND = "#cfcfcf"


@dataclass(frozen=True)
class PlanFrame:
    """Axes of the plan: a rotation about a point, and whether the picture may stretch across.

    Attributes:
        centre: east_m, north_m of the plan's zero.
        yaw_rad: of the plan's first axis, counter-clockwise from east; 0 on the map.
        along_road: the first axis follows the road.
    """

    centre: tuple[float, float]
    yaw_rad: float
    along_road: bool

    def __call__(
        self, east_m: Float[np.ndarray, " point"], north_m: Float[np.ndarray, " point"]
    ) -> tuple[Float[np.ndarray, " point"], Float[np.ndarray, " point"]]:
        """East and north to the plan's own axes, in metres."""
        cos, sin = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        east, north = east_m - self.centre[0], north_m - self.centre[1]
        return cos * east + sin * north, cos * north - sin * east


def reference_track(result: DriveResult) -> Float[np.ndarray, "scan 2"]:
    """East and north of the truth where it is known, else of the prior."""
    if result.truth_east_m is not None and result.truth_north_m is not None:
        return np.stack([result.truth_east_m, result.truth_north_m], axis=1)
    return np.stack([result.prior_east_m, result.prior_north_m], axis=1)


def plan_frame(track: Float[np.ndarray, "scan 2"]) -> PlanFrame:
    """Follow a straight road from its start; leave anything else on the map."""
    track = track[np.isfinite(track).all(axis=1)]
    if len(track) < 2:
        return PlanFrame((0.0, 0.0), 0.0, along_road=False)
    # The principal axis, not the line from first to last point: a prior's ends wander.
    middle = track.mean(axis=0)
    axis = np.linalg.svd(track - middle, full_matrices=False)[2][0]
    way = axis if axis @ (track[-1] - track[0]) >= 0.0 else -axis
    start = middle + way * ((track[0] - middle) @ way)
    frame = PlanFrame((float(start[0]), float(start[1])), float(np.arctan2(way[1], way[0])), along_road=True)
    along, cross = frame(track[:, 0], track[:, 1])
    if np.ptp(along) == 0.0 or np.ptp(cross) > _STRAIGHT * np.ptp(along):
        return PlanFrame((0.0, 0.0), 0.0, along_road=False)
    return frame


def draw_plan(
    axes: Axes, result: DriveResult, frame: PlanFrame, error_m: Float[np.ndarray, " scan"], limit_m: float
) -> PathCollection:
    """Draw baselines, truth, prior and the fixes coloured by ``error_m``; return the fixes for the colour bar."""
    axes.set_facecolor(_GROUND)
    for number, track in enumerate(result.baseline_tracks):
        label = "baseline drives" if number == 0 else "_"
        axes.plot(*frame(track[:, 0], track[:, 1]), color="white", linewidth=2.5, label=label, zorder=1)
    drawn = [frame(result.prior_east_m, result.prior_north_m)]
    axes.plot(*drawn[0], color=BLUE, linewidth=1.2, linestyle=(0, (3, 2)), label="prior", zorder=2)
    if result.truth_east_m is not None and result.truth_north_m is not None:
        drawn.append(frame(result.truth_east_m, result.truth_north_m))
        # Stretched, fixes stand beside the truth and would hide it; on a map they lie on it, and it would hide them.
        over = 5.0 if frame.along_road else 3.0
        axes.plot(*drawn[1], color=INK, linewidth=0.9, label="truth", zorder=over)
    declined = result.tried & ~result.ok
    if declined.any():
        place = frame(result.prior_east_m[declined], result.prior_north_m[declined])
        axes.plot(*place, "x", color=MUTED, markersize=4, mew=1.0, label="declined (at the prior)", zorder=2.5)
    fixes = frame(result.east_m[result.ok], result.north_m[result.ok])
    drawn.append(fixes)
    points = axes.scatter(
        *fixes, c=error_m[result.ok], s=16, cmap=ERROR_MAP, vmin=-limit_m, vmax=limit_m, linewidth=0, zorder=4
    )
    if result.ok.any():
        axes.plot([], [], "o", color=colormaps[ERROR_MAP](0.85), markersize=5, label="ok fixes, coloured by error")
    _set_limits(axes, frame, drawn)
    axes.legend(
        loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=5, facecolor=_GROUND, framealpha=1.0, edgecolor="none"
    )
    return points


def name_axes(axes: Axes, result: DriveResult, frame: PlanFrame) -> str:
    """Label the axes, once the layout stands; return the sentence that the caption needs."""
    anchor = f"{result.origin[0]:.6f}°, {result.origin[1]:.6f}°"
    if not frame.along_road:
        axes.set_xlabel("east (m)")
        axes.set_ylabel("north (m)")
        return f"Plan: metres about latitude, longitude {anchor}; equal aspect."
    bearing = np.degrees(np.pi / 2.0 - frame.yaw_rad) % 360.0
    axes.set_xlabel(f"along the road (m), towards {bearing:.0f}°")
    axes.set_ylabel("left (m)")
    return (
        f"Plan: along and left of the road from east {frame.centre[0]:.2f} m, north {frame.centre[1]:.2f} m about "
        f"latitude, longitude {anchor}; across drawn ×{exaggeration(axes):.1f}."
    )


def _set_limits(
    axes: Axes, frame: PlanFrame, drawn: list[tuple[Float[np.ndarray, " _"], Float[np.ndarray, " _"]]]
) -> None:
    """Frame the drive, not the map: baselines may run on for kilometres."""
    along = np.concatenate([x for x, _ in drawn])
    cross = np.concatenate([y for _, y in drawn])
    for values, setter in ((along, axes.set_xlim), (cross, axes.set_ylim)):
        finite = values[np.isfinite(values)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 0.0)
        half = max(0.5 * (high - low) * 1.08, _LEAST_HALF_WIDTH_M)
        # auto: an equal aspect may widen what is set here.
        setter(0.5 * (low + high) - half, 0.5 * (low + high) + half, auto=not frame.along_road)
    if not frame.along_road:
        axes.set_aspect("equal", adjustable="datalim")
