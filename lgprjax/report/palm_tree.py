"""The palm tree: one branch a setting of the steering, its positions and the arc fitted to them."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.cm import ScalarMappable
from matplotlib.collections import LineCollection
from matplotlib.colors import ListedColormap, Normalize

from lgprjax.report.style import INK, picture, write_caption

# The lightest tenth of the map cannot be told from the paper.
_ANGLE_MAP = ListedColormap(colormaps["viridis"](np.linspace(0.0, 0.9, 256)), name="steering")
_LABELS_PER_SIDE = 5
_OUTLIER_SCALES = 4.0


@dataclass(frozen=True)
class Branch:
    """One stretch of constant steering.

    Attributes:
        east_m, north_m: fixes of the rear axle, in the order of driving, finite.
        way_m: along the path at each fix, forward positive.
        curvature_radpm: fitted, of the rear axle's path; a left turn is positive, in reverse too.
        front_rad: front wheel angle that the fit gives.
    """

    east_m: Float[np.ndarray, " fix"]
    north_m: Float[np.ndarray, " fix"]
    way_m: Float[np.ndarray, " fix"]
    curvature_radpm: float
    front_rad: float


def draw_palm_tree(
    branches: list[Branch], path: str | Path, *, dropped: dict[str, int] | None = None, force: bool = False
) -> None:
    """Draw branches coloured by front wheel angle, with the fitted arcs, on a map of equal aspect.

    Args:
        branches: one or more.
        path: the PNG.
        dropped: stretches that were left out of the fit, by reason, for the caption.
        force: replace a file that exists.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    front_deg = np.degrees([branch.front_rad for branch in branches])
    scale = Normalize(*_span(float(front_deg.min()), float(front_deg.max())))
    fitted = [lay_arc(branch) for branch in branches]
    scatter_m = np.concatenate(
        [_misses(branch, arc) for branch, arc in zip(branches, fitted, strict=True)], dtype=np.float64
    )
    common = np.median([arc[0] for arc in fitted], axis=0)
    with picture(path, 7.6, 7.4, force) as figure:
        axes = figure.subplots()
        for branch, angle in zip(branches, front_deg, strict=True):
            axes.plot(branch.east_m, branch.north_m, ".", color=_ANGLE_MAP(scale(angle)), markersize=4.5, zorder=1)
        axes.add_collection(LineCollection([arc.tolist() for arc in fitted], colors=INK, linewidths=0.8, zorder=2))
        for index in _labelled(front_deg):
            end, onward = _tip(fitted[index], common)
            axes.annotate(
                f"{front_deg[index]:+.0f}°".replace("+0°", "0°").replace("-0°", "0°"),
                (float(end[0]), float(end[1])),
                textcoords="offset points",
                xytext=(float(12.0 * onward[0]), float(12.0 * onward[1])),
                fontsize=9.0,
                color=INK,
                ha="center",
                va="center",
            )
        axes.plot([], [], ".", color=_ANGLE_MAP(0.5), markersize=7, label="rear axle, positions")
        axes.plot([], [], color=INK, linewidth=0.8, label="fitted arcs")
        axes.legend(loc="best")
        figure.colorbar(
            ScalarMappable(scale, _ANGLE_MAP), ax=axes, label="front wheel angle by the fit (degrees)", shrink=0.8
        )
        axes.set_aspect("equal", adjustable="datalim")
        axes.set_xlabel("east (m)")
        axes.set_ylabel("north (m)")
        figure.suptitle(f"Palm tree: {len(branches)} stretches, {front_deg.min():+.1f}° to {front_deg.max():+.1f}°")
        left_out = ", ".join(f"{count} {why}" for why, count in (dropped or {}).items()) or "none"
        write_caption(
            figure,
            f"Each stretch of constant steering and the arc of its fitted curvature; median distance of a position "
            f"from its arc {100.0 * np.median(scatter_m):.1f} cm. Stretches left out: {left_out}.",
        )


def lay_arc(branch: Branch) -> Float[np.ndarray, "fix 2"]:
    """East and north of the arc of a branch's curvature, laid onto its positions by the best turn and shift."""
    way = branch.way_m - np.mean(branch.way_m)
    turned = branch.curvature_radpm * way
    # Chord of an arc from its middle, without dividing by the curvature.
    half = 0.5 * turned
    chord = way * np.sinc(half / np.pi)
    shape = np.stack([chord * np.cos(half), chord * np.sin(half)], axis=1)
    place = np.stack([branch.east_m, branch.north_m], axis=1)
    kept = np.ones(len(way), dtype=bool)
    arc = shape
    for _ in range(4):
        middle, centre = shape[kept].mean(axis=0), place[kept].mean(axis=0)
        cross = (shape[kept] - middle).T @ (place[kept] - centre)
        angle = np.arctan2(cross[0, 1] - cross[1, 0], cross[0, 0] + cross[1, 1])
        turn = np.array([[np.cos(angle), np.sin(angle)], [-np.sin(angle), np.cos(angle)]])
        arc = (shape - middle) @ turn + centre
        away = np.hypot(*(place - arc).T)
        # A position that is metres off must not pull the picture along.
        kept = away <= _OUTLIER_SCALES * max(1.4826 * float(np.median(away)), 1e-9)
    return np.asarray(arc)


def _tip(
    arc: Float[np.ndarray, "fix 2"], common: Float[np.ndarray, "2"]
) -> tuple[Float[np.ndarray, "2"], Float[np.ndarray, "2"]]:
    """End of an arc that lies farther from where branches begin, and the direction in which it would go on."""
    outward = arc if np.hypot(*(arc[-1] - common)) >= np.hypot(*(arc[0] - common)) else arc[::-1]
    onward = outward[-1] - outward[-1 - max(len(arc) // 5, 1)]
    return outward[-1], onward / max(float(np.hypot(*onward)), 1e-12)


def _misses(branch: Branch, arc: Float[np.ndarray, "fix 2"]) -> Float[np.ndarray, " fix"]:
    """Distance of each position from the arc, across it: the odometer's scale is not the arc's fault."""
    direction = np.gradient(arc, axis=0)
    direction /= np.maximum(np.hypot(*direction.T), 1e-12)[:, None]
    east, north = branch.east_m - arc[:, 0], branch.north_m - arc[:, 1]
    return np.asarray(np.abs(direction[:, 0] * north - direction[:, 1] * east))


def _labelled(front_deg: Float[np.ndarray, " branch"]) -> list[int]:
    """Branches to write the angle beside: the outermost, the straightest and some between, once an angle."""
    distinct = np.unique(np.round(front_deg, 0), return_index=True)[1]
    distinct = distinct[np.argsort(front_deg[distinct])]
    picked = np.unique(np.linspace(0, len(distinct) - 1, 2 * _LABELS_PER_SIDE + 1).round().astype(int))
    return [int(distinct[number]) for number in picked]


def _span(low: float, high: float) -> tuple[float, float]:
    return (low, high) if high > low else (low - 1.0, high + 1.0)
