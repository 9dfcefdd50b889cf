"""One measured figure beside its goal, and tables of them."""

import json
import math
import os
import platform
import subprocess
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from time import gmtime, strftime
from typing import Any, Literal, NamedTuple

from benchmarks.process import PeerResult, results_as_json
from lgprjax.machine import usable_cores

HEADER = ("key", "value", "unit", "goal", "met", "note")


@dataclass(frozen=True)
class Record:
    """A figure.

    Attributes:
        key: names it, stable between runs.
        value: measured.
        unit: of value and goal; empty for counts.
        direction: where better lies.
        goal: to be reached, or None where a figure is only told.
        note: on what and how it was measured.
    """

    key: str
    value: float
    unit: str
    direction: Literal["higher", "lower"]
    goal: float | None = None
    note: str = ""

    @property
    def met(self) -> bool | None:
        """Whether the goal is reached; None without one. A value that is no number meets nothing."""
        if self.goal is None:
            return None
        return self.value >= self.goal if self.direction == "higher" else self.value <= self.goal


def text_table(records: Sequence[Record]) -> str:
    """Columns of equal width, one record a line, for the terminal."""
    rows = [HEADER, *(_row(record) for record in records)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(HEADER))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join(lines) + "\n"


def markdown_table(records: Sequence[Record]) -> str:
    """The same as a markdown table; a goal that is not met is bold."""
    rows = [HEADER, ("---",) * len(HEADER), *(_row(record, missed="**no**") for record in records)]
    return "".join("| " + " | ".join(cell.replace("|", "\\|") for cell in row) + " |\n" for row in rows)


def read_records(path: Path) -> tuple[dict[str, Any], list[Record]]:
    """What a benchmark wrote (``--json``): all of it, and its records; values that were not measured are NaN."""
    told: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
    kept = [{key: value for key, value in each.items() if key != "met"} for each in told["records"]]
    return told, [
        Record(**{**each, "value": float("nan") if each["value"] is None else each["value"]}) for each in kept
    ]


def records_as_json(records: Sequence[Record]) -> str:
    """A JSON list of the records with ``met``; values that are no numbers become null."""
    rows = [{**asdict(record), "value": _plain(record.value), "met": record.met} for record in records]
    return json.dumps(rows, indent=2, allow_nan=False) + "\n"


def kept_text(command: str, records: Sequence[Record], *, quick: bool = False, **more: object) -> str:
    """Text of a record file, as ``read_records`` reads it: command, date, commit, machine, records, and more."""
    rows = json.loads(records_as_json(records))
    told = {"command": command, **date_and_commit(), "machine": machine_line(), "quick": quick, "records": rows, **more}
    return json.dumps(told, indent=1, allow_nan=False) + "\n"


def _row(record: Record, missed: str = "no") -> tuple[str, ...]:
    sign = "≥" if record.direction == "higher" else "≤"
    goal = "" if record.goal is None else f"{sign} {record.goal:.4g}"
    met = {None: "", True: "yes", False: missed}[record.met]
    return (record.key, f"{record.value:.4g}", record.unit, goal, met, record.note)


def _plain(value: float) -> float | None:
    return value if abs(value) < float("inf") else None


# How much a share of successes may be wrong by.

_TWO_SIDED_95 = 1.959963984540054


class Interval(NamedTuple):
    """A range of shares."""

    low: float
    high: float


def wilson(successes: int, trials: int) -> Interval:
    """Wilson's 95 % score interval of a share; all of 0 to 1 where nothing was tried.

    Unlike the normal one it stays within 0 to 1 and is of use where all trials succeeded.
    """
    if trials == 0:
        return Interval(0.0, 1.0)
    z2 = _TWO_SIDED_95**2
    share = successes / trials
    middle = (share + z2 / (2 * trials)) / (1 + z2 / trials)
    half = _TWO_SIDED_95 / (1 + z2 / trials) * math.sqrt(share * (1 - share) / trials + z2 / (4 * trials**2))
    # Rounding must not push the ends of "none" and "all" past them.
    low = 0.0 if successes == 0 else middle - half
    high = 1.0 if successes == trials else middle + half
    return Interval(low, high)


# The comparison's records: how many times faster than what, beside the goals.

SCANS_A_TILE = 114
"""Of a tile of 4 m driven at 3.5 cm a scan."""
ENOUGH = 0.99
"""Share of problems that a search must solve to be compared with."""

