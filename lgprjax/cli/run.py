"""``lgprjax run``: the onboard runtime."""

import math
import os
import signal
import threading
from collections.abc import Callable, Sequence
from contextlib import nullcontext
from dataclasses import dataclass
from datetime import UTC, datetime
from importlib.util import find_spec
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from rich.table import Table
from tyro.conf import Positional, arg

from lgprjax.cli.figures import check_outputs, write_figures
from lgprjax.cli.terminal import BAD_INPUT, UsageError, console, counted, progress_bar, say, verdict, working
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.runtime.config import RuntimeConfig
    from lgprjax.simulation.lock_step import LockStep

_RECEIVERS, _PAGE = ("pynmeagps", "pyubx2"), ("starlette", "uvicorn", "websockets")


@dataclass(frozen=True)
class Run:
    """Run the onboard runtime from a configuration, on the devices of a vehicle or on simulated devices.

    The configuration defines the connections of radar, GNSS/INS, drive-by-wire box and operator controller. Only the
    operator controller engages the vehicle; the display page shows and selects routes. Every run is recorded in a
    folder of its own, with a drive log written at the end. Ctrl-C or SIGTERM ends the run.
    """

    config: Annotated[Positional[Path], arg(metavar="CONFIG.toml", help="configuration; see lgprjax examples")]
    simulate: bool = False
    """start the simulated devices of [simulation]; create map and route, or plan, if missing. Exit status 0 if the
    autopilot engaged and arrived at the end of its route or plan, else 1 with the reason"""
    lockstep: bool = False
    """with --simulate: run in simulated time, as fast as this machine allows; default if a one-second measurement shows
    that the machine does not keep real time"""
    realtime: bool = False
    """with --simulate: run in real time, without that measurement"""
    replay: Annotated[Path | None, arg(metavar="RUN_FOLDER")] = None
    """repeat the control loop on a recorded run and compare: all commands must be bit-identical"""
    preflight: bool = False
    """check files, devices and settings without sending commands; exit status 1 if a check fails"""
    resume: bool = False
    """field plans: continue where the earlier runs of this machine ended. All runs of the plan in the recording folder
    count as processed ground, also runs copied from other machines; the tool is off there"""
    start_line: int | None = None
    """field plans: start at this line of the plan, counted from 1 in driving order"""
    start_m: float = 0.0
    """with --start-line: start at this distance along the line"""
    end_line: int | None = None
    """field plans: last line of the plan to drive"""
    for_s: float | None = None
    """end the run this many seconds after all processes are ready (simulated seconds in lock step); a simulated run
    also ends on arrival"""
    json: Path | None = None
    """with --simulate or --replay: JSON file for the figures; - for standard output"""
    force: bool = False
    """replace existing outputs"""

    def run(self) -> int:
        """Run."""
        from lgprjax.runtime.config import read_config
        from lgprjax.runtime.process import use_cache

        kinds = {"--simulate": self.simulate, "--replay": self.replay is not None, "--preflight": self.preflight}
        if sum(kinds.values()) > 1:
            raise UsageError(f"{' and '.join(name for name in kinds if kinds[name])}: expected only one of them")
        if (self.lockstep or self.realtime) and not self.simulate:
            raise UsageError(f"{'--lockstep' if self.lockstep else '--realtime'}: needs --simulate as well")
        if self.lockstep and self.realtime:
            raise UsageError("--lockstep and --realtime: expected only one of them")
        if self.json is not None and not (self.simulate or self.replay is not None):
            raise UsageError("--json: needs --simulate or --replay as well")
        if self.for_s is not None and not 0.0 < self.for_s < math.inf:
            raise UsageError(f"--for-s: expected a number above 0, found {self.for_s:g}")
        if self.start_m and self.start_line is None:
            raise UsageError("--start-m: needs --start-line as well")
        if self._takes_up and (self.preflight or self.replay is not None):
            raise UsageError("--resume, --start-line and --end-line: not with --preflight or --replay")
        config = read_config(self.config)
        use_cache(config)
        check_outputs(self.json, force=self.force)
        # A replay has no display page.
        _require_packages(_RECEIVERS if self.replay is not None else _RECEIVERS + _PAGE)
        if self.preflight:
            return _preflight(config)
        if self.replay is not None:
            return self._replay(self.replay)
        if self.simulate:
            return self._simulate(config)
        if config.simulation is not None:
            # Its ports lead to no device: the runtime would wait forever.
            expected = "--simulate as well, or no such table for a real vehicle"
            raise InputError(config.file, "simulation", expected, "a table")
        if config.map and not config.path(config.map).is_file():
            raise InputError(config.file, "map", "an existing map", str(config.path(config.map)))
        if not config.map and config.coverage is None:
            from lgprjax.runtime.preflight import check_recordable  # reads receivers, whose packages are there by now

            check_recordable(config)
        folder = run_folder(config)
        return _drive(self._resumed(config, folder), folder, self.for_s)

    @property
    def _takes_up(self) -> bool:
        return self.resume or self.start_line is not None or self.end_line is not None

    def _resumed(self, config: "RuntimeConfig", folder: Path) -> "RuntimeConfig":
        """The configuration that continues earlier runs, written to the folder of the run."""
        from lgprjax.coverage.resume import RoutePlace
        from lgprjax.formats import read_vehicle
        from lgprjax.formats.coverage_files import write_taken_up
        from lgprjax.recordings.vehicles import machine_of
        from lgprjax.runtime.config import read_config, write_config
        from lgprjax.worked.plans import open_cover_plan
        from lgprjax.worked.resume import TAKEN_UP, runs_by_plan, take_up

        if not self._takes_up:
            return config
        if config.coverage is None or config.coverage.plan is None:
            expected = "a plan, for --resume, --start-line and --end-line"
            raise InputError(self.config, "coverage.plan", expected, "none")
        plan = open_cover_plan(config.path(config.coverage.plan))
        with working("reading earlier runs"):
            runs = runs_by_plan(folder.parent, plan) if self.resume else []
        if self.resume and not runs:
            raise InputError(folder.parent, "runs", f"a run of {plan.path.name}", "none; run without --resume")
        place = None if self.start_line is None else RoutePlace(self.start_line - 1, self.start_m)
        if place is None and not self.resume:
            place = RoutePlace(0, 0.0)
        table = config.coverage
        with progress_bar("computing cells", sum(len(run.rows) for run in runs), "ticks") as progress:
            held = take_up(
                plan,
                runs,
                cell_m=table.cell_m,
                level=table.level,
                shared_sigma_m=table.shared_sigma_m,
                place=place,
                last_line=None if self.end_line is None else self.end_line - 1,
                machine=machine_of(read_vehicle(config.path(config.vehicle))),
                progress=progress,
            )
        folder.mkdir(parents=True, exist_ok=True)
        write_taken_up(folder / TAKEN_UP, held)
        at = held.resumption.place
        say(f"earlier runs: {len(held.runs)}; start at line {at.line + 1}, metre {at.along_m:.1f}")
        if held.resumption.worked:
            done_m = sum(each.high_m - each.low_m for each in held.resumption.worked)
            say(f"{done_m:.0f} m of the remaining swaths are processed: the tool is off there")
        file = folder / "resumed.run.toml"
        write_config(
            file,
            config.model_copy(
                update={"coverage": table.model_copy(update={"resume": str(folder.resolve() / TAKEN_UP)})}
            ),
        )
        return read_config(file)

    def _replay(self, folder: Path) -> int:
        from lgprjax.runtime.replay import replay_run

        with working(f"replaying {folder}"):
            found = replay_run(folder)
        table = Table("replay", "value", title=str(folder))
        table.add_row("starts of the control loop", str(found.starts))
        table.add_row("ticks", str(found.ticks))
        table.add_row("frames sent", str(found.frames))
        table.add_row("frames that differ", str(found.differing))
        if found.first is not None:
            table.add_row("first difference", f"tick {found.first[0]}, {found.first[1].lower()}")
        if found.broken is not None:
            table.add_row("records missing", f"before tick {found.broken}; replayed up to that tick")
        console.print(table, highlight=False)
        if self.json is not None:
            write_figures(self.json, found._asdict(), force=self.force)
        if found.ticks:
            verdict(f"{counted(found.frames, 'frame')} replayed, {found.differing} differ")
        else:
            verdict("nothing to replay: no tick in the recording")
        return BAD_INPUT if found.differing or not found.ticks else 0

    def _simulate(self, config: "RuntimeConfig") -> int:
        from lgprjax.report import draw_timing
        from lgprjax.runtime.preflight import check_recordable
        from lgprjax.simulation.real_time import ended_when_over
        from lgprjax.simulation.run_figures import field_figures, figures_of, read_records, timing_of
        from lgprjax.simulation.run_setup import (
            check_before,
            course_spec,
            devices,
            field_spec,
            prepare_course,
            prepare_field,
            with_addresses,
        )

        table = config.simulation
        if table is None:
            raise InputError(self.config, "simulation", "a table with the simulated devices", "none")
        check_before(config, table)
        if not config.map and config.coverage is None:
            check_recordable(config)
        field = config.coverage is not None
        records = config.mode == "record" or (config.coverage is not None and config.coverage.plan is None)
        if records and self.for_s is None:
            raise UsageError("--for-s: a simulated run that only records needs its duration in seconds")
        if not records:
            making = (
                "creating the plan"
                if field
                else "creating course, map and route"
                if config.map
                else "creating course and route"
            )
            # A first map takes minutes, and a terminal without colours shows no progress.
            say(making)
            with working(making):
                (prepare_field if field else prepare_course)(config, table)
        folder = run_folder(config)
        config = self._resumed(config, folder)
        table = config.simulation
        assert table is not None
        with working("preparing simulated devices"):
            spec = field_spec(config, table) if field else course_spec(config, table)
        lockstep = self.lockstep or not (self.realtime or keeps_real_time())
        folder.mkdir(parents=True, exist_ok=self._takes_up)
        if lockstep:
            driven = in_lock_step(config, spec, folder, self.for_s)
            if not field:
                _write_drive(driven, folder)
        else:
            with devices(spec, folder) as addresses:
                driven = with_addresses(folder, config, addresses)
                leaves_error = any(line.get("button") == "override" for line in table.script)
                ends = nullcontext() if records else ended_when_over(folder, say, leaves_error=leaves_error)
                with ends as all_ready:
                    status = supervised(driven, folder, self.for_s, all_ready)
            if status:
                return status
            if not field:
                _write_drive(driven, folder)
        if records and field:
            return _conclude_field(folder)
        if records:
            return 0 if (folder / f"{config.name}.drive.h5").is_file() else BAD_INPUT
        with working("evaluating the run"):
            if field:
                figures = field_figures(folder, driven)
            else:
                found = read_records(folder)
                figures = figures_of(found, folder)
                draw_timing(timing_of(found, f"Run {folder.name}: from scan to command"), folder / "timing.png")
        print_figures(figures, folder)
        if self.json is not None:
            write_figures(self.json, figures, force=self.force)
        return _conclude(folder)


