"""A self-contained page of pictures with axes that can be zoomed and moved by mouse, finger or keys."""

import base64
import io
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from html import escape
from pathlib import Path

import numpy as np
from jaxtyping import Float, UInt8
from matplotlib import colormaps
from matplotlib.colors import to_rgb
from matplotlib.image import imsave

from lgprjax.formats.store import atomic_output
from lgprjax.radar import WAVE_SPEED_M_PER_NS, Radargram
from lgprjax.report.radargram import (
    NO_TRACE,
    LinePlan,
    LineView,
    MapStations,
    amplitude_limit,
    caption_of,
    caption_of_slices,
    depth_label,
    level_limits,
    slice_map,
    slice_title,
)
from lgprjax.report.results import CODES, LEAST_P, DriveResult, track_errors
from lgprjax.report.style import AMPLITUDE_MAP, BLUE, CODE_COLOURS, CORRELATION_MAP, FAINT, INK, outer_edges
from lgprjax.report.summary import WRONG_M

_MOST_COLUMNS, _MOST_ROWS = 2400, 1200
_MOST_POINTS = 4000


@dataclass(frozen=True, kw_only=True)
class _Panel:
    """A picture and its axes; ``lines`` are x and y of curves with their colours, ``points`` x and y of the scans."""

    title: str
    labels: tuple[str, str]
    x: tuple[float, float]
    y: tuple[float, float]
    pixels: UInt8[np.ndarray, "row column 4"] | None = None
    lines: tuple[tuple[str, np.ndarray, np.ndarray], ...] = ()
    points: tuple[np.ndarray, np.ndarray] | None = None
    depth_m_per_ns: float | None = None
    equal: bool = False
    contrast: bool = False


def write_line_page(view: LineView, path: str | Path, *, force: bool = False) -> None:
    """Write the radargrams of a line, and their plan, as a page that can be zoomed.

    Very long lines are averaged down to 2400 columns, and 1200 rows, a picture.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    panels = [_radargram_panel(each, view) for each in view.radargrams]
    caption = caption_of(view)
    if view.plan is not None:
        panels.append(_plan_panel(view.plan))
        caption += f" Plan: metres from {view.plan.origin}."
    _write(path, view.title, caption, panels, force)


def write_map_page(
    stations: MapStations,
    path: str | Path,
    *,
    wave_speed_m_per_ns: float = WAVE_SPEED_M_PER_NS,
    speed_is: str = "assumed",
    force: bool = False,
) -> None:
    """Write the slices of a map as a page that can be zoomed.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    slices = slice_map(stations)
    x, y = outer_edges(slices.x_m), outer_edges(slices.y_m)
    low, high = level_limits(slices.level)
    panels = []
    for number, level in enumerate(slices.level):
        shade = np.clip((level - low) / (high - low), 0.0, 1.0)
        pixels = colormaps[CORRELATION_MAP](np.nan_to_num(shade), bytes=True)
        pixels[~np.isfinite(level)] = 0  # transparent
        title = slice_title(stations, number, wave_speed_m_per_ns)
        panels.append(
            _Panel(title=title, labels=slices.labels, x=x, y=(y[1], y[0]), pixels=pixels[::-1], equal=slices.equal)
        )
    caption = caption_of_slices(stations, slices, wave_speed_m_per_ns, speed_is)
    _write(path, f"Map {stations.name}", caption, panels, force)


_MARKS = {
    "ok": "disc",
    "low_correlation": "cross",
    "ambiguous": "square",
    "edge": "up",
    "off_map": "down",
    "low_overlap": "ring",
    "non_finite": "plus",
}
"""Shapes of codes, which distinguish them without colours."""
_MOST_SCANS = 20_000


