"""A mile driven with full registration, and very many with an error model; records.

``python -m benchmarks closed-loop``.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.course_drive import CONDITIONS
from benchmarks.process import ProgramError, run_program
from benchmarks.records import Record, machine_line
from lgprjax.machine import usable_cores

MILE_M = 1609.344
_PUBLISHED_CROSS_M = {"clear": 0.26, "snow": 0.29, "rain, drifting scale": 0.40}


@dataclass(frozen=True)
class LoopPlan:
    """How much is measured.

    Attributes:
        length_m: of each drive.
        seeds: of the courses that each condition is driven on.
        conditions: of ``course_drive``.
        lanes: drives of a mile with the error model.
        lane_m: length of each.
        limit_s: of each process.
        processes: drives at a time, each on a core of its own.
        picture: of the first drive, a PNG; None for none.
    """

    length_m: float = MILE_M
    seeds: tuple[int, ...] = (2,)
    conditions: tuple[str, ...] = tuple(CONDITIONS)
    lanes: int = 640
    lane_m: float = MILE_M
    limit_s: float = 7200.0
    processes: int = field(default_factory=usable_cores)
    picture: Path | None = None


FULL_LOOP = LoopPlan()
QUICK_LOOP = LoopPlan(length_m=60.0, conditions=("clear",), lanes=64, lane_m=100.0)


class LoopOutcome(NamedTuple):
    """What a run found: machine, figures with goals among them, what did not run, and every drive's figures."""

    machine: str
    records: list[Record]
    not_measured: list[str]
    drives: list[dict[str, Any]]


Done = tuple[str, dict[str, Any]]
"""A drive's condition and its figures."""


def run_closed_loop(plan: LoopPlan, say: Callable[[str], None]) -> LoopOutcome:
    """Run a plan; ``say`` is told what has been done."""
    machine, failed = machine_line(), []
    done: list[Done] = []
    say(f"drives of {plan.length_m:.0f} m")
    with ThreadPoolExecutor(plan.processes) as pool:
        # The longest, at the full rate, is among the first.
        for name, found in zip(
            plan.conditions, pool.map(lambda each: _drive(plan, each), plan.conditions), strict=True
        ):
            if isinstance(found, str):
                failed.append(f"{name}, seeds {plan.seeds}: {found}")
            else:
                done += [(name, figures) for figures in found]
            say(f"{len(done)} drives of {plan.length_m:.0f} m done")
    say(f"{plan.lanes} drives with the error model")
    many = _many(plan, failed)
    records = [*drive_records(done), *(many_records(many) if many else [])]
    told = [{"name": name, **found} for name, found in done]
    return LoopOutcome(machine, records, failed, [*told, *([{"name": "error model", **many}] if many else [])])


def drive_records(done: Sequence[Done]) -> list[Record]:
    """Figures of the drives with full registration, a condition after the other; of several seeds the worst."""
    records = []
    for name, condition in CONDITIONS.items():
        found = [figures for kind, figures in done if kind == name]
        if not found:
            continue
        worst = {key: max(f[key] for f in found) for key in ("rms_m", "largest_m", "wrong_fixes")}
        least = {key: min(f[key] for f in found) for key in ("engaged_share", "speed_mps", "finished")}
        steering = max(f["largest_steering_step_rad"] / f["steering_limit_rad"] for f in found)
        note = f"{len(found)} drives of {_mean(found, 'way_m'):.0f} m, {_mean(found, 'seconds'):.0f} s of a core each"
        published = _PUBLISHED_CROSS_M.get(name)
        beside = "" if published is None else f"mean, across; RA-L 2020 has {published:.2f} m on its own roads"
        relative = _mean(found, "relative_cross_mean_m")
        nees = f"position; heading {_mean(found, 'nees_yaw'):.2f}"
        records += [
            Record(f"{name}: finished", float(least["finished"]), "", "higher", 1.0, note),
            Record(f"{name}: engaged, of the way", 100.0 * least["engaged_share"], "%", "higher", 95.0),
            Record(f"{name}: speed", least["speed_mps"], "m/s", "higher", condition.speed_goal_mps),
            Record(f"{name}: tracking, RMS", worst["rms_m"], "m", "lower", condition.rms_goal_m),
            Record(f"{name}: tracking, largest", worst["largest_m"], "m", "lower", 0.9144),
            Record(f"{name}: ok", 100.0 * _mean(found, "ok_share"), "%", "higher", None, "of the scans"),
            Record(f"{name}: wrong by over 0.3 m", float(worst["wrong_fixes"]), "", "lower", 0.0, "ok fixes"),
            Record(f"{name}: located across, RMS", _mean(found, "located_cross_rms_m"), "m", "lower"),
            Record(f"{name}: GNSS/INS across, RMS", _mean(found, "gnss_ins_cross_rms_m"), "m", "lower"),
            Record(f"{name}: relative accuracy", relative, "m", "lower", published, beside),
            Record(f"{name}: NEES", _mean(found, "nees_position"), "", "lower", None, nees),
            Record(f"{name}: degraded", 100.0 * _mean(found, "degraded_share"), "%", "lower", None, "of the time"),
            Record(f"{name}: largest steering step / limit", steering, "×", "lower", 1.001),
        ]
    return records


def many_records(found: dict[str, Any]) -> list[Record]:
    """Figures of the drives with the error model."""
    first = f"{found['first_block_s']:.0f} s of them for the first block, compilation with it"
    note = f"{found['kilometres']:.0f} km in {found['seconds']:.0f} s, {first}"
    return [
        Record("error model: speed against real time", found["times_real_time"], "×", "higher", None, note),
        Record("error model: 1,000 km take", 1e3 * found["seconds"] / found["kilometres"] / 60.0, "min", "lower", 10.0),
        Record("error model: tracking RMS", found["rms_m"], "m", "lower", 0.10),
        Record("error model: 95 % of drives below", found["rms_95_m"], "m", "lower"),
        Record("error model: largest offset", found["largest_m"], "m", "lower", 0.9144),
        Record("error model: length within a foot", found["within_foot"], "", "higher", 0.99),
        Record("error model: NEES, position", found["nees_position"], "", "lower", None, "a degree of freedom"),
        Record("error model: NEES, heading", found["nees_yaw"], "", "lower"),
        Record("error model: drives that stopped", found["stopped"], "", "lower"),
        Record("error model: memory", found["peak_rss_mb"], "MB", "lower"),
    ]


def _drive(plan: LoopPlan, condition: str) -> list[dict[str, Any]] | str:
    arguments = ["--condition", condition, "--seeds", *map(str, plan.seeds)]
    arguments += ["--length-m", str(plan.length_m), "--threads", "1"]
    if plan.picture and condition == plan.conditions[0]:
        arguments += ["--picture", str(plan.picture.absolute())]
    try:
        found = run_program("benchmarks.course_drive", arguments, threads=1, limit_s=plan.limit_s)
    except ProgramError as error:
        return str(error)
    drives: list[dict[str, Any]] = found["drives"]
    return drives


def _many(plan: LoopPlan, failed: list[str]) -> dict[str, Any] | None:
    arguments = ["--lanes", str(plan.lanes), "--length-m", str(plan.lane_m), "--threads", str(plan.processes)]
    try:
        return run_program("benchmarks.many_drives", arguments, threads=plan.processes, limit_s=plan.limit_s)
    except ProgramError as error:
        failed.append(str(error))
        return None


def _mean(found: Sequence[dict[str, Any]], key: str) -> float:
    return float(np.mean([figures[key] for figures in found]))
