"""``lgprjax calibrate``: the numbers of a new vehicle, step by step, with the kit itself."""

import json
import os
import shutil
import signal
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NamedTuple

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.terminal import BAD_INPUT, UsageError, console, counted, say, verdict, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.formats import VehicleFile
    from lgprjax.runtime.config import RuntimeConfig
    from lgprjax.simulation.lock_step import LockStep
    from lgprjax.tuning.studies.calibration import CalibrationStep, FittedStep

_JUDGE_S = 10.0
"""Period at which the recording of a manoeuvre is fitted, s."""
_IDLE_S = 8.0
"""A manoeuvre that suffices ends when neither vehicle nor steering wheel has moved for so long."""
_STILL_SHARE, _STILL_V, _STILL_M = 0.03, 0.03, 0.05
_DRIVEN: dict[str, dict[str, Any]] = {
    "straight": {"kind": "straight", "length_m": 120.0, "speed_mps": 3.0, "weave_rad": 0.008},
    "palm_tree": {"kind": "palm_tree", "speed_mps": 1.5},
    "turns": {"kind": "turns", "speeds_mps": [1.0, 2.0, 3.5, 5.0, 6.5], "angles_rad": [0.1, -0.1]},
    "half_turns": {"kind": "standing"},
}
"""Manoeuvre of the simulated driver by step; in other steps the vehicle stays at standstill until commanded."""
_PRESSES: dict[str, list[dict[str, Any]]] = {
    "none": [],
    "steering": [{"at_s": 1.0, "do": "press", "button": "steering"}],
    "pedals": [
        {"at_s": 1.0, "do": "press", "button": "steering"},
        {"after": {"mode": 3, "for_s": 1.0}, "do": "press", "button": "plus"},
    ],
}


