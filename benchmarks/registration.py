"""``python -m benchmarks registration``: the hard set, every peer on it, the measuring programs, their records."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Bool, Float, Int

from benchmarks.coverage import Texture, draw_ground, sample_ground
from benchmarks.process import AS_THE_PEER, ProgramError, run_peer, run_program
from benchmarks.records import Ran, Record, Role, TileCost, machine_line, ratio_records
from benchmarks.tracking import latency_records, length_records, tile_cost, tile_records
from lgprjax.errors import InputError
from lgprjax.machine import usable_cores

# Hard registration problems from a seed: what every search in the comparison is given.
#
# Grounds are smooth Gaussian fields in plan, independent from one coefficient to the next up to a depth envelope, with
# autocorrelation exp(-d²/(2 l²)); a share of the power repeats exactly every 0.61 m along the track, so that false
# places look right. Scans are heard from the field itself between its nodes (``field``), not by the bilinear sampling
# that the searches use, and carry as much noise as makes r at the truth the drawn value.

LIGHT_SPEED_M_PER_NS = 0.299792458
SAMPLES = 369
SAMPLE_INTERVAL_NS = 0.16
HARMONICS = np.arange(5, 27)
"""On the grid of the discrete Fourier transform, where Parseval is exact. 100-400 MHz holds 18 of its
frequencies; two more at either end make 22, 85 to 440 MHz."""
CHANNELS = 11
CHANNEL_LEFT_M = 0.127 * (CHANNELS // 2 - np.arange(CHANNELS))
"""Of each channel from the array's centre; channel 0 is the leftmost."""
HEIGHT_REFERENCE_M = 0.3
CELL_M = np.array([0.04, 0.0635])
HALF_CELLS = (92, 68)
"""3.68 m by 4.32 m either way: the box and the array at 5°, no search leaves the map."""
SUCCESS_M = 0.10
_OUT_OF_BAND_SHARE = 0.05
_FULL_SCALE_RMS = 5.0


@dataclass(frozen=True)
class HardSetConfig(Texture):
    """Size and difficulty; the ground's look in plan is inherited.

    Attributes:
        maps, scans: grounds, and scans on each; 114 scans are a tile of 4 m driven at 3.5 cm.
        half_width: of the search box: along_m, cross_m, height_m, heading_rad, roll_rad.
        correlation_low, correlation_high: r at the truth is drawn between them, one a scan.
    """

    maps: int = 8
    scans: int = 114
    half_width: tuple[float, float, float, float, float] = (
        3.5,
        3.5,
        0.08,
        float(np.deg2rad(4)),
        float(np.deg2rad(1.5)),
    )
    correlation_low: float = 0.45
    correlation_high: float = 0.65


class HardSet(NamedTuple):
    """The problems.

    Attributes:
        ground: coefficients (real parts, then imaginary parts) at each node, at ``HEIGHT_REFERENCE_M``.
        origin_m, cell_m: along and cross of node (0, 0), and between nodes.
        omega: angular frequency of each complex coefficient, rad/ns.
        basis: orthonormal; ``samples @ basis`` are the band-limited numbers of a trace.
        scans: int8 values; scaled each by itself.
        map_index: ground of each problem.
        truth: along_m, cross_m, height_m above ground, heading_rad, roll_rad.
        prior: centre of each box, in the same units; its height is ``HEIGHT_REFERENCE_M``.
        half_width: of every box.
        correlation: r at the truth, in band, before quantisation.
    """

    ground: Float[np.ndarray, "map along cross coefficient"]
    origin_m: Float[np.ndarray, " 2"]
    cell_m: Float[np.ndarray, " 2"]
    omega: Float[np.ndarray, " half"]
    basis: Float[np.ndarray, "sample coefficient"]
    scans: Float[np.ndarray, "problem channel sample"]
    map_index: Int[np.ndarray, " problem"]
    truth: Float[np.ndarray, "problem 5"]
    prior: Float[np.ndarray, "problem 5"]
    half_width: Float[np.ndarray, " 5"]
    correlation: Float[np.ndarray, " problem"]


def make_hard_set(seed: int, config: HardSetConfig | None = None) -> HardSet:
    """The same problems for the same seed and settings."""
    config = config or HardSetConfig()
    rng = np.random.default_rng(seed)
    basis, omega = band_basis()
    size = (2 * HALF_CELLS[0] + 1, 2 * HALF_CELLS[1] + 1)
    shaping = _depth_shaping(basis)
    ground = np.stack([draw_ground(rng, size, CELL_M, shaping, config) for _ in range(config.maps)]).astype(np.float32)
    origin = -CELL_M * np.array(HALF_CELLS)
    index = np.repeat(np.arange(config.maps), config.scans)
    half_width = np.array(config.half_width)
    prior = np.tile(np.array([0.0, 0.0, HEIGHT_REFERENCE_M, 0.0, 0.0]), (len(index), 1))
    truth = prior + 0.8 * half_width * rng.uniform(-1.0, 1.0, prior.shape)
    drawn = rng.uniform(config.correlation_low, config.correlation_high, len(index))
    scans = np.empty((len(index), CHANNELS, SAMPLES), np.float32)
    for problem, place in enumerate(index):
        heard = hear(ground[place], origin, omega, truth[problem])
        scans[problem] = _noisy_samples(rng, heard, basis, drawn[problem])
    return HardSet(ground, origin, CELL_M, omega, basis, scans, index, truth, prior, half_width, drawn)


