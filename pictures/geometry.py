"""Diagrams of geometry: the ground under the array, frames, vehicles, arrays and swaths."""

from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes
from matplotlib.patches import Arc, Circle, Rectangle

from pictures.style import (
    BLUE,
    GAP,
    GREEN,
    INK,
    LARGE,
    MUTED,
    ORANGE,
    SKY,
    VERMILLION,
    arrow,
    diagram,
    dimension,
    label,
    shape,
    tint,
)

_SEED = 7


def draw_how_it_works(path: Path) -> None:
    """Draw a vehicle above strata, its live radargram, the map of the same ground, and the match."""
    with diagram(path, 104.0) as axes:
        label(axes, (2, 101), "1  A radar array scans the ground", align="left", size=LARGE, bold=True)
        _ground(axes)
        label(axes, (2, 46), "2  The live scan is matched to the map", align="left", size=LARGE, bold=True)
        _match(axes)


def _layer(x: np.ndarray, depth: float, phase: float, size: float = 1.6) -> np.ndarray:
    return depth + size * np.sin(x / 9.0 + phase) + 0.5 * size * np.sin(x / 4.1 + 2.0 * phase)


_DEPTHS = ((77.0, 0.3, "#e9dcc3"), (69.0, 1.7, "#d9c49c"), (61.0, 4.0, "#c3a878"))


def _ground(axes: Axes) -> None:
    x = np.linspace(0.0, 100.0, 300)
    top = 82.0
    axes.fill_between(x, 52.0, top, color="#b59566", linewidth=0)
    bounds = [np.full_like(x, top)] + [_layer(x, depth, phase) for depth, phase, _ in _DEPTHS]
    for (above, below), (_, _, colour) in zip(pairwise(bounds), _DEPTHS, strict=True):
        axes.fill_between(x, below, above, color=colour, linewidth=0)
        axes.plot(x, below, color="#8a6d3f", linewidth=1.6)
    rng = np.random.default_rng(_SEED)
    for _ in range(16):
        at = (rng.uniform(2.0, 98.0), rng.uniform(55.0, 78.0))
        axes.add_patch(Circle(at, rng.uniform(0.6, 1.4), facecolor="#8f8f8f", edgecolor=INK, linewidth=0.8))
    axes.plot([0, 100], [top, top], color=INK, linewidth=2.0)
    body = np.array([[29, 86.5], [29, 93], [44, 93], [48, 97.5], [59, 97.5], [59, 86.5]])
    shape(axes, body, colour=tint(BLUE, 0.5))
    for wheel in (34.5, 54.0):
        axes.add_patch(Circle((wheel, 85.0), 3.0, facecolor=INK, edgecolor="white", linewidth=2.0))
    axes.add_patch(Rectangle((59.5, 83.6), 13.0, 2.2, facecolor=VERMILLION, edgecolor=INK, linewidth=1.2))
    for number in range(5):
        foot = 61.0 + 2.5 * number
        axes.plot(
            [foot, foot], [83.6, 57.0 + 2.0 * (number % 2)], color=VERMILLION, linewidth=1.5, linestyle=(0, (3, 2))
        )
    label(axes, (74, 90.5), "antenna array", align="left", colour="#9c4400")
    arrow(axes, [(79, 88.4), (73, 85.6)], colour=VERMILLION, width=1.6)
    label(axes, (3, 78.6), "layers and stones hardly change", align="left", background=True)
    label(axes, (98, 54.6), "2 to 3 m deep", align="right", background=True)


def _traces(along: np.ndarray, noise: float, seed: int) -> np.ndarray:
    """A radargram of the drawn layers: a wavelet at the depth of each."""
    depth = np.linspace(54.0, 81.0, 120)[:, None]
    total = np.zeros((120, len(along)))
    for number, (level, phase, _) in enumerate(_DEPTHS):
        off = (depth - _layer(along, level, phase)[None]) / 1.3
        total += (1.0 - 0.5 * number / 3) * (1.0 - 2.0 * off**2) * np.exp(-(off**2))
    rng = np.random.default_rng(seed)
    return np.asarray(total + noise * rng.normal(size=total.shape))


