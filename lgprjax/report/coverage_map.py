"""A worked field from above: what is processed at which confidence, what is uncertain, what is not, and every stop."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float, UInt8
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap
from matplotlib.patches import Patch, Polygon

from lgprjax.report.style import BLUE, GAP, INK, MUTED, SKY, VERMILLION, picture, write_caption

# Apart for every common colour blindness, and of four different lightnesses in print.
_YELLOW = "#F0E442"
COLOURS = (VERMILLION, _YELLOW, SKY, BLUE)
"""Not processed, uncertain, processed at the lower level only, processed at the higher level."""
_WIDTH_IN = 9.0


@dataclass(frozen=True, kw_only=True)
class CoverPicture:
    """What the map of a field shows, metres east and north of its anchor.

    Attributes:
        name: of the field.
        perimeter_m: its corners.
        east_m, north_m, cell_m: south-west corner and side of the cells.
        inside: cells whose centre lies inside the perimeter.
        levels: the lower and the higher confidence.
        states: of the cells at each level: 0 not processed, 1 uncertain, 2 processed.
        swaths_m: the tool's ways.
        stops_m: where the vehicle had a reason to stop.
    """

    name: str
    perimeter_m: Float[np.ndarray, "corner 2"]
    east_m: float
    north_m: float
    cell_m: float
    inside: Bool[np.ndarray, "north east"]
    levels: tuple[float, float]
    states: UInt8[np.ndarray, "2 north east"]
    swaths_m: tuple[Float[np.ndarray, "_ 2"], ...]
    stops_m: Float[np.ndarray, "stop 2"]


def draw_coverage(cover: CoverPicture, path: str | Path, *, force: bool = False) -> None:
    """Draw the map at equal scale, north up.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    kinds = np.where(cover.states[1] == 2, 3, cover.states[0])
    north, east = kinds.shape
    extent = (
        cover.east_m,
        cover.east_m + east * cover.cell_m,
        cover.north_m,
        cover.north_m + north * cover.cell_m,
    )
    height_in = 1.9 + float(np.clip(_WIDTH_IN * north / east, 2.5, 11.0))
    with picture(path, _WIDTH_IN, height_in, force) as figure:
        axes = figure.subplots()
        axes.imshow(
            np.ma.masked_array(kinds, ~cover.inside),
            cmap=ListedColormap(COLOURS).with_extremes(bad=GAP),
            vmin=-0.5,
            vmax=3.5,
            origin="lower",
            extent=extent,
            interpolation="nearest",
            aspect="equal",
        )
        for way in cover.swaths_m:
            axes.plot(*way.T, color="white", linewidth=0.5, alpha=0.7)
        axes.add_patch(Polygon(cover.perimeter_m, fill=False, edgecolor=INK, linewidth=1.4))
        if len(cover.stops_m):
            axes.plot(*cover.stops_m.T, "X", color=INK, markeredgecolor="white", markersize=9, label="stop")
        axes.set_xlim(*extent[:2])
        axes.set_ylim(*extent[2:])
        axes.set_xlabel("east of the anchor (m)")
        axes.set_ylabel("north of the anchor (m)")
        figure.suptitle(f"{cover.name}: what the machine processed")
        _legend(axes, cover, kinds)
        write_caption(
            figure,
            "North is up. Each cell has the probability of its best pass. White lines: ways of the tool's centre; "
            f"grey: beyond the perimeter. Cells of {100.0 * cover.cell_m:g} cm. A machine pass is not clearance.",
        )


def _legend(axes: Axes, cover: CoverPicture, kinds: UInt8[np.ndarray, "north east"]) -> None:
    low, high = (f"{100.0 * level:g} %" for level in cover.levels)
    words = ("not processed", f"uncertain at {low}", f"processed at {low} only", f"processed at {high}")
    inside = kinds[cover.inside]
    patches = [
        Patch(facecolor=colour, edgecolor=MUTED, label=f"{word}: {_share(inside == kind)}")
        for kind, (colour, word) in enumerate(zip(COLOURS, words, strict=True))
    ]
    handles, _ = axes.get_legend_handles_labels()
    axes.legend(
        handles=[*patches[::-1], *handles], loc="lower center", bbox_to_anchor=(0.5, 1.01), ncols=3, frameon=False
    )


def _share(held: Bool[np.ndarray, " cell"]) -> str:
    """Rounded down: what is nearly all is not all."""
    return f"{np.floor(1000.0 * np.mean(held)) / 10.0:.1f} %"
