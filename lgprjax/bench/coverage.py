"""``lgprjax bench coverage``: the live worked area, the source's cached shapes, brute force; records."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

from lgprjax.bench.machine import machine_line
from lgprjax.bench.programs import AS_THE_PEER, ProgramError, run_program
from lgprjax.bench.records import Record
from lgprjax.coverage.worked import LEVELS

_PERIOD_MS = 100.0
_SPARE = 10.0
"""Times that a step must fit into the period of ten moments a second."""


@dataclass(frozen=True)
class CoveragePlan:
    """How much is measured.

    Attributes:
        moments: of the drive.
        draws: of the brute force, at each cell of one moment's patch.
        limit_s: of the process.
    """

    moments: int = 20_000
    draws: int = 100_000
    limit_s: float = 1800.0


FULL_COVERAGE = CoveragePlan()
QUICK_COVERAGE = CoveragePlan(moments=2000, draws=10_000, limit_s=400.0)


class CoverageOutcome(NamedTuple):
    """What a run found.

    Attributes:
        machine: what it ran on.
        records: figures, those with goals among them.
        not_measured: what did not run, and why.
        figures: as the program left them.
    """

    machine: str
    records: list[Record]
    not_measured: list[str]
    figures: dict[str, float]


def run_coverage(plan: CoveragePlan, say: Callable[[str], None]) -> CoverageOutcome:
    """Run a plan.

    Args:
        plan: what to run.
        say: told what runs now.
    """
    machine = machine_line()
    say("worked area, one core")
    arguments = ["--moments", str(plan.moments), "--draws", str(plan.draws)]
    try:
        figures = run_program(
            "lgprjax.bench.worked_area", arguments, threads=1, limit_s=plan.limit_s, environment=AS_THE_PEER
        )
    except ProgramError as error:
        return CoverageOutcome(machine, [], [str(error)], {})
    return CoverageOutcome(machine, coverage_records(figures), [], figures)


def coverage_records(figures: Mapping[str, float]) -> list[Record]:
    """Records of what the program found."""
    goal = _PERIOD_MS / _SPARE
    step = figures["p50_ms"]
    told = f"{figures['moments']:.0f} moments, {figures['cells'] / 1e6:.0f} million cells; period {_PERIOD_MS:.0f} ms"
    worst = f"a full step's whole wait; {_PERIOD_MS / figures['max_ms']:.1f} fit into a period"
    brute = f"{figures['brute_force_ms']:.0f} ms with {figures['draws']:.0f} draws a moment, NumPy"
    records = [
        Record("step, median", step, "ms", "lower", goal, told),
        Record("step, p99", figures["p99_ms"], "ms", "lower", goal, told),
        Record("step, longest", figures["max_ms"], "ms", "lower", None, worst),
        Record("steps in a period", _PERIOD_MS / step, "×", "higher", _SPARE, "of 0.1 s, one core"),
        Record("memory, map", figures["map_mb"], "MB", "lower", None, "probabilities of all cells"),
        Record("memory, process", figures["peak_rss_mb"], "MB", "lower", None, "peak, with JAX and its compiler"),
        Record("brute force / step", figures["brute_force_ms"] / step, "×", "higher", None, brute),
    ]
    for level in LEVELS:
        cached, made_s = figures[f"cached_ms_{level:g}"], figures[f"cached_made_s_{level:g}"]
        ours, theirs = figures[f"ours_m2_{level:g}"], figures[f"cached_m2_{level:g}"]
        told = f"{cached:.3g} ms a moment and {made_s:.3g} s beforehand, one level; a step serves all levels"
        area = f"{ours:.1f} m² to {theirs:.1f} m² of the same drive"
        beyond = figures[f"cached_beyond_ours_cells_{level:g}"]
        records += [
            Record(f"cached shapes / step, {level:g}", cached / step, "×", "higher", None, told),
            Record(f"area / cached shapes, {level:g}", ours / theirs, "×", "higher", 1.0, area),
            Record(f"cells of cached shapes alone, {level:g}", beyond, "", "lower", 0.0, "the cache is a lower bound"),
        ]
    return records
