"""A drive in a dozen figures, each named by its metric."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float, Shaped
from matplotlib.axes import Axes
from matplotlib.patches import Patch
from scipy.spatial import KDTree

from lgprjax.report.results import CODES, LEAST_P, DriveResult, track_errors
from lgprjax.report.style import BLUE, CODE_COLOURS, CODE_HATCHES, GAP, INK, MUTED, picture, write_caption

_UNKNOWN = "–"
WRONG_M = 0.3
"""An ``ok`` fix with a larger error is wrong: the nominal 1 ft of the Husky's requirements (``registration.WRONG_M``;
repeated here so that pictures need no accelerator library)."""


@dataclass(frozen=True, kw_only=True)
class DriveSummary:
    """Summary of a drive; figures are ``None`` without ok fixes or without truth.

    Errors are in the map frame, over the ok fixes whose truth is known (``judged`` of them). RMS compares with
    the 4.3 cm of Cornick et al. 2016, the means with Ort et al. 2020 (who fit a clock offset first; here none is).

    Attributes:
        scans, tried, ok: number of scans, of registered scans, and of scans with a position.
        counts: number of scans by code.
        ok_fraction: share of ok fixes among the tried scans.
        median_correlation_ok, median_correlation_at_truth: median correlation of the ok fixes, and of all scans at the
            true pose.
        max_error_m: largest distance from the truth.
        remarks: further remarks, one line each.
        place_assumed: whether the geographic position of the drive, or of the map, is assumed.
        search: description of the search; empty in summaries of older versions.
        risk: largest accepted probability of a false match; ``None`` in summaries of older versions.
        wrong_ok: number of judged fixes with an error above ``WRONG_M``; for an impostor all ok fixes.
        length_m: distance driven; this and the following are ``None`` in summaries of older versions.
        median_sigma_along_m, median_sigma_cross_m: median standard deviations of the ok fixes.
        median_offset_m: median distance of the ok fixes from the position in the log.
        median_off_line_m: median distance of the log's positions from the nearest line of a map with a known position.
    """

    name: str
    map_name: str
    impostor: bool
    scans: int
    tried: int
    ok: int
    ok_fraction: float | None
    counts: dict[str, int]
    median_correlation_ok: float | None
    median_correlation_at_truth: float | None
    judged: int
    rms_cross_m: float | None
    rms_along_m: float | None
    mean_absolute_total_m: float | None
    mean_absolute_cross_m: float | None
    max_error_m: float | None
    wrong_ok: int | None
    milliseconds_per_scan: float
    remarks: tuple[str, ...] = ()
    place_assumed: bool = False
    search: str = ""
    risk: float | None = None
    length_m: float | None = None
    median_sigma_along_m: float | None = None
    median_sigma_cross_m: float | None = None
    median_offset_m: float | None = None
    median_off_line_m: float | None = None

    def as_rows(self) -> list[tuple[str, str]]:
        """Label and value with unit, for a table of one drive; unknown values are left out."""
        declined = ", ".join(f"{n} {c}" for c, n in self.counts.items() if n and c not in ("ok", "no_window"))
        rows = [
            ("length", _length(self.length_m)),
            ("scans, of which tried", f"{self.scans}, {self.tried}"),
            ("ok", f"{self.ok} ({_percent(self.ok_fraction)} of the tried scans)"),
            ("declined", declined or "none"),
            ("ok but wrong (more than 0.3 m off)", _whole(self.wrong_ok)),
            ("median correlation of ok fixes", _number(self.median_correlation_ok)),
            ("median correlation at the truth", _number(self.median_correlation_at_truth)),
            ("RMS cross-track error", _metres(self.rms_cross_m)),
            ("RMS along-track error", _metres(self.rms_along_m)),
            ("mean distance from the truth", _metres(self.mean_absolute_total_m)),
            ("mean absolute cross-track error", _metres(self.mean_absolute_cross_m)),
            ("largest error of an ok fix", _metres(self.max_error_m)),
            ("median sigma cross-track of ok fixes", _metres(self.median_sigma_cross_m)),
            ("median sigma along-track of ok fixes", _metres(self.median_sigma_along_m)),
            ("median offset of ok fixes from the log's position", _metres(self.median_offset_m)),
            ("median distance of the log's positions from a line of the map", _metres(self.median_off_line_m)),
            ("time per scan, without compilation", f"{self.milliseconds_per_scan:.2f} ms"),
        ]
        return [(label, value) for label, value in rows if value != _UNKNOWN]

    def as_json(self) -> dict[str, object]:
        """Everything, ready for ``json.dump``."""
        return {**asdict(self), "remarks": list(self.remarks)}


def summary_of(told: Mapping[str, Any]) -> DriveSummary:
    """Summary from the output of ``as_json``. Raises ``TypeError`` or ``KeyError`` for anything else."""
    return DriveSummary(**{**told, "remarks": tuple(told["remarks"])})


def summarise(result: DriveResult) -> DriveSummary:
    """Count the codes and measure the ok fixes against the truth."""
    ok, tried = int(result.ok.sum()), int(result.tried.sum())
    errors = track_errors(result)
    judged = result.ok & np.isfinite(errors.along_m) & np.isfinite(errors.cross_m) & result.has_truth
    # The ground of an impostor is elsewhere: distances of its fixes mean nothing.
    judged &= not result.impostor
    along, cross = errors.along_m[judged].astype(np.float64), errors.cross_m[judged].astype(np.float64)
    total = np.hypot(along, cross)
    wrong = int((total > WRONG_M).sum()) if len(total) else None
    at_truth = result.correlation_at_truth
    offset = np.hypot(result.east_m - result.prior_east_m, result.north_m - result.prior_north_m)
    return DriveSummary(
        name=result.name,
        map_name=result.map_name,
        impostor=result.impostor,
        scans=len(result.code),
        tried=tried,
        ok=ok,
        ok_fraction=ok / tried if tried else None,
        counts={label: int((result.code == label).sum()) for label in CODES},
        median_correlation_ok=_median(result.correlation[result.ok]),
        median_correlation_at_truth=None if at_truth is None else _median(at_truth),
        judged=len(total),
        rms_cross_m=_rms(cross),
        rms_along_m=_rms(along),
        mean_absolute_total_m=float(total.mean()) if total.size else None,
        mean_absolute_cross_m=float(np.abs(cross).mean()) if total.size else None,
        max_error_m=float(total.max()) if total.size else None,
        wrong_ok=ok if result.impostor else wrong,
        milliseconds_per_scan=float(result.milliseconds_per_scan),
        remarks=result.remarks,
        place_assumed=result.place_assumed,
        length_m=float(result.distance_m[-1] - result.distance_m[0]) if len(result.distance_m) else None,
        median_sigma_along_m=_median(result.sigma_along_m[result.ok]),
        median_sigma_cross_m=_median(result.sigma_cross_m[result.ok]),
        median_offset_m=None if result.place_assumed else _median(offset[result.ok]),
        median_off_line_m=_off_line_m(result),
    )


def _off_line_m(result: DriveResult) -> float | None:
    """Median distance of the log's positions from the nearest line of the map; None where their place is assumed."""
    if result.place_assumed or not result.baseline_tracks:
        return None
    prior = np.stack([result.prior_east_m, result.prior_north_m], axis=1)
    away = KDTree(np.concatenate(result.baseline_tracks)).query(prior[np.isfinite(prior).all(axis=1)])[0]
    return _median(away)


