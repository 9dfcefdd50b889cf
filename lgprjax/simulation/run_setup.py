"""A simulated run made ready: map and route, or plan, where they are missing; the devices and their specification."""

import json
import math
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from lgprjax.config import TableKey
from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.runtime.config import RuntimeConfig, SimulationTable


_UP_S = 180.0
_DOWN_S = 60.0
_PRIORITY = 10
"""Below the priority of the control loop in onboard/."""
_CRUISE_MPS = 4.4704


def check_before(config: "RuntimeConfig", table: "SimulationTable") -> None:
    """Check vehicle file, script and faults before anything is made or started.

    Raises:
        InputError: the vehicle file cannot be used; an action or fault is unknown, or its values are out of range.
    """
    from lgprjax.formats import read_vehicle
    from lgprjax.runtime.control.setup import setup_of_vehicle
    from lgprjax.simulation.devices.faults import FAULTS, check_choice, read_items
    from lgprjax.simulation.devices.field_stage import FIELD_BUTTONS, FIELD_FAULTS, FIELD_LINES, FIELD_SCRIPT
    from lgprjax.simulation.devices.sensors import LINES
    from lgprjax.simulation.devices.vehicle import BUTTONS, SCRIPT
    from lgprjax.simulation.vehicle_plans import true_vehicle

    field = config.coverage is not None
    if config.vehicle:
        vehicle = read_vehicle(config.path(config.vehicle))
        if not field and config.mode == "drive":
            setup_of_vehicle(config, vehicle)
    if not field:
        true_vehicle(table.vehicle, TableKey(config.file, "simulation.vehicle"), 0.0)
    actions, buttons = (FIELD_SCRIPT, FIELD_BUTTONS) if field else (SCRIPT, BUTTONS)
    faults, lines = (FIELD_FAULTS, FIELD_LINES) if field else (FAULTS, LINES)
    for name, key, rows, known, choice, choices in (
        ("script", "do", _script(table, (0.0, 0.0)), actions, "button", buttons),
        ("faults", "kind", table.faults, faults, "line", lines),
    ):
        place = f"simulation.{name}"
        items = read_items(config.file, place, rows, key=key, known=known, lasts_s={})
        check_choice(config.file, place, items, choice, choices)


def prepare_course(config: "RuntimeConfig", table: "SimulationTable") -> None:
    """Create the map and the first route of the configuration if they are missing; without a map, waypoints.

    Raises:
        InputError: a file cannot be written.
    """
    route = config.path(config.routes[0])
    source = config.path(config.map) if config.map else route.with_name(route.name.split(".")[0] + ".csv")
    if config.map and not source.exists():
        _make_map(table, source)
    if not route.exists():
        if not config.map:
            _make_waypoints(table, source)
        _make_route(config, source, route)


def _make_waypoints(table: "SimulationTable", output: Path) -> None:
    """The course's true baseline, as waypoints."""
    from lgprjax.formats import write_waypoints
    from lgprjax.mapping import Route, RouteSource, waypoints_of
    from lgprjax.navigation import RouteSpeeds, RouteTrack, legs_of_track, make_route_path
    from lgprjax.simulation.drives import SITE_FRAME
    from lgprjax.simulation.loop import OffRoad, anchor_of, baseline_poses, lay_course

    output.parent.mkdir(parents=True, exist_ok=True)
    laid_course = lay_course(OffRoad(table.seed, table.length_m, table.scan_share))
    poses = baseline_poses(laid_course)
    track = RouteTrack("baseline", anchor_of(poses, laid_course.spec.array_x_m), poses[:, 3])
    nowhere = np.zeros(len(poses))
    source = RouteSource(output, SITE_FRAME, [Route("baseline", track, nowhere, nowhere, closed=False)])
    laid = make_route_path(*legs_of_track(track), None, RouteSpeeds(_CRUISE_MPS))
    write_waypoints(output, "baseline", waypoints_of(laid, source), force=True)


