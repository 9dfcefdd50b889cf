"""A mile driven with full registration, and very many with an error model; records.

``python -m benchmarks closed-loop``.
"""

from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from benchmarks.process import ProgramError, run_program
from benchmarks.records import Record, machine_line
from lgprjax.machine import usable_cores

MILE_M = 1609.344
_PUBLISHED_CROSS_M = {"clear": 0.26, "snow": 0.29, "rain": 0.40}


class Drives(NamedTuple):
    """Drives of one kind: ``share`` records every so many-th scan."""

    name: str
    seeds: tuple[int, ...]
    share: int
    weather: str = "clear"
    fusion: str = "filter"


@dataclass(frozen=True)
class LoopPlan:
    """How much is measured.

    Attributes:
        length_m: of each drive.
        full_rate: seeds driven with all 126 scans a second.
        third_rate: seeds driven with every third.
        switched: seeds of those driven by LL's threshold switch too.
        days: seeds of the days in snow and rain.
        lanes: drives of a mile with the error model.
        lane_m: length of each.
        limit_s: of each process.
        processes: drives at a time, each on a core of its own.
        picture: of the first drive, a PNG; None for none.
    """

    length_m: float = MILE_M
    full_rate: tuple[int, ...] = (1,)
    third_rate: tuple[int, ...] = tuple(range(2, 21))
    switched: tuple[int, ...] = (2,)
    days: tuple[int, ...] = (2,)
    lanes: int = 640
    lane_m: float = MILE_M
    limit_s: float = 7200.0
    processes: int = field(default_factory=usable_cores)
    picture: Path | None = None

    @property
    def drives(self) -> list[Drives]:
        """All drives with full registration; those of one entry share a process."""
        third = [Drives("42 Hz", self.third_rate[n :: self.processes], 3) for n in range(self.processes)]
        return [
            group
            for group in (
                *third,
                Drives("126 Hz", self.full_rate, 1),
                Drives("switch", self.switched, 3, fusion="switch"),
                Drives("snow", self.days, 3, weather="snow"),
                Drives("rain", self.days, 3, weather="rain"),
            )
            if group.seeds
        ]


FULL_LOOP = LoopPlan()
QUICK_LOOP = LoopPlan(length_m=60.0, full_rate=(), third_rate=(1,), switched=(), days=(), lanes=64, lane_m=100.0)


class LoopOutcome(NamedTuple):
    """What a run found: machine, figures with goals among them, what did not run, and every drive's figures."""

    machine: str
    records: list[Record]
    not_measured: list[str]
    drives: list[dict[str, Any]]


Done = tuple[Drives, dict[str, Any]]
"""A drive's kind and its figures."""


def run_closed_loop(plan: LoopPlan, say: Callable[[str], None]) -> LoopOutcome:
    """Run a plan; ``say`` is told what has been done."""
    machine, failed = machine_line(), []
    done: list[Done] = []
    say(f"drives of {plan.length_m:.0f} m")
    with ThreadPoolExecutor(plan.processes) as pool:
        for group, found in zip(plan.drives, pool.map(lambda each: _drive(plan, each), plan.drives), strict=True):
            if isinstance(found, str):
                failed.append(f"{group.name}, seeds {group.seeds}: {found}")
            else:
                done += [(group, figures) for figures in found]
            say(f"{len(done)} drives of {plan.length_m:.0f} m done")
    say(f"{plan.lanes} drives with the error model")
    many = _many(plan, failed)
    records = [*drive_records(done), *day_records(done), *(many_records(many) if many else [])]
    told = [{"name": group.name, "weather": group.weather, **found} for group, found in done]
    return LoopOutcome(machine, records, failed, [*told, *([{"name": "error model", **many}] if many else [])])


def drive_records(done: Sequence[Done]) -> list[Record]:
    """Tracking of the clear drives, and of those by the threshold switch beside the same seeds by the filter."""
    records = []
    for name in ("126 Hz", "42 Hz", "switch"):
        found = [figures for drive, figures in done if drive.name == name]
        if not found:
            continue
        goal = {"126 Hz": (0.10, 0.9144, 0.99), "42 Hz": (0.10, 0.9144, 0.99)}.get(name, (None, None, None))
        note = f"{len(found)} drives of {_mean(found, 'way_m'):.0f} m at {_mean(found, 'speed_mps'):.1f} m/s"
        records += [
            Record(f"{name}: tracking, worst RMS", max(f["rms_m"] for f in found), "m", "lower", goal[0], note),
            Record(f"{name}: tracking, mean RMS", _mean(found, "rms_m"), "m", "lower"),
            Record(f"{name}: tracking, largest", max(f["largest_m"] for f in found), "m", "lower", goal[1]),
            Record(f"{name}: length within a foot, least", min(f["within_foot"] for f in found), "", "higher", goal[2]),
            Record(f"{name}: finished", float(np.mean([f["finished"] for f in found])), "", "higher", 1.0),
            Record(f"{name}: ok fixes", _mean(found, "ok_share"), "", "higher", None, "share of the scans"),
            Record(f"{name}: wrong fixes", float(sum(f["wrong_fixes"] for f in found)), "", "lower", 0.0),
            Record(f"{name}: located, cross RMS", _mean(found, "located_cross_rms_m"), "m", "lower"),
            Record(f"{name}: threshold switch beside it, cross RMS", _mean(found, "switch_cross_rms_m"), "m", "lower"),
            Record(f"{name}: GNSS/INS beside it, cross RMS", _mean(found, "gnss_ins_cross_rms_m"), "m", "lower"),
            Record(f"{name}: NEES, position", _mean(found, "nees_position"), "", "lower", None, "a degree of freedom"),
            Record(f"{name}: NEES, heading", _mean(found, "nees_yaw"), "", "lower"),
            Record(
                f"{name}: largest steering step / limit",
                max(f["largest_steering_step_rad"] / f["steering_limit_rad"] for f in found),
                "×",
                "lower",
                1.001,
            ),
            Record(f"{name}: degraded", _mean(found, "degraded_share"), "", "lower", None, "share of the time"),
            Record(f"{name}: time", _mean(found, "seconds"), "s", "lower", None, "a drive, on one core"),
        ]
    return records


def day_records(done: Sequence[Done]) -> list[Record]:
    """Relative accuracy by day, beside what was published of other ground."""
    records = []
    for weather, published_m in _PUBLISHED_CROSS_M.items():
        found = [f for drive, f in done if drive.weather == weather and drive.fusion == "filter"]
        if found:
            note = (
                f"mean, across; RA-L 2020 has {published_m:.2f} m on its own roads. {_mean(found, 'ok_share'):.0%} ok"
            )
            key = f"{weather}: relative accuracy"
            records.append(Record(key, _mean(found, "relative_cross_mean_m"), "m", "lower", published_m, note))
            tracking = max(f["rms_m"] for f in found)
            records.append(Record(f"{weather}: tracking, worst RMS of days", tracking, "m", "lower"))
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


def _drive(plan: LoopPlan, group: Drives) -> list[dict[str, Any]] | str:
    options = {
        "--weather": group.weather,
        "--fusion": group.fusion,
        "--share": group.share,
        "--length-m": plan.length_m,
        "--threads": 1,
    }
    arguments = ["--picture", str(plan.picture.absolute())] if plan.picture and group == plan.drives[0] else []
    arguments += ["--seeds", *map(str, group.seeds), *(str(part) for pair in options.items() for part in pair)]
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