Role = Literal["ours", "seeded", "control", "swarm"]
Time = Callable[[PeerResult], float]


class Ran(NamedTuple):
    """A peer's result and what it stands for: this project, its swarm from coarse starts, the control, a swarm."""

    role: Role
    result: PeerResult

    @property
    def interval(self) -> Interval:
        """Of its success."""
        return wilson(self.result.successes, self.result.problems)


class TileCost(NamedTuple):
    """Milliseconds that a tile takes before its first scan: reading and gridding, and its columns."""

    gridding_ms: float
    columns_ms: float


def single(result: PeerResult) -> float:
    """A scan by itself on a prepared map, ms."""
    return result.single_ms


def batch(result: PeerResult) -> float:
    """A scan among many on a prepared map, ms."""
    return result.batch_ms


def amortised(result: PeerResult) -> float:
    """The same with a share of the map's preparation, ms."""
    return result.batch_ms + result.preparation_ms / SCANS_A_TILE


def equal_success(ran: Ran, ours: Ran) -> bool:
    """Solves 99 % or more, or as many as ``ours`` as far as both intervals can tell."""
    return ran.result.success_share >= ENOUGH or ran.interval.high >= ours.interval.low


def fastest(runs: Sequence[Ran], ours: Ran, time: Time) -> Ran | None:
    """The fastest of those that ran and reach equal success."""
    able = [ran for ran in runs if not ran.result.missing and equal_success(ran, ours)]
    return min(able, key=lambda ran: time(ran.result)) if able else None


def success_record(ours: Ran) -> Record:
    """Success of this project with its interval."""
    return Record("success", 100.0 * ours.result.success_share, "%", "higher", 100.0 * ENOUGH, told_success(ours))


def told_success(ran: Ran) -> str:
    """Successes, problems, interval."""
    low, high = ran.interval
    return f"{ran.result.successes} of {ran.result.problems}, 95 % interval {100 * low:.1f} to {100 * high:.1f} %"


def ratio_records(runs: Sequence[Ran], tile: TileCost | None) -> list[Record]:
    """All ratios; not a number where a side is missing.

    Args:
        runs: of all roles; exactly one is ``ours``.
        tile: what a map's tile costs, where it was measured.
    """
    ours = next(ran for ran in runs if ran.role == "ours")
    swarms = [ran for ran in runs if ran.role == "swarm"]
    packaged = [ran for ran in swarms if ran.result.name == "pyswarms_peer"]
    compiled = [ran for ran in swarms if ran.result.name == "numba_swarm"]
    controls = [ran for ran in runs if ran.role == "control"]
    seeded = fastest([ran for ran in runs if ran.role == "seeded"], ours, batch)

    def against(key: str, others: Sequence[Ran], time: Time, goal: float | None, note: str, cost: float) -> Record:
        return _ratio(key, fastest(others, ours, time), time, cost, goal, note)

    mine = ours.result
    share = f"map's columns over {SCANS_A_TILE} scans"
    records = [
        success_record(ours),
        against("batch / best swarm", swarms, amortised, 30.0, share, amortised(mine)),
        against("batch / best swarm, warm", swarms, batch, None, "map prepared", batch(mine)),
        *_cold(swarms, ours, tile),
        against("batch / PySwarms", packaged, amortised, 1000.0, share, amortised(mine)),
        against("batch / PySwarms, warm", packaged, batch, None, "map prepared", batch(mine)),
        against("single / best swarm", swarms, single, 10.0, "map prepared", single(mine)),
        against("batch / control", controls, batch, 1.0, "map prepared", batch(mine)),
        against("batch / control, amortised", controls, amortised, None, share, amortised(mine)),
        against("single / control", controls, single, 0.5, "map prepared", single(mine)),
    ]
    for key, time, goal in (("seeded swarm / Numba swarm, batch", batch, 3.0), ("…, single", single, None)):
        key = key.replace("…", "seeded swarm / Numba swarm")
        cost = time(seeded.result) if seeded else float("nan")
        told = f"{seeded.result.setting}, {told_success(seeded)}" if seeded else "no seeded swarm of equal success"
        records.append(against(key, compiled, time, goal, told, cost))
    return records


