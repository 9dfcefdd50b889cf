"""A whole study, look-ahead from logs, and parts of it by SciPy and by NumPy; records.

``python -m benchmarks tuning``.
"""

import importlib.util
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.process import ProgramError, run_program
from benchmarks.records import Record, machine_line
from benchmarks.tuning_peers import TUNING_PEERS
from benchmarks.tuning_problem import MOST_LOGS, simulate_logs
from lgprjax.machine import usable_cores

GOAL_S = 60.0


@dataclass(frozen=True)
class TuningPlan:
    """How much is measured.

    Attributes:
        logs: of the study, up to ``MOST_LOGS``.
        draws: of the vehicle.
        steps: of the gradient.
        repeats: of each program in its process, after one that compiles; the best counts.
        single: draws that the loop over draws is timed on.
        threads: of each program.
        limit_s: of each process.
    """

    logs: int = MOST_LOGS
    draws: int = 4096
    steps: int = 150
    repeats: int = 2
    single: int = 64
    threads: int = field(default_factory=usable_cores)
    limit_s: float = 1800.0


FULL_TUNING = TuningPlan()
QUICK_TUNING = TuningPlan(logs=4, draws=256, steps=20, repeats=1, single=8, limit_s=600.0)


class TuningOutcome(NamedTuple):
    """What a run found.

    Attributes:
        machine: what it ran on.
        records: figures, those with goals among them.
        not_measured: what did not run, and why.
    """

    machine: str
    records: list[Record]
    not_measured: list[str]


Figures = Mapping[str, Any]


def run_tuning(plan: TuningPlan, folder: Path, say: Callable[[str], None]) -> TuningOutcome:
    """Run a plan.

    Args:
        plan: what to run.
        folder: for the logs and the problem, removed by the caller.
        say: told what runs now.
    """
    machine = machine_line()
    say(f"{plan.logs} drives")
    logs, problem = folder / "logs", folder / "problem.npz"
    logs.mkdir()
    simulate_logs(plan.logs, logs)
    sizes = {
        "this_project": [str(logs), str(problem), "--draws", str(plan.draws), "--steps", str(plan.steps)],
        "scipy_fit": [str(problem)],
        "numpy_draws": [str(problem), "--single", str(plan.single)],
    }
    found: dict[str, Figures] = {}
    failed: list[str] = []
    for name, package in TUNING_PEERS.items():
        if importlib.util.find_spec(package) is None:
            failed.append(f'{name}: package {package} is not installed: pip install "lgprjax[bench]"')
            continue
        say(name)
        repeats = [] if name == "numpy_draws" else ["--repeats", str(plan.repeats)]
        arguments = [*sizes[name], *repeats, "--threads", str(plan.threads)]
        try:
            found[name] = run_program(
                f"benchmarks.tuning_peers.{name}",
                arguments,
                threads=plan.threads,
                limit_s=plan.limit_s,
                # The first run is told with all of its compiling.
                environment={"JAX_ENABLE_COMPILATION_CACHE": "false"},
            )
        except ProgramError as error:
            failed.append(str(error))
            if name == "this_project":
                break  # it makes the problem of the others
    return TuningOutcome(machine, tuning_records(found), failed)


def tuning_records(found: Mapping[str, Figures]) -> list[Record]:
    """The study and its parts, then each peer beside its part."""
    ours = found.get("this_project")
    if ours is None:
        return []
    taken = ours["taken_s"]
    threads = "1 thread" if ours["threads"] == 1 else f"{ours['threads']} threads"
    size = f"{ours['logs']} logs, {ours['draws']:,} draws"
    told = (
        f"from files to schedule, {ours['driven_s']:.0f} s of driving; {threads}, {min(taken):.3g} to {max(taken):.3g} "
        f"s in {len(taken)} runs, {ours['cpu_s']:.3g} s of processor time; peak {ours['peak_rss_mb']:.0f} MB"
    )
    records = [
        Record(f"whole study, {size}", min(taken), "s", "lower", GOAL_S, told),
        Record("the first one in a process", ours["first_s"], "s", "lower", None, "all programs compiled"),
        Record("of it: identification", ours["fit_s"], "s", "lower", None, "posterior of nine numbers"),
        Record("of it: cost over all draws", ours["judge_s"], "s", "lower", None, "of one schedule, without gradient"),
    ]
    return [*records, *_fit_records(ours, found.get("scipy_fit")), *_draw_records(ours, found.get("numpy_draws"))]


def _fit_records(ours: Figures, theirs: Figures | None) -> list[Record]:
    if theirs is None:
        return []
    note = f"{theirs['fit_s']:.3g} s: the likeliest numbers only, NumPy over all drives at once; ours has the posterior"
    apart = "largest distance of a number from scipy's, in its standard errors: mean against likeliest"
    return [
        Record("identification / scipy.optimize", theirs["fit_s"] / ours["fit_s"], "×", "higher", None, note),
        Record("numbers, apart from scipy.optimize", theirs["apart"], "", "lower", 1.0, apart),
    ]


def _draw_records(ours: Figures, theirs: Figures | None) -> list[Record]:
    if theirs is None:
        return []
    loop = f"{theirs['single_s']:.3g} s, from {theirs['single_draws']} draws; a draw's trials at once"
    many = f"{theirs['all_s']:.3g} s; as many draws at once as caches hold"
    apart = f"mean over all draws, {theirs['mean_m']:.4f} m; a single draw's at most {1e3 * theirs['apart_m']:.2g} mm"
    return [
        Record("cost / per-draw NumPy loop", theirs["single_s"] / ours["judge_s"], "×", "higher", None, loop),
        Record("cost / NumPy, draws at once", theirs["all_s"] / ours["judge_s"], "×", "higher", None, many),
        Record("cost, apart from NumPy", 1e3 * theirs["mean_apart_m"], "mm", "lower", 1.0, apart),
    ]