@dataclass(frozen=True)
class Calibrate:
    """Calibrate a new vehicle step by step: prompt a manoeuvre, record it, fit its numbers, write them to the file.

    The steps are straight line, palm tree, turning tests, half turns, steering steps, pedal steps and look-ahead.
    Steering steps and pedal steps are commanded within cautious limits, after the operator has engaged them with the
    controller; all others are driven by hand. Each step ends when its recording suffices. A calibration that was
    interrupted goes on with the first step that has something left to find.
    """

    vehicle: Annotated[
        Positional[Path], arg(metavar="VEHICLE.toml", help="vehicle file, X.vehicle.toml; it is updated")
    ]
    config: Annotated[Path | None, arg(metavar="CONFIG.toml")] = None
    """configuration with the connections; default: the one in the folder of VEHICLE.toml that names it"""
    step: str | None = None
    """do only this step, even if its numbers are known: straight, palm_tree, turns, half_turns, steering, pedals or
    look_ahead"""
    list: bool = False
    """list the numbers with their state, known, assumed or open, and the steps that are due; change nothing"""
    simulate: bool = False
    """calibrate the simulated vehicle of [simulation] in simulated time"""

    def run(self) -> int:
        """Calibrate."""
        from lgprjax.formats import read_vehicle
        from lgprjax.tuning.studies.calibration import is_due, require_measured, steps_of

        vehicle = read_vehicle(self.vehicle)
        if vehicle.steering_kind != "counter_steer":
            raise InputError(self.vehicle, "steering_kind", "counter_steer", vehicle.steering_kind)
        known = {each.name: each for each in steps_of(vehicle)}
        if self.step is not None and self.step not in known:
            raise UsageError(f"--step: expected {', '.join(known)}, found {self.step}")
        if self.list:
            _list(vehicle)
            return 0
        config = self._configuration()
        steps = [known[self.step]] if self.step else [each for each in known.values() if is_due(vehicle, each)]
        folder = self.vehicle.parent / "calibration" / self.vehicle.name.removesuffix(".vehicle.toml")
        for number, step in enumerate(steps, 1):
            say(f"step {number} of {len(steps)}: {step.title}")
            require_measured(read_vehicle(self.vehicle), self.vehicle, step)
            if not self._do(step, config, folder):
                return BAD_INPUT
        if self.step:
            verdict(f"{self.step}: wrote {self.vehicle}", f"calibrate {self.vehicle}")
            return 0
        return self._conclude()

    def _configuration(self) -> "RuntimeConfig":
        """The configuration with the lines of the vehicle.

        Raises:
            InputError: none, or more than one, names the vehicle file.
        """
        from lgprjax.runtime.config import read_config
        from lgprjax.runtime.process import use_cache

        named = self.config
        if named is None:
            files = sorted(self.vehicle.resolve().parent.glob("*.run.toml"))
            configs = [config for file in files if (config := _read(file)) is not None]
            own = [each for each in configs if each.vehicle and each.path(each.vehicle) == self.vehicle.resolve()]
            # Any of several that have the same lines.
            if not own or any(each.ports != own[0].ports for each in own):
                found = "none" if not own else ", ".join(each.file.name for each in own) + " with other connections"
                expected = f"one X.run.toml in {self.vehicle.parent} that names it, or --config CONFIG.toml"
                raise InputError(self.vehicle, "configuration", expected, found)
            named = own[0].file
        config = read_config(named)
        if self.simulate == (config.simulation is None):
            expected = "a table, with --simulate; without --simulate none"
            raise InputError(config.file, "simulation", expected, "none" if self.simulate else "a table")
        use_cache(config)
        return config

    def _do(self, step: "CalibrationStep", config: "RuntimeConfig", folder: Path) -> bool:
        """Do a step; whether its numbers were found."""
        from lgprjax.formats import read_vehicle, write_vehicle
        from lgprjax.report.study_pictures import study_pictures
        from lgprjax.tuning.studies.calibration import fit_step

        folder.mkdir(parents=True, exist_ok=True)
        vehicle = read_vehicle(self.vehicle)
        if any(each.drive == step.name for each in step.studies) and not self._drive(step, config, folder):
            return False
        with working(f"fitting {step.name}"):
            fitted = fit_step(step, vehicle, _logs(folder), folder / "scratch.vehicle.toml")
        (folder / "scratch.vehicle.toml").unlink(missing_ok=True)
        for done in fitted.studies:
            for name, draw in study_pictures(done.study.kind).items():
                picture = folder / f"{step.name}.{done.study.kind}.{name}.png"
                draw(done.outcome.detail, picture, True)
                say(f"picture: {picture}")
        write_vehicle(self.vehicle, fitted.vehicle, force=True)
        _tell(fitted)
        return True

    def _drive(self, step: "CalibrationStep", config: "RuntimeConfig", folder: Path) -> bool:
        """Record the manoeuvre of a step as ``STEP.drive.h5``; whether its recording suffices."""
        from lgprjax.cli.run import in_lock_step, supervised
        from lgprjax.formats import read_run
        from lgprjax.runtime.config import read_config, write_config
        from lgprjax.runtime.drive_log import drive_of_run
        from lgprjax.runtime.supervisor import make_rings_folder
        from lgprjax.simulation.run_setup import course_spec

        for line in step.prompt:
            say(f"  {line}")
        run = folder / f"{step.name}-{time.strftime('%Y-%m-%dT%H-%M-%SZ', time.gmtime())}"
        run.mkdir()
        write_config(run / "calibrate.run.toml", _calibrating(config, step, self.vehicle, folder))
        own = read_config(run / "calibrate.run.toml")
        judge = _Judge(step, own, self.vehicle, run, _logs(folder))
        if self.simulate:
            assert own.simulation is not None
            table = own.simulation.model_copy(
                update={"script": _PRESSES[step.commands] + own.simulation.script, "gnss_slow_m": 0.0}
            )
            spec = course_spec(own, table, _DRIVEN.get(step.name, {"kind": "stand"}))
            own = in_lock_step(own, spec, run, None, judge.over)
        else:
            rings = make_rings_folder()
            with judge.beside(rings):
                status = supervised(own, run, None, rings=rings)
            if status:
                return False
        log = run / f"{step.name}.drive.h5"
        drive_of_run(read_run(run), own, log, force=True)
        enough, words = judge.fit(log)
        say(words)
        if not enough:
            verdict(f"{step.name}: not enough; the recording is kept in {run}", f"calibrate {self.vehicle}")
            return False
        shutil.copyfile(log, folder / f".{step.name}.part")
        (folder / f".{step.name}.part").replace(folder / f"{step.name}.drive.h5")
        return True

    def _conclude(self) -> int:
        from lgprjax.formats import read_vehicle
        from lgprjax.recordings import open_numbers

        vehicle = read_vehicle(self.vehicle)
        left = open_numbers(vehicle)
        assumed = f"; assumed: {', '.join(vehicle.assumed)}" if vehicle.assumed else ""
        if left:
            names = ", ".join(f"{each.path} ({each.step})" for each in left)
            verdict(f"{counted(len(left), 'number')} still open: {names}{assumed}", f"calibrate {self.vehicle} --list")
            return BAD_INPUT
        verdict(f"{self.vehicle}: nothing is open{assumed}", f"check {self.vehicle}")
        return 0


