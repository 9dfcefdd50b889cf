"""A thousand short drives by one worker and by several, one of them killed; records.

``python -m benchmarks archive``.
"""

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
from jaxtyping import Float

from benchmarks.records import Record, machine_line
from benchmarks.village import village_drives
from lgprjax.batch import JobRecord, outputs_of, read_records, shares_of
from lgprjax.files import file_hash
from lgprjax.formats import DriveLog, DriveWriter, NavigationTrack, OdometryTrack, TraceRecording
from lgprjax.mapping import build_map
from lgprjax.simulation import write_drives

# Very many short drives on disk: cut from one simulated drive, each at scans of its own, with the map they lie on.


class ShortDrives(NamedTuple):
    """A map and the drives on it."""

    map: Path
    drives: list[Path]


def make_short_drives(
    folder: Path, count: int, *, length_m: float, scans: int, say: Callable[[str], None]
) -> ShortDrives:
    """Simulate a road, map it by two drives, and cut a third one into many that overlap.

    Args:
        folder: for all files.
        count: of the short drives; no two begin at the same scan.
        length_m: of the road.
        scans: of a short drive.
        say: told what is being done.

    Raises:
        ValueError: the road is too short for so many.
    """
    say(f"simulating a road of {length_m:g} m")
    site = {name: drive for name, drive in village_drives(1, length_m).items() if name != "impostor"}
    logs = write_drives(site, folder)
    database = folder / "road.map.h5"
    build_map([logs["baseline_left"], logs["baseline_right"]], database)
    say(f"cutting {count} drives of {scans} scans")
    with DriveLog.open(logs["live"]) as log:
        starts = np.unique(np.linspace(0, log.scans - scans, count).astype(int))
        if len(starts) < count:
            raise ValueError(f"{log.scans} scans hold no {count} different drives of {scans}")
        drives = [folder / f"drive_{number:04d}.drive.h5" for number in range(count)]
        for start, path in zip(starts, drives, strict=True):
            cut_drive(log, int(start), int(start) + scans, path)
    return ShortDrives(database, drives)


def cut_drive(log: DriveLog, start: int, stop: int, path: Path) -> None:
    """Write the scans from ``start`` to before ``stop`` of a drive of bytes as a drive of their own."""
    time_s, whole = log.scan_time_s[start:stop], log.description
    assert isinstance(whole.recording, TraceRecording)
    traces, valid = log.read_traces(start, stop)
    odometry = _span(whole.odometry.time_s, time_s)
    part = replace(
        whole,
        name=path.name.removesuffix(".drive.h5"),
        navigation=_track(whole.navigation, time_s),
        odometry=OdometryTrack(whole.odometry.time_s[odometry], whole.odometry.distance_m[odometry]),
        truth=None if whole.truth is None else _track(whole.truth, time_s),
        provenance={**whole.provenance, "scans": [start, stop]},
    )
    with DriveWriter.create(path, part, channels=log.channels, dtype=np.uint8) as writer:
        writer.append(time_s, np.round(traces + np.float32(whole.recording.zero_level)).astype(np.uint8), valid)


def _track(track: NavigationTrack, time_s: Float[np.ndarray, " scan"]) -> NavigationTrack:
    kept = _span(track.time_s, time_s)
    columns = {field.name: getattr(track, field.name) for field in fields(track)}
    cut: dict[str, Any] = {name: None if values is None else values[kept] for name, values in columns.items()}
    return NavigationTrack(**cut)


def _span(at_s: Float[np.ndarray, " time"], time_s: Float[np.ndarray, " scan"]) -> slice:
    """What spans the scans, and a moment to both sides."""
    low, high = np.searchsorted(at_s, [time_s[0], time_s[-1]])
    return slice(max(int(low) - 1, 0), int(high) + 2)


_CODE = "import sys; from lgprjax.cli import main; main(sys.argv[1:])"
_ROOT = Path(__file__).resolve().parents[1]
_NOTHING = "nothing to do"
_AGAIN_S = 30.0


@dataclass(frozen=True)
class ArchivePlan:
    """How much is measured.

    Attributes:
        drives, scans, length_m: so many drives of so many scans, on a road of this length.
        workers: of each run; the first is what the others are held against.
        threads: of each worker.
        cluster: also on a cluster of dask.distributed with two workers.
        limit_s: of each run.
    """

    drives: int = 1000
    scans: int = 252
    length_m: float = 100.0
    workers: tuple[int, ...] = (1, 2, 4)
    threads: int = 1
    cluster: bool = True
    limit_s: float = 3600.0


FULL_ARCHIVE = ArchivePlan()
QUICK_ARCHIVE = ArchivePlan(drives=40, length_m=60.0, workers=(1, 2), limit_s=600.0)


class ArchiveOutcome(NamedTuple):
    """Machine, figures with goals among them, and what did not run and why."""

    machine: str
    records: list[Record]
    not_measured: list[str]


class Run(NamedTuple):
    """One run of the program: wall time, start of the processes included, and what it left.

    Attributes:
        outputs: SHA-256 of each drive's fixes, by file name.
        jobs: records of its jobs.
    """

    seconds: float
    outputs: dict[str, str]
    jobs: list[JobRecord]


class RunError(Exception):
    """A run did not end well; one line says why."""


