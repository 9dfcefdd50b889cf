"""Whether fixes are as good as they say: stated and true errors, errors by evidence, and what is declined."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes

from lgprjax.report.results import LEAST_P, DriveResult, track_errors
from lgprjax.report.style import (
    BLUE,
    FAINT,
    GAP,
    INK,
    MUTED,
    ORANGE,
    SKY,
    VERMILLION,
    label_decades,
    picture,
    write_caption,
)
from lgprjax.report.summary import WRONG_M

_BINS = 8
_LEAST_IN_BIN = 20
_LEAST_CM = 0.1
_EVIDENCE_COLOURS = (SKY, BLUE, INK)


@dataclass(frozen=True, kw_only=True)
class StatedErrors:
    """Tried fixes whose truth is known, of any drives, one row each.

    Attributes:
        name: of the drives.
        along_m, cross_m: fix less truth; NaN where there is no pose.
        sigma_along_m, sigma_cross_m: that the fix states.
        evidence: decades, −log₁₀ of the probability that ground that is not the map's matches as well.
        ok: the fix is called a position; the others are declined.
    """

    name: str
    along_m: Float[np.ndarray, " fix"]
    cross_m: Float[np.ndarray, " fix"]
    sigma_along_m: Float[np.ndarray, " fix"]
    sigma_cross_m: Float[np.ndarray, " fix"]
    evidence: Float[np.ndarray, " fix"]
    ok: Bool[np.ndarray, " fix"]

    @property
    def total_m(self) -> Float[np.ndarray, " fix"]:
        """Distance from the truth."""
        return np.asarray(np.hypot(self.along_m, self.cross_m))


def stated_errors(results: Sequence[DriveResult]) -> StatedErrors:
    """The tried fixes of drives whose truth is known.

    Impostors are left out, as how near they come to anything says nothing, and scans that the truth does not reach.
    """
    judged = [result for result in results if result.has_truth and not result.impostor]
    parts: list[tuple[np.ndarray, ...]] = [tuple(np.zeros(0) for _ in range(5)) + (np.zeros(0, bool),)]
    for result in judged:
        assert result.truth_east_m is not None
        assert result.truth_north_m is not None
        errors = track_errors(result)
        known = result.tried & np.isfinite(result.truth_east_m + result.truth_north_m)
        columns = (*errors, result.sigma_along_m, result.sigma_cross_m, -np.log10(np.maximum(result.p_false, LEAST_P)))
        parts.append((*(np.asarray(column, np.float64)[known] for column in columns), result.ok[known]))
    along, cross, sigma_along, sigma_cross, evidence, ok = (np.concatenate(c) for c in zip(*parts, strict=True))
    return StatedErrors(
        name=", ".join(result.name for result in judged),
        along_m=along,
        cross_m=cross,
        sigma_along_m=sigma_along,
        sigma_cross_m=sigma_cross,
        evidence=evidence,
        ok=ok,
    )


def draw_confidence(stated: StatedErrors, path: str | Path, *, force: bool = False) -> None:
    """Draw the reliability of the sigmas, errors by evidence, and what a smaller risk would decline.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    declined, tried = int((~stated.ok).sum()), len(stated.ok)
    share = f"{100.0 * declined / tried:.1f} % of {tried} tried fixes declined" if tried else "no truth known"
    with picture(path, 12.5, 5.0, force) as figure:
        reliability, by_evidence, asked = figure.subplots(1, 3)
        _draw_reliability(reliability, stated)
        _draw_by_evidence(by_evidence, stated)
        _draw_asked(asked, stated)
        figure.suptitle(f"{stated.name or 'No drive'}: {share}")
        write_caption(
            figure,
            "Left: ok fixes in bins of equal number, root mean square error of each over the sigma that they state; "
            "bars: 95 % if errors were independent, which within a drive they are not. Right: on top of the codes "
            f"given; wrong: more than {WRONG_M:g} m off.",
        )