def _read(file: Path) -> "RuntimeConfig | None":
    from lgprjax.runtime.config import read_config

    try:
        return read_config(file)
    except InputError:
        return None


def _logs(folder: Path) -> dict[str, Path]:
    """Drive logs of finished steps, by step."""
    return {path.name.removesuffix(".drive.h5"): path for path in folder.glob("*.drive.h5")}


def _calibrating(config: "RuntimeConfig", step: "CalibrationStep", vehicle: Path, folder: Path) -> "RuntimeConfig":
    """The configuration of a step: its lines, the manoeuvre, nothing to drive along."""
    from lgprjax.runtime.config import CalibrationTable

    ports = config.ports.model_copy(update={"radar": None})
    # A simulated vehicle is not turned round by a crew.
    area = {} if config.simulation is None else {"area_m": 1000.0}
    table = CalibrationTable(step=step.title, prompt=[*step.prompt], commands=step.commands, **area)
    change = {
        "name": step.name,
        "mode": "calibrate",
        "vehicle": str(vehicle.resolve()),
        "map": "",
        "routes": [],
        "ports": ports,
        "coverage": None,
        "output": None,
        "calibration": table,
        "recording": config.recording.model_copy(update={"folder": str(folder.resolve())}),
    }
    return config.model_copy(update=change)


class Judged(NamedTuple):
    """Whether a recording suffices, and why or what is missing, in words."""

    enough: bool
    words: str


class _Judge:
    """Fits the recording of a running manoeuvre repeatedly until it suffices.

    Args:
        step: calibration step of the manoeuvre.
        config: configuration of its run.
        vehicle: vehicle file with the numbers known so far.
        run: folder of the run.
        logs: drive logs of the previous steps.
    """

    def __init__(
        self, step: "CalibrationStep", config: "RuntimeConfig", vehicle: Path, run: Path, logs: dict[str, Path]
    ) -> None:
        self._step, self._config, self._vehicle, self._run, self._logs = step, config, vehicle, run, logs
        self._began, self._left_s = False, 0

    def fit(self, log: Path) -> Judged:
        """The verdict on a drive log."""
        from lgprjax.formats import read_vehicle
        from lgprjax.tuning.studies.calibration import fit_step

        try:
            scratch = self._run / "scratch.vehicle.toml"
            fit_step(self._step, read_vehicle(self._vehicle), {**self._logs, self._step.name: log}, scratch)
        except InputError as error:
            return Judged(False, f"not enough yet: {error.place}: expected {error.expected}, found {error.found}")
        return Judged(True, f"{self._step.title}: enough")

    def look(self) -> Judged:
        """The verdict on what has been recorded by now."""
        from lgprjax.formats import read_run
        from lgprjax.runtime.drive_log import drive_of_run

        log = self._run / "so_far.drive.h5"
        try:
            drive_of_run(read_run(self._run), self._config, log, force=True)
        except InputError as error:
            return Judged(False, f"not enough yet: {error.place}: expected {error.expected}, found {error.found}")
        try:
            if not _is_idle(log):
                return Judged(False, "recording")
            return self.fit(log)
        finally:
            log.unlink(missing_ok=True)

    def over(self, run: "LockStep") -> bool:
        """Whether a run in simulated time may end: its driver has finished, or has taken over and stays so.

        A commanded manoeuvre that is complete ends by itself.
        """
        if self._step.commands == "none":
            return run.driven
        self._left_s = 0 if run.engaged else self._left_s + 1
        self._began |= run.engaged
        return self._began and self._left_s > _JUDGE_S

    @contextmanager
    def beside(self, rings: Path) -> Iterator[None]:
        """Watch a run in real time: report to the page, and end the run when it suffices.

        A commanded manoeuvre ends when it is complete.
        """
        over = threading.Event()

        def watch() -> None:
            while not over.wait(_JUDGE_S):
                complete = self._step.commands != "none" and _is_complete(self._run)
                found = self.look() if self._step.commands == "none" else Judged(complete, "")
                _put_progress(rings, found.words)
                if found.enough and not over.is_set():
                    os.kill(os.getpid(), signal.SIGTERM)
                    return

        thread = threading.Thread(target=watch, name="judge", daemon=True)
        thread.start()
        try:
            yield
        finally:
            over.set()
            thread.join()


