"""Time zero, sign, direction and start of survey lines, from their traces and headers."""

import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import asdict, dataclass, replace
from typing import Literal, NamedTuple

import numpy as np
from jaxtyping import Float

from lgprjax.errors import InputError
from lgprjax.formats.line_layout import check_rising, own_distances_m
from lgprjax.formats.profile import Profile
from lgprjax.radar.survey_lines import DirectWave, Neighbours, compare_neighbours, echo_image, pick_direct_wave
from lgprjax.radar.time_domain import WAVE_SPEED_M_PER_NS

_LEAST_TOLERANCE = 2.0
_PERIOD_SHARE = 0.25
"""Headers agree if they are as far from the first break as those of the other lines, to a quarter of a period."""
_SAME_TIME_ZERO = 0.05
"""Share of the trace: headers that differ by more, without a direct wave, belong to other recordings."""
_CERTAIN, _SIGN_CERTAIN = 2.5, 2.0
"""Standard deviations by which a neighbour's direction and sign must lead to override the stored ones."""

_START_SIGMA_M, _PARITY = 0.2, 5.0
"""Sigma of the neighbours' starts relative to their topography, and log odds at which one of its two directions is
accepted.
"""

TimeZero = float | Literal["auto", "header"]
Reversed = Literal["auto", "odd", "even"] | Sequence[int]


@dataclass(frozen=True)
class LineFinding:
    """Findings on one line. Samples count from 0; metres as in the drive log.

    Attributes:
        file: name of the file; with its folder if several lines have the name.
        traces: number of traces read.
        cut: traces read of the total, if the file was truncated; else ``None``.
        time_zero_header, first_break, direct_wave, time_zero: time zero in samples by the header, by the direct wave's
            first break and by its strongest lobe, and the one used.
        time_zero_from: ``header``, ``first break`` or ``option``.
        sign: sign of the direct wave's first lobe; 0 if it is not detected.
        inverted: whether the traces were inverted.
        reversed: whether the order of the traces was reversed.
        direction_from: ``header``, ``neighbours``, ``topography``, ``receiver``, ``option``, or ``assumed``: as stored.
        start_m: start along the lines' direction; 0 if each trace has its own geographic position.
        start_from: ``header``, ``topography``, ``receiver``, ``neighbours`` or ``tape``.
        correlation: correlation with the previous line, at the best lag; 0 for the first.
    """

    file: str
    traces: int
    cut: str | None
    time_zero_header: float
    first_break: float | None
    direct_wave: float | None
    time_zero: float
    time_zero_from: str
    sign: int
    inverted: bool
    reversed: bool
    direction_from: str
    start_m: float
    start_from: str
    correlation: float

    def as_record(self) -> dict[str, object]:
        """The finding as a table, for the provenance of a drive log."""
        return asdict(self)


class FoundLine(NamedTuple):
    """A line in the survey's direction, with the survey's sign and its own time zero.

    Attributes:
        profile: corrected traces.
        along_m: position of each trace along the line, rising.
        finding: findings and changes.
    """

    profile: Profile
    along_m: Float[np.ndarray, " trace"]
    finding: LineFinding