def _match(axes: Axes) -> None:
    stored = np.linspace(0.0, 100.0, 380)
    axes.imshow(
        _traces(stored, 0.12, 1), cmap="gray", vmin=-1.2, vmax=1.2, extent=(2, 98, 2, 15), aspect="auto", origin="lower"
    )
    live = np.linspace(52.0, 78.0, 100)
    where = (52.0, 77.0)
    axes.imshow(
        _traces(live, 0.3, 2), cmap="gray", vmin=-1.2, vmax=1.2, extent=(*where, 26, 39), aspect="auto", origin="lower"
    )
    for low, high, left, right, colour in (
        (2, 15, 2, 98, ORANGE),
        (26, 39, *where, VERMILLION),
        (2, 15, *where, GREEN),
    ):
        axes.add_patch(Rectangle((left, low), right - left, high - low, fill=False, edgecolor=colour, linewidth=3.0))
    for x in where:
        axes.plot([x, x], [15, 26], color=GREEN, linewidth=2.4, linestyle=(0, (4, 2)))
    label(axes, (49, 35), "live scans", align="right")
    label(axes, (2, 18.5), "map: recorded earlier", align="left")
    label(axes, (64.5, 20.5), "best match", background=True)
    label(axes, (80, 35), "= position", align="left", bold=True)
    label(axes, (80, 30.5), "no match:", align="left")
    label(axes, (80, 26.6), "rejected", align="left")
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(0.0, 104.0)


def draw_coordinate_frames(path: Path) -> None:
    """Draw the map's frame and the vehicle's, with heading and yaw."""
    with diagram(path, 84.0) as axes:
        origin = (14.0, 14.0)
        arrow(axes, [origin, (92, 14)], colour=BLUE)
        arrow(axes, [origin, (14, 80)], colour=BLUE)
        label(axes, (84, 9.5), "x: east (m)", colour=BLUE)
        label(axes, (16.5, 79), "y: north (m)", colour=BLUE, align="left")
        axes.add_patch(Circle(origin, 1.3, facecolor=BLUE))
        label(axes, (16, 8.5), "anchor: latitude,", align="left")
        label(axes, (16, 4.4), "longitude", align="left")
        centre, yaw = np.array([45.0, 36.0]), np.radians(35.0)
        forward, left = np.array([np.cos(yaw), np.sin(yaw)]), np.array([-np.sin(yaw), np.cos(yaw)])
        corners = [centre + a * forward + b * left for a, b in ((-4, -6), (-4, 6), (20, 6), (20, -6))]
        shape(axes, np.array(corners), colour=tint(MUTED, 0.25), edge=MUTED)
        nose, side = centre + 38 * forward, centre + 24 * left
        arrow(axes, [tuple(centre), tuple(nose)], colour=VERMILLION)
        arrow(axes, [tuple(centre), tuple(side)], colour=VERMILLION)
        label(axes, (float(nose[0]) + 1.0, float(nose[1]) + 3.5), "x: forward", colour="#9c4400")
        label(axes, (float(side[0]) - 1.0, float(side[1]) + 3.0), "y: left", colour="#9c4400")
        axes.add_patch(Circle(tuple(centre), 1.3, facecolor=VERMILLION))
        label(axes, (43, 29.5), "rear axle", align="right")
        axes.plot([45, 81], [36, 36], color=MUTED, linewidth=1.4, linestyle=(0, (4, 2)))
        axes.plot([45, 45], [36, 74], color=MUTED, linewidth=1.4, linestyle=(0, (4, 2)))
        axes.add_patch(Arc(tuple(centre), 60, 60, theta1=0.0, theta2=35.0, color=INK, linewidth=2.2))
        axes.add_patch(Arc(tuple(centre), 64, 64, theta1=35.0, theta2=90.0, color=GREEN, linewidth=2.2))
        label(axes, (84, 44), "yaw:", background=True)
        label(axes, (84, 40), "from east", background=True)
        label(axes, (63, 72.5), "heading: from north", colour="#00684c", background=True)
        label(axes, (98, 28), "up: z, ellipsoidal height", align="right")


def _wheel(axes: Axes, at: tuple[float, float], angle_deg: float, size: float = 9.0) -> None:
    half, width = 0.5 * size, 1.5
    cos, sin = np.cos(np.radians(angle_deg)), np.sin(np.radians(angle_deg))
    turn = np.array([[cos, -sin], [sin, cos]])
    corners = np.array([[-half, -width], [half, -width], [half, width], [-half, width]]) @ turn.T + at
    shape(axes, corners, colour=INK, edge=INK, width=0.5)


