"""Moving pictures: a drive that is located and one that is refused, and evidence that grows along a drive."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float
from matplotlib import colormaps, rc_context
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from PIL import Image

from lgprjax.batch import FixExample
from lgprjax.report.style import CORRELATION_MAP, UNSCORED, outer_edges
from pictures.demo import DemoSite, Located, errors_m
from pictures.style import GREEN, INK, MUTED, ORANGE, VERMILLION, moving_style, tint

_WIDTH_PX = 960
_QUALITY = 62


def write_moving(frames: Sequence[Image.Image], durations_ms: Sequence[int], path: Path) -> None:
    """Write frames as an endless WebP."""
    first, *others = frames
    first.save(
        path,
        format="WEBP",
        save_all=True,
        append_images=others,
        duration=list(durations_ms),
        loop=0,
        quality=_QUALITY,
        method=4,
        minimize_size=False,
    )


def _frame(figure: Figure) -> Image.Image:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", metadata={"Software": None})
    buffer.seek(0)
    return Image.open(buffer).convert("RGB")


# A drive that is located, then one over other ground.

_RATE_HZ = 8
_FROM_M, _TO_M = 15.0, 41.0
_IMPOSTOR_TO_M = 26.0
_STRIP_M = 3.5
_LAST_MS = 1400


@dataclass(frozen=True)
class _Radargram:
    """Traces along a way: image [sample, place] of evenly spaced places."""

    live: Float[np.ndarray, "sample place"]
    stored: Float[np.ndarray, "sample place"]
    distance_m: Float[np.ndarray, " place"]


def _radargram(site: DemoSite, located: Located, to_m: float) -> _Radargram:
    """The live traces and those of the map, from strips one after the other."""
    travel = located.drive.track.travel_m
    distance = np.arange(_FROM_M, to_m, 0.05)
    live, stored = np.zeros((2, 0, len(distance)))
    for end_m in np.arange(_FROM_M + _STRIP_M, to_m + _STRIP_M, _STRIP_M):
        scan = min(int(np.searchsorted(travel - travel[0], end_m)), len(travel) - 1)
        strips = site.example(located, scan).strips
        if not live.size:
            live, stored = np.zeros((2, strips.live.shape[1], len(distance)))
        at = strips.distance_m - travel[0]
        here = (distance > end_m - _STRIP_M - 1e-9) & (distance <= end_m + 1e-9)
        for target, source in ((live, strips.live), (stored, strips.baseline)):
            for sample in range(len(target)):
                target[sample, here] = np.interp(distance[here], at, source[:, sample])
    return _Radargram(live, stored, distance)


def draw_hero(site: DemoSite, path: Path) -> None:
    """Draw the live radargram growing above the map, the fix and its error; then other ground, refused."""
    good = _radargram(site, site.live, _TO_M)
    bad = _radargram(site, site.impostor, _IMPOSTOR_TO_M)
    frames, durations = [], []
    with rc_context(moving_style()):
        for number, (located, view, to_m) in enumerate(
            ((site.live, good, _TO_M), (site.impostor, bad, _IMPOSTOR_TO_M))
        ):
            seconds = 5.5 if number == 0 else 2.5
            figure = _Hero(located, view.live, good.stored, good.distance_m)
            for end_m in np.linspace(_FROM_M + 3.0, to_m - 0.1, round(seconds * _RATE_HZ)):
                frames.append(figure.at(float(end_m)))
                durations.append(1000 // _RATE_HZ)
            durations[-1] = _LAST_MS
    write_moving(frames, durations, path)


class _Hero:
    """One drive's frames."""

    def __init__(
        self,
        located: Located,
        live: Float[np.ndarray, "sample place"],
        stored: Float[np.ndarray, "sample place"],
        distance_m: Float[np.ndarray, " place"],
    ) -> None:
        self._located = located
        self._impostor = located.result.impostor
        self._live = np.full(stored.shape, np.nan)
        self._live[:, : live.shape[1]] = live
        self._distance_m = distance_m
        self._error_m = errors_m(located)
        prior, truth = located.drive.track.pose, located.drive.truth
        assert truth is not None
        self._prior_m = np.hypot(*(prior - truth)[:, :2].T)
        self._figure = Figure(figsize=(10.0, 6.7), dpi=96)
        extent = (distance_m[0], distance_m[-1], 1.0, 0.0)
        above = self._figure.add_axes((0.02, 0.575, 0.96, 0.275))
        below = self._figure.add_axes((0.02, 0.215, 0.96, 0.275))
        for axes in (above, below):
            axes.set_xticks([])
            axes.set_yticks([])
            axes.set_facecolor("#f4f4f4")
        self._image = above.imshow(self._live, cmap="gray", vmin=-2.2, vmax=2.2, extent=extent, aspect="auto")
        below.imshow(stored, cmap="gray", vmin=-2.2, vmax=2.2, extent=extent, aspect="auto")
        self._boxes = [Rectangle((0, 0.012), 1, 0.976, fill=False, linewidth=4.0) for _ in range(2)]
        for axes, rectangle in zip((above, below), self._boxes, strict=True):
            axes.add_patch(rectangle)
        for axes in (above, below):
            axes.set_xlim(distance_m[0], distance_m[-1])
            axes.set_ylim(1.0, 0.0)
        where = "on another road" if self._impostor else "on the mapped road"
        self._figure.text(0.02, 0.875, f"Live radargram, {where}", va="bottom", fontweight="bold")
        self._figure.text(
            0.98,
            0.885,
            "simulated",
            va="bottom",
            ha="right",
            bbox={"facecolor": "white", "edgecolor": MUTED, "pad": 6.0},
        )
        self._figure.text(0.02, 0.510, "Map, recorded earlier", va="bottom", fontweight="bold")
        self._code = self._figure.text(0.02, 0.105, "", va="center", fontweight="bold", fontsize=34.0)
        self._more = self._figure.text(0.98, 0.105, "", va="center", ha="right", linespacing=1.25)

    def at(self, end_m: float) -> Image.Image:
        """The frame after a distance."""
        travel = self._located.result.distance_m
        scan = int(np.searchsorted(travel, end_m))
        shown = np.where(self._distance_m <= end_m, self._live, np.nan)
        self._image.set_data(np.ma.masked_invalid(shown))
        code = str(self._located.result.code[scan])
        ok = code == "ok"
        for number, rectangle in enumerate(self._boxes):
            rectangle.set_x(end_m - 2.0)
            rectangle.set_width(2.0)
            rectangle.set_edgecolor(GREEN if ok else VERMILLION)
            rectangle.set_linestyle("-" if ok or number == 0 else (0, (2, 1.5)))
        self._code.set_color("#00734f" if ok else "#b34700")
        if ok:
            self._code.set_text(f"ok: error {100.0 * self._error_m[scan]:.0f} cm")
            self._more.set_text(f"GNSS/INS alone:\nerror {100.0 * self._prior_m[scan]:.0f} cm")
        else:
            self._code.set_text(code)
            self._code.set_fontsize(34.0)
            self._more.set_text("rejected:\nno position")
        return _frame(self._figure)