def find_lines(
    lines: Sequence[Profile],
    *,
    time_zero: TimeZero = "auto",
    polarity: Literal["auto", "keep"] = "auto",
    reversed_lines: Reversed = "auto",
    length_m: float | None = None,
    topography_m: Sequence[Float[np.ndarray, " _"]] | None = None,
    topography_from: str = "topography",
    on_earth_by: str | None = None,
) -> list[FoundLine]:
    """Examine the lines of a survey and correct errors of their headers.

    Args:
        lines: lines of one channel each, in spatial order.
        time_zero: ``auto``: the header's if it agrees with the direct wave, else the first break plus the offset of the
            other headers from theirs; ``header``; or nanoseconds after the first sample, for all lines.
        polarity: ``auto``: lines with a sign other than most are inverted; ``keep``.
        reversed_lines: ``auto``: those whose header positions fall, if any do, or else detected; ``odd`` or ``even``:
            by the numbers in their names; or their numbers from 0.
        length_m: length over which every line is spread evenly.
        topography_m: position of each trace along the lines' direction, in the order of the survey.
        topography_from: source of these positions.
        on_earth_by: source of each stored trace's own geographic position, such as ``receiver``: directions and starts
            are then not estimated, and ``reversed_lines`` and ``topography_m`` are unused.

    Raises:
        InputError: lines without a spacing, time zeros that disagree without a direct wave, a topography of another
            line, or invalid numbers.
    """
    waves = [pick_direct_wave(line.traces, line.sample_interval_ns, line.centre_frequency_hz) for line in lines]
    zeros, zeros_from = _time_zeros(lines, waves, time_zero)
    own = [own_distances_m(line, length_m) for line in lines]
    step_m = float(np.median([np.median(np.diff(distances)) for distances in own]))
    images = [
        echo_image(_even(line, distances, step_m), zero, line.sample_interval_ns, line.centre_frequency_hz, step_m)
        for line, distances, zero in zip(lines, own, zeros, strict=True)
    ]
    if on_earth_by is not None:
        backwards, direction_from, topography_m = [False] * len(lines), [on_earth_by] * len(lines), None
    elif reversed_lines == "auto" and topography_m is None and any(_falls(line) for line in lines):
        # Positions rise by default: if some fall, the direction of every line was recorded.
        backwards, direction_from = [_falls(line) for line in lines], ["header"] * len(lines)
    else:
        backwards, direction_from = _directions(lines, images, step_m, reversed_lines)
    if topography_m is not None:
        rows_m = [_rows_of(line, rows) for line, rows in zip(lines, topography_m, strict=True)]
        if reversed_lines == "auto":
            backwards, direction_from = _directions_by_topography(
                rows_m, images, step_m, backwards, direction_from, topography_from
            )
        # If a line was walked against its rows and cut, the beginning of the rows is missing.
        topography_m = [
            _rows_of(line, rows, last=line.cut is not None and back == bool(rows[-1] > rows[0]))
            for line, rows, back in zip(lines, topography_m, backwards, strict=True)
        ]
    turned = [image[::-1] if back else image for image, back in zip(images, backwards, strict=True)]
    beside = [compare_neighbours(turned[i], turned[i - 1], step_m, directions=(False,)) for i in range(1, len(lines))]
    inverted = _signs(waves, beside) if polarity == "auto" else [False] * len(lines)
    if on_earth_by is not None:
        along, start_from = own, on_earth_by
    else:
        along, start_from = _along(lines, own, backwards, direction_from, beside, length_m, topography_m)
        start_from = topography_from if topography_m is not None else start_from
    found = []
    names = Counter(path.name for path in {line.path for line in lines})
    for i, line in enumerate(lines):
        channels = line.channels[::-1] if backwards[i] else line.channels
        interval_ns = line.sample_interval_ns
        finding = LineFinding(
            file="/".join(line.path.parts[-min(2, names[line.path.name]) :]),
            traces=len(line.channels),
            cut=line.cut,
            time_zero_header=line.time_zero_ns / interval_ns,
            first_break=_finite(waves[i].first_break),
            direct_wave=_finite(waves[i].strongest),
            time_zero=zeros[i],
            time_zero_from=zeros_from[i],
            sign=waves[i].sign,
            inverted=inverted[i],
            reversed=backwards[i],
            direction_from=direction_from[i],
            start_m=float(along[i][0]),
            start_from=start_from,
            correlation=beside[i - 1].correlation if i else 0.0,
        )
        profile = replace(
            line, channels=_turned(channels) if inverted[i] else channels, time_zero_ns=zeros[i] * interval_ns
        )
        found.append(FoundLine(profile, along[i], finding))
    return found


def found_time_zero(line: Profile) -> tuple[float, str]:
    """Time zero of a single line, nanoseconds after its first sample, and its source (see ``find_lines``)."""
    first = replace(line, channels=line.channels[:, :1])
    wave = pick_direct_wave(first.traces, line.sample_interval_ns, line.centre_frequency_hz)
    (sample,), (source,) = _time_zeros([first], [wave], "auto")
    return sample * line.sample_interval_ns, source


