"""Verification of a map: a survey along its routes with verdicts, and all measurements as tables."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd
from jaxtyping import Bool, Float

from lgprjax.formats import MapFile
from lgprjax.mapping.survey import STEP_M, MapSurvey, survey_map
from lgprjax.recordings.verdicts import Verdict, runs, verdict_of, worst
from lgprjax.registration import MIN_OVERLAP, Code

# Measurements along a map against stated limits: a verdict for each kind, and the stretches that fall short.

WEAK_REPEATS = 0.3
"""Share of the stations' signal that repeats an eighth of a wavelength farther, below which it is hardly ground."""
WIDE_OFFSET_M = 0.1
"""A baseline farther than this from its place on the ground of the others."""
_DISAGREEMENT_PERCENT = (20.0, 40.0)  # of the places: on good ground, too, one single scan in seven is declined
_CHANNEL_LIMITS = (0.5, 0.25)  # of the usual correlation of neighbouring channels
_LEAST_LIKENESS = 0.1  # channels so far apart that neighbours receive different ground cannot be compared
_LIMITS_PERCENT = (2.0, 20.0)  # of the route, for kinds that count places


class RouteInterval(NamedTuple):
    """Part of a map that a finding refers to.

    Attributes:
        start_m, stop_m: start and end along the route.
        start, stop: latitude_deg and longitude_deg of its ends.
        worst: worst value there, in the finding's unit.
        drive, channel: baseline and channel concerned; ``None`` for all.
    """

    start_m: float
    stop_m: float
    start: tuple[float, float]
    stop: tuple[float, float]
    worst: float
    drive: int | None = None
    channel: int | None = None


class MapFinding(NamedTuple):
    """One kind of finding on a map: ``value`` against the limits of look and bad, and where it falls short."""

    kind: str
    value: float
    unit: str
    look: float
    bad: float
    verdict: Verdict
    text: str
    where: tuple[RouteInterval, ...]