def draw_vehicle_geometry(path: Path) -> None:
    """Draw a counter-steer vehicle as a bicycle model: front wheels by phi, rear wheels by minus k phi."""
    with diagram(path, 84.0) as axes:
        rear, front, anchor = np.array([18.0, 62.0]), np.array([62.0, 62.0]), np.array([86.0, 62.0])
        phi = 22.0
        k = 0.63
        length = front[0] - rear[0]
        drop = length / (np.tan(np.radians(phi)) + np.tan(np.radians(k * phi)))
        back = drop * np.tan(np.radians(k * phi))
        # A turn to the right: the centre lies below.
        centre = np.array([rear[0] + back, rear[1] - drop * 0.52])
        axes.plot(*np.array([rear, anchor]).T, color=INK, linewidth=3.0)
        angles = [np.degrees(np.arctan2(*(point - centre)[[0, 1]])) for point in (rear, front)]
        for point, angle in zip((rear, front), angles, strict=True):
            _wheel(axes, (point[0], point[1]), -angle, 12.0)
            axes.plot(*np.array([point, centre]).T, color=MUTED, linewidth=1.6, linestyle=(0, (4, 2)))
            axes.plot([point[0] - 9, point[0] + 9], [62, 62], color=INK, linewidth=1.2, linestyle=":")
        axes.plot([centre[0], centre[0]], [centre[1], 62], color=BLUE, linewidth=1.6, linestyle=(0, (2, 2)))
        axes.add_patch(Circle(tuple(centre), 1.4, facecolor=BLUE))
        label(axes, (float(centre[0]) + 3, float(centre[1]) - 1), "turn centre", align="left", colour=BLUE)
        axes.add_patch(Circle(tuple(anchor), 1.6, facecolor=VERMILLION, zorder=5))
        axes.add_patch(Rectangle((84.6, 52), 2.8, 20, facecolor=VERMILLION, edgecolor=INK, alpha=0.6))
        label(axes, (98, 79.5), "anchor: array centre", align="right", colour="#9c4400")
        label(axes, (62, 73), "front: φ", bold=True)
        label(axes, (18, 73), "rear: −k φ", bold=True)
        goal = (96.0, 38.0)
        arrow(axes, [tuple(anchor), goal], colour=GREEN)
        label(axes, (99, 33.5), "goal point", align="right", colour="#00684c")
        label(axes, (87.5, 47.5), "distance D,", align="right", colour="#00684c")
        label(axes, (89, 43.3), "bearing η", align="right", colour="#00684c")
        for x in (18.0, 62.0, 86.0):
            axes.plot([x, x], [9, 52], color=GAP, linewidth=1.2, zorder=0)
        dimension(axes, (18, 19), (62, 19), "wheelbase L", (30, 22.5))
        dimension(axes, (18, 11), (86, 11), "anchor l, ahead of the rear axle", (52, 7))


def draw_skid_geometry(path: Path) -> None:
    """Draw a skid-steer vehicle: track speeds, track width, turn centre and tool."""
    with diagram(path, 82.0) as axes:
        for y in (48.0, 70.0):
            axes.add_patch(Rectangle((30, y - 4), 34, 8, facecolor=INK, edgecolor=INK))
        axes.add_patch(Rectangle((34, 52.5), 26, 13, facecolor=tint(MUTED, 0.3), edgecolor=MUTED, linewidth=2.0))
        axes.add_patch(Rectangle((72, 43), 6, 32, facecolor=tint(ORANGE, 0.5), edgecolor=ORANGE, linewidth=2.0))
        axes.plot([60, 72], [59, 59], color=MUTED, linewidth=4.0)
        axes.add_patch(Circle((47, 59), 1.5, facecolor=VERMILLION, zorder=5))
        axes.plot([47, 47], [20, 59], color=MUTED, linewidth=1.6, linestyle=(0, (4, 2)))
        axes.add_patch(Circle((47, 20), 1.5, facecolor=BLUE))
        label(axes, (50, 20), "turn centre", align="left", colour=BLUE)
        axes.add_patch(
            Arc((47, 20), 78, 78, theta1=70.0, theta2=110.0, color=VERMILLION, linewidth=2.4, linestyle="--")
        )
        arrow(axes, [(66, 70), (69.5, 70)], colour=GREEN)
        label(axes, (47, 77.8), "left track: speed v_l", colour="#00684c")
        label(axes, (47, 39.8), "right track: speed v_r", colour="#00684c", background=True)
        dimension(axes, (20, 48), (20, 70), "track\nwidth w", (11, 59))
        for y in (48, 70):
            axes.plot([18, 30], [y, y], color=MUTED, linewidth=1.0)
        label(axes, (75, 78.5), "tool", bold=True)
        dimension(axes, (82.5, 43), (82.5, 75), "width", (91, 59))
        label(axes, (26, 12), "yaw rate = (v_r − v_l) / w", align="left", bold=True)
        label(axes, (26, 6.5), "speed = (v_l + v_r) / 2", align="left", bold=True)
        label(axes, (44.5, 62.5), "origin", align="right")


