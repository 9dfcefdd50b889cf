"""A drive of ten minutes registered from end to end: what a scan costs, and where the time goes.

``python -m benchmarks drive``. Each figure is taken in a process of its own; its program is this module
(``python -m benchmarks.whole_drive OUT MAP LOG --threads N``).
"""

import argparse
import cProfile
import json
import os
import pstats
import subprocess
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, NamedTuple

from benchmarks.process import ProgramError, hold_to, run_program
from benchmarks.records import Record, machine_line
from benchmarks.village import village_drives
from lgprjax.batch import register_log
from lgprjax.formats import DriveLog, MapFile
from lgprjax.machine import compile_clock, peak_rss_mb, usable_cores
from lgprjax.mapping import build_map
from lgprjax.registration import RegisterOptions
from lgprjax.simulation import read_site, site_file, write_drives
from lgprjax.simulation.site_tables import Site, plan_drive, prepare_site

_PARTS = {
    "reading": ("formats/drive.py", "read_traces"),
    "samples to coefficients": ("registration/queries.py", "coefficients"),
    "ground and template banks": ("registration/template_bank.py", "make"),
    "scores over lattices": ("registration/lattice.py", "surfaces_of"),
    "peaks of windows": ("registration/evidence.py", "_peaks_of"),
    "refinement and covariance": ("registration/candidates.py", "finish"),
    "scores at the true pose": ("registration/candidates.py", "score_at"),
    "table of fixes": ("batch/register.py", "fixes_table"),
}
"""Functions whose time is told, callees included; the first three of them lie within later ones now and then."""

_LINES, _LINE_SPACING_M = 20, 0.25
_CODE = "import sys; from lgprjax.cli import main; main(sys.argv[1:])"
_ROOT = Path(__file__).resolve().parents[1]


@dataclass(frozen=True)
class WholeDrivePlan:
    """How much is measured.

    Attributes:
        length_m: of the road of eleven channels; a drive at 10 mph makes 28 scans a metre.
        lines_m: of the road that twenty lines of three channels map.
        limit_s: of each process.
    """

    length_m: float = 2700.0
    lines_m: float = 120.0
    limit_s: float = 1800.0


FULL_DRIVE = WholeDrivePlan()
QUICK_DRIVE = WholeDrivePlan(length_m=60.0, lines_m=30.0, limit_s=300.0)


class DriveOutcome(NamedTuple):
    """Machine, figures with goals among them, and what did not run and why."""

    machine: str
    records: list[Record]
    not_measured: list[str]


def run_drive(plan: WholeDrivePlan, folder: Path, say: Callable[[str], None]) -> DriveOutcome:
    """Run a plan.

    Args:
        plan: how much.
        folder: for drives and results.
        say: told what is being done.
    """
    machine, cores = machine_line(), min(2, usable_cores())
    say(f"simulating a road of {plan.length_m:g} m")
    site = {name: drive for name, drive in village_drives(1, plan.length_m).items() if name != "impostor"}
    logs = write_drives(site, folder)
    road = folder / "road.map.h5"
    build_map([logs["baseline_left"], logs["baseline_right"]], road)
    say(f"simulating {_LINES} lines of 3 channels")
    lines, few = lines_of_few_channels(folder / "lines", plan.lines_m)
    live = logs["live"]
    missing: list[str] = []
    found: dict[str, dict[str, Any]] = {}
    runs: list[tuple[str, tuple[Path, Path], int, list[str]]] = [
        ("first process", (road, live), cores, []),
        ("default", (road, live), cores, ["--profile"]),
        ("default, 1 core", (road, live), 1, []),
        ("single scans", (road, live), cores, ["--window-m", "0"]),
        ("windows of 4 m", (road, live), cores, ["--window-m", "4"]),
        (f"3 channels on {_LINES} lines", (lines, few), cores, []),
    ]
    own = {"JAX_COMPILATION_CACHE_DIR": str(folder / "compiled"), "JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS": "0.1"}
    for name, files, threads, options in runs:
        say(name)
        given = [*map(str, files), "--threads", str(threads), *options]
        try:
            found[name] = run_program(
                "benchmarks.whole_drive", given, threads=threads, limit_s=plan.limit_s, environment=own
            )
        except ProgramError as error:
            missing.append(f"{name}: {error}")
    say("the command")
    try:
        found["command"] = {"seconds": _command_s(road, live, folder / "fixes", own, plan.limit_s)}
    except ProgramError as error:
        missing.append(f"command: {error}")
    return DriveOutcome(machine, drive_records(found, cores), missing)


def lines_of_few_channels(folder: Path, length_m: float) -> tuple[Path, Path]:
    """A map of twenty lines of three channels and a drive between two of them."""
    folder.mkdir()
    site = read_site(site_file("village"))
    longer_m = length_m - site.ground.length_m
    plain = {drive.name: drive for drive in site.drives}

    def moved(kind: str, name: str, lane_m: float, number: int) -> Any:
        drive = plain[kind]
        way = replace(drive.plan, lane_m=lane_m, stop_m=drive.plan.stop_m + longer_m)
        return replace(
            drive, name=name, plan=way, seed=drive.seed + number, day=replace(drive.day, seed=drive.day.seed + number)
        )

    middle = 0.5 * (_LINES - 1)
    lines = [moved("baseline_left", f"line{n:02d}", (n - middle) * _LINE_SPACING_M, 100 + n) for n in range(_LINES)]
    scene: Site = replace(
        site,
        ground=replace(site.ground, length_m=length_m, half_width_m=6.0),
        road=replace(site.road, length_m=length_m),
        array=replace(site.array, channels=3, pitch_m=_LINE_SPACING_M),
        drives=(*lines, moved("live", "live", 0.1, 0)),
    )
    prepared = prepare_site(scene)
    logs = write_drives({drive.name: plan_drive(prepared, drive) for drive in scene.drives}, folder)
    path = folder / "lines.map.h5"
    build_map([logs[line.name] for line in lines], path)
    return path, logs["live"]