def _time_zeros(
    lines: Sequence[Profile], waves: Sequence[DirectWave], wanted: TimeZero
) -> tuple[list[float], list[str]]:
    """Time zero of each line in samples, and its source."""
    headers = [line.time_zero_ns / line.sample_interval_ns for line in lines]
    if wanted == "header":
        return headers, ["header"] * len(lines)
    if wanted != "auto":
        for line in lines:
            window_ns = line.channels.shape[2] * line.sample_interval_ns
            if not abs(wanted) < window_ns:
                raise InputError(
                    line.path, "time zero", f"less than the trace length, {window_ns:g} ns", f"{wanted:g} ns"
                )
        return [float(wanted) / line.sample_interval_ns for line in lines], ["option"] * len(lines)
    period = np.array([1e9 / (line.centre_frequency_hz or np.inf) / line.sample_interval_ns for line in lines])
    period = np.where(period > 0.0, period, [0.1 * line.channels.shape[2] for line in lines])
    after = np.array(headers) - [wave.first_break for wave in waves]
    plausible = np.abs(after) <= period  # not if no first break is detected
    usual = float(np.median(after[plausible])) if plausible.any() else 0.0
    zeros, sources = [], []
    for line, header, wave, off, tolerance in zip(
        lines, headers, waves, after, np.maximum(_LEAST_TOLERANCE, _PERIOD_SHARE * period), strict=True
    ):
        if not np.isfinite(off):
            expected = float(np.median(headers))
            if abs(header - expected) > _SAME_TIME_ZERO * line.channels.shape[2]:
                interval_ns = line.sample_interval_ns
                raise InputError(
                    line.path,
                    "time zero",
                    f"about {expected * interval_ns:g} ns, or --time-zero (the record begins after the direct wave)",
                    f"{line.time_zero_ns:g} ns",
                )
        agrees = not np.isfinite(off) or (abs(off - usual) <= tolerance and plausible.any())
        zeros.append(header if agrees else wave.first_break + usual)
        sources.append("header" if agrees else "first break")
    return zeros, sources


def _even(line: Profile, own_m: Float[np.ndarray, " trace"], step_m: float) -> np.ndarray:
    at = np.arange(int(own_m[-1] / step_m + 1e-6) + 1) * step_m
    nearest = np.rint(np.interp(at, own_m, np.arange(len(own_m)))).astype(np.intp)
    return np.asarray(line.traces[nearest])


def _directions(
    lines: Sequence[Profile], images: Sequence[np.ndarray], step_m: float, wanted: Reversed
) -> tuple[list[bool], list[str]]:
    """Lines that ran against the first one, or are given."""
    if isinstance(wanted, str) and wanted != "auto":
        rest = 1 if wanted == "odd" else 0
        return [number_of(line, i) % 2 == rest for i, line in enumerate(lines)], ["option"] * len(lines)
    if not isinstance(wanted, str):
        return [i in wanted for i in range(len(lines))], ["option"] * len(lines)
    pairs = [compare_neighbours(images[i], images[i - 1], step_m) for i in range(1, len(lines))]
    certain = [pair.certainty >= _CERTAIN for pair in pairs]
    # Where a pair of neighbours is inconclusive, it follows the majority.
    turns = [pair.reversed for pair, sure in zip(pairs, certain, strict=True) if sure]
    usually = 2 * sum(turns) > len(turns)
    backwards, source = [False], ["assumed"]
    for pair, sure in zip(pairs, certain, strict=True):
        backwards.append(backwards[-1] ^ (pair.reversed if sure else usually))
        source.append("neighbours" if sure else "assumed")
    return backwards, source


def number_of(line: Profile, index: int) -> int:
    """Number at the end of a line's name, as on a survey's sheet; else its place in the list."""
    digits = re.search(r"\d+$", line.path.stem)
    return int(digits[0]) if digits else index


def _rows_of(line: Profile, rows_m: Float[np.ndarray, " row"], *, last: bool = False) -> Float[np.ndarray, " trace"]:
    """Places of the traces of a line, by the first or the ``last`` of the rows."""
    traces = len(line.channels)
    missing = traces - len(rows_m)
    if missing > 0:
        step_m = float(np.median(np.diff(rows_m)))
        rows_m = np.concatenate([rows_m, rows_m[-1] + step_m * np.arange(1, missing + 1)])
    return rows_m[-traces:] if last else rows_m[:traces]


