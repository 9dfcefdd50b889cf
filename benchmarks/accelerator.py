"""The same problems on an accelerator and on two cores of its machine: times, floors, and whether the results agree.

``python -m benchmarks registration|rollouts|drive --device gpu``.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, NamedTuple

import numpy as np

from benchmarks.process import AS_THE_PEER, ProgramError, run_program
from benchmarks.records import Record, machine_line
from benchmarks.registration import HardSetConfig, make_hard_set, save_hard_set
from benchmarks.rollout_problem import make_problem, save_problem
from benchmarks.village import village_drives
from lgprjax.machine import usable_cores
from lgprjax.mapping import build_map
from lgprjax.simulation import write_drives

Problem = Literal["registration", "rollouts", "drive"]
_SEED = 0
_GOAL = 100.0
_APART_MM = 1.0


@dataclass(frozen=True)
class AcceleratorPlan:
    """How much is measured.

    Attributes:
        hard_set: scans to register in batch.
        lanes, steps: of the rollouts.
        length_m: of the road whose drive is registered.
        limit_s: of each process.
    """

    hard_set: HardSetConfig
    lanes: int = 1 << 20
    steps: int = 400
    length_m: float = 70.0
    limit_s: float = 300.0


FULL_ACCELERATOR = AcceleratorPlan(HardSetConfig(maps=4, scans=2048))
QUICK_ACCELERATOR = AcceleratorPlan(HardSetConfig(maps=1, scans=57), lanes=8192, steps=100)


class AcceleratorOutcome(NamedTuple):
    """Machine and device, figures with goals among them, and what did not run and why."""

    machine: str
    records: list[Record]
    not_measured: list[str]


class Ran(NamedTuple):
    """Figures and results of a problem on one device."""

    figures: Mapping[str, Any]
    results: Mapping[str, np.ndarray]


def run_accelerator(
    problem: Problem, plan: AcceleratorPlan, folder: Path, say: Callable[[str], None]
) -> AcceleratorOutcome:
    """Run one problem on both.

    Args:
        problem: what to run.
        plan: how much.
        folder: for its files, removed by the caller.
        say: told what is being done.
    """
    machine = machine_line()
    say(f"{problem}: files")
    files = _FILES[problem](plan, folder)
    cores = min(2, usable_cores())
    try:
        found = _run(problem, files, folder / "there.npz", cores, plan.limit_s, {"JAX_PLATFORMS": ""}, say)
        device = found.figures["device"]
        if found.figures["platform"] == "cpu":
            return AcceleratorOutcome(machine, [], [f"{problem}: JAX finds no accelerator here"])
        here = _run(problem, files, folder / "here.npz", cores, plan.limit_s, AS_THE_PEER, say)
    except ProgramError as error:
        return AcceleratorOutcome(machine, [], [str(error)])
    return AcceleratorOutcome(f"{machine}; {device}", _RECORDS[problem](found, here, cores), [])


def _run(
    problem: Problem,
    files: list[Path],
    results: Path,
    cores: int,
    limit_s: float,
    environment: dict[str, str],
    say: Callable[[str], None],
) -> Ran:
    say(f"{problem}: {'the accelerator' if 'JAX_PLATFORMS' in environment else f'{cores} cores'}")
    given = [problem, str(results), *map(str, files), "--threads", str(cores)]
    figures = run_program("benchmarks.on_accelerator", given, threads=cores, limit_s=limit_s, environment=environment)
    with np.load(results) as arrays:
        return Ran(figures, dict(arrays))


def registration_records(there: Ran, here: Ran, cores: int) -> list[Record]:
    """Scans in batch: their time from bytes on the host to poses on the host, and where both are on the device."""
    ours, theirs = there.figures, here.figures
    apart_mm = 1e3 * np.hypot(*(there.results["pose"] - here.results["pose"])[:, :2].T)
    told = f"{ours['scans']} scans, {ours['right']} right; {theirs['right']} right on {cores} cores"
    floor_us = 1e6 * ours["bytes"] / ours["bandwidth"]
    floor = (
        f"{ours['bytes'] / 1e3:.0f} kB a scan at {ours['bandwidth'] / 1e12:.2f} TB/s: samples, and surfaces written "
        f"and read once; {floor_us / ours['on_device_us']:.0%} of the time on the device"
    )
    return [
        *_ratios("registration", theirs["host_to_host_us"], ours["host_to_host_us"], ours["on_device_us"], told),
        Record("gpu/registration, 2 cores", theirs["host_to_host_us"], "µs a scan", "lower", None, told),
        Record("gpu/registration", ours["host_to_host_us"], "µs a scan", "lower", None, "from host to host"),
        Record("gpu/registration, on the device", ours["on_device_us"], "µs a scan", "lower", None, "no transfer"),
        Record("gpu/registration, floor by bytes", floor_us, "µs a scan", "lower", None, floor),
        *_apart("registration", apart_mm),
    ]


def rollout_records(there: Ran, here: Ran, cores: int) -> list[Record]:
    """Vehicles in closed loop: the same."""
    ours, theirs = there.figures, here.figures
    steps = ours["vehicle_steps"]
    apart_mm = 1e3 * np.hypot(*(there.results["pose"] - here.results["pose"]))
    floor_s = ours["bytes"] * steps / ours["bandwidth"]
    told = f"{steps / 1e6:.0f} million steps, 2 cores {steps / theirs['host_to_host_s'] / 1e6:.0f} M steps/s"
    floor = (
        f"{ours['bytes']} bytes a step at {ours['bandwidth'] / 1e12:.2f} TB/s, every step through memory; "
        f"{floor_s / ours['on_device_s']:.0%} of the time on the device"
    )

    def rate(key: str, seconds: float, note: str) -> Record:
        return Record(f"gpu/rollouts{key}", steps / seconds / 1e6, "M steps/s", "higher", None, note)

    return [
        *_ratios("rollouts", theirs["host_to_host_s"], ours["host_to_host_s"], ours["on_device_s"], told),
        rate(", 2 cores", theirs["host_to_host_s"], f"{cores} cores of the same machine"),
        rate("", ours["host_to_host_s"], "from host to host"),
        rate(", on the device", ours["on_device_s"], "no transfer"),
        rate(", floor by bytes", floor_s, floor),
        *_apart("rollouts", apart_mm),
    ]


def drive_records(there: Ran, here: Ran, cores: int) -> list[Record]:
    """A drive registered by default: codes, positions, time."""
    ours, theirs = there.figures, here.figures
    equal = there.results["code"] == here.results["code"]
    both = equal & (there.results["code"] == "ok")
    apart_mm = 1e3 * np.hypot(*(there.results["pose"] - here.results["pose"])[both, :2].T)
    told = f"{int(equal.sum())} of {len(equal)} scans"
    each = f"second run in one process; the first took {ours['first_s']:.0f} s, of which most compiles"
    return [
        Record("gpu/drive, equal codes", 100.0 * float(equal.mean()), "%", "higher", 100.0, told),
        *_apart("drive", apart_mm),
        Record("gpu/drive", ours["each_ms"], "ms a scan", "lower", None, each),
        Record("gpu/drive, 2 cores", theirs["each_ms"], "ms a scan", "lower", None, f"{cores} cores, likewise"),
    ]


def _ratios(what: str, cores: float, whole: float, device: float, told: str) -> list[Record]:
    return [
        Record(f"gpu/{what} / 2 cores", cores / device, "×", "higher", _GOAL, f"on the device; {told}"),
        Record(f"gpu/{what} / 2 cores, host to host", cores / whole, "×", "higher", None, told),
    ]


def _apart(what: str, apart_mm: np.ndarray) -> list[Record]:
    """Largest distance between the two devices' results."""
    far = int(np.sum(apart_mm > _APART_MM))
    note = f"median {np.median(apart_mm):.2g} mm; {far} of {len(apart_mm)} by more than {_APART_MM:g} mm"
    return [Record(f"gpu/{what}, apart", float(np.max(apart_mm)), "mm", "lower", _APART_MM, note)]