# Evidence: the score over the search region, for more and more ground.

_WINDOWS_M = (0.0, 0.25, 0.5, 1.0, 2.0, 4.0)
_HOLD_MS = 1000
_START_M = 5.6


def draw_evidence(site: DemoSite, path: Path) -> None:
    """Draw the score over the search region beside the probability of a false match, for growing windows."""
    found: list[tuple[FixExample, float, str]] = []
    for window_m in _WINDOWS_M:
        located = site.wet(window_m=window_m)
        travel = located.result.distance_m
        scan = int(np.searchsorted(travel, _START_M + window_m))
        p_false = float(located.result.p_false[scan])
        found.append((site.example(located, scan), p_false, str(located.result.code[scan])))
        risk = located.options.risk
    frames = []
    with rc_context(moving_style()):
        for number in range(len(found)):
            figure = Figure(figsize=(10.0, 6.7), dpi=96)
            surface = figure.add_axes((0.015, 0.09, 0.49, 0.72))
            curve = figure.add_axes((0.665, 0.17, 0.315, 0.64))
            _draw_scores(surface, found[number][0])
            _draw_curve(curve, [p for _, p, _ in found], number, risk)
            code = found[number][2]
            length = _WINDOWS_M[number]
            seen = "one scan" if length == 0.0 else f"{length:g} m of ground"
            figure.text(0.015, 0.90, f"{seen}:", va="center", fontweight="bold", fontsize=28.0)
            figure.text(
                0.42,
                0.90,
                code,
                va="center",
                fontweight="bold",
                fontsize=28.0,
                color="#00734f" if code == "ok" else "#b34700",
            )
            figure.text(
                0.985,
                0.955,
                "simulated",
                va="center",
                ha="right",
                bbox={"facecolor": "white", "edgecolor": MUTED, "pad": 6.0},
            )
            frames.append(_frame(figure))
    write_moving(frames, [_HOLD_MS] * (len(frames) - 1) + [3 * _HOLD_MS], path)


def _draw_scores(axes: Axes, example: FixExample) -> None:
    axes.set_facecolor(UNSCORED)
    surface = example.surface
    best = np.nanmax(surface.score)
    axes.imshow(
        (surface.score / best).T,
        cmap=colormaps[CORRELATION_MAP].with_extremes(bad=UNSCORED),
        vmin=0.0,
        vmax=1.0,
        origin="lower",
        aspect="equal",
        interpolation="nearest",
        extent=(*outer_edges(surface.along_m), *outer_edges(surface.cross_m)),
    )
    assert example.truth_m is not None
    axes.plot(*example.truth_m, "o", color="none", markeredgecolor=VERMILLION, markersize=34, mew=4.0)
    axes.set_xticks([])
    axes.set_yticks([])
    axes.set_xlabel("match score; circle: true place")


def _draw_curve(axes: Axes, p_false: list[float], number: int, risk: float) -> None:
    shown = np.maximum(p_false, 1e-16)
    axes.axhspan(1e-17, risk, color=tint(GREEN, 0.18), linewidth=0)
    axes.plot(_WINDOWS_M, shown, color="#d5d5d5", linewidth=4.0)
    axes.plot(_WINDOWS_M[: number + 1], shown[: number + 1], color=INK, linewidth=4.0)
    axes.plot(_WINDOWS_M[number], shown[number], "o", color=ORANGE, markeredgecolor=INK, markersize=20)
    axes.set_yscale("log")
    axes.set_ylim(1e-17, 10.0)
    axes.set_yticks([1.0, 1e-4, 1e-8, 1e-12, 1e-16])
    axes.minorticks_off()
    axes.set_xlim(-0.2, 4.3)
    axes.set_xticks([0, 2, 4])
    axes.set_xlabel("ground seen (m)")
    axes.set_title("p_false", fontweight="bold")
    axes.text(-0.05, 3e-16, "below the\nrisk: ok", ha="left", va="center", color="#00573c")
