"""Style of the documentation's own pictures: diagrams of boxes and arrows, charts, and files that do not vary.

Diagrams are 780 pixels wide. Shown at 390 pixels their smallest text, ``SMALL``, is still 9 points.
"""

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import FancyArrowPatch, FancyBboxPatch, Polygon
from matplotlib.typing import ColorType

from lgprjax.report.style import BLUE, FAINT, GAP, GREEN, INK, MUTED, ORANGE, PURPLE, SKY, VERMILLION

__all__ = [
    "BLUE",
    "FAINT",
    "GAP",
    "GREEN",
    "INK",
    "LARGE",
    "MUTED",
    "ORANGE",
    "PURPLE",
    "SKY",
    "SMALL",
    "VERMILLION",
    "WIDTH_IN",
    "Box",
    "arrow",
    "box",
    "chart",
    "diagram",
    "dimension",
    "label",
    "mark_figure",
    "mark_simulated",
    "moving_style",
    "save",
    "shape",
    "tint",
]

WIDTH_IN = 8.125
"""Width of a diagram: 780 pixels of 1/96 inch."""
SMALL, LARGE = 18.0, 22.0
_DPI = 120
_LINE = 100.0 * 1.22 / (72.0 * WIDTH_IN)
"""Height of a line of text, in units of a diagram a point of its size."""
_SALT = "lgprjax"
_MARK: dict[str, Any] = {"facecolor": "white", "edgecolor": MUTED, "boxstyle": "round,pad=0.25", "alpha": 0.92}
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": SMALL,
    "axes.titlesize": SMALL,
    "axes.titlelocation": "left",
    "axes.labelsize": SMALL,
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "xtick.labelsize": SMALL,
    "ytick.labelsize": SMALL,
    "legend.fontsize": SMALL,
    "legend.frameon": False,
    "text.color": INK,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
    "svg.hashsalt": _SALT,
    "svg.fonttype": "path",
}


def save(figure: Figure, path: Path) -> None:
    """Write a figure as PNG or SVG, by the name's end, without a date."""
    metadata = {"Date": None} if path.suffix == ".svg" else {"Software": None}
    figure.savefig(path, format=path.suffix[1:], metadata=metadata)


@contextmanager
def diagram(path: Path, height: float) -> Iterator[Axes]:
    """Yield axes 100 wide and ``height`` high, in equal units, origin at the lower left; write the file at the end."""
    with rc_context(_STYLE):
        figure = Figure(figsize=(WIDTH_IN, WIDTH_IN * height / 100.0), dpi=96)
        axes = figure.add_axes((0.0, 0.0, 1.0, 1.0))
        axes.set_axis_off()
        axes.set_xlim(0.0, 100.0)
        axes.set_ylim(0.0, height)
        yield axes
        save(figure, path)


@contextmanager
def chart(path: Path, height_in: float, width_in: float = WIDTH_IN) -> Iterator[Figure]:
    """Yield a figure for charts; write the file at the end."""
    with rc_context(_STYLE):
        figure = Figure(figsize=(width_in, height_in), dpi=_DPI, layout="constrained")
        yield figure
        save(figure, path)


def moving_style() -> dict[Any, Any]:
    """Style of moving pictures, which are 960 pixels wide: letters are larger."""
    sizes = ("font.size", "axes.titlesize", "axes.labelsize", "xtick.labelsize", "ytick.labelsize")
    return _STYLE | dict.fromkeys(sizes, 22.5)


def tint(colour: str, share: float = 0.18) -> tuple[float, float, float]:
    """A colour mixed with white: ``share`` of the colour."""
    channels = [int(colour[at : at + 2], 16) / 255.0 for at in (1, 3, 5)]
    red, green, blue = (1.0 - share * (1.0 - channel) for channel in channels)
    return red, green, blue


@dataclass(frozen=True)
class Box:
    """A box of a diagram: its centre and size."""

    x: float
    y: float
    width: float
    height: float

    @property
    def left(self) -> tuple[float, float]:
        """Middle of the left edge."""
        return self.x - 0.5 * self.width, self.y

    @property
    def right(self) -> tuple[float, float]:
        """Middle of the right edge."""
        return self.x + 0.5 * self.width, self.y

    @property
    def top(self) -> tuple[float, float]:
        """Middle of the upper edge."""
        return self.x, self.y + 0.5 * self.height

    @property
    def bottom(self) -> tuple[float, float]:
        """Middle of the lower edge."""
        return self.x, self.y - 0.5 * self.height