def _make_map(table: "SimulationTable", database: Path) -> None:
    import tempfile

    from lgprjax.mapping import build_map
    from lgprjax.scene import SweepPlan
    from lgprjax.simulation.loop import OffRoad, make_course

    database.parent.mkdir(parents=True, exist_ok=True)
    sweeps = SweepPlan() if table.recording == "sweeps" else None
    with tempfile.TemporaryDirectory(dir=database.parent) as name:
        course = make_course(OffRoad(table.seed, table.length_m, table.scan_share, sweeps=sweeps), Path(name))
        build_map([course.baseline], database)


def _make_route(config: "RuntimeConfig", source: Path, route: Path) -> None:
    from lgprjax.files import file_hash
    from lgprjax.formats import RouteFile, write_route
    from lgprjax.mapping import read_source

    first = read_source(source).routes[0]
    chosen = RouteFile(
        map=source,
        map_sha256=file_hash(source),
        route=first.name,
        from_m=0.0,
        to_m=first.length_m,
        direction="along",
        cruise_mps=_CRUISE_MPS,
        lateral_mps2=1.5,
        vehicle=config.path(config.vehicle),
    )
    write_route(route, chosen)


def course_spec(
    config: "RuntimeConfig", table: "SimulationTable", manoeuvre: dict[str, Any] | None = None
) -> dict[str, Any]:
    """Specification of the simulated devices on a course, or of a manoeuvre driven by hand on level ground."""
    host = "drive" if config.commands else "record"
    return {
        "seed": table.seed,
        "length_m": table.length_m,
        "scan_share": table.scan_share,
        "weather": table.weather,
        "drive_seed": table.drive_seed,
        "recording": table.recording,
        "gain_drift": table.gain_drift,
        "in_view": table.in_view,
        "gnss_slow_m": table.gnss_slow_m,
        "map": str(config.path(config.map)) if config.map else "",
        "host": host if (config.ports.radar and config.mode == "record") or host == "drive" else "record_without_radar",
        "vehicle": table.vehicle,
        "manoeuvre": manoeuvre or {},
        "script": table.script,
        "faults": table.faults,
    }


@contextmanager
def devices(spec: dict[str, Any], folder: Path) -> Iterator[dict[str, str]]:
    """Run the simulated devices during the block. Yields the addresses of their ports.

    Args:
        spec: specification of the devices.
        folder: folder for the true poses and the log of the devices.

    Raises:
        InputError: the devices did not start.
    """
    spec = {**spec, "ports": str(folder / "ports.json"), "truth": str(folder / "truth.npz"), "parent": os.getpid()}
    file = folder / "devices.json"
    file.write_text(json.dumps(spec, indent=1), encoding="utf-8")
    told = folder / "devices.log"
    environment = {"XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", **os.environ, "OMP_NUM_THREADS": "1"}
    # The simulation runs in real time: if permitted, its devices have priority over the runtime.
    first = ["chrt", "--fifo", str(_PRIORITY)] if _may_run_in_real_time() else []
    with told.open("w", encoding="utf-8") as log:
        process = subprocess.Popen(
            [*first, sys.executable, "-P", "-m", "lgprjax.simulation.devices", str(file)],
            stdout=log,
            stderr=subprocess.STDOUT,
            env=environment,
        )
    try:
        yield _addresses(process, folder / "ports.json", told)
    finally:
        process.terminate()
        try:
            process.wait(_DOWN_S)
        except subprocess.TimeoutExpired:
            process.kill()


def _may_run_in_real_time() -> bool:
    """Whether this process may start another one with real-time priority."""
    if shutil.which("chrt") is None:
        return False
    return subprocess.run(["chrt", "--fifo", str(_PRIORITY), "true"], capture_output=True, check=False).returncode == 0


def _addresses(process: "subprocess.Popen[bytes]", ports: Path, told: Path) -> dict[str, str]:
    began_s = time.monotonic()
    while time.monotonic() - began_s < _UP_S:
        if ports.exists():
            addresses: dict[str, str] = json.loads(ports.read_text(encoding="utf-8"))
            return addresses
        if process.poll() is not None:
            break
        time.sleep(0.1)
    lines = told.read_text(encoding="utf-8").strip().splitlines() or ["no message"]
    raise InputError(told, "devices", "running simulated devices", lines[-1])


