"""Why scans were declined, in words: what each code means, and what to do about it."""

from collections.abc import Sequence
from typing import NamedTuple

from lgprjax.report.html import ReportTable
from lgprjax.report.summary import DriveSummary


class Decline(NamedTuple):
    """A code in words."""

    meaning: str
    action: str


_PLACE_ASSUMED = (
    "Nobody said where on the earth the drive, or the map, lies: import it again with --latitude-deg, --longitude-deg "
    "and --heading-deg"
)
DECLINES = {
    "low_correlation": Decline(
        "no place in the search region matches better than other ground would",
        "the first metres of a drive: nothing, there is too little travel yet to be sure. Else: is the drive over the "
        "map's ground, and its position right to within the search region (--search-m)? Leave --window-m and "
        "--time-scale at their defaults; lgprjax check --health examines the recording",
    ),
    "ambiguous": Decline(
        "another place in the region matches about as well",
        "ground that repeats itself: allow longer windows (no --window-m), or a smaller --search-m if the position "
        "allows it; lgprjax map verify shows where the map resembles itself",
    ),
    "edge": Decline(
        "the best place lies at the rim of the search region, or where the map ends",
        "a larger --search-m if the position in the log is wrong by more than its sigma says; where the map ends, more "
        "lines beside it: ground beyond a map resembles its outermost line",
    ),
    "off_map": Decline(
        "no map below the array anywhere in the region",
        "the drive has left the map, or its position is wrong by more than the region; lgprjax map info tells what "
        "the map covers",
    ),
    "low_overlap": Decline(
        "less than 0.6 of the array is over mapped ground",
        "the drive runs beside the mapped lane: drive closer to it, or add this lane with lgprjax map update",
    ),
    "non_finite": Decline(
        "less than 0.6 of the traces hold finite data",
        "lgprjax check --health names dead channels and lost scans",
    ),
    "no_window": Decline(
        "too little travel yet for a window: at the start, and after travel was lost",
        "nothing, where it is few scans; else a shorter --window-m, or none",
    ),
}


def declines_table(summaries: Sequence[DriveSummary]) -> ReportTable | None:
    """Declined scans of all drives by code, the most frequent first; None where there are none.

    Drives that are known to lie on other ground are left out: theirs must be declined.
    """
    rows = []
    for summary in summaries:
        counts = {code: summary.counts.get(code, 0) for code in DECLINES}
        for code, count in sorted(counts.items(), key=lambda each: -each[1]):
            if count and not summary.impostor:
                share = f"{count}, {100.0 * count / summary.scans:.1f} %"
                rows.append((summary.name, code, share, *_decline(code, summary)))
    header = ("drive", "code", "scans", "meaning", "what to do")
    return ReportTable(header, tuple(rows), "Scans without an ok fix, by code.") if rows else None


def main_decline(summary: DriveSummary) -> tuple[str, Decline] | None:
    """The most frequent code of a drive's declined scans, in words; None where none was declined."""
    code = max(DECLINES, key=lambda each: summary.counts.get(each, 0))
    return (code, _decline(code, summary)) if summary.counts.get(code, 0) else None


def _decline(code: str, summary: DriveSummary) -> Decline:
    """A code in words for one drive."""
    words = DECLINES[code]
    if code != "off_map" or not summary.place_assumed:
        return words
    return words._replace(action=f"{words.action}. {_PLACE_ASSUMED}")