def _is_idle(log: Path) -> bool:
    """Whether nothing has moved lately: the crew has finished, or waits."""
    import numpy as np

    from lgprjax.formats import VehicleLog

    drive = VehicleLog.open(log)
    signals = drive.vehicle or {}
    volts = np.asarray(signals.get("steering_potentiometer_v", [np.nan]), np.float64)
    time_s = np.asarray(signals.get("time_s", [0.0]), np.float64)
    lately = volts[time_s > time_s[-1] - _IDLE_S]
    way_m = drive.odometry.distance_m[drive.odometry.time_s > drive.odometry.time_s[-1] - _IDLE_S]
    still = np.ptp(lately) < max(_STILL_SHARE * np.ptp(volts), _STILL_V)
    return bool(time_s[-1] - time_s[0] > _IDLE_S and still and np.ptp(way_m) < _STILL_M)


def _is_complete(run: Path) -> bool:
    from lgprjax.runtime.timeline import read_timeline

    try:
        return read_timeline(run).arrived
    except InputError:
        return False


def _put_progress(rings: Path, words: str) -> None:
    from lgprjax.run_records import Record, RecordKind, Source, pack
    from lgprjax.runtime.process import RINGS
    from lgprjax.runtime.ring import Ring

    payload = json.dumps({"progress": words}).encode()
    ring = Ring.create(rings / "progress", RINGS["progress"])
    ring.put(pack(Record(RecordKind.EVENT, Source.SUPERVISOR, 0, time.monotonic_ns(), payload)))


def _tell(fitted: "FittedStep") -> None:
    """Print the numbers found, with their intervals."""
    from lgprjax.formats import load_schema

    units = {entry.path: entry.unit for entry in load_schema("vehicle").keys}
    table = Table("number", "value", "95 % interval")
    for done in fitted.studies:
        for path, found in done.outcome.found.items():
            if not isinstance(found, list):
                table.add_row(path, f"{found.value:.5g} {units[path]}".strip(), f"{found.low:.5g} to {found.high:.5g}")
    console.print(table, highlight=False, markup=False)


def _list(vehicle: "VehicleFile") -> None:
    """Print each number that driving needs with its state, and the steps that are due."""
    from lgprjax.recordings.vehicles import NEEDED_TO_DRIVE
    from lgprjax.tuning.studies.calibration import is_due, state_of, steps_of

    table = Table("number", "state", "needed for", "found by")
    for each in NEEDED_TO_DRIVE:
        states = [state_of(vehicle, path) for path in each.path.split("|")]
        state = next((word for word in ("known", "assumed") if word in states), "open")
        table.add_row(each.path.replace("|", " or "), state, each.why, each.step)
    console.print(table, highlight=False, markup=False)
    due = [step.name for step in steps_of(vehicle) if is_due(vehicle, step)]
    verdict(f"steps that are due: {', '.join(due) or 'none'}")