def with_addresses(folder: Path, config: "RuntimeConfig", addresses: dict[str, str]) -> "RuntimeConfig":
    """The configuration with the addresses of the devices, in the folder of the run."""
    from lgprjax.runtime.config import PortsTable, PortTable, read_config, write_config

    file = folder / "simulated.run.toml"
    used = {name: url for name, url in addresses.items() if getattr(config.ports, name) is not None}
    ports = PortsTable(**{name: PortTable(url=url) for name, url in used.items()})
    write_config(file, config.model_copy(update={"ports": ports}))
    return read_config(file)


# A simulated run in a field: create a missing plan, specify the devices.

_BEHIND_M = 8.0
"""Initial distance of the vehicle from the start of the plan: the straight drive there initialises the heading."""


def prepare_field(config: "RuntimeConfig", table: "SimulationTable") -> None:
    """Create the plan of the configuration if it is missing.

    Raises:
        InputError: the field is missing, cannot be planned, or the plan cannot be written.
    """
    from lgprjax.worked.plans import PlanOptions, make_cover_plan, save_cover_plan

    assert config.coverage is not None
    if config.coverage.plan is None or config.path(config.coverage.plan).exists():
        return
    if table.field is None:
        raise InputError(config.file, "simulation.field", "a field to plan, if there is no plan", "none")
    output = config.path(config.coverage.plan)
    output.parent.mkdir(parents=True, exist_ok=True)
    options = PlanOptions(overlap=table.overlap, order=table.order, turning_room_m=table.turning_room_m)
    plan = make_cover_plan(config.path(table.field), config.path(config.vehicle), options)
    assert plan is not None
    save_cover_plan(output, plan)


def field_spec(config: "RuntimeConfig", table: "SimulationTable") -> dict[str, Any]:
    """Specification of the simulated devices in a field. The vehicle starts behind the start of the plan.

    Without a plan it starts behind the first corner of ``simulation.field``, facing the second corner; the origin of
    ``drive_to`` is then that corner.

    Raises:
        InputError: vehicle, plan or field cannot be used.
    """
    from lgprjax.formats import read_vehicle
    from lgprjax.formats.field_files import read_field
    from lgprjax.frames import LocalFrame
    from lgprjax.recordings.vehicles import skid_setup_of
    from lgprjax.runtime.control.skid.setup import load_skid

    assert config.coverage is not None
    path = config.path(config.vehicle)
    vehicle = read_vehicle(path)
    setup = skid_setup_of(vehicle, path)
    if config.coverage.plan is None:
        if table.field is None:
            raise InputError(config.file, "simulation.field", "a field, if there is no plan", "none")
        places = read_field(config.path(table.field))
        frame = LocalFrame(*(float(each[0]) for each in (places.latitude_deg, places.longitude_deg, places.height_m)))
        east, north, _ = frame.to_local(places.latitude_deg, places.longitude_deg, places.height_m)
        x, y, yaw = 0.0, 0.0, math.atan2(float(north[1] - north[0]), float(east[1] - east[0]))
    else:
        loaded = load_skid(config)
        assert loaded.frame is not None
        frame = loaded.frame
        x, y, yaw = (float(number) for number in np.asarray(loaded.route.rows[0, :3], np.float64))
    start = (x - _BEHIND_M * math.cos(yaw), y - _BEHIND_M * math.sin(yaw), yaw)
    return {
        "anchor": (frame.latitude_deg, frame.longitude_deg, frame.height_m),
        "start": start,
        "track_m": float(setup.vehicle.track_m),
        "gnss_x_m": float(setup.model.gnss_x_m),
        "gnss_y_m": float(setup.model.gnss_y_m),
        "host": config.mode,
        "threshold_mps": vehicle.skid_steer.threshold_mps or 0.0,
        "seed": table.seed,
        "script": _script(table, (x, y)),
        "faults": table.faults,
    }


def _script(table: "SimulationTable", start: tuple[float, float]) -> list[dict[str, Any]]:
    """Script with the start of the plan as the default goal of ``drive_to``."""
    place = {"x_m": start[0], "y_m": start[1]}
    return [{**place, **line} if line.get("do") == "drive_to" else line for line in table.script]
