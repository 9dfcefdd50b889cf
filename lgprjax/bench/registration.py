"""``lgprjax bench registration``: the hard set, every peer on it, the measuring programs, their records."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

from lgprjax.bench.hard_set import HardSetConfig, make_hard_set, save_hard_set
from lgprjax.bench.machine import machine_line
from lgprjax.bench.process import PeerResult, run_peer
from lgprjax.bench.programs import AS_THE_PEER, ProgramError, run_program
from lgprjax.bench.ratios import Ran, Role, TileCost, ratio_records
from lgprjax.bench.records import Record
from lgprjax.bench.tracking import latency_records, length_records, tile_cost, tile_records
from lgprjax.machine import usable_cores

_SEED = 0
_RATIO = "×"


def _thread_counts() -> tuple[int, ...]:
    """One, two and all cores that this process may use."""
    cores = usable_cores()
    return tuple(sorted({1, min(2, cores), cores}))


class PeerRun(NamedTuple):
    """A peer to run: what it stands for, its name, problems, options of its command line."""

    role: Role
    name: str
    problems: int
    options: tuple[str, ...] = ()


@dataclass(frozen=True)
class Plan:
    """How much is measured.

    Attributes:
        hard_set: size of the set.
        peers: in the order of the table; the first is this project.
        threads: that each peer is tried with.
        latency_scans: consecutive scans of tracking size; 0 leaves them out.
        tiles: whether the preparation of tiles is timed.
        stages: whether, where a ratio is not reached, the time of each stage and the floor are.
        kilometres: of the short and of the long map; none leaves both out.
        length_scans: of the drive on them.
        length_runs: on each map, in turn.
        limit_s: of each process.
    """

    hard_set: HardSetConfig
    peers: tuple[PeerRun, ...]
    threads: tuple[int, ...] = field(default_factory=_thread_counts)
    latency_scans: int = 10_000
    tiles: bool = True
    stages: bool = True
    kilometres: tuple[int, ...] = (1, 100)
    length_scans: int = 2850
    length_runs: int = 3
    limit_s: float = 900.0


class Outcome(NamedTuple):
    """What a run found.

    Attributes:
        machine: what it ran on.
        peers: results in the plan's order.
        records: figures, those with goals among them.
        not_measured: what did not run, and why.
    """

    machine: str
    peers: list[Ran]
    records: list[Record]
    not_measured: list[str]


def _swarm(particles: int, iterations: int, *more: str) -> tuple[str, ...]:
    return ("--particles", str(particles), "--iterations", str(iterations), *more)


_WHOLE = ("--full",)
FULL = Plan(
    HardSetConfig(),
    (
        PeerRun("ours", "this_project", 912),
        PeerRun("control", "numba_control", 912),
        PeerRun("seeded", "this_project", 456, ("--swarm", "16", "8")),
        PeerRun("seeded", "this_project", 456, ("--swarm", "24", "8")),
        PeerRun("seeded", "this_project", 456, ("--swarm", "48", "8")),
        PeerRun("swarm", "numba_swarm", 456, _swarm(256, 40)),
        PeerRun("swarm", "numba_swarm", 456, _swarm(384, 40)),
        PeerRun("swarm", "numba_swarm", 96, _swarm(256, 40, *_WHOLE)),
        PeerRun("swarm", "numba_swarm", 96, _swarm(384, 40, *_WHOLE)),
        PeerRun("swarm", "direct_swarm", 48, _swarm(384, 40)),
        PeerRun("swarm", "direct_swarm", 24, _swarm(384, 40, *_WHOLE)),
        PeerRun("swarm", "evosax_peer", 48, _swarm(384, 40)),
        PeerRun("swarm", "evosax_peer", 24, _swarm(384, 40, *_WHOLE)),
        PeerRun("swarm", "pyswarms_peer", 24, _swarm(384, 40)),
        PeerRun("swarm", "pyswarms_peer", 12, _swarm(384, 40, *_WHOLE)),
    ),
)
QUICK = Plan(
    HardSetConfig(maps=1),
    (
        PeerRun("ours", "this_project", 114),
        PeerRun("control", "numba_control", 114),
        PeerRun("seeded", "this_project", 57, ("--swarm", "24", "8")),
        PeerRun("swarm", "numba_swarm", 24, _swarm(384, 40)),
        PeerRun("swarm", "direct_swarm", 4, _swarm(384, 40)),
        PeerRun("swarm", "evosax_peer", 4, _swarm(384, 40)),
        PeerRun("swarm", "pyswarms_peer", 3, _swarm(384, 40)),
    ),
    threads=_thread_counts()[-1:],
    latency_scans=1000,
    stages=False,
    kilometres=(),
    limit_s=240.0,
)


def run_registration(plan: Plan, folder: Path, say: Callable[[str], None]) -> Outcome:
    """Run a plan.

    Args:
        plan: what to run.
        folder: for the hard set's file, removed by the caller.
        say: told what runs now.
    """
    machine = machine_line()
    say("hard set")
    file = folder / "hard_set.npz"
    save_hard_set(file, make_hard_set(_SEED, plan.hard_set))
    peers = []
    for role, name, problems, options in plan.peers:
        say(" ".join((name, *options)))
        result = run_peer(name, file, count=problems, threads=plan.threads, options=options, limit_s=plan.limit_s)
        peers.append(Ran(role, result))
    programs = _Programs(plan, say)
    measured = programs.records()
    records = [*ratio_records(peers, programs.tile), *memory_records(peers), *measured]
    ours = next(ran.result for ran in peers if ran.role == "ours")
    unmet = any(record.unit == _RATIO and record.met is False for record in records)
    if plan.stages and unmet and not ours.missing:
        records += programs.stage_records(file)
    records += programs.accelerator_records(file)
    return Outcome(machine, peers, records, programs.failed)


def memory_records(peers: list[Ran]) -> list[Record]:
    """Peak memory of this project's process and of the control's."""
    return [
        Record(f"memory, {ran.result.name}", ran.result.peak_rss_mb, "MB", "lower", None, "peak of the process")
        for ran in peers
        if ran.role in ("ours", "control") and not ran.result.missing
    ]


class _Programs:
    """The programs that are no peers, one after the other; what fails is kept as a line."""

    def __init__(self, plan: Plan, say: Callable[[str], None]) -> None:
        self.failed: list[str] = []
        self.tile: TileCost | None = None
        self._plan, self._say = plan, say

    def records(self) -> list[Record]:
        """Latency, map length, tiles."""
        plan, records = self._plan, []
        for threads in (1, 2) if plan.latency_scans else ():
            arguments = ["--scans", str(plan.latency_scans)]
            found = self._run(f"latency, {threads} cores", "latency", arguments, threads, AS_THE_PEER)
            records += latency_records(found) if found else []
        threads = max(plan.threads)
        tiles = self._run("tiles", "map_length", ["--tiles"], threads) if plan.tiles else None
        if tiles:
            self.tile = tile_cost(tiles)
            records += tile_records(tiles)
        if not plan.kilometres:
            return records
        runs: dict[int, list[dict[str, Any]]] = {kilometres: [] for kilometres in plan.kilometres}
        # In turn: what else the machine does then falls on both alike.
        for kilometres in plan.kilometres * plan.length_runs:
            arguments = ["--kilometres", str(kilometres), "--scans", str(plan.length_scans)]
            found = self._run(f"map of {kilometres} km", "map_length", arguments, threads)
            runs[kilometres] += [found] if found else []
        short, long = (runs[kilometres] for kilometres in plan.kilometres)
        return [*records, *(length_records(short, long) if short and long else [])]

    def stage_records(self, hard_set: Path) -> list[Record]:
        """Where the time goes and the floor."""
        records = []
        for how, more in (("single", []), ("batch", ["--batch"])):
            found = self._run(f"stages, {how}", "stages", [str(hard_set), *more], 1, AS_THE_PEER)
            records += [
                Record(f"stage, {how}: {stage}", value, "ms", "lower", None, "a scan, one thread")
                for stage, value in (found or {}).items()
            ]
        return records

    def accelerator_records(self, hard_set: Path) -> list[Record]:
        """This project on an accelerator, if JAX has one."""
        arguments = [str(hard_set), "--count", str(self._plan.peers[0].problems)]
        anywhere = {"JAX_PLATFORMS": ""}
        found = self._run("accelerator", "on_accelerator", arguments, max(self._plan.threads), anywhere)
        if not found:
            return []
        result = PeerResult(**found)
        told = f"{result.setting}, {result.successes} of {result.problems} found"
        return [
            Record("accelerator, batch", result.batch_ms, "ms", "lower", None, told),
            Record("accelerator, single", result.single_ms, "ms", "lower", None, told),
        ]

    def _run(
        self, what: str, module: str, arguments: list[str], threads: int, environment: dict[str, str] | None = None
    ) -> dict[str, Any] | None:
        self._say(what)
        arguments = [*arguments, "--threads", str(threads)]
        limit_s = self._plan.limit_s
        try:
            return run_program(
                f"lgprjax.bench.{module}", arguments, threads=threads, limit_s=limit_s, environment=environment
            )
        except ProgramError as error:
            self.failed.append(str(error))
            return None