def _draw_reliability(axes: Axes, stated: StatedErrors) -> None:
    axes.set_title("stated against true")
    rows = (
        ("along", stated.along_m, stated.sigma_along_m, BLUE, "o"),
        ("cross", stated.cross_m, stated.sigma_cross_m, ORANGE, "s"),
    )
    drawn: list[np.ndarray] = []
    for name, error_m, sigma_m, colour, marker in rows:
        good = stated.ok & np.isfinite(error_m) & (sigma_m > 0.0) & np.isfinite(sigma_m)
        if not good.any():
            continue
        error_cm, sigma_cm = 100.0 * error_m[good], 100.0 * sigma_m[good]
        bins = np.array_split(np.argsort(sigma_cm), max(1, min(_BINS, good.sum() // _LEAST_IN_BIN)))
        sigma = np.array([np.sqrt(np.mean(sigma_cm[b] ** 2)) for b in bins])
        rms = np.maximum([np.sqrt(np.mean(error_cm[b] ** 2)) for b in bins], 0.1 * _LEAST_CM)
        # The root of a mean of n squares scatters by 1/sqrt(2 n) of itself; in the exponent it stays positive.
        factor = np.exp(1.96 / np.sqrt(2.0 * np.array([len(b) for b in bins])))
        within = [100.0 * float(np.mean(np.abs(error_cm) <= n * sigma_cm)) for n in (1.0, 3.0)]
        label = f"{name}: {within[0]:.0f} % within 1 σ, {within[1]:.1f} % within 3 σ"
        bars = [rms - rms / factor, rms * factor - rms]
        axes.errorbar(
            sigma, rms, yerr=bars, fmt=marker, color=colour, ecolor=colour, elinewidth=1.0, capsize=2.5, label=label
        )
        drawn += [sigma, rms / factor, rms * factor]
    if not drawn:
        _say_nothing(axes)
        return
    values = np.concatenate(drawn)
    span = np.array([0.7 * values.min(), 1.4 * values.max()])
    axes.plot(span, span, color=INK, linewidth=1.2, zorder=1)
    axes.fill_between(span, span / 2.0, span * 2.0, color=GAP, zorder=0)
    axes.set(xscale="log", yscale="log", xlim=span, ylim=span, aspect="equal")
    axes.text(0.04, 0.96, "too sure", transform=axes.transAxes, va="top", color=MUTED)
    axes.text(0.96, 0.04, "too modest", transform=axes.transAxes, ha="right", color=MUTED)
    label_decades(axes.xaxis)
    label_decades(axes.yaxis)
    axes.set_xlabel("stated σ (cm); shaded: within a factor of two")
    axes.set_ylabel("true error, RMS (cm)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), frameon=False, handletextpad=0.2)


def _draw_by_evidence(axes: Axes, stated: StatedErrors) -> None:
    axes.set_title("error by evidence")
    total_cm = np.maximum(100.0 * stated.total_m, _LEAST_CM)
    posed = np.isfinite(total_cm)
    good = np.flatnonzero(stated.ok & posed & np.isfinite(stated.evidence))
    thirds = np.array_split(good[np.argsort(stated.evidence[good])], min(len(_EVIDENCE_COLOURS), max(len(good), 1)))
    for members, colour in zip(thirds, _EVIDENCE_COLOURS, strict=False):
        if len(members):
            low, high = stated.evidence[members[[0, -1]]]
            _draw_distribution(axes, total_cm[members], colour, "-", f"ok, evidence {low:.1f} to {high:.1f}")
    declined = ~stated.ok & posed
    if declined.any():
        _draw_distribution(
            axes, total_cm[declined], VERMILLION, (0, (4, 2)), f"declined, with a pose: {int(declined.sum())}"
        )
    if not len(good) and not declined.any():
        _say_nothing(axes)
        return
    axes.axvline(100.0 * WRONG_M, color=MUTED, linewidth=1.0, linestyle=":")
    axes.set_xscale("log")
    label_decades(axes.xaxis)
    axes.set_ylim(0.0, 101.0)
    axes.set_xlabel(f"distance from the truth (cm); dotted: {100.0 * WRONG_M:g} cm")
    axes.set_ylabel("share of the fixes no farther off (%)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), frameon=False)


def _draw_distribution(
    axes: Axes, values: Float[np.ndarray, " fix"], colour: str, style: str | tuple[int, tuple[int, int]], label: str
) -> None:
    share = 100.0 * np.arange(1, len(values) + 1) / len(values)
    # From nothing on, or a single fix would have no line.
    x, y = np.concatenate([[values.min()], np.sort(values)]), np.concatenate([[0.0], share])
    axes.plot(x, y, color=colour, linestyle=style, linewidth=1.8, drawstyle="steps-post", label=label)


def _draw_asked(axes: Axes, stated: StatedErrors) -> None:
    axes.set_title("what a smaller risk would cost")
    total_m, tried = stated.total_m, len(stated.ok)
    held = stated.ok & np.isfinite(total_m) & np.isfinite(stated.evidence)
    if not held.any():
        _say_nothing(axes)
        return
    evidence = np.sort(stated.evidence[held])
    least = np.concatenate([[min(0.0, evidence[0])], evidence])
    kept = held.sum() - np.searchsorted(evidence, least, "left")
    wrong = np.sort(stated.evidence[held & (total_m > WRONG_M)])
    left_wrong = len(wrong) - np.searchsorted(wrong, least, "left")
    axes.plot(
        least, 100.0 * (1.0 - kept / tried), color=BLUE, lw=2.0, drawstyle="steps-pre", label="declined, of all tried"
    )
    shares = 100.0 * left_wrong / np.maximum(kept, 1)
    label = f"wrong, of those left: {len(wrong)} as it is"
    axes.plot(least, shares, color=VERMILLION, lw=2.0, linestyle="--", drawstyle="steps-pre", label=label)
    axes.axvline(evidence[0], color=FAINT, linewidth=1.0, zorder=0)
    axes.set_ylim(-1.0, 101.0)
    axes.set_xlabel("evidence asked for (decades); grey: least ok")
    axes.set_ylabel("share (%)")
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.18), frameon=False)


def _say_nothing(axes: Axes) -> None:
    axes.set(xticks=[], yticks=[])
    axes.text(0.5, 0.5, "no fix to show", transform=axes.transAxes, ha="center", va="center", color=MUTED)