_SHOWN: tuple[tuple[str, str, float, tuple[str, ...]], ...] = (
    ("control ticks", "{:.0f}", 1.0, ("ticks",)),
    ("control period, median", "{:.1f} ms", 1.0, ("period_p50_ms",)),
    (
        "control period: p99, p99.9, max",
        "{:.1f} ms",
        1.0,
        ("period_p99_ms", "period_p99_9_ms", "period_largest_ms"),
    ),
    ("scans: received, registered", "{:.0f}", 1.0, ("scans", "searched")),
    ("scans: missed while tracking", "{:.0f}", 1.0, ("missed_scans",)),
    ("longest gap between fixes", "{:.0f} scans", 1.0, ("largest_gap_scans",)),
    ("longest queue", "{:.0f} scans", 1.0, ("most_waiting",)),
    ("ok fixes, share of search stops", "{:.2f} %", 100.0, ("ok_share",)),
    ("scan to command, median", "{:.1f} ms", 1.0, ("scan_to_command_p50_ms",)),
    ("scan to command: p99, max", "{:.1f} ms", 1.0, ("scan_to_command_p99_ms", "scan_to_command_largest_ms")),
    ("memory of all processes", "{:.0f} MB", 1.0, ("memory_mb",)),
    ("memory growth in the second half", "{:.0f} MB/h", 1.0, ("memory_growth_mb_per_h",)),
    ("simulated devices: processor time, rendering", "{:.1f} s", 1.0, ("devices_cpu_s", "devices_render_s")),
    ("simulated devices: share of one core", "{:.1f} %", 100.0, ("devices_cpu_share",)),
    ("simulated devices: late ticks", "{:.0f}", 1.0, ("devices_late_ticks",)),
    ("distance engaged", "{:.1f} m", 1.0, ("engaged_way_m",)),
    ("cross-track error from the baseline: RMS, max", "{:.1f} cm", 100.0, ("tracking_rms_m", "tracking_largest_m")),
    ("distance within 1 ft of the baseline", "{:.2f} %", 100.0, ("within_foot",)),
    ("swaths: planned, completed", "{:.0f}", 1.0, ("passes", "passes_driven")),
    ("operator overrides", "{:.0f}", 1.0, ("times_taken_over",)),
    ("distance to go", "{:.1f} m", 1.0, ("to_go_m",)),
    ("time with a GNSS position", "{:.1f} %", 100.0, ("share_fixed",)),
    ("position error with GNSS: RMS", "{:.1f} cm", 100.0, ("position_rms_fixed_m",)),
    ("position error: RMS, max", "{:.1f} cm", 100.0, ("position_rms_m", "position_largest_m")),
    ("cross-track error with GNSS: RMS", "{:.1f} cm", 100.0, ("cross_track_rms_fixed_m",)),
    ("cross-track error: RMS, max", "{:.1f} cm", 100.0, ("cross_track_rms_m", "cross_track_largest_m")),
    ("heading error: RMS, max", "{:.2f}°", 1.0, ("heading_rms_deg", "heading_largest_deg")),
    (
        "squared error over variance: x, y, yaw",
        "{:.2f}",
        1.0,
        tuple(f"squared_error_over_variance_{name}" for name in ("x", "y", "yaw")),
    ),
    (
        "share of the field at 95 %: processed, not processed",
        "{:.1f} %",
        100.0,
        ("worked_share_95", "not_worked_share_95"),
    ),
)
"""Rows of the table: label, number format, factor, names of the figures."""


