"""Charts of accuracy, drawn from the records of docs/records."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import chi2

from pictures.demo import DemoSite, errors_m
from pictures.style import BLUE, GAP, GREEN, INK, ORANGE, VERMILLION, chart, mark_simulated

RECORDS = Path(__file__).parents[1] / "docs" / "records"


def _record(name: str) -> dict[str, Any]:
    found: dict[str, Any] = json.loads((RECORDS / f"{name}.json").read_text(encoding="utf-8"))
    return found


def _values(name: str) -> dict[str, Any]:
    return {record["key"]: record["value"] for record in _record(name)["records"]}


_CONDITIONS = {
    "clear, 126 Hz": "clear, 126 scans/s",
    "clear": "clear, 42 scans/s",
    "snow": "snow",
    "rain, drifting scale": "rain",
    "GNSS 2 m": "GNSS wanders 2 m",
    "GNSS off": "GNSS lost",
    "rebuilt road": "200 m rebuilt",
}


def draw_accuracy_weather(path: Path) -> None:
    """Draw errors across the route in seven simulated conditions, from docs/records/closed-loop.json."""
    drives = _record("closed-loop")["drives"]
    names = list(_CONDITIONS)[::-1]
    with chart(path, 8.6) as figure:
        axes = figure.subplots()
        for number, name in enumerate(names):
            of_name = [drive for drive in drives if drive["name"] == name]
            for key, mark, colour in (("gnss_ins_cross_rms_m", "s", ORANGE), ("located_cross_rms_m", "o", BLUE)):
                values = 100.0 * np.array([drive[key] for drive in of_name])
                axes.plot(values, np.full(len(values), number), mark, color=colour, markeredgecolor=INK, markersize=12)
        axes.plot([], [], "o", color=BLUE, markeredgecolor=INK, markersize=12, label="with radar")
        axes.plot([], [], "s", color=ORANGE, markeredgecolor=INK, markersize=12, label="GNSS/INS alone")
        axes.set_xscale("log")
        axes.set_xlim(1.0, 1000.0)
        axes.set_xticks([1, 10, 100, 1000], ["1", "10", "100", "1000"])
        axes.set_yticks(range(len(names)), [_CONDITIONS[name] for name in names])
        axes.set_ylim(-0.6, len(names) - 0.4)
        axes.set_xlabel("RMS error across the route (cm)")
        axes.grid(axis="x", color=GAP)
        axes.legend(loc="lower center", bbox_to_anchor=(0.3, 1.0), ncols=2, columnspacing=1.0, handletextpad=0.1)
        mark_simulated(axes)


_SURVEYS = {
    "dune, 400 MHz: even traces on odd ones": "dune 400 MHz,\nsame line",
    "Yosemite, 50 MHz: even traces on odd ones": "Yosemite 50 MHz,\nsame line",
    "MALA utility line, 500 MHz: even traces on odd ones": "utility 500 MHz,\nsame line",
    "GPR-O even lines on odd ones, three channels": "GPR-O, even lines\non odd ones",
    "Flagogna even lines on odd ones, one channel": "Flagogna, even on\nodd, 1 channel",
    "Flagogna even lines on odd ones, eight channels": "Flagogna, even on\nodd, 8 channels",
    "Flagogna 67 on 50-66, by default": "Flagogna line\n67 on 50–66",
    "Flagogna 66 on 67-83, by default": "Flagogna line\n66 on 67–83",
    "Flagogna 68 on 50-66, by default": "Flagogna line\n68 on 50–66",
    "Flagogna 68 on 50-66, windows of 4 m": "line 68 on 50–66,\nwindows of 4 m",
    "Flagogna 69 and 70 on 50-66, by default": "Flagogna lines\n69, 70 on 50–66",
    "Hautefeuille a third of line 2 on line 1": "Hautefeuille\nline 2 on 1",
    "Flagogna 80-103 led onto 20-40: other ground": "Flagogna,\nother ground",
}


def draw_accuracy_real(path: Path) -> None:
    """Draw the shares of right, wrong and refused scans on real surveys, from docs/records/real.json."""
    values = _values("real")
    names = list(_SURVEYS)[::-1]
    with chart(path, 14.4) as figure:
        axes = figure.subplots()
        for number, name in enumerate(names):
            ok = float(values[f"{name}: `ok`"])
            right = ok * float(values[f"{name}: right, of the `ok`"] or 0.0) / 100.0
            left = 0.0
            for share, colour, hatch in (
                (right, GREEN, ""),
                (ok - right, VERMILLION, "///"),
                (100.0 - ok, "#dddddd", ""),
            ):
                axes.barh(number, share, left=left, color=colour, hatch=hatch, edgecolor="white", height=0.72)
                left += share
            axes.text(
                1.5 if ok > 30 else ok + 1.5,
                number,
                f"{ok:.1f} % ok",
                va="center",
                color="white" if ok > 30 else INK,
                fontweight="bold",
            )
        axes.set_yticks(range(len(names)), [_SURVEYS[name] for name in names])
        axes.set_xlim(0.0, 100.0)
        axes.set_xlabel("share of scans (%), real survey lines")
        for label, colour, hatch in (
            ("ok, right", GREEN, ""),
            ("ok, wrong", VERMILLION, "///"),
            ("rejected", "#dddddd", ""),
        ):
            axes.barh([-10], [0], color=colour, hatch=hatch, edgecolor="white", label=label)
        axes.set_ylim(-0.6, len(names) - 0.4)
        axes.legend(loc="lower center", bbox_to_anchor=(0.35, 1.0), ncols=3, columnspacing=1.0, handlelength=1.2)


def draw_accuracy_calibration(path: Path) -> None:
    """Draw the NEES of each synthetic site and its 99.9 % interval, from docs/records/worlds.json."""
    record = _record("worlds")
    figures = [each for each in record["figures"] if each["day"] in _NEES_DAYS and each["nees_pieces"]]
    pooled = next(each["value"] for each in record["records"] if each["key"] == "worlds/NEES")
    sites = []
    for world in sorted({each["world"] for each in figures}):
        of_world = [each for each in figures if each["world"] == world]
        pieces = np.array([each["nees_pieces"] for each in of_world], np.float64)
        mean = float(np.average([each["nees"] for each in of_world], weights=pieces))
        low, high = chi2.ppf([0.0005, 0.9995], 2.0 * pieces.sum()) / (2.0 * pieces.sum())
        sites.append((mean, low, high))
    mean, low, high = np.array(sorted(sites)).T
    at = np.arange(len(mean))
    outside = (mean < low) | (mean > high)
    with chart(path, 7.0) as figure:
        axes = figure.subplots()
        axes.vlines(at, low, high, color="#bdbdbd", linewidth=9.0, label="99.9 % interval")
        axes.axhline(1.0, color=INK, linewidth=1.6, linestyle=(0, (4, 2)))
        for chosen, mark, colour, label in ((~outside, "o", BLUE, "inside"), (outside, "D", VERMILLION, "outside")):
            name = f"{label}: {int(chosen.sum())}"
            axes.plot(at[chosen], mean[chosen], mark, color=colour, markeredgecolor=INK, markersize=9, label=name)
        axes.set_yscale("log")
        axes.set_ylim(0.3, 4.0)
        axes.set_yticks([0.5, 1.0, 2.0, 4.0], ["0.5", "1", "2", "4"])
        axes.minorticks_off()
        axes.set_xticks([])
        axes.set_xlabel(f"{len(mean)} synthetic sites, in order; together {pooled:.2f}")
        axes.set_ylabel("NEES")
        axes.legend(loc="upper left", handletextpad=0.3)
        axes.text(len(mean) - 1, 0.34, "below 1: sigmas too large", va="center", ha="right")
        mark_simulated(axes, (0.995, 1.0))


_NEES_DAYS = ("clear", "clear_beside", "snow", "rain", "gps_jump", "gps_jump_chords")


# The time scale: a wave travels more slowly in wet ground.

_SCALES = (0.98, 0.99, 1.0, 1.01, 1.02, 1.03, 1.04, 1.05, 1.06, 1.07)
_WINDOW_M = 2.0


def draw_time_scale(site: DemoSite, path: Path) -> None:
    """Draw the correlation of the wet drive with the dry map over the time scale."""
    found = [site.wet(window_m=_WINDOW_M, time_scale=scale).result for scale in _SCALES]
    chosen = site.wet(window_m=_WINDOW_M)
    correlation = [float(np.nanmedian(result.correlation)) for result in found]
    share = [100.0 * float(np.sum(result.ok) / np.sum(result.tried)) for result in found]
    auto = float(np.median(chosen.drive.time_scale[chosen.result.ok]))
    error_cm = 100.0 * float(np.median(errors_m(chosen)[chosen.result.ok]))
    with chart(path, 9.0) as figure:
        above, below = figure.subplots(2, 1, sharex=True)
        for axes, values, colour, name in (
            (above, correlation, BLUE, "correlation"),
            (below, share, GREEN, "ok fixes (%)"),
        ):
            axes.plot(_SCALES, values, "o-", color=colour, linewidth=3.0, markersize=10)
            axes.axvline(auto, color=VERMILLION, linewidth=2.4, linestyle=(0, (3, 2)))
            axes.set_ylabel(name)
            axes.grid(axis="y", color=GAP)
        above.set_ylim(0.0, 1.25 * max(correlation))
        below.set_ylim(0.0, 105.0)
        below.set_xlabel("time scale: travel time, wet / dry")
        above.set_title(f"Found along the drive: {auto:.2f}; median error {error_cm:.0f} cm", color="#9c4400")
        mark_simulated(above, (0.995, 0.16))