class MapJudge:
    """Judges a survey against limits.

    Args:
        source: map.
        survey: survey of the map.
    """

    def __init__(self, source: MapFile, survey: MapSurvey) -> None:
        self._source, self._survey = source, survey
        pose = survey.route.pose
        self._latitude, self._longitude, _ = source.description.frame.to_geodetic(
            pose[:, 0], pose[:, 1], np.zeros(len(pose))
        )

    def coverage(self) -> MapFinding:
        """Share of the route whose ground is as wide as the array."""
        wanted_m = 0.9 * self._source.description.array_width_m
        width, passes = self._survey.ground.width_m, self._survey.ground.passes
        text = (
            f"route with less than {wanted_m:.2f} m of ground across (0.9 of the array); median width "
            f"{np.median(width):.2f} m, {passes.min()} to {passes.max()} passes"
        )
        return self._counted("coverage", width < wanted_m, width, text, smallest=True)

    def holes(self) -> MapFinding:
        """Places where a scan on the route would be rejected for lack of ground."""
        least = MIN_OVERLAP
        overlap = self._survey.ground.overlap
        text = f"route with less than {least:g} of the array on the map: a scan there has code low_overlap"
        found = self._counted("holes", overlap < least, overlap, text, smallest=True)
        # One hole is enough to lose a vehicle without another source of position.
        metres = found.value / 100.0 * len(overlap) * STEP_M
        return found._replace(
            value=metres, unit="m", look=STEP_M, bad=2.0 * STEP_M, verdict=verdict_of(metres, STEP_M, 2.0 * STEP_M)
        )

    def weak(self) -> MapFinding:
        """Places whose signal is noise rather than ground."""
        repeats = self._survey.signal.repeats
        text = (
            f"route whose stations correlate by less than {WEAK_REPEATS:g} with those an eighth of a wavelength "
            f"farther; median {np.nanmedian(repeats):.2f}"
        )
        return self._counted("weak", repeats < WEAK_REPEATS, repeats, text, smallest=True)

    def ambiguous(self) -> MapFinding:
        """Places so similar to others that a scan could not be distinguished from its rival."""
        likeness = self._survey.signal.likeness
        text = (
            f"route where the map's own scan exceeds the best other position in the search region by less "
            f"than a fix requires; median of the rival's score over the scan's own {np.nanmedian(likeness):.2f}"
        )
        short = self._survey.signal.ambiguous
        return self._counted("ambiguous", short, likeness, text, smallest=False)

    def offset(self) -> MapFinding:
        """Distance of the baselines' labels from their places on the ground of the others."""
        agreement, match = self._survey.agreement, self._survey.agreement.match
        ok = match.code == Code.OK
        apart = np.where(ok, np.hypot(match.along_m, match.cross_m), np.nan)
        parts, value, where = [], 0.0, []
        for drive in np.unique(agreement.drive):
            mine = ok & (agreement.drive == drive)
            if not mine.any():
                parts.append(f"baseline {drive}: no match")
                continue
            along, cross = np.median(match.along_m[mine]), np.median(match.cross_m[mine])
            value = max(value, float(np.hypot(along, cross)))
            parts.append(f"baseline {drive}: {along:+.3f} m along, {cross:+.3f} m across")
            wide = self._on_route(mine & (apart >= WIDE_OFFSET_M))
            where += self._intervals(wide, self._worst_on_route(apart, mine), smallest=False, drive=int(drive))
        largest = float(np.nanmax(apart)) if ok.any() else np.nan
        text = f"median of match minus label, largest baseline ({'; '.join(parts)}); worst position {largest:.2f} m"
        value = value if ok.any() else np.nan
        limits = (0.05, WIDE_OFFSET_M)
        return MapFinding("offset", value, "m", *limits, verdict_of(value, *limits), text, tuple(where))

    def disagreement(self) -> MapFinding:
        """Places where a baseline is not found on the ground of the others although both exist."""
        agreement, match = self._survey.agreement, self._survey.agreement.match
        tried = match.code != Code.OFF_MAP
        poor = tried & (match.code != Code.OK)
        share = 100.0 * float(poor.sum()) / max(int(tried.sum()), 1)
        where: list[RouteInterval] = []
        for drive in np.unique(agreement.drive):
            mine = agreement.drive == drive
            value = self._worst_on_route(-match.score, mine & tried)
            where += self._intervals(self._on_route(poor & mine), -value, smallest=True, drive=int(drive))
        middle = float(np.nanmedian(match.correlation[tried])) if tried.any() else np.nan
        text = (
            f"places where a baseline overlaps others, but the match is not ok (no better than chance, "
            f"ambiguous or at the edge); median correlation {middle:.2f}"
        )
        limits = _DISAGREEMENT_PERCENT
        verdict = verdict_of(share, *limits) if tried.any() else "good"
        return MapFinding("disagreement", share, "%", *limits, verdict, text, tuple(where))

    def channels(self) -> MapFinding | None:
        """Channels whose ground is not that of their neighbours; None where neighbours cannot be compared."""
        beside = self._survey.beside
        if not beside.shape[1] or float(np.median(beside)) < _LEAST_LIKENESS:
            return None
        # To the better of its two neighbours, so that the faulty channel is named and not its neighbour.
        padded = np.pad(beside, [(0, 0), (1, 1)], constant_values=-1.0)
        best = np.maximum(padded[:, 1:], padded[:, :-1]) / np.median(beside, axis=1, keepdims=True)
        where = []
        whole = np.ones(len(self._latitude), bool)
        for drive, channel in zip(*np.nonzero(best <= _CHANNEL_LIMITS[0]), strict=True):
            interval = self._intervals(whole, None, smallest=True, drive=int(drive))[0]
            where.append(interval._replace(worst=float(best[drive, channel]), channel=int(channel)))
        value = float(best.min())
        text = (
            "least correlation of a channel's ground with that of its better neighbour, over a baseline, as a share of "
            f"the median ({np.median(beside):.2f}); low: opposite polarity, wrong position or no signal"
        )
        verdict = verdict_of(value, *_CHANNEL_LIMITS)
        return MapFinding("channels", value, "", *_CHANNEL_LIMITS, verdict, text, tuple(where))

    def _counted(
        self,
        kind: str,
        short: Bool[np.ndarray, " route"],
        value: Float[np.ndarray, " route"],
        text: str,
        smallest: bool,
    ) -> MapFinding:
        share = 100.0 * float(np.mean(short))
        where = tuple(self._intervals(short, value, smallest=smallest))
        return MapFinding(kind, share, "%", *_LIMITS_PERCENT, verdict_of(share, *_LIMITS_PERCENT), text, where)

    def _intervals(
        self,
        mask: Bool[np.ndarray, " route"],
        value: Float[np.ndarray, " route"] | None,
        *,
        smallest: bool,
        drive: int | None = None,
    ) -> list[RouteInterval]:
        at_m, out = self._survey.route.at_m, []
        for low, high in runs(mask):
            part = np.zeros(1) if value is None else value[low : high + 1]
            ends = [(float(self._latitude[n]), float(self._longitude[n])) for n in (low, high)]
            part = part[np.isfinite(part)]
            extreme = float(part.min() if smallest else part.max()) if len(part) else float("nan")
            metres = float(at_m[low]) - 0.5 * STEP_M, float(at_m[high]) + 0.5 * STEP_M
            out.append(RouteInterval(*metres, ends[0], ends[1], extreme, drive))
        return out

    def _on_route(self, rows: Bool[np.ndarray, " row"]) -> Bool[np.ndarray, " route"]:
        mask = np.zeros(len(self._latitude), bool)
        places = self._survey.agreement.route[rows]
        mask[places[places >= 0]] = True
        return mask

    def _worst_on_route(
        self, value: Float[np.ndarray, " row"], rows: Bool[np.ndarray, " row"]
    ) -> Float[np.ndarray, " route"]:
        out = np.full(len(self._latitude), np.nan)
        place = self._survey.agreement.route
        for row in np.flatnonzero(rows & (place >= 0) & np.isfinite(value)):
            out[place[row]] = np.fmax(out[place[row]], value[row])
        return out