def _directions_by_topography(
    rows_m: Sequence[Float[np.ndarray, " _"]],
    images: Sequence[np.ndarray],
    step_m: float,
    backwards: list[bool],
    source: list[str],
    topography_from: str,
) -> tuple[list[bool], list[str]]:
    """Directions by a topography, whose rows either follow the traces or always run one way.

    Where rows run both ways they follow the traces. Where they always run one way, lines walked back are in the
    opposite order of their rows, and the starts show which of two directions is that of the rows: neighbouring ground
    must be aligned.
    """
    falls = [bool(rows[-1] < rows[0]) for rows in rows_m]
    if any(falls) and not all(falls):
        return falls, [topography_from] * len(falls)
    if len(images) < 2:
        return backwards, source
    turned = [image[::-1] if back else image for image, back in zip(images, backwards, strict=True)]
    # Evidence against the assumption: improvement of the starts, in variances of a start.
    evidence = 0.0
    for i in range(1, len(turned)):
        pair = compare_neighbours(turned[i], turned[i - 1], step_m, directions=(False,))
        if pair.sign_certainty < _SIGN_CERTAIN:
            continue
        apart_m = min(rows_m[i]) - min(rows_m[i - 1])
        longer_m = (len(turned[i - 1]) - len(turned[i])) * step_m
        off_m = apart_m - pair.lag_m, apart_m - (longer_m - pair.lag_m)
        evidence += (off_m[0] ** 2 - off_m[1] ** 2) / (2.0 * max(_START_SIGMA_M, step_m) ** 2)
    if evidence > _PARITY:
        return [not back for back in backwards], [topography_from] * len(images)
    return backwards, [topography_from] * len(images) if evidence < -_PARITY else source


def _signs(waves: Sequence[DirectWave], beside: Sequence[Neighbours]) -> list[bool]:
    """Lines with a sign other than the majority."""
    signs = [1]
    for i, pair in enumerate(beside, 1):
        if pair.sign_certainty >= _SIGN_CERTAIN:
            relative = 1 if pair.correlation > 0 else -1
        else:
            relative = waves[i].sign * waves[i - 1].sign or 1
        signs.append(signs[-1] * relative)
    most = 1 if 2 * signs.count(1) >= len(signs) else -1
    return [sign != most for sign in signs]


def _along(
    lines: Sequence[Profile],
    own_m: Sequence[Float[np.ndarray, " _"]],
    backwards: Sequence[bool],
    direction_from: Sequence[str],
    beside: Sequence[Neighbours],
    length_m: float | None,
    topography_m: Sequence[Float[np.ndarray, " _"]] | None,
) -> tuple[list[Float[np.ndarray, " _"]], str]:
    """Place of each trace of each line, and the source of the starts."""
    if topography_m is not None:
        placed = [np.asarray(rows if rows[-1] > rows[0] else rows[::-1]) for rows in topography_m]
        for line, rows in zip(lines, placed, strict=True):
            check_rising(line, rows)
        return placed, "topography"
    turned = [own[-1] - own[::-1] if back else own for own, back in zip(own_m, backwards, strict=True)]
    if length_m is not None:
        return turned, "tape"
    wavelength_m = max(WAVE_SPEED_M_PER_NS * 1e9 / (line.centre_frequency_hz or np.inf) for line in lines)
    lags_m = np.array([pair.lag_m for pair in beside])
    sure = np.array([pair.sign_certainty >= _CERTAIN for pair in beside])
    if len(lags_m) and sure.mean() > 0.5 and np.sqrt(np.mean(lags_m[sure] ** 2)) > 0.25 * wavelength_m > 0.0:
        starts_m = np.concatenate([[0.0], np.cumsum(np.where(sure, lags_m, 0.0))])
        # Oblique structure under all lines looks like drifting starts: a rope is straighter than that.
        order = np.arange(len(lines))
        if len(lines) > 2:
            starts_m -= np.polyval(np.polyfit(order, starts_m, 1), order)
        starts_m -= starts_m.min()
        return [own + start for own, start in zip(turned, starts_m, strict=True)], "neighbours"
    starts = [0.0 if line.positions_m is None else float(min(line.positions_m[[0, -1]])) for line in lines]
    # Of a line that another source has turned, the header's positions are not those of its ends.
    known = [not back or source == "header" for back, source in zip(backwards, direction_from, strict=True)]
    return [
        start - min(starts) + own if sure else own for own, start, sure in zip(turned, starts, known, strict=True)
    ], "header"


def _falls(line: Profile) -> bool:
    """Whether the header's positions fall: the line was walked back."""
    return line.positions_m is not None and bool(line.positions_m[-1] < line.positions_m[0])


def _turned(channels: np.ndarray) -> np.ndarray:
    """Inverted traces; the most negative integer has no opposite and becomes the largest."""
    if channels.dtype.kind != "i":
        return np.asarray(-channels)
    return np.asarray(-np.maximum(channels, np.iinfo(channels.dtype).min + 1))


def _finite(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None