def _hard_set_file(plan: AcceleratorPlan, folder: Path) -> list[Path]:
    file = folder / "hard_set.npz"
    save_hard_set(file, make_hard_set(_SEED, plan.hard_set))
    return [file]


def _problem_file(plan: AcceleratorPlan, folder: Path) -> list[Path]:
    file, steps = folder / "problem.npz", folder / "steps"
    save_problem(file, make_problem(plan.lanes, plan.steps, _SEED))
    steps.write_text(str(plan.steps), encoding="utf-8")
    return [file, steps]


def _drive_files(plan: AcceleratorPlan, folder: Path) -> list[Path]:
    site = {name: drive for name, drive in village_drives(1, plan.length_m).items() if name != "impostor"}
    logs = write_drives(site, folder)
    road = folder / "road.map.h5"
    build_map([logs["baseline_left"], logs["baseline_right"]], road)
    return [road, logs["live"]]


_FILES: dict[Problem, Callable[[AcceleratorPlan, Path], list[Path]]] = {
    "registration": _hard_set_file,
    "rollouts": _problem_file,
    "drive": _drive_files,
}
_RECORDS: dict[Problem, Callable[[Ran, Ran, int], list[Record]]] = {
    "registration": registration_records,
    "rollouts": rollout_records,
    "drive": drive_records,
}
