"""Why fixes were accepted or refused: evidence, margin and codes of several drives side by side."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.patches import Patch

from lgprjax.report.results import CODES, LEAST_P, DriveResult
from lgprjax.report.style import BLUE, CODE_COLOURS, GAP, INK, MUTED, picture, write_caption
from lgprjax.report.summary import labelled

_BINS = 50
_COMPACT: dict[str, Any] = {"frameon": False, "handlelength": 1.2, "columnspacing": 1.0}
# Narrower parts of a bar hold no number.
_LABELLED_SHARE = 0.07
_LEAST_SPAN = 0.1
"""Of the margins, so that a drive with next to none does not look as if it had some."""
_MOST_RISKS = 5.0
"""Evidence beyond so many times what is asked is drawn in the last bin."""


def draw_codes(
    results: Sequence[DriveResult],
    path: str | Path,
    *,
    risk: float,
    force: bool = False,
) -> None:
    """Draw a row a drive: histograms of evidence, with the risk, and of margin, and the shares of the codes.

    Args:
        results: at least one drive.
        path: the PNG.
        risk: probability of a false match up to which a fix is believed.
        force: replace a file that exists.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    margins = np.concatenate([_shown(result.margin, result) for result in results])
    low, high = (float(margins.min()), float(margins.max())) if margins.size else (0.0, 0.0)
    span = (min(low, 0.0), max(high, _LEAST_SPAN))
    asked = -np.log10(risk)
    evidence = [-np.log10(np.maximum(_shown(result.p_false, result), LEAST_P)) for result in results]
    most = float(min(_MOST_RISKS * asked, max(2.0 * asked, *(each.max(initial=0.0) for each in evidence))))
    with picture(path, 11.0, 2.1 + 1.15 * len(results), force) as figure:
        grid = figure.subplots(len(results), 3, squeeze=False, sharex="col", width_ratios=(1.0, 1.0, 1.1))
        for row, result, decades in zip(grid, results, evidence, strict=True):
            colour = INK if result.impostor else BLUE
            _draw_histogram(row[0], decades, (0.0, most), colour)
            row[0].axvspan(0.0, asked, color=GAP, zorder=0)
            row[0].axvline(asked, color=INK, linewidth=1.2, linestyle=(0, (4, 2)))
            _draw_histogram(row[1], _shown(result.margin, result), span, colour)
            _draw_codes_bar(row[2], result)
            name = labelled(result.name, impostor=result.impostor)
            row[0].set_title(f"{name}: {int(result.ok.sum())} ok of {int(result.tried.sum())} tried", fontweight="bold")
        grid[-1, 0].set_xlabel("evidence, decades: −log₁₀ p_false")
        grid[-1, 1].set_xlabel("margin over the runner-up")
        grid[-1, 2].set_xlabel("share of the tried scans (%)")
        figure.supylabel("scans")
        figure.suptitle("Why fixes are accepted or refused")
        seen = [label for label in CODES[:-1] if any((result.code == label).any() for result in results)]
        handles = [Patch(color=CODE_COLOURS[label], label=label) for label in seen]
        # Three columns of at most seven codes fit over the bars; nothing was tried: nothing to explain.
        if handles:
            grid[0, 2].legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.9), ncols=3, **_COMPACT)
        write_caption(
            figure,
            f"Dashed: the risk, {risk:g}. To be ok a fix must stand in the white part, where ground that is not the "
            "map's would match as well less often than that, and lead over its runner-up by enough noise floors. "
            "Without a runner-up there is no margin. Black: an impostor. Scans without a fix of their own (no_window) "
            "are left out.",
        )


def _shown(values: Float[np.ndarray, " scan"], result: DriveResult) -> Float[np.ndarray, " shown"]:
    return np.asarray(values[result.tried & np.isfinite(values)])


def _draw_histogram(axes: Axes, values: Float[np.ndarray, " shown"], span: tuple[float, float], colour: str) -> None:
    # What lies beyond belongs to the last bin, not out of sight.
    axes.hist(np.clip(values, *span), bins=_BINS, range=span, color=colour, histtype="stepfilled")
    axes.set_xlim(*span)
    axes.locator_params(axis="y", nbins=3, integer=True)


def _draw_codes_bar(axes: Axes, result: DriveResult) -> None:
    axes.set_yticks([])
    axes.set_xlim(0.0, 100.0)
    axes.set_ylim(-0.5, 0.5)
    for side in ("left", "right", "top"):
        axes.spines[side].set_visible(False)
    tried = int(result.tried.sum())
    if not tried:
        axes.text(50.0, 0.0, "no scan was tried", ha="center", va="center", color=MUTED)
        return
    left = 0.0
    for label in CODES[:-1]:
        share = 100.0 * float((result.code == label).sum()) / tried
        axes.barh(0.0, share, left=left, height=0.6, color=CODE_COLOURS[label], edgecolor="white", linewidth=0.8)
        if share >= 100.0 * _LABELLED_SHARE:
            dark = label in ("non_finite", "low_overlap")
            text = f"{share:.0f}"
            axes.text(left + share / 2, 0.0, text, ha="center", va="center", color="white" if dark else INK)
        left += share