def figure_rows(figures: dict[str, Any]) -> list[tuple[str, str]]:
    """Labels and values with units, of the figures that the run has."""
    from lgprjax.autopilot import Mode

    rows = []
    for words, form, scale, names in _SHOWN:
        found = [figures[name] for name in names if name in figures]
        if found:
            rows.append((words, ", ".join(form.format(scale * value) for value in found)))
    modes = figures.get("modes", {})
    ticks = max(sum(modes.values()), 1)
    shares = [f"{Mode(int(mode)).name} {100.0 * count / ticks:.1f} %" for mode, count in modes.items()]
    return [*rows, ("share of time per mode", ", ".join(shares))] if shares else rows


def print_figures(figures: dict[str, Any], folder: Path) -> None:
    """Print as a table."""
    table = Table("simulated run", "value", title=str(folder))
    for row in figure_rows(figures):
        table.add_row(*row)
    console.print(table, highlight=False, markup=False)


def in_lock_step(
    config: "RuntimeConfig",
    spec: "dict[str, Any]",
    folder: Path,
    for_s: float | None,
    over: "Callable[[LockStep], bool] | None" = None,
) -> "RuntimeConfig":
    """Run in simulated time and print its progress; arguments as for ``drive_in_lock_step``.

    Returns the configuration of the run.
    """
    from lgprjax.simulation.lock_step import drive_in_lock_step
    from lgprjax.simulation.run_setup import with_addresses

    driven = with_addresses(
        folder, config, dict.fromkeys(("drive_by_wire", "controller", "gnss", "radar"), "/dev/null")
    )
    say(f"run: {folder}, in simulated time (lock step)")
    say(f"display: http://{config.display.host}:{config.display.port}")
    with working("starting") as status:
        try:
            drive_in_lock_step(driven, spec, folder, for_s, lambda at: status.update(at.line), over)
        except KeyboardInterrupt:
            say("interrupted")
    return driven