def drive_records(found: Mapping[str, Mapping[str, Any]], cores: int) -> list[Record]:
    """Records of what the processes found.

    Args:
        found: by name of the run; those that failed are missing.
        cores: that a run had where its name does not say.
    """
    records = []
    goals = {"default": 0.8, f"3 channels on {_LINES} lines": 4.0}
    for name, run in found.items():
        if name in ("first process", "command"):
            continue
        told = f"{run['scans']} scans, {100 * run['ok']:.1f} % ok, {run['peak_rss_mb']:.0f} MB; all but compiling"
        each_ms = _each_ms(run)
        records.append(Record(f"drive/{name}", each_ms, "ms a scan", "lower", goals.get(name), told))
    if "single scans" in found and "windows of 4 m" in found:
        ratio = _each_ms(found["windows of 4 m"]) / _each_ms(found["single scans"])
        records.append(Record("drive/windows of 4 m / single scans", ratio, "×", "lower", 1.5, "same machine and run"))
    for name, key, goal in (("first process", "first", None), ("default", "second", 3.0)):
        if name in found:
            note = "cache empty" if key == "first" else "cache of the first"
            records.append(Record(f"drive/compile, {key} process", found[name]["compile_s"], "s", "lower", goal, note))
    if "command" in found and "default" in found:
        each = 1e3 * found["command"]["seconds"] / found["default"]["scans"]
        note = f"{cores} cores; start, hashes, loading of programs, report and pictures included"
        records.append(Record("drive/command", each, "ms a scan", "lower", None, note))
    for part, seconds in found.get("default", {}).get("parts", {}).items():
        each = 1e3 * seconds / found["default"]["scans"]
        records.append(Record(f"drive/of it: {part}", each, "ms a scan", "lower", None, "under a profiler"))
    return records


def _each_ms(run: Mapping[str, Any]) -> float:
    return 1e3 * float(run["seconds"] - run["compile_s"]) / float(run["scans"])


def _command_s(road: Path, live: Path, into: Path, own: Mapping[str, str], limit_s: float) -> float:
    """Seconds of the command as a person gives it."""
    command = [sys.executable, "-c", _CODE, "register", str(road), str(live), "-o", str(into)]
    path = os.pathsep.join(part for part in (str(_ROOT), os.environ.get("PYTHONPATH", "")) if part)
    began = time.perf_counter()
    try:
        done = subprocess.run(
            command,
            env={**os.environ, **own, "PYTHONPATH": path},
            capture_output=True,
            text=True,
            timeout=limit_s,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ProgramError(f"not done within {limit_s:.0f} s") from None
    if done.returncode != 0:
        raise ProgramError((done.stderr.strip().splitlines() or ["no message"])[-1])
    return time.perf_counter() - began


def main(arguments: Sequence[str] | None = None) -> None:
    """The program: one process, one setting."""
    parser = argparse.ArgumentParser(prog="benchmarks.whole_drive")
    parser.add_argument("out", type=Path)
    parser.add_argument("map", type=Path)
    parser.add_argument("log", type=Path)
    parser.add_argument("--threads", type=int, required=True)
    parser.add_argument("--window-m", type=float)
    parser.add_argument("--profile", action="store_true")
    chosen = parser.parse_args(arguments)
    hold_to(chosen.threads)
    clock, began = compile_clock(), time.perf_counter()
    drive = _registered(chosen)
    told: dict[str, Any] = {
        "scans": len(drive.table),
        "ok": float((drive.table["code"] == "ok").mean()),
        "seconds": time.perf_counter() - began,
        "compile_s": clock.seconds_since(began),
        "peak_rss_mb": peak_rss_mb(),
    }
    if chosen.profile:
        profile = cProfile.Profile()
        profile.runcall(_registered, chosen)
        told["parts"] = _parts_of(pstats.Stats(profile))
    chosen.out.write_text(json.dumps(told), encoding="utf-8")


def _registered(chosen: argparse.Namespace) -> Any:
    with MapFile.open(chosen.map) as source, DriveLog.open(chosen.log) as log:
        return register_log(source, log, RegisterOptions(window_m=chosen.window_m))


def _parts_of(stats: pstats.Stats) -> dict[str, float]:
    """Seconds of each part, callees included."""
    rows: Mapping[tuple[str, int, str], tuple[int, int, float, float, Any]] = getattr(stats, "stats")  # noqa: B009
    return {
        part: sum(row[3] for (file, _, name), row in rows.items() if file.endswith(where) and name == function)
        for part, (where, function) in _PARTS.items()
    }


if __name__ == "__main__":
    main()
