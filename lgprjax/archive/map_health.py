"""Can this map be trusted? A walk along its routes, judged, with everything measured as tables."""

import time
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import pandas as pd

from lgprjax.archive.map_findings import MapFinding, MapJudge
from lgprjax.archive.map_survey import STEP_M, MapSurvey, survey_map
from lgprjax.archive.verdicts import Verdict, worst
from lgprjax.formats import MapFile
from lgprjax.registration import Code


class MapHealth(NamedTuple):
    """What a map says about its own soundness.

    Attributes:
        name: of the map.
        length_m: of the route: ground covered more than once counts once.
        baselines: number of drives.
        seconds: that the measurement took.
        findings: one a kind.
        survey: all measurements, place by place.
        places, agreement: the same as tables, for a CSV.
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
        """The finding of this kind. Raises ``KeyError`` where it was not measured."""
        for finding in self.findings:
            if finding.kind == kind:
                return finding
        raise KeyError(kind)

    def as_json(self) -> dict[str, object]:
        """Plain values, for JSON; what is not a finite number is null."""
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

    Memory: a few tiles, and some hundred bytes a metre of route and baseline.

    Args:
        source: the database.
        progress: told the number of places done since the last call, of ``places_of``.
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
            "strength": match.strength,
            "share": match.share,
            "code": [Code(int(code)).label for code in match.code],
        }
    )