def _cold(swarms: Sequence[Ran], ours: Ran, tile: TileCost | None) -> list[Record]:
    """With what a tile of a map costs: for scans along a drive, and for the first scan of all."""
    if tile is None:
        return []
    whole_ms = tile.gridding_ms + tile.columns_ms
    note = f"gridding {tile.gridding_ms:.0f} and columns {tile.columns_ms:.0f} ms a tile charged to this project alone"
    along, first = fastest(swarms, ours, batch), fastest(swarms, ours, single)
    mine = ours.result
    return [
        _ratio("batch / best swarm, cold", along, batch, batch(mine) + whole_ms / SCANS_A_TILE, None, note),
        _ratio("single / best swarm, first scan of a tile", first, single, single(mine) + whole_ms, None, note),
    ]


def _ratio(key: str, other: Ran | None, time: Time, cost_ms: float, goal: float | None, note: str) -> Record:
    if other is None:
        return Record(key, float("nan"), "×", "higher", goal, "nothing of equal success to compare with")
    theirs = time(other.result)
    name = f"{other.result.name} {other.result.setting} ({other.result.successes} of {other.result.problems})"
    told = f"{theirs:.4g} ms of {name} to {cost_ms:.4g} ms; {note}"
    return Record(key, theirs / cost_ms, "×", "higher", goal, told)


# The peers side by side, for the terminal and as data.

_HEADER = (
    *("search", "setting", "success", "95 % interval", "n", "median", "single", "batch"),
    *("evaluations", "preparation", "memory"),
)
_INSTALL = 'pip install "lgprjax[bench]"'


def peer_table(runs: Sequence[Ran]) -> str:
    """A line for each peer that ran, then one for each that did not and why."""
    ran = [entry for entry in runs if not entry.result.missing]
    rows = [_HEADER, *(_peer_row(entry) for entry in ran)]
    widths = [max(len(row[column]) for row in rows) for column in range(len(_HEADER))]
    lines = ["  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip() for row in rows]
    return "\n".join([*lines, *missing_lines(runs)]) + "\n"


def missing_lines(runs: Sequence[Ran]) -> list[str]:
    """Which peers have no result, why, and what helps."""
    lines = []
    for _, result in (entry for entry in runs if entry.result.missing):
        helps = f": {_INSTALL}" if result.missing.endswith("is not installed") else ""
        lines.append(f"missing: {result.name} {result.setting}".rstrip() + f": {result.missing}{helps}")
    return lines


def peers_as_data(runs: Sequence[Ran]) -> list[dict[str, Any]]:
    """The results with role and interval, as JSON takes them."""
    rows = json.loads(results_as_json([entry.result for entry in runs]))
    return [
        {"role": entry.role, **row, "interval": list(entry.interval)} for entry, row in zip(runs, rows, strict=True)
    ]


def _peer_row(entry: Ran) -> tuple[str, ...]:
    result, (low, high) = entry.result, entry.interval
    return (
        result.name,
        result.setting,
        f"{100 * result.success_share:.1f} %",
        f"{100 * low:.1f}-{100 * high:.1f} %",
        str(result.problems),
        f"{100 * result.median_error_m:.1f} cm",
        f"{result.single_ms:.3g} ms ({result.single_threads})",
        f"{result.batch_ms:.3g} ms ({result.batch_threads})",
        str(result.evaluations),
        f"{result.preparation_ms:.1f} ms",
        f"{result.peak_rss_mb:.0f} MB",
    )


# When and on what a measurement ran.

_PACKAGES = ("numpy", "jax", "numba", "evosax", "pyswarms")


def date_and_commit() -> dict[str, str]:
    """Date (UTC) and commit of the measured source; without the commit outside of a repository."""
    found = {"date": strftime("%Y-%m-%d", gmtime())}
    with suppress(OSError, subprocess.CalledProcessError):
        command = ["git", "describe", "--always", "--dirty"]
        done = subprocess.run(command, cwd=Path(__file__).parent, capture_output=True, text=True, check=True)
        found["commit"] = done.stdout.strip()
    return found


def machine_line() -> str:
    """CPU, cores that may be used, load, versions of everything that computes."""
    cores = usable_cores()
    load = f", load {os.getloadavg()[0]:.2f} at the start" if hasattr(os, "getloadavg") else ""
    found = [f"Python {platform.python_version()}", *(f"{name} {_version(name)}" for name in _PACKAGES)]
    return f"{_cpu()}, {cores} cores{load}; {', '.join(found)}"


def _cpu() -> str:
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        lines = []
    names = [line.split(":", 1)[1].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def _version(package: str) -> str:
    try:
        return version(package)
    except PackageNotFoundError:
        return "missing"