def write_drive_page(result: DriveResult, path: str | Path, *, force: bool = False) -> None:
    """Write a registered drive as a page that can be zoomed, with the numbers of the scan that is pointed at.

    Scans without a fix of their own are left out; a very long drive is thinned, except for wrong ok fixes.

    Raises:
        InputError: the file exists (without ``force``) or cannot be written.
    """
    tried = np.flatnonzero(result.tried)
    step = max(1, -(-len(tried) // _MOST_SCANS))
    errors = track_errors(result)
    wrong = result.ok & (np.hypot(*errors) > WRONG_M) & result.has_truth
    shown = np.union1d(tried[::step], np.flatnonzero(wrong))
    code = result.code[shown]
    present = [label for label in CODES if (result.code[tried] == label).any()]
    evidence = -np.log10(np.maximum(result.p_false[shown], LEAST_P))
    distance_m = result.distance_m[shown]
    against = "the truth" if result.has_truth else "the prior"
    tracks = [(FAINT, track[:, 0], track[:, 1]) for track in map(_thinned_track, result.baseline_tracks)]
    if result.truth_east_m is not None and result.truth_north_m is not None:
        truth = np.stack([result.truth_east_m, result.truth_north_m], axis=1)
        tracks.append((INK, *_thinned_track(truth[np.isfinite(truth).all(axis=1)]).T))
    panels = [
        _scan_panel("plan", ("east (m)", "north (m)"), result.east_m[shown], result.north_m[shown], tracks),
        _scan_panel(f"across, from {against}", ("distance (m)", "to the left (m)"), distance_m, errors.cross_m[shown]),
        _scan_panel(f"along, from {against}", ("distance (m)", "forward (m)"), distance_m, errors.along_m[shown]),
        _scan_panel("correlation", ("distance (m)", "correlation"), distance_m, result.correlation[shown]),
        _scan_panel("margin over the runner-up", ("distance (m)", "margin"), distance_m, result.margin[shown]),
        _scan_panel("evidence", ("distance (m)", "−log₁₀ p_false"), distance_m, evidence),
    ]
    columns = (
        ("scan", shown.astype(float), 0, ""),
        ("time", result.time_s[shown], 2, " s"),
        ("distance", distance_m, 2, " m"),
        ("correlation", result.correlation[shown], 3, ""),
        ("margin", result.margin[shown], 3, ""),
        ("sigma along", 100.0 * result.sigma_along_m[shown], 1, " cm"),
        ("sigma across", 100.0 * result.sigma_cross_m[shown], 1, " cm"),
    )
    scans = {
        "code": [present.index(str(each)) for each in code],
        "codes": [[each, CODE_COLOURS[each], _MARKS[each], int((result.code == each).sum())] for each in present],
        "columns": [[name, _rounded(values, digits), unit, digits] for name, values, digits, unit in columns],
    }
    lines = "Grey: baselines of the map." + (" Black: the truth." if result.has_truth else "")
    caption = f"Plan: metres from {result.origin[0]:.7f}°, {result.origin[1]:.7f}°. {lines}"
    if step > 1:
        caption += (
            f" One in {step} of {len(tried)} scans is drawn, and every ok fix more than {WRONG_M:g} m from the truth; "
            "the counts are of all."
        )
    _write(path, f"{result.name} on {result.map_name}", caption, [each for each in panels if each], force, scans)


def _scan_panel(
    title: str,
    labels: tuple[str, str],
    x: Float[np.ndarray, " scan"],
    y: Float[np.ndarray, " scan"],
    lines: Sequence[tuple[str, np.ndarray, np.ndarray]] = (),
) -> _Panel | None:
    """A panel of one value per scan; None where no scan has one."""
    known = np.isfinite(x) & np.isfinite(y)
    if not known.any():
        return None
    equal = bool(lines)
    spans = []
    for values in (x[known], y[known]):
        low, high = float(values.min()), float(values.max())
        room = 0.05 * max(high - low, 1.0 if equal else 1e-3)
        spans.append((low - room, high + room))
    (left, right), (low, high) = spans
    points = (np.where(known, x, np.nan), np.where(known, y, np.nan))
    return _Panel(
        title=title, labels=labels, x=(left, right), y=(high, low), lines=tuple(lines), points=points, equal=equal
    )


def _thinned_track(track_m: Float[np.ndarray, "place 2"]) -> Float[np.ndarray, "kept 2"]:
    return track_m[:: max(1, -(-len(track_m) // _MOST_POINTS))]


def _rounded(values: Float[np.ndarray, " scan"], digits: int) -> list[float | int | None]:
    return [
        None if not np.isfinite(value) else int(value) if digits == 0 else round(float(value), digits)
        for value in values
    ]


def _radargram_panel(radargram: Radargram, view: LineView) -> _Panel:
    limit = amplitude_limit(radargram)
    amplitude = _thinned(radargram.amplitude)
    pixels = colormaps[AMPLITUDE_MAP](np.nan_to_num(0.5 + 0.5 * amplitude.T / limit, nan=0.5), bytes=True)
    gap = np.asarray([*to_rgb(NO_TRACE), 1.0]) * 255.0
    pixels[np.isnan(amplitude.T)] = gap.astype(np.uint8)
    return _Panel(
        title=radargram.name,
        labels=("distance along the line (m)" if radargram.in_metres else "trace number", "two-way travel time (ns)"),
        x=outer_edges(radargram.along),
        y=outer_edges(radargram.time_ns),
        pixels=pixels,
        depth_m_per_ns=view.wave_speed_m_per_ns / 2.0,
        contrast=True,
    )


def _thinned(amplitude: Float[np.ndarray, "trace sample"]) -> Float[np.ndarray, "column row"]:
    """Means of neighbours, as many as make the picture small enough; NaN if one of them is."""
    for axis, most in ((0, _MOST_COLUMNS), (1, _MOST_ROWS)):
        together = -(-amplitude.shape[axis] // most)
        starts = np.arange(0, amplitude.shape[axis], together)
        counts = np.diff(np.append(starts, amplitude.shape[axis]))
        shape = (-1, 1) if axis == 0 else (1, -1)
        amplitude = np.add.reduceat(amplitude, starts, axis=axis) / counts.reshape(shape)
    return amplitude


def _plan_panel(plan: LinePlan) -> _Panel:
    every = -(-len(plan.east_m) // _MOST_POINTS)
    order = sorted(range(plan.east_m.shape[1]), key=lambda channel: channel in plan.shown)
    lines = tuple(
        (BLUE if channel in plan.shown else FAINT, plan.east_m[::every, channel], plan.north_m[::every, channel])
        for channel in order
    )
    margin_m = 0.05 * max(float(np.ptp(plan.east_m)), float(np.ptp(plan.north_m)), 1.0)
    x = (float(plan.east_m.min()) - margin_m, float(plan.east_m.max()) + margin_m)
    y = (float(plan.north_m.max()) + margin_m, float(plan.north_m.min()) - margin_m)
    return _Panel(title="plan", labels=("east (m)", "north (m)"), x=x, y=y, lines=lines, equal=True)


def _write(
    path: str | Path,
    title: str,
    caption: str,
    panels: Sequence[_Panel],
    force: bool,
    scans: Mapping[str, object] | None = None,
) -> None:
    told = {"ink": INK, "panels": [_as_json(panel) for panel in panels], "scans": scans}
    data = json.dumps(told).replace("</", "<\\/")
    help_text = _HELP if scans is None else f"{_HELP} {_HELP_SCANS}"
    with atomic_output(path, force) as temporary:
        temporary.write_text(
            '<!doctype html>\n<html lang="en">\n<head>\n<meta charset="utf-8">\n'
            '<meta name="viewport" content="width=device-width, initial-scale=1">\n'
            f"<title>{escape(title)}</title>\n<style>{_STYLE}</style>\n</head>\n<body>\n<main>\n"
            f"<h1>{escape(title)}</h1>\n<p>{help_text}</p>\n<noscript><p>This page needs JavaScript.</p></noscript>\n"
            f'<div id="panels"></div>\n<p class="soft">{escape(caption)}</p>\n</main>\n'
            f'<script type="application/json" id="data">{data}</script>\n<script>{_SCRIPT}</script>\n'
            "</body>\n</html>\n",
            encoding="utf-8",
            newline="\n",
        )


def _as_json(panel: _Panel) -> dict[str, object]:
    source = None
    if panel.pixels is not None:
        png = io.BytesIO()
        imsave(png, panel.pixels, format="png")
        source = "data:image/png;base64," + base64.b64encode(png.getvalue()).decode("ascii")
    return {
        "title": panel.title,
        "labels": panel.labels,
        "x": panel.x,
        "y": panel.y,
        "src": source,
        "lines": [[colour, np.round(x, 3).tolist(), np.round(y, 3).tolist()] for colour, x, y in panel.lines],
        "points": None if panel.points is None else [_numbers(values) for values in panel.points],
        "depth": panel.depth_m_per_ns,
        "depthLabel": "" if panel.depth_m_per_ns is None else depth_label(2.0 * panel.depth_m_per_ns),
        "equal": panel.equal,
        "contrast": panel.contrast,
    }


def _numbers(values: np.ndarray) -> list[float | None]:
    return [round(float(value), 3) if np.isfinite(value) else None for value in values]


_HELP = (
    "Mouse wheel, or + and −: zoom; with Shift along the line only. Drag, or arrow keys: move. Double click, or 0: "
    "show everything. Touch screen: one finger moves along the line, two fingers zoom and move."
)
_HELP_SCANS = (
    "Point at a scan, or use n and p to step through the scans: its values are shown above the picture, and a ring "
    "marks it in every picture."
)
_STYLE = """
:root { color-scheme: light dark; --ground: #fff; --ink: #222222; --soft: #595959; --frame: #6b6b6b;
  --focus: #0057a3; }
@media (prefers-color-scheme: dark) {
  :root { --ground: #16181a; --ink: #e4e4e4; --soft: #b0b0b0; --frame: #8f8f8f; --focus: #7cc4ff; }
}
body { margin: 0; background: var(--ground); color: var(--ink);
  font: 1rem/1.5 system-ui, -apple-system, "Segoe UI", "DejaVu Sans", sans-serif; }
main { max-width: 80rem; margin: 0 auto; padding: 1rem 1rem 3rem; }
h1 { font-size: 1.4rem; margin: 0 0 0.4rem; }
h2 { font-size: 1.05rem; margin: 0; }
p { max-width: 60rem; margin: 0.4rem 0; }
.soft { color: var(--soft); font-size: 0.92rem; }
.bar { display: flex; flex-wrap: wrap; gap: 0.3rem 1.2rem; align-items: center; margin-top: 1.2rem; }
output { font-variant-numeric: tabular-nums; color: var(--soft); min-width: min(18rem, 100%); min-height: 1.5em; }
.legend { display: flex; flex-wrap: wrap; gap: 0.2rem 1.2rem; list-style: none; padding: 0; margin: 0.8rem 0 0; }
.legend canvas { width: 16px; height: 16px; display: inline-block; vertical-align: -3px; }
canvas { width: 100%; display: block; touch-action: pan-y; cursor: crosshair; }
canvas:focus-visible { outline: 2px solid var(--focus); }
"""
_SCRIPT = """
"use strict";
const LEFT = 66, TOP = 8, BOTTOM = 46;
function ticks(a, b, room) {
  const low = Math.min(a, b), high = Math.max(a, b), rough = (high - low) / Math.max(2, room);
  const ten = Math.pow(10, Math.floor(Math.log10(rough)));
  const step = [1, 2, 2.5, 5, 10].map(k => k * ten).find(k => k >= rough);
  const digits = Math.max(0, Math.min(6, -Math.floor(Math.log10(step) + 1e-9) + (step / ten === 2.5 ? 1 : 0)));
  const found = [];
  for (let n = Math.ceil(low / step - 1e-9); n * step <= high + 1e-9 * step; n++)
    found.push([n * step, (n === 0 ? 0 : n * step).toFixed(digits)]);
  return found;
}
const data = JSON.parse(document.getElementById("data").textContent), scans = data.scans, all = [];
const style = getComputedStyle(document.documentElement), tone = name => style.getPropertyValue(name).trim();
// What the house draws in its ink has that of the page, which is dark where the reader's system is.
const shade = colour => colour === data.ink ? tone("--ink") : colour;
let picked = null;
const MARKS = {
  disc: (c, x, y, r) => { c.beginPath(); c.arc(x, y, r, 0, 7); c.fill(); },
  cross: (c, x, y, r) => { c.beginPath(); c.moveTo(x - r, y - r); c.lineTo(x + r, y + r);
    c.moveTo(x - r, y + r); c.lineTo(x + r, y - r); c.stroke(); },
  square: (c, x, y, r) => c.strokeRect(x - r, y - r, 2 * r, 2 * r),
  ring: (c, x, y, r) => { c.beginPath(); c.arc(x, y, r, 0, 7); c.stroke(); },
  up: (c, x, y, r) => { c.beginPath(); c.moveTo(x, y - r); c.lineTo(x + r, y + r); c.lineTo(x - r, y + r);
    c.closePath(); c.stroke(); },
  down: (c, x, y, r) => { c.beginPath(); c.moveTo(x, y + r); c.lineTo(x + r, y - r); c.lineTo(x - r, y - r);
    c.closePath(); c.stroke(); },
  plus: (c, x, y, r) => { c.beginPath(); c.moveTo(x - r, y); c.lineTo(x + r, y); c.moveTo(x, y - r);
    c.lineTo(x, y + r); c.stroke(); },
};
function pick(n) { picked = n; for (const each of all) each(); }
function legend() {
  const list = document.createElement("ul"); list.className = "legend";
  scans.codes.forEach(([name, colour, mark, count]) => {
    const entry = document.createElement("li"), sign = document.createElement("canvas");
    const dots = window.devicePixelRatio || 1;
    sign.width = sign.height = 16 * dots; sign.setAttribute("aria-hidden", "true");
    const c = sign.getContext("2d"); c.scale(dots, dots); c.lineWidth = 1.6;
    const paint = () => {
      c.clearRect(0, 0, 16, 16); c.fillStyle = c.strokeStyle = shade(colour); MARKS[mark](c, 8, 8, 4.5);
    };
    all.push(paint); paint(); entry.append(sign, " " + name + " (" + count + ")"); list.append(entry);
  });
  document.getElementById("panels").append(list);
}
function show(panel) {
  const box = document.createElement("section"), bar = document.createElement("div");
  const head = document.createElement("h2"), said = document.createElement("output");
  const canvas = document.createElement("canvas");
  bar.className = "bar"; head.textContent = panel.title; bar.append(head);
  canvas.tabIndex = 0; canvas.setAttribute("role", "img");
  canvas.setAttribute("aria-label", panel.title + ": " + panel.labels[1] + " over " + panel.labels[0]);
  let contrast = 1;
  if (panel.contrast) {
    const label = document.createElement("label"), slide = document.createElement("input");
    slide.type = "range"; slide.min = "-1"; slide.max = "2"; slide.step = "0.1"; slide.value = "0";
    slide.addEventListener("input", () => { contrast = Math.pow(2, Number(slide.value)); draw(); });
    label.append("contrast ", slide); bar.append(label);
  }
  if (document.querySelector("output")) said.setAttribute("aria-live", "off");
  bar.append(said); box.append(bar, canvas);
  document.getElementById("panels").append(box);
  const context = canvas.getContext("2d"), RIGHT = panel.depth ? 66 : 24;
  let view, wide = 0, high = 0;
  const image = new Image();
  function whole() {
    view = { x0: panel.x[0], x1: panel.x[1], y0: panel.y[0], y1: panel.y[1] };
    if (!panel.equal) return;
    const sx = Math.abs(view.x1 - view.x0) / wide, sy = Math.abs(view.y1 - view.y0) / high, s = Math.max(sx, sy);
    const mx = (view.x0 + view.x1) / 2, my = (view.y0 + view.y1) / 2;
    const dx = Math.sign(view.x1 - view.x0) * s * wide / 2, dy = Math.sign(view.y1 - view.y0) * s * high / 2;
    view = { x0: mx - dx, x1: mx + dx, y0: my - dy, y1: my + dy };
  }
  const px = x => LEFT + (x - view.x0) / (view.x1 - view.x0) * wide;
  const py = y => TOP + (y - view.y0) / (view.y1 - view.y0) * high;
  const xp = p => view.x0 + (p - LEFT) / wide * (view.x1 - view.x0);
  const yp = p => view.y0 + (p - TOP) / high * (view.y1 - view.y0);
  function size() {
    const dots = window.devicePixelRatio || 1, outer = canvas.clientWidth;
    const tall = Math.round(Math.max(240, Math.min(window.innerHeight * 0.72, outer * 0.5)));
    canvas.style.height = tall + "px";
    canvas.width = Math.round(outer * dots); canvas.height = Math.round(tall * dots);
    context.setTransform(dots, 0, 0, dots, 0, 0);
    wide = Math.max(40, outer - LEFT - RIGHT); high = tall - TOP - BOTTOM;
  }
  function draw() {
    const c = context, right = LEFT + wide, bottom = TOP + high;
    c.clearRect(0, 0, wide + LEFT + RIGHT, high + TOP + BOTTOM);
    c.save(); c.beginPath(); c.rect(LEFT, TOP, wide, high); c.clip();
    if (panel.src && image.complete) {
      const x0 = px(panel.x[0]), x1 = px(panel.x[1]), y0 = py(panel.y[0]), y1 = py(panel.y[1]);
      c.filter = contrast === 1 ? "none" : "contrast(" + contrast + ")";
      c.imageSmoothingEnabled = Math.abs(x1 - x0) < 6 * image.width;
      c.drawImage(image, x0, y0, x1 - x0, y1 - y0);
      c.filter = "none";
    }
    if (panel.depth && (view.y0 < 0) && (view.y1 > 0)) {
      c.strokeStyle = "#D55E00"; c.lineWidth = 1; stroke(LEFT, py(0), right, py(0));
    }
    for (const [colour, xs, ys] of panel.lines) {
      c.strokeStyle = shade(colour); c.lineWidth = 1.5; c.beginPath();
      xs.forEach((x, n) => n ? c.lineTo(px(x), py(ys[n])) : c.moveTo(px(x), py(ys[n])));
      c.stroke();
    }
    if (panel.points) {
      const [xs, ys] = panel.points;
      c.lineWidth = 1.2;
      xs.forEach((x, n) => {
        if (x === null || ys[n] === null) return;
        const [, colour, mark] = scans.codes[scans.code[n]];
        c.fillStyle = c.strokeStyle = shade(colour); MARKS[mark](c, px(x), py(ys[n]), 3);
      });
      if (picked !== null && xs[picked] !== null && ys[picked] !== null) {
        c.strokeStyle = tone("--ink"); c.lineWidth = 2.5; MARKS.ring(c, px(xs[picked]), py(ys[picked]), 8);
      }
    }
    c.restore();
    if (panel.points) said.textContent = picked === null ? "" : scans.columns.map(
      ([name, values, unit, digits]) => name + " " +
        (values[picked] === null ? "–" : values[picked].toFixed(digits) + unit)).join(", ") +
      ", code " + scans.codes[scans.code[picked]][0];
    c.strokeStyle = tone("--frame"); c.fillStyle = tone("--ink"); c.lineWidth = 1; c.strokeRect(LEFT, TOP, wide, high);
    c.font = "12px system-ui, sans-serif"; c.textAlign = "center"; c.textBaseline = "top";
    for (const [x, text] of ticks(view.x0, view.x1, wide / 90)) {
      stroke(px(x), bottom, px(x), bottom + 5); c.fillText(text, px(x), bottom + 8);
    }
    c.fillText(panel.labels[0], LEFT + wide / 2, bottom + 28);
    c.textAlign = "right"; c.textBaseline = "middle";
    for (const [y, text] of ticks(view.y0, view.y1, high / 50)) {
      stroke(LEFT, py(y), LEFT - 5, py(y)); c.fillText(text, LEFT - 8, py(y));
    }
    sideways(panel.labels[1], 12);
    if (!panel.depth) return;
    c.textAlign = "left";
    for (const [depth, text] of ticks(Math.max(0, view.y0 * panel.depth), view.y1 * panel.depth, high / 50)) {
      const y = py(depth / panel.depth);
      stroke(right, y, right + 5, y); c.fillText(text, right + 8, y);
    }
    sideways(panel.depthLabel, right + RIGHT - 12);
  }
  function stroke(x0, y0, x1, y1) {
    context.beginPath(); context.moveTo(x0, y0); context.lineTo(x1, y1); context.stroke();
  }
  function sideways(text, x) {
    context.save(); context.translate(x, TOP + high / 2); context.rotate(-Math.PI / 2);
    context.textAlign = "center"; context.textBaseline = "middle"; context.fillText(text, 0, 0); context.restore();
  }
  function zoom(factor, x, y, alongOnly) {
    const cx = xp(x), cy = yp(y);
    view.x0 = cx + (view.x0 - cx) * factor; view.x1 = cx + (view.x1 - cx) * factor;
    if (!alongOnly || panel.equal) { view.y0 = cy + (view.y0 - cy) * factor; view.y1 = cy + (view.y1 - cy) * factor; }
    draw();
  }
  function step_scan(by) {
    if (scans) pick(picked === null ? 0 : Math.max(0, Math.min(scans.code.length - 1, picked + by)));
  }
  function move(dx, dy) {
    const x = dx / wide * (view.x1 - view.x0), y = dy / high * (view.y1 - view.y0);
    view.x0 -= x; view.x1 -= x; view.y0 -= y; view.y1 -= y;
    draw();
  }
  canvas.addEventListener("wheel", event => {
    event.preventDefault();
    const turned = event.deltaY || event.deltaX;
    zoom(turned > 0 ? 1.25 : 0.8, event.offsetX, event.offsetY, event.shiftKey);
  }, { passive: false });
  const held = new Map();
  canvas.addEventListener("pointerdown", event => {
    canvas.setPointerCapture(event.pointerId); held.set(event.pointerId, [event.offsetX, event.offsetY]);
  });
  const apart = () => { const [a, b] = [...held.values()]; return Math.hypot(a[0] - b[0], a[1] - b[1]); };
  const middle = () => { const [a, b] = [...held.values()]; return [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]; };
  canvas.addEventListener("pointermove", event => {
    const place = [event.offsetX, event.offsetY], before = held.get(event.pointerId);
    if (before && held.size === 2) {
      const was = apart(), from = middle(); held.set(event.pointerId, place);
      const to = middle();
      move(to[0] - from[0], to[1] - from[1]);
      if (apart() > 0) zoom(was / apart(), to[0], to[1], false);
    } else if (before) {
      held.set(event.pointerId, place); move(place[0] - before[0], place[1] - before[1]);
    }
    if (panel.points) {
      const [xs, ys] = panel.points;
      let best = null, near = 196;
      xs.forEach((x, n) => {
        if (x === null || ys[n] === null) return;
        const d = (px(x) - place[0]) ** 2 + (py(ys[n]) - place[1]) ** 2;
        if (d < near) { near = d; best = n; }
      });
      if (best !== null && best !== picked) pick(best);
      return;
    }
    const x = xp(place[0]), y = yp(place[1]);
    const unit = panel.labels[0].includes("(m)") ? " m" : "";
    said.textContent = panel.depth ? x.toFixed(unit ? 2 : 0) + unit + ", " + y.toFixed(2) + " ns, depth " +
      (y * panel.depth).toFixed(2) + " m" : x.toFixed(2) + " m, " + y.toFixed(2) + " m";
  });
  for (const end of ["pointerup", "pointercancel"]) canvas.addEventListener(end, e => held.delete(e.pointerId));
  canvas.addEventListener("dblclick", () => { whole(); draw(); });
  canvas.addEventListener("keydown", event => {
    const mx = LEFT + wide / 2, my = TOP + high / 2, step = 60;
    const act = {
      "+": () => zoom(0.8, mx, my, false), "=": () => zoom(0.8, mx, my, false), "-": () => zoom(1.25, mx, my, false),
      "0": () => { whole(); draw(); }, ArrowLeft: () => move(step, 0), ArrowRight: () => move(-step, 0),
      n: () => step_scan(1), p: () => step_scan(-1), ArrowUp: () => move(0, step), ArrowDown: () => move(0, -step),
    }[event.key];
    if (act && !event.ctrlKey && !event.metaKey) { event.preventDefault(); act(); }
  });
  window.addEventListener("resize", () => { size(); if (panel.equal) whole(); draw(); });
  all.push(draw); size(); whole();
  image.addEventListener("load", draw);
  if (panel.src) image.src = panel.src;
  draw();
}
if (scans) legend();
data.panels.forEach(show);
matchMedia("(prefers-color-scheme: dark)").addEventListener("change", () => all.forEach(each => each()));
"""