def labelled(name: str, *, impostor: bool) -> str:
    """A drive's name, that of an impostor marked as one."""
    return f"{name} (impostor)" if impostor and "impostor" not in name else name


_OVERVIEW: tuple[tuple[str, Callable[[DriveSummary], str]], ...] = (
    ("drive", lambda s: labelled(s.name, impostor=s.impostor)),
    ("map", lambda s: s.map_name),
    ("tried", lambda s: str(s.tried)),
    ("ok", lambda s: _percent(s.ok_fraction)),
    ("ok but wrong", lambda s: _whole(s.wrong_ok)),
    ("length", lambda s: _length(s.length_m)),
    ("median r, ok fixes", lambda s: _number(s.median_correlation_ok)),
    ("median r at the truth", lambda s: _number(s.median_correlation_at_truth)),
    ("RMS cross-track", lambda s: _metres(s.rms_cross_m)),
    ("RMS along-track", lambda s: _metres(s.rms_along_m)),
    ("mean total", lambda s: _metres(s.mean_absolute_total_m)),
    ("largest", lambda s: _metres(s.max_error_m)),
    ("sigma cross-track", lambda s: _metres(s.median_sigma_cross_m)),
    ("sigma along-track", lambda s: _metres(s.median_sigma_along_m)),
    ("offset from the log", lambda s: _metres(s.median_offset_m)),
    ("ms/scan", lambda s: f"{s.milliseconds_per_scan:.2f}"),
)
_WITHOUT_ERRORS = ("length", "sigma cross-track", "sigma along-track", "offset from the log")
"""Columns shown if errors are unknown."""


