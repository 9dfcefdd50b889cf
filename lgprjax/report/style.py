"""Common style of all pictures: colours for print and colour blindness, and writing of files."""

import textwrap
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Int
from matplotlib import rc_context
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure
from matplotlib.ticker import LogLocator, NullFormatter

from lgprjax.formats.store import atomic_output

AMPLITUDE_MAP = "gray"
CORRELATION_MAP = "viridis"
ERROR_MAP = "RdBu_r"

UNSCORED = "#a6a6a6"
"""Colour of missing values in a colour map: at neither of its ends."""

# Okabe and Ito's palette: distinguishable with every common colour blindness, and of different lightness in print.
BLUE, SKY, GREEN, ORANGE, VERMILLION, PURPLE = "#0072B2", "#56B4E9", "#009E73", "#E69F00", "#D55E00", "#CC79A7"
INK, MUTED, FAINT, GAP = "#222222", "#6b6b6b", "#bdbdbd", "#ececec"

CODE_COLOURS = MappingProxyType(
    {
        "ok": GREEN,
        "low_correlation": VERMILLION,
        "ambiguous": PURPLE,
        "edge": ORANGE,
        "off_map": SKY,
        "low_overlap": BLUE,
        "non_finite": INK,
        "no_window": "#d9d9d9",
    }
)

CODE_HATCHES = MappingProxyType(
    {
        "ok": "",
        "low_correlation": "///",
        "ambiguous": "xxx",
        "edge": "\\\\\\",
        "off_map": "...",
        "low_overlap": "---",
        "non_finite": "",
        "no_window": "",
    }
)
"""Patterns of codes whose colours are alike in a print without colours."""

DPI = 120
_CAPTION_CHARACTERS_PER_INCH = 15.0
# Newer matplotlib types the keys as a list of literals, older ones as str.
_STYLE: dict[Any, Any] = {
    "font.family": "DejaVu Sans",
    "font.size": 10.0,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 10.0,
    "xtick.labelsize": 9.0,
    "ytick.labelsize": 9.0,
    "legend.fontsize": 9.0,
    "legend.framealpha": 0.9,
    "figure.titlesize": 12.5,
    "figure.titleweight": "bold",
    "axes.edgecolor": MUTED,
    "axes.labelcolor": INK,
    "text.color": INK,
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}


@contextmanager
def picture(path: str | Path, width_in: float, height_in: float, force: bool) -> Iterator[Figure]:
    """Yield an empty figure in the house style; write it to ``path`` as PNG when the block ends well.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    # rc_context restores its settings, and a Figure made without pyplot is not registered globally.
    with atomic_output(path, force) as temporary, rc_context(_STYLE):
        figure = Figure(figsize=(width_in, height_in), dpi=DPI, layout="constrained")
        yield figure
        figure.savefig(temporary, format="png")


def write_caption(figure: Figure, text: str) -> None:
    """Set ``text`` under the picture, wrapped to its width. A second call replaces the first."""
    width = int(figure.get_figwidth() * _CAPTION_CHARACTERS_PER_INCH)
    figure.supxlabel(textwrap.fill(text, width), x=0.01, ha="left", fontsize=9.0, color=MUTED)


def write_stretch_caption(axes: Axes, text: str, direction: str, metres_per_unit: float = 1.0) -> None:
    """Set ``text`` under the picture, and how much longer a vertical metre is drawn in ``axes`` than a horizontal one.

    Call it last: the figure is laid out here, once, and not again when it is written.

    Args:
        axes: panel whose stretch is stated.
        text: other sentences of the caption.
        direction: name of the vertical, such as "Depth".
        metres_per_unit: length of one unit of the vertical axis, m.
    """
    figure = axes.get_figure(root=True)
    assert figure is not None
    # The layout needs the caption's height before the number is known: another one takes its place.
    write_caption(figure, f"{text} {direction} drawn ×1.0.")
    layout = figure.get_layout_engine()
    assert layout is not None
    layout.execute(figure)
    figure.set_layout_engine("none")
    box, (left, right), (bottom, top) = axes.get_window_extent(), axes.get_xlim(), axes.get_ylim()
    stretch = box.height / (abs(top - bottom) * metres_per_unit) / (box.width / abs(right - left))
    write_caption(figure, f"{text} {direction} drawn ×{stretch:{'.1f' if stretch < 10.0 else '.0f'}}.")


def outer_edges(centres: Float[np.ndarray, " cell"]) -> tuple[float, float]:
    """Start of the first and end of the last of evenly spaced cells; a single cell is one unit wide."""
    half = (centres[-1] - centres[0]) / (2 * (len(centres) - 1)) if len(centres) > 1 else 0.5
    return float(centres[0] - half), float(centres[-1] + half)


def speed_text(speed_m_per_ns: float) -> str:
    """A wave's speed with at least two decimals, keeping all given digits."""
    short = f"{speed_m_per_ns:.2f}"
    return short if float(short) == speed_m_per_ns else f"{speed_m_per_ns:.4g}"


def runs_of(held: Bool[np.ndarray, " place"]) -> Int[np.ndarray, "run 2"]:
    """First of each run of held places, and the first place after it."""
    edges = np.diff(np.concatenate([[False], held, [False]]).astype(np.int8))
    return np.asarray(np.flatnonzero(edges)).reshape(-1, 2)


def label_decades(axis: Axis) -> None:
    """Numbers at 1, 2 and 5 of each decade of a logarithmic axis: a short one may contain no power of ten."""
    axis.set_major_locator(LogLocator(subs=(1.0, 2.0, 5.0)))
    axis.set_major_formatter("{x:g}")
    axis.set_minor_formatter(NullFormatter())