def box(
    axes: Axes,
    at: tuple[float, float],
    size: tuple[float, float],
    title: str,
    text: str = "",
    *,
    colour: str = BLUE,
    dashed: bool = False,
    title_size: float = LARGE,
) -> Box:
    """Draw a box centred at a point: a title in bold, and below it a text."""
    made = Box(*at, *size)
    corner = (made.x - 0.5 * made.width, made.y - 0.5 * made.height)
    axes.add_patch(
        FancyBboxPatch(
            corner,
            *size,
            boxstyle="round,pad=0,rounding_size=1.6",
            facecolor=tint(colour),
            edgecolor=colour,
            linewidth=2.2,
            linestyle=(0, (4, 2)) if dashed else "-",
        )
    )
    title_height = _LINE * title_size * (title.count("\n") + 1)
    text_height = _LINE * SMALL * (text.count("\n") + 1) if text else 0.0
    upper = made.y + 0.5 * text_height
    axes.text(made.x, upper, title, ha="center", va="center", fontsize=title_size, fontweight="bold", linespacing=1.1)
    if text:
        lower = made.y - 0.5 * title_height
        axes.text(made.x, lower, text, ha="center", va="center", fontsize=SMALL, linespacing=1.1)
    return made


def arrow(
    axes: Axes,
    points: Sequence[tuple[float, float]],
    text: str = "",
    *,
    at: tuple[float, float] | None = None,
    colour: str = INK,
    dashed: bool = False,
    width: float = 2.4,
) -> None:
    """Draw a line through points with a head at its end, and a text: at a place, or at the middle of the line."""
    style = (0, (4, 2)) if dashed else "-"
    if len(points) > 2:
        axes.plot(*np.transpose(points[:-1]), color=colour, linewidth=width, linestyle=style, solid_capstyle="butt")
    head = FancyArrowPatch(
        points[-2],
        points[-1],
        arrowstyle="-|>",
        mutation_scale=22.0,
        color=colour,
        linewidth=width,
        linestyle=style,
        shrinkA=0.0,
        shrinkB=0.0,
    )
    axes.add_patch(head)
    if text:
        where = at or (0.5 * (points[0][0] + points[1][0]), 0.5 * (points[0][1] + points[1][1]))
        label(axes, where, text, background=True)


def label(
    axes: Axes,
    at: tuple[float, float],
    text: str,
    *,
    colour: str = INK,
    size: float = SMALL,
    align: str = "center",
    bold: bool = False,
    background: bool = False,
    angle: float = 0.0,
) -> None:
    """Write a text at a point, over a white patch where it crosses lines."""
    patch = {"facecolor": "white", "edgecolor": "none", "pad": 1.5} if background else None
    axes.text(
        *at,
        text,
        ha=align,
        va="center",
        color=colour,
        fontsize=size,
        fontweight="bold" if bold else "normal",
        rotation=angle,
        rotation_mode="anchor",
        linespacing=1.15,
        bbox=patch,
    )


def dimension(
    axes: Axes,
    first: tuple[float, float],
    second: tuple[float, float],
    text: str,
    at: tuple[float, float],
    *,
    colour: str = INK,
    align: str = "center",
) -> None:
    """Draw a measured length with heads at both ends, and its name at a place."""
    axes.add_patch(
        FancyArrowPatch(
            first,
            second,
            arrowstyle="<|-|>",
            mutation_scale=16.0,
            color=colour,
            linewidth=1.6,
            shrinkA=0.0,
            shrinkB=0.0,
        )
    )
    label(axes, at, text, colour=colour, align=align, background=True)


def shape(
    axes: Axes, points: Float[np.ndarray, "point 2"], *, colour: ColorType, edge: str = INK, width: float = 1.8
) -> None:
    """Draw a filled polygon."""
    axes.add_patch(Polygon(points, closed=True, facecolor=colour, edgecolor=edge, linewidth=width))


def mark_simulated(axes: Axes, at: tuple[float, float] = (0.995, 0.985)) -> None:
    """Write "simulated" into axes: the data are from a simulation."""
    axes.text(*at, "simulated", transform=axes.transAxes, ha="right", va="top", fontsize=SMALL, bbox=_MARK, zorder=10)


def mark_figure(figure: Figure) -> None:
    """Write "simulated" above all axes of a figure."""
    figure.suptitle("simulated", x=0.985, ha="right", fontsize=SMALL, fontweight="normal", bbox=_MARK)
