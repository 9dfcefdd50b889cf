"""The same lanes by this project, by Numba in two forms and by plain Python; records.

``python -m benchmarks rollouts``.
"""

import importlib.util
import statistics
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from benchmarks.process import ProgramError, run_program
from benchmarks.records import Record, machine_line
from benchmarks.rollout_peers import ROLLOUT_PEERS
from benchmarks.rollout_problem import make_problem, save_problem
from lgprjax.machine import usable_cores

_SEED = 0
_NUMBA = ("numba_blocks", "numba_lanes")


@dataclass(frozen=True)
class RolloutPlan:
    """How much is measured.

    Attributes:
        lanes, steps: of the comparison.
        rounds: in each, every program runs once, in turn, so that what else the machine does falls on all alike.
        repeats: of each program in its process; the best counts.
        many_lanes, many_steps: of the run whose memory is measured.
        threads: of each program.
        limit_s: of each process.
    """

    lanes: int = 65_536
    steps: int = 400
    rounds: int = 3
    repeats: int = 5
    many_lanes: int = 1_000_000
    many_steps: int = 2000
    threads: int = field(default_factory=usable_cores)
    limit_s: float = 1800.0


FULL_ROLLOUTS = RolloutPlan()
QUICK_ROLLOUTS = RolloutPlan(
    lanes=16_384, steps=200, rounds=1, repeats=3, many_lanes=100_000, many_steps=200, limit_s=400.0
)


class RolloutOutcome(NamedTuple):
    """What a run found.

    Attributes:
        machine: what it ran on.
        records: figures, those with goals among them.
        not_measured: what did not run, and why.
    """

    machine: str
    records: list[Record]
    not_measured: list[str]


Runs = Mapping[str, Sequence[Mapping[str, float]]]
"""Figures of each program, one entry a round in which it ran."""


def run_rollouts(plan: RolloutPlan, folder: Path, say: Callable[[str], None]) -> RolloutOutcome:
    """Run a plan.

    Args:
        plan: what to run.
        folder: for the problem and the final states, removed by the caller.
        say: told what runs now.
    """
    machine = machine_line()
    file = folder / "problem.npz"
    save_problem(file, make_problem(plan.lanes, plan.steps, _SEED))
    failed: list[str] = []
    names = []
    for name, package in ROLLOUT_PEERS.items():
        if importlib.util.find_spec(package) is None:
            failed.append(f'{name}: package {package} is not installed: pip install "lgprjax[bench]"')
        else:
            names.append(name)
    runs: dict[str, list[dict[str, float]]] = {name: [] for name in ROLLOUT_PEERS}
    for number in range(plan.rounds):
        for name in names:
            say(f"{name}, round {number + 1} of {plan.rounds}")
            options = ["--steps", str(plan.steps), "--repeats", str(plan.repeats)]
            arguments = [str(file), str(folder / f"{name}.npz"), *options]
            found = _run(f"rollout_peers.{name}", arguments, plan, failed)
            runs[name] += [found] if found else []
    say("memory")
    size = ["--lanes", str(plan.many_lanes), "--steps", str(plan.many_steps)]
    memory = _run("rollout_memory", size, plan, failed)
    records = [
        *speed_records(runs),
        *difference_records({name: read_pose(folder / f"{name}.npz") for name, found in runs.items() if found}),
        *gradient_records(runs["this_project"]),
        *(memory_records(memory, plan) if memory else []),
    ]
    return RolloutOutcome(machine, records, failed)


def read_pose(file: Path) -> Float[np.ndarray, "4 lane"]:
    """Final x, y, cosine and sine that a program left."""
    with np.load(file) as found:
        pose: np.ndarray = found["pose"]
    return pose