def keeps_real_time() -> bool:
    """Whether this machine keeps real time now, measured for a second; prints a line if it does not."""
    from lgprjax.simulation.real_time import measure_real_time

    with working("measuring whether this machine keeps real time"):
        found = measure_real_time()
    if not found.keeps:
        say(f"{found.line}; running in simulated time (--realtime: run in real time)")
    return found.keeps


def _conclude_field(folder: Path) -> int:
    """Print what a run without a plan has recorded. Returns its exit status."""
    from lgprjax.run_records import ToolBits
    from lgprjax.worked.record import read_cover_run

    rows = read_cover_run(folder).rows
    counted_s = 0.1 * float(((rows["tool"] & ToolBits.COUNTS) != 0).sum())
    verdict(f"recorded: {counted_s:.0f} s of work in {0.1 * len(rows):.0f} s", f"cover record {folder} -o R.worked.h5")
    return 0


def _conclude(folder: Path) -> int:
    """Print the outcome of a simulated run. Returns its exit status."""
    from lgprjax.runtime.timeline import read_timeline

    found = read_timeline(folder)
    if found.arrived:
        verdict("arrived: engaged, at the end of the route or plan", f"events {folder}")
        return 0
    verdict(f"did not arrive: {found.shortfall}{_devices_late(folder)}", f"events {folder}")
    return BAD_INPUT