def overview(summaries: Sequence[DriveSummary]) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Header, and one row per drive, for terminal and page; columns without any value are left out."""
    left_out = _WITHOUT_ERRORS if any(summary.judged for summary in summaries) else ()
    columns = [(title, *map(cell, summaries)) for title, cell in _OVERVIEW if title not in left_out]
    header, *rows = zip(*(each for each in columns if set(each[1:]) != {_UNKNOWN}), strict=True)
    return header, rows


def overview_caption(summaries: Sequence[DriveSummary]) -> str:
    """Caption that explains the figures of the overview."""
    if any(summary.judged for summary in summaries):
        return "Errors of the ok fixes in the map frame; wrong: error above 0.3 m."
    return "True poses unknown: no errors. Sigmas and offsets: medians of the ok fixes."


def _median(values: Float[np.ndarray, " any"]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else None


def _rms(values: Float[np.ndarray, " any"]) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _percent(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{100.0 * value:.1f} %"


def _number(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{value:.3f}"


def _length(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{value:.1f} m"


def _metres(value: float | None) -> str:
    return _UNKNOWN if value is None else f"{value:.3f} m"


def _whole(value: int | None) -> str:
    return _UNKNOWN if value is None else str(value)


# Why fixes were accepted or refused: evidence, margin and codes of several drives side by side.

_BINS = 50
_COMPACT: dict[str, Any] = {"frameon": False, "handlelength": 1.2, "columnspacing": 1.0}
# Narrower parts of a bar have no number.
_LABELLED_SHARE = 0.07
_LEAST_SPAN = 0.1
"""Least range of the margins, so that a drive with almost none is not magnified."""
_NO_RISK = 4.0  # decades of the picture's axis without a known risk
_MOST_RISKS = 5.0
"""Evidence beyond this multiple of the required is drawn in the last bin."""


@dataclass(frozen=True)
class CodedDrive:
    """Data of a drive for the picture of the codes, one value per scan: see ``DriveResult``."""

    name: str
    impostor: bool
    code: Shaped[np.ndarray, " scan"]
    margin: Float[np.ndarray, " scan"]
    p_false: Float[np.ndarray, " scan"]

    @property
    def ok(self) -> Shaped[np.ndarray, " scan"]:
        """Scans whose fix is a position."""
        return np.asarray(self.code == "ok")

    @property
    def tried(self) -> Shaped[np.ndarray, " scan"]:
        """Scans that were registered."""
        return np.asarray(self.code != "no_window")


def draw_codes(
    results: Sequence[DriveResult | CodedDrive],
    path: str | Path,
    *,
    risks: Sequence[float | None],
    force: bool = False,
) -> None:
    """Draw one row per drive: histograms of evidence, with the risk, and of margin, and the shares of the codes.

    Args:
        results: results of at least one drive.
        path: path of the PNG.
        risks: largest accepted probability of a false match of each drive's search; ``None`` if unknown.
        force: whether to replace an existing file.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    margins = np.concatenate([_shown(result.margin, result) for result in results])
    low, high = (float(margins.min()), float(margins.max())) if margins.size else (0.0, 0.0)
    span = (min(low, 0.0), max(high, _LEAST_SPAN))
    required = [None if risk is None else float(-np.log10(risk)) for risk in risks]
    largest = max((each for each in required if each is not None), default=_NO_RISK)
    evidence = [-np.log10(np.maximum(_shown(result.p_false, result), LEAST_P)) for result in results]
    most = float(min(_MOST_RISKS * largest, max(2.0 * largest, *(each.max(initial=0.0) for each in evidence))))
    with picture(path, 11.0, 2.1 + 1.15 * len(results), force) as figure:
        grid = figure.subplots(len(results), 3, squeeze=False, sharex="col", width_ratios=(1.0, 1.0, 1.1))
        for row, result, decades, least in zip(grid, results, evidence, required, strict=True):
            colour = INK if result.impostor else BLUE
            _draw_histogram(row[0], decades, (0.0, most), colour)
            if least is not None:
                row[0].axvspan(0.0, least, color=GAP, zorder=0)
                row[0].axvline(least, color=INK, linewidth=1.2, linestyle=(0, (4, 2)))
            _draw_histogram(row[1], _shown(result.margin, result), span, colour)
            _draw_codes_bar(row[2], result)
            name = labelled(result.name, impostor=result.impostor)
            row[0].set_title(f"{name}: {int(result.ok.sum())} ok of {int(result.tried.sum())} tried", fontweight="bold")
        grid[-1, 0].set_xlabel("evidence, decades: −log₁₀ p_false")
        grid[-1, 1].set_xlabel("margin over the runner-up")
        grid[-1, 2].set_xlabel("share of the tried scans (%)")
        figure.supylabel("scans")
        figure.suptitle("Acceptance of fixes: evidence, margin and codes")
        seen = [label for label in CODES[:-1] if any((result.code == label).any() for result in results)]
        handles = [
            Patch(facecolor=CODE_COLOURS[label], edgecolor="white", hatch=CODE_HATCHES[label], label=label)
            for label in seen
        ]
        # Three columns of at most seven codes fit over the bars; without tried scans there is none.
        if handles:
            grid[0, 2].legend(handles=handles, loc="lower left", bbox_to_anchor=(0.0, 0.9), ncols=3, **_COMPACT)
        told = dict.fromkeys(f"{risk:g}" for risk in risks if risk is not None)
        stated = f", {', '.join(told)}" if len(told) == 1 else " of each drive's search"
        write_caption(
            figure,
            f"Dashed: the risk{stated}. To be ok a fix must be in the white part, where foreign ground would "
            "match as well less often than that, and exceed its runner-up by enough noise floors. Without a "
            "runner-up there is no margin. Black: an impostor. Scans without a fix of their own (no_window) "
            "are left out.",
        )