def band_basis() -> tuple[Float[np.ndarray, "sample coefficient"], Float[np.ndarray, " half"]]:
    """Orthonormal in-band columns of the discrete Fourier transform, and their frequencies in rad/ns."""
    omega = 2.0 * np.pi * HARMONICS / (SAMPLES * SAMPLE_INTERVAL_NS)
    phase = np.outer(np.arange(SAMPLES) * SAMPLE_INTERVAL_NS, omega)
    return np.concatenate([np.cos(phase), -np.sin(phase)], axis=1) * np.sqrt(2.0 / SAMPLES), omega


def hear(
    ground: Float[np.ndarray, "along cross coefficient"],
    origin_m: Float[np.ndarray, " 2"],
    omega: Float[np.ndarray, " half"],
    pose: Float[np.ndarray, " 5"],
) -> Float[np.ndarray, "channel coefficient"]:
    """Coefficients that the array hears at a pose, without noise: an antenna higher up hears its trace later."""
    left = CHANNEL_LEFT_M
    place = np.stack([pose[0] - np.sin(pose[3]) * left, pose[1] + np.cos(pose[3]) * left], axis=-1)
    still = sample_ground(ground, (place - origin_m) / CELL_M)
    delay_ns = (pose[2] + left * np.sin(pose[4]) - HEIGHT_REFERENCE_M) * 2.0 / LIGHT_SPEED_M_PER_NS
    half = len(omega)
    later = (still[:, :half] + 1j * still[:, half:]) * np.exp(-1j * delay_ns[:, None] * omega)
    return np.concatenate([later.real, later.imag], axis=1)


def success(pose: Float[np.ndarray, "*batch 5"], truth: Float[np.ndarray, "*batch 5"]) -> Bool[np.ndarray, "*batch"]:
    """Within 0.10 m of the truth horizontally."""
    return np.asarray(error_m(pose, truth) <= SUCCESS_M)


def error_m(pose: Float[np.ndarray, "*batch 5"], truth: Float[np.ndarray, "*batch 5"]) -> Float[np.ndarray, "*batch"]:
    """Horizontal distance from the truth."""
    return np.asarray(np.hypot(pose[..., 0] - truth[..., 0], pose[..., 1] - truth[..., 1]))


def save_hard_set(path: str | Path, hard_set: HardSet) -> None:
    """As an npz file for other processes."""
    with Path(path).open("wb") as file:
        np.savez(file, **hard_set._asdict())


def load_hard_set(path: str | Path) -> HardSet:
    """Read what ``save_hard_set`` wrote.

    Raises:
        InputError: the file is missing or lacks an array.
    """
    try:
        with np.load(path) as file:
            return HardSet(**{name: file[name] for name in HardSet._fields})
    except (OSError, ValueError, KeyError) as error:
        raise InputError(path, "hard set", "an npz file of a hard set", str(error)) from None


def _depth_shaping(basis: Float[np.ndarray, "sample coefficient"]) -> Float[np.ndarray, "coefficient coefficient"]:
    """Spectrum about 220 MHz, then a depth envelope that falls by e in 40 ns, in band."""
    frequency_mhz = HARMONICS / (SAMPLES * SAMPLE_INTERVAL_NS) * 1e3
    amplitude = np.tile(np.exp(-(((frequency_mhz - 220.0) / 130.0) ** 2)), 2)
    envelope = np.exp(-np.arange(SAMPLES) * SAMPLE_INTERVAL_NS / 40.0)
    return np.asarray(amplitude[:, None] * (basis.T @ (envelope[:, None] * basis)))


def _noisy_samples(
    rng: np.random.Generator,
    heard: Float[np.ndarray, "channel coefficient"],
    basis: Float[np.ndarray, "sample coefficient"],
    correlation: float,
) -> Float[np.ndarray, "channel sample"]:
    """Int8 samples whose in-band part has exactly this correlation with what was heard, but for rounding."""
    noise = rng.standard_normal(heard.shape)
    noise -= heard * np.sum(noise * heard) / np.sum(heard**2)
    noise *= np.sqrt(np.sum(heard**2) * (correlation**-2 - 1.0) / np.sum(noise**2))
    inside = (heard + noise) @ basis.T
    outside = rng.standard_normal(inside.shape)
    outside -= outside @ basis @ basis.T
    outside *= np.sqrt(_OUT_OF_BAND_SHARE * np.sum(inside**2) / np.sum(outside**2))
    samples = inside + outside
    scale = 127.0 / (_FULL_SCALE_RMS * np.sqrt(np.mean(samples**2)))
    return np.asarray(np.clip(np.round(samples * scale), -127, 127), np.float32)


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

    def _run(
        self, what: str, module: str, arguments: list[str], threads: int, environment: dict[str, str] | None = None
    ) -> dict[str, Any] | None:
        self._say(what)
        arguments = [*arguments, "--threads", str(threads)]
        limit_s = self._plan.limit_s
        try:
            return run_program(
                f"benchmarks.{module}", arguments, threads=threads, limit_s=limit_s, environment=environment
            )
        except ProgramError as error:
            self.failed.append(str(error))
            return None
