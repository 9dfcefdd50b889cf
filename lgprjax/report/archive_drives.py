"""Very many drives at one look: how their availability, errors and times are spread, and which codes were given."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes

from lgprjax.report.results import CODES
from lgprjax.report.style import BLUE, CODE_COLOURS, INK, MUTED, ORANGE, picture, write_caption

_BINS = 40


@dataclass(frozen=True, kw_only=True)
class ArchiveDrives:
    """Drives of an archive, one value a drive; NaN where there is none.

    Attributes:
        name: of the map.
        ok_share: of the scans searched, 0 to 1.
        rms_cross_m, rms_along_m: errors of the ok fixes.
        milliseconds_per_scan: of the search.
        counts: scans by code, all drives together.
    """

    name: str
    ok_share: Float[np.ndarray, " drive"]
    rms_cross_m: Float[np.ndarray, " drive"]
    rms_along_m: Float[np.ndarray, " drive"]
    milliseconds_per_scan: Float[np.ndarray, " drive"]
    counts: dict[str, int]


def draw_archive_drives(drives: ArchiveDrives, path: str | Path, *, force: bool = False) -> None:
    """Draw three histograms over the drives, and the codes of all scans.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    with picture(path, 11.0, 5.6, force) as figure:
        (share, errors), (times, codes) = figure.subplots(2, 2)
        share.hist(100.0 * drives.ok_share, bins=_BINS, range=(0.0, 100.0), color=BLUE)
        share.set_xlabel("scans with an ok fix (%)")
        _draw_errors(errors, drives)
        top_ms = 2.0 * float(np.percentile(drives.milliseconds_per_scan, 90.0))
        times.hist(np.minimum(drives.milliseconds_per_scan, top_ms), bins=_BINS, range=(0.0, top_ms), color=MUTED)
        times.set_xlabel("time a scan (ms)")
        for axes in (share, errors, times):
            axes.set_ylabel("drives")
            axes.yaxis.get_major_locator().set_params(integer=True)
        _draw_codes(codes, drives.counts)
        figure.suptitle(f"{len(drives.ok_share)} drives on {drives.name}")
        write_caption(
            figure,
            "Errors are those of the ok fixes, root mean square over a drive, in the map's frame; where known. What "
            "lies beyond an axis stands in its last bar: a worker compiles in the time of its first drive.",
        )


def _draw_errors(axes: Axes, drives: ArchiveDrives) -> None:
    cross, along = (values[np.isfinite(values)] for values in (drives.rms_cross_m, drives.rms_along_m))
    axes.set_xlabel("RMS error (m)")
    if not len(cross):
        axes.text(0.5, 0.5, "no truth is known", transform=axes.transAxes, ha="center", color=MUTED)
        return
    top = max(float(np.percentile(np.concatenate([cross, along]), 99.0)), 0.02) * 1.2
    for values, colour, label in ((cross, BLUE, "across"), (along, ORANGE, "along")):
        axes.hist(np.minimum(values, top), bins=_BINS, range=(0.0, top), color=colour, histtype="step", label=label)
    axes.legend(frameon=False)


def _draw_codes(axes: Axes, counts: dict[str, int]) -> None:
    shown = [code for code in CODES[:-1] if counts.get(code, 0)][::-1]
    total = max(sum(counts[code] for code in shown), 1)
    shares = [100.0 * counts[code] / total for code in shown]
    bars = axes.barh(shown, shares, color=[CODE_COLOURS[code] for code in shown])
    axes.bar_label(bars, [f"{share:.3g} %" for share in shares], padding=3, color=INK, fontsize=8.5)
    axes.set_xlim(0.0, 115.0)
    axes.set_xlabel("of the scans searched (%)")