def _shown(values: Float[np.ndarray, " scan"], result: DriveResult | CodedDrive) -> Float[np.ndarray, " shown"]:
    return np.asarray(values[result.tried & np.isfinite(values)])


def _draw_histogram(axes: Axes, values: Float[np.ndarray, " shown"], span: tuple[float, float], colour: str) -> None:
    # Values beyond belong to the last bin.
    axes.hist(np.clip(values, *span), bins=_BINS, range=span, color=colour, histtype="stepfilled")
    axes.set_xlim(*span)
    axes.locator_params(axis="y", nbins=3, integer=True)


def _draw_codes_bar(axes: Axes, result: DriveResult | CodedDrive) -> None:
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
        axes.barh(
            0.0,
            share,
            left=left,
            height=0.6,
            color=CODE_COLOURS[label],
            hatch=CODE_HATCHES[label],
            edgecolor="white",
            linewidth=0.8,
        )
        if share >= 100.0 * _LABELLED_SHARE:
            dark = label in ("non_finite", "low_overlap")
            text = f"{share:.0f}"
            shown = axes.text(left + share / 2, 0.0, text, ha="center", va="center", color="white" if dark else INK)
            if CODE_HATCHES[label]:
                shown.set_bbox({"facecolor": CODE_COLOURS[label], "edgecolor": "none", "pad": 1.5})
        left += share