def run_archive(plan: ArchivePlan, folder: Path, say: Callable[[str], None]) -> ArchiveOutcome:
    """Run a plan.

    Args:
        plan: how much.
        folder: for drives and results.
        say: told what is being done.
    """
    machine = machine_line()
    made = make_short_drives(folder, plan.drives, length_m=plan.length_m, scans=plan.scans, say=say)
    runs: dict[str, Run] = {}
    missing: list[str] = []

    def attempt(name: str, into: str, *options: str, killed: bool = False) -> None:
        say(name)
        try:
            runs[name] = _run(made, folder / into, [*options, "--threads", str(plan.threads)], plan.limit_s, killed)
        except RunError as error:
            missing.append(f"{name}: {error}")

    for count in plan.workers:
        attempt(f"{count} worker{'s' * (count > 1)}", f"by-{count}", "--workers", str(count))
    attempt("one of 2 workers killed", "killed", "--workers", "2", killed=True)
    if plan.cluster:
        _on_cluster(lambda address: attempt("cluster of 2 workers", "cluster", "--scheduler", address), missing)
    attempt(_NOTHING, f"by-{plan.workers[0]}", "--workers", str(plan.workers[0]))
    return ArchiveOutcome(machine, archive_records(runs, plan), missing)


def archive_records(runs: Mapping[str, Run], plan: ArchivePlan) -> list[Record]:
    """Records of what runs found, the first of them the yardstick."""
    if not runs:
        return []
    first, *others = runs
    told = f"{plan.drives} drives of {plan.scans} scans, {plan.threads} thread{'s' * (plan.threads > 1)} a worker"
    records = []
    for name, run in runs.items():
        if name == _NOTHING:
            records.append(Record(f"archive/{name}", run.seconds, "s", "lower", _AGAIN_S, "the same command again"))
            continue
        rate = 60.0 * plan.drives / run.seconds
        records.append(Record(f"archive/{name}", rate, "drives/min", "higher", None, f"{run.seconds:.0f} s; {told}"))
        if name != first:
            ratio = runs[first].seconds / run.seconds
            told_too = "start and compile included"
            records.append(Record(f"archive/{name} / {first}", ratio, "×", "higher", None, told_too))
    for name in others:
        same = sum(runs[first].outputs.get(file) != sha256 for file, sha256 in runs[name].outputs.items())
        same += len(runs[first].outputs.keys() - runs[name].outputs.keys())
        records.append(
            Record(f"archive/files unlike, {name}", float(same), "", "lower", 0.0, f"CSV and HDF5, to {first}")
        )
    records += _process_records([run for name, run in runs.items() if name != _NOTHING])
    return records


def _process_records(runs: Sequence[Run]) -> list[Record]:
    """What processes compiled, held and spent."""
    shares = [share for run in runs for share in shares_of(run.jobs)]
    costs = [job.cost for run in runs for job in run.jobs if job.cost is not None]
    if not costs:
        return []
    compiled = [share.compiled for share in shares]
    again = max(job.attempts for run in runs for job in run.jobs)
    search_ms = 1e3 * np.median([cost.search_s for cost in costs])
    beside_ms = 1e3 * np.median([cost.seconds - cost.search_s for cost in costs])
    note = f"{len(shares)} processes, {min(compiled)} to {max(compiled)} programs each"
    return [
        Record("archive/programs a worker", float(max(compiled)), "", "lower", None, note),
        Record("archive/drives that compiled late", float(sum(share.late for share in shares)), "", "lower", 0.0,
               "after a worker's first drive"),
        Record("archive/memory a worker", max(share.peak_rss_mb for share in shares), "MB", "lower", None, "peak"),
        Record("archive/workers a drive, most", float(again), "", "lower", 3.0, "a worker was killed over it"),
        Record("archive/search a drive", float(search_ms), "ms", "lower", None, "median; reading and tiles included"),
        Record("archive/beside the search", float(beside_ms), "ms", "lower", None,
               "median a drive: hash, opening, track, outputs on disk"),
    ]  # fmt: skip


def _run(made: ShortDrives, folder: Path, options: Sequence[str], limit_s: float, killed: bool) -> Run:
    """One command, as a person gives it."""
    command = [sys.executable, "-c", _CODE, "register", str(made.map), *map(str, made.drives), "-o", str(folder)]
    path = os.pathsep.join(part for part in (str(_ROOT), os.environ.get("PYTHONPATH", "")) if part)
    began = time.perf_counter()
    process = subprocess.Popen(
        [*command, *options],
        env={**os.environ, "PYTHONPATH": path},
        stdout=subprocess.DEVNULL,
        stderr=subprocess.PIPE,
        text=True,
    )
    try:
        if killed:
            _kill_a_worker(process, folder, len(made.drives) // 3, began + limit_s)
        _, said = process.communicate(timeout=limit_s)
    except subprocess.TimeoutExpired:
        process.send_signal(signal.SIGINT)
        process.wait()
        raise RunError(f"not done within {limit_s:.0f} s") from None
    seconds = time.perf_counter() - began
    if process.returncode != 0:
        raise RunError((said.strip().splitlines() or ["no message"])[-1])
    names = [output for drive in made.drives for output in outputs_of(drive.name.removesuffix(".drive.h5"))]
    return Run(seconds, {name: file_hash(folder / name) for name in names}, list(read_records(folder).values()))


def _kill_a_worker(process: "subprocess.Popen[str]", folder: Path, done: int, until_s: float) -> None:
    """Kill a worker as a machine does that is out of memory, once so many drives are done."""
    while process.poll() is None and time.perf_counter() < until_s:
        time.sleep(0.2)
        if len(list(folder.glob("jobs/*.json"))) >= done:
            costs = [record.cost for record in read_records(folder).values() if record.cost is not None]
            os.kill(int(costs[-1].worker.rpartition(":")[2]), signal.SIGKILL)
            return


def _on_cluster(action: Callable[[str], None], missing: list[str]) -> None:
    """Do something with the address of a cluster that lives as long."""
    try:
        from distributed import LocalCluster
    except ImportError:
        missing.append('cluster: package distributed is not installed: pip install "lgprjax[batch]"')
        return
    with LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        action(cluster.scheduler_address)
