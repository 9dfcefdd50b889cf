"""The comparison's records: how many times faster than what, beside the goals."""

from collections.abc import Callable, Sequence
from typing import Literal, NamedTuple

from lgprjax.bench.intervals import Interval, wilson
from lgprjax.bench.process import PeerResult
from lgprjax.bench.records import Record

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