def speed_records(runs: Runs) -> list[Record]:
    """Throughputs and their ratios; a ratio is taken within each round, its median counts and its range is told."""
    ours = runs["this_project"]
    records = [_throughput(name, runs[name]) for name in ROLLOUT_PEERS if runs[name]]
    if not ours:
        return records
    best_numba = max((name for name in _NUMBA if runs[name]), key=lambda name: _rate(runs[name]), default=None)
    for name in _NUMBA:
        goal = 1.5 if name == (best_numba or _NUMBA[0]) else None
        records.append(_ratio(name, runs[name], ours, goal))
    records.append(_ratio("plain_python", runs["plain_python"], ours, 1000.0))
    operations, peak = ours[0]["operations"], max(run["peak_operations"] for run in ours)
    note = (
        f"{operations:.0f} operations a step at the {peak / 1e9:.0f} GFLOP/s of a matrix product, which are all "
        f"multiply-adds; no rows fetched, no memory. This project runs at {_rate(ours) * operations / peak:.0%} of it"
    )
    return [*records, Record("floor, arithmetic alone", peak / operations / 1e6, "M steps/s", "higher", None, note)]


def difference_records(poses: Mapping[str, Float[np.ndarray, "4 lane"]]) -> list[Record]:
    """Largest distance between final positions, ours from each other program's."""
    if "this_project" not in poses:
        return []
    records = []
    for name, pose in poses.items():
        if name != "this_project":
            ours = poses["this_project"][:, : pose.shape[1]]
            apart_mm = 1e3 * float(np.max(np.hypot(*(ours[:2] - pose[:2]))))
            note = f"{pose.shape[1]} lanes; rear axle after all steps"
            records.append(Record(f"final states, apart from {name}", apart_mm, "mm", "lower", 1.0, note))
    return records


def gradient_records(ours: Sequence[Mapping[str, float]]) -> list[Record]:
    """Value and gradient beside the value alone."""
    if not ours:
        return []
    ratios = [run["value_and_gradient_s"] / run["value_s"] for run in ours]
    note = f"mean RMS by look-ahead and servo of {ours[0]['gradient_lanes']:.0f} lanes, {_range(ratios)}"
    return [Record("value and gradient / value", statistics.median(ratios), "×", "lower", 5.0, note)]


def memory_records(found: Mapping[str, float], plan: RolloutPlan) -> list[Record]:
    """Peak of the process that rolls out very many lanes."""
    size = f"{plan.many_lanes:,} lanes x {plan.many_steps:,} steps"
    rate = plan.many_lanes * plan.many_steps / found["seconds"] / 1e6
    note = f"peak of the process; {found['seconds']:.0f} s, {rate:.1f} M steps/s with its compile"
    return [Record(f"memory, {size}", found["peak_rss_mb"] / 1e3, "GB", "lower", 4.0, note)]


def _run(module: str, arguments: list[str], plan: RolloutPlan, failed: list[str]) -> dict[str, Any] | None:
    arguments = [*arguments, "--threads", str(plan.threads)]
    try:
        return run_program(f"benchmarks.{module}", arguments, threads=plan.threads, limit_s=plan.limit_s)
    except ProgramError as error:
        failed.append(str(error))
        return None


def _rate(runs: Sequence[Mapping[str, float]]) -> float:
    """Vehicle-steps a second, best of all rounds."""
    return max(run["vehicle_steps"] / run["best_s"] for run in runs)


def _throughput(name: str, runs: Sequence[Mapping[str, float]]) -> Record:
    rates = [run["vehicle_steps"] / run["best_s"] / 1e6 for run in runs]
    told = f"{runs[0]['threads']:.0f} threads, {_range(rates)}, peak {runs[0]['peak_rss_mb']:.0f} MB"
    return Record(f"throughput, {name}", statistics.median(rates), "M steps/s", "higher", None, told)


def _ratio(
    name: str, theirs: Sequence[Mapping[str, float]], ours: Sequence[Mapping[str, float]], goal: float | None
) -> Record:
    ratios = [
        (mine["vehicle_steps"] / mine["best_s"]) / (other["vehicle_steps"] / other["best_s"])
        for mine, other in zip(ours, theirs, strict=False)
    ]
    if not ratios:
        return Record(f"throughput / {name}", float("nan"), "×", "higher", goal, "nothing to compare with")
    return Record(f"throughput / {name}", statistics.median(ratios), "×", "higher", goal, _range(ratios))


def _range(values: Sequence[float]) -> str:
    return f"{min(values):.4g} to {max(values):.4g} in {len(values)} rounds"