class MapHealth(NamedTuple):
    """Health of a map.

    Attributes:
        name: name of the map.
        length_m: length of the route; ground covered repeatedly counts once.
        baselines: number of drives.
        seconds: duration of the measurement.
        findings: findings, one per kind.
        survey: all measurements, by place.
        places, agreement: the measurements as tables, for a CSV.
    """

    name: str
    length_m: float
    baselines: int
    seconds: float
    findings: tuple[MapFinding, ...]
    survey: MapSurvey
    places: pd.DataFrame
    agreement: pd.DataFrame

    @property
    def verdict(self) -> Verdict:
        """The worst verdict of all findings."""
        return worst([finding.verdict for finding in self.findings])

    def finding(self, kind: str) -> MapFinding:
        """The finding of this kind. Raises ``KeyError`` if it was not measured."""
        for finding in self.findings:
            if finding.kind == kind:
                return finding
        raise KeyError(kind)

    def as_json(self) -> dict[str, object]:
        """Plain values, for JSON; non-finite numbers become null."""
        findings = []
        for finding in self.findings:
            row: dict[str, object] = dict(finding._asdict())
            row["value"] = finding.value if np.isfinite(finding.value) else None
            row["where"] = [
                {**interval._asdict(), "worst": interval.worst if np.isfinite(interval.worst) else None}
                for interval in finding.where
            ]
            findings.append(row)
        return {
            "name": self.name,
            "length_m": self.length_m,
            "step_m": STEP_M,
            "baselines": self.baselines,
            "seconds": round(self.seconds, 1),
            "seconds_per_km": round(1e3 * self.seconds / max(self.length_m, 1e-9), 1),
            "verdict": self.verdict,
            "findings": findings,
        }


def verify_map(source: MapFile, progress: Callable[[int], None] = lambda _: None) -> MapHealth:
    """Measure a map along its route and judge it.

    Memory: a few tiles, and some hundred bytes per metre of route and baseline.

    Args:
        source: the database.
        progress: called with the number of places done since the last call, out of ``places_of``.
    """
    began = time.perf_counter()
    survey = survey_map(source, progress)
    judge = MapJudge(source, survey)
    findings = [judge.coverage(), judge.holes(), judge.weak(), judge.ambiguous()]
    if len(survey.agreement.drive):
        findings += [judge.offset(), judge.disagreement()]
    channels = judge.channels()
    if channels is not None:
        findings.append(channels)
    return MapHealth(
        name=source.description.name,
        length_m=len(survey.route.at_m) * STEP_M,
        baselines=int(source.drive.max()) + 1,
        seconds=time.perf_counter() - began,
        findings=tuple(findings),
        survey=survey,
        places=_place_table(source, survey),
        agreement=_agreement_table(survey),
    )


def _place_table(source: MapFile, survey: MapSurvey) -> pd.DataFrame:
    pose = survey.route.pose
    latitude, longitude, _ = source.description.frame.to_geodetic(pose[:, 0], pose[:, 1], np.zeros(len(pose)))
    power_db = 10.0 * np.log10(np.maximum(survey.signal.power / np.nanmedian(survey.signal.power), 1e-12))
    return pd.DataFrame(
        {
            "route_m": survey.route.at_m,
            "latitude_deg": latitude,
            "longitude_deg": longitude,
            "baseline": survey.route.drive,
            "passes": survey.ground.passes,
            "width_m": survey.ground.width_m,
            "overlap": survey.ground.overlap,
            "power_db": power_db,
            "repeats": survey.signal.repeats,
            "likeness": survey.signal.likeness,
        }
    )


def _agreement_table(survey: MapSurvey) -> pd.DataFrame:
    agreement = survey.agreement
    known = agreement.route >= 0
    at_m = np.full(len(known), np.nan)
    at_m[known] = survey.route.at_m[agreement.route[known]]
    match = agreement.match
    return pd.DataFrame(
        {
            "baseline": agreement.drive,
            "route_m": at_m,
            "along_m": match.along_m,
            "cross_m": match.cross_m,
            "sigma_m": match.sigma_m,
            "correlation": match.correlation,
            "strength": match.score,
            "share": match.share,
            "code": [Code(int(code)).label for code in match.code],
        }
    )