def draw_array_layout(path: Path) -> None:
    """Draw an array of eleven channels under a vehicle, seen from above and from behind."""
    with diagram(path, 86.0) as axes:
        label(axes, (2, 82.5), "From above", align="left", size=LARGE, bold=True)
        axes.add_patch(Rectangle((6, 44), 46, 30, facecolor=tint(MUTED, 0.2), edgecolor=MUTED, linewidth=2.0))
        axes.add_patch(Rectangle((64, 39), 7, 40, facecolor=tint(VERMILLION), edgecolor=VERMILLION, linewidth=2.0))
        for number in range(11):
            axes.add_patch(Circle((67.5, 76.5 - 3.5 * number), 1.2, facecolor=VERMILLION, edgecolor=INK, linewidth=0.8))
        axes.plot([6, 67.5], [59, 59], color=MUTED, linewidth=1.2, linestyle=(0, (4, 2)))
        axes.add_patch(Circle((13, 59), 1.4, facecolor=BLUE))
        label(axes, (15, 64), "rear axle", align="left", colour=BLUE)
        arrow(axes, [(13, 59), (27, 59)], colour=BLUE)
        label(axes, (28, 55.5), "x forward", align="left", colour=BLUE)
        arrow(axes, [(13, 59), (13, 72)], colour=BLUE)
        label(axes, (15, 70.5), "y left", align="left", colour=BLUE)
        label(axes, (74, 76.5), "channel 0", align="left")
        label(axes, (74, 41.5), "channel 10", align="left")
        dimension(axes, (74.5, 59), (74.5, 55.5), "", (0, 0))
        label(axes, (77, 57.3), "spacing", align="left")
        dimension(axes, (13, 47.5), (67.5, 47.5), "array ahead of the axle", (36, 47.5))
        label(axes, (2, 32), "From behind", align="left", size=LARGE, bold=True)
        axes.plot([4, 96], [8, 8], color=INK, linewidth=2.0)
        axes.fill_between([4, 96], [2, 2], [8, 8], color="#e9dcc3", linewidth=0)
        base, slope = np.array([18.0, 24.0]), -0.13
        for number in range(11):
            x = base[0] + 5.5 * number
            y = base[1] + slope * (x - base[0])
            axes.add_patch(Circle((x, y), 1.3, facecolor=VERMILLION, edgecolor=INK, linewidth=0.8))
            axes.plot([x, x], [y - 1.4, 8], color=VERMILLION, linewidth=1.0, linestyle=(0, (3, 2)))
        axes.plot([14, 77], [24.5, 24.5 + slope * 63 - 0.3], color=MUTED, linewidth=1.2, zorder=0)
        dimension(axes, (45.5, 20.2), (45.5, 8.2), "height h", (45.5, 14.5))
        label(axes, (80, 20), "roll: right", align="left")
        label(axes, (80, 15.8), "side down", align="left")
        label(axes, (50, 4.4), "delay of each trace: 6.67 ns for each metre in air")


def draw_swath_geometry(path: Path) -> None:
    """Draw neighbouring swaths with overlap, a headland turn, and the tool's width less its uncertainty."""
    with diagram(path, 86.0) as axes:
        axes.add_patch(Rectangle((10, 12), 62, 66, fill=False, edgecolor=INK, linewidth=2.4))
        label(axes, (12, 81.5), "perimeter of the field", align="left")
        width, pitch = 17.0, 14.0
        for number in range(3):
            y = 20.0 + pitch * number
            axes.add_patch(
                Rectangle((10, y - 0.5 * width), 62, width, facecolor=SKY, alpha=0.30, edgecolor=BLUE, linewidth=1.6)
            )
            ends = ((12, y), (70, y)) if number % 2 == 0 else ((70, y), (12, y))
            arrow(axes, list(ends), colour=BLUE)
            label(axes, (22, y + 3.6), f"swath {number + 1}")
        axes.add_patch(Arc((72, 27), 20, pitch, theta1=-90.0, theta2=90.0, color=MUTED, linewidth=2.4))
        label(axes, (83.5, 27), "turn", align="left")
        dimension(axes, (50, 11.5), (50, 28.5), "tool\nwidth", (58, 15.3))
        dimension(axes, (40, 20.3), (40, 33.7), "", (0, 0))
        label(axes, (38.5, 28), "spacing", align="right")
        for y in (25.5, 39.5):
            axes.add_patch(Rectangle((10, y), 62, 3.0, facecolor=VERMILLION, alpha=0.45, linewidth=0))
        arrow(axes, [(76, 48), (71, 41.5)], colour=VERMILLION, width=1.8)
        label(axes, (75, 51), "overlap", align="left", colour="#9c4400")
        axes.add_patch(Rectangle((14, 61), 6, width - 2, facecolor=tint(ORANGE, 0.5), edgecolor=ORANGE, linewidth=2.0))
        axes.add_patch(Rectangle((14, 64.5), 6, width - 9, facecolor=GREEN, edgecolor=INK, linewidth=1.2))
        label(axes, (23, 71), "worked to 95 %:", align="left")
        label(axes, (23, 66.6), "narrower than the tool", align="left", colour="#00684c")
        label(axes, (10, 5.5), "spacing = tool width less overlap", align="left", bold=True)