def _devices_late(folder: Path) -> str:
    """Lateness of the simulated devices, if this machine was too slow."""
    import numpy as np

    truth = folder / "truth.npz"
    if not truth.exists():
        return ""
    with np.load(truth) as known:
        late_s = float(known["largest_late_s"]) if "largest_late_s" in known else 0.0
        skipped = float(known["skipped_scans"]) if "skipped_scans" in known else 0.0
    if late_s < _LATE_S and not skipped:
        return ""
    return f"; this machine did not keep real time, simulated devices up to {late_s:.2f} s late (use --lockstep)"


_LATE_S = 0.1
"""Simulated devices that are later are treated as failed."""


def _require_packages(needed: Sequence[str]) -> None:
    """Raise ``InputError`` if a package of the runtime is missing."""
    missing = [name for name in needed if find_spec(name) is None]
    if missing:
        extra = 'the packages of the extra onboard (pip install "lgprjax[onboard]")'
        raise InputError("lgprjax run", "packages", extra, f"no {', '.join(missing)}")


def run_folder(config: "RuntimeConfig") -> Path:
    """Path of a new folder for a run, named by its start in UTC."""
    name = datetime.now(UTC).strftime("%Y-%m-%dT%H-%M-%SZ")
    return (config.path(config.recording.folder) / f"{config.name}-{name}").resolve()


def _drive(config: "RuntimeConfig", folder: Path, for_s: float | None) -> int:
    status = supervised(config, folder, for_s)
    if config.coverage is None and not status:
        written = _write_drive(config, folder)
        # Without its drive log a recording has failed.
        return BAD_INPUT if config.mode == "record" and not written else 0
    return status


def supervised(
    config: "RuntimeConfig",
    folder: Path,
    for_s: float | None,
    all_ready: threading.Event | None = None,
    *,
    rings: Path | None = None,
) -> int:
    """Run the processes of a vehicle, for ``for_s`` seconds after they are ready. Returns the exit status."""
    from lgprjax.runtime.supervisor import Ready, make_rings_folder, say_ready, supervise

    ending = threading.Timer(for_s or 0.0, os.kill, (os.getpid(), signal.SIGTERM))
    ending.daemon = True

    def ready(found: Ready) -> None:
        say_ready(found)
        if all_ready is not None:
            all_ready.set()
        if for_s is not None:
            ending.start()

    folder.mkdir(parents=True, exist_ok=True)
    say(f"run: {folder}")
    say(f"display: http://{config.display.host}:{config.display.port}")
    try:
        return supervise(config, folder, rings or make_rings_folder(), ready=ready)
    finally:
        # A later signal would end this process while it writes, and leave the simulated devices running.
        ending.cancel()


def _write_drive(config: "RuntimeConfig", folder: Path) -> bool:
    """Write the run as a drive log in its folder; a failure is reported, the recording is kept.

    Returns whether it was written.
    """
    from lgprjax.formats import read_run
    from lgprjax.runtime.drive_log import drive_of_run

    output = folder / f"{config.name}.drive.h5"
    try:
        with working(f"writing {output}"):
            drive = drive_of_run(read_run(folder), config, output, force=True)
    except InputError as error:
        say(f"no drive log: {error}; retry with lgprjax recover")
        return False
    written = f"wrote {output}: {drive.seconds:.1f} s, {drive.scans} scans"
    if config.mode == "record":
        verdict(written, f"map build {output} -o M.map.h5" if drive.scans else f"check {output}")
    else:
        say(written)
    return True


def _preflight(config: "RuntimeConfig") -> int:
    from lgprjax.runtime.preflight import preflight

    table = Table("item", "state", "found", title=f"preflight of {config.file.name}")
    failed = list[str]()
    with working("checking"):
        items = list(preflight(config))
    for item in items:
        failed += [] if item.good else [item.name]
        table.add_row(item.name, "ok" if item.good else "NOT OK", item.finding)
    console.print(table, highlight=False, markup=False)
    if failed:
        verdict(f"not ready: {', '.join(failed)}")
        return BAD_INPUT
    verdict("ready to run", f"run {config.file}")
    return 0
