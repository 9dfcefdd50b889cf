"""A drive in a dozen figures, each named by the metric it is."""

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np
from jaxtyping import Float

from lgprjax.report.results import CODES, DriveResult, track_errors

WRONG_M = 0.3
"""An ``ok`` fix farther off than this is wrong: the nominal 1 ft of the Husky's requirements (``registration.WRONG_M``;
repeated here so that pictures need no accelerator library)."""


@dataclass(frozen=True, kw_only=True)
class DriveSummary:
    """What came of a drive. ``None`` stands for what cannot be told: no ok fix, no truth.

    Errors are in the map frame, over the ok fixes whose truth is known (``judged`` of them). RMS compares with
    the 4.3 cm of Cornick et al. 2016, the means with Ort et al. 2020 (who fit a clock offset first; here none is).

    Attributes:
        scans: of the drive; tried: those registered; ok: those with a position; counts: by code.
        ok_fraction: of the tried.
        median_correlation_ok, median_correlation_at_truth: of the ok fixes; of all scans at the true pose.
        max_error_m: the largest distance from the truth.
        remarks: what else a reader must know, a line each.
        place_assumed: whether nobody said where on the earth the drive, or the map, lies.
        wrong_ok: ok fixes more than ``WRONG_M`` off; of an impostor all of them.
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

    def as_rows(self) -> list[tuple[str, str]]:
        """Label and value with its unit, for a table of one drive."""
        declined = ", ".join(f"{n} {c}" for c, n in self.counts.items() if n and c not in ("ok", "no_window"))
        return [
            ("scans, of these tried", f"{self.scans}, {self.tried}"),
            ("ok", f"{self.ok} ({_percent(self.ok_fraction)} of the tried)"),
            ("declined", declined or "none"),
            ("ok but wrong (more than 0.3 m off)", _whole(self.wrong_ok)),
            ("median correlation of ok fixes", _number(self.median_correlation_ok)),
            ("median correlation at the truth", _number(self.median_correlation_at_truth)),
            ("RMS cross-track error (metric of 2016)", _metres(self.rms_cross_m)),
            ("RMS along-track error", _metres(self.rms_along_m)),
            ("mean absolute total error (metric of 2020, no clock offset fitted)", _metres(self.mean_absolute_total_m)),
            ("mean absolute cross-track error (as above)", _metres(self.mean_absolute_cross_m)),
            ("largest error of an ok fix", _metres(self.max_error_m)),
            ("time per scan", f"{self.milliseconds_per_scan:.2f} ms"),
        ]

    def as_json(self) -> dict[str, object]:
        """Everything, ready for ``json.dump``."""
        return {**asdict(self), "remarks": list(self.remarks)}


def summarise(result: DriveResult) -> DriveSummary:
    """Count the codes and measure the ok fixes against the truth."""
    ok, tried = int(result.ok.sum()), int(result.tried.sum())
    errors = track_errors(result)
    judged = result.ok & np.isfinite(errors.along_m) & np.isfinite(errors.cross_m) & result.has_truth
    # The ground of an impostor lies elsewhere: how near its fixes come to anything says nothing.
    judged &= not result.impostor
    along, cross = errors.along_m[judged].astype(np.float64), errors.cross_m[judged].astype(np.float64)
    total = np.hypot(along, cross)
    wrong = int((total > WRONG_M).sum()) if result.has_truth else None
    at_truth = result.correlation_at_truth
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
    )


OVERVIEW_HEADER = (
    "drive",
    "map",
    "tried",
    "ok",
    "ok but wrong",
    "median r, ok fixes",
    "median r at the truth",
    "RMS cross-track",
    "RMS along-track",
    "mean total",
    "largest",
    "ms/scan",
)


def labelled(name: str, *, impostor: bool) -> str:
    """A drive's name, that of an impostor marked as one."""
    return f"{name} (impostor)" if impostor and "impostor" not in name else name


def overview_rows(summaries: Sequence[DriveSummary]) -> list[tuple[str, ...]]:
    """One row a drive under ``OVERVIEW_HEADER``, for the terminal and the page alike."""
    return [
        (
            labelled(s.name, impostor=s.impostor),
            s.map_name,
            str(s.tried),
            _percent(s.ok_fraction),
            _whole(s.wrong_ok),
            _number(s.median_correlation_ok),
            _number(s.median_correlation_at_truth),
            _metres(s.rms_cross_m),
            _metres(s.rms_along_m),
            _metres(s.mean_absolute_total_m),
            _metres(s.max_error_m),
            f"{s.milliseconds_per_scan:.2f}",
        )
        for s in summaries
    ]


def _median(values: Float[np.ndarray, " any"]) -> float | None:
    finite = values[np.isfinite(values)]
    return float(np.median(finite)) if finite.size else None


def _rms(values: Float[np.ndarray, " any"]) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _percent(value: float | None) -> str:
    return "–" if value is None else f"{100.0 * value:.1f} %"


def _number(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f}"


def _metres(value: float | None) -> str:
    return "–" if value is None else f"{value:.3f} m"


def _whole(value: int | None) -> str:
    return "–" if value is None else str(value)
