"""``run --simulate``: its map and route made where they are missing, and its devices started."""

import json
import os
import shutil
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Any

from lgprjax.errors import InputError

if TYPE_CHECKING:
    from lgprjax.runtime.config import RuntimeConfig, SimulationTable

_UP_S = 180.0
_DOWN_S = 60.0
_PRIORITY = 10
"""Below what onboard/ gives the control loop."""
_CRUISE_MPS = 4.4704


def prepare_course(config: "RuntimeConfig", table: "SimulationTable") -> None:
    """Make the files of the configuration that are not there: the map, and its first route.

    Raises:
        InputError: a file cannot be written.
    """
    database = config.path(config.map)
    if not database.exists():
        _make_map(table, database)
    route = config.path(config.routes[0])
    if not route.exists():
        _make_route(config, database, route)


def _make_map(table: "SimulationTable", database: Path) -> None:
    import tempfile

    from lgprjax.archive import build_map
    from lgprjax.simulation.loop import OffRoad, make_course

    database.parent.mkdir(parents=True, exist_ok=True)
    with tempfile.TemporaryDirectory(dir=database.parent) as name:
        course = make_course(OffRoad(table.seed, table.length_m, table.scan_share), Path(name))
        build_map([course.baseline], database)


def _make_route(config: "RuntimeConfig", database: Path, route: Path) -> None:
    from lgprjax.archive import routes_of
    from lgprjax.files import file_hash
    from lgprjax.formats import MapFile, RouteFile, write_route

    with MapFile.open(database) as source:
        first = routes_of(source)[0]
    chosen = RouteFile(
        database,
        file_hash(database),
        first.name,
        0.0,
        first.length_m,
        "along",
        _CRUISE_MPS,
        1.5,
        config.path(config.vehicle),
    )
    write_route(route, chosen)


def course_spec(config: "RuntimeConfig", table: "SimulationTable") -> dict[str, Any]:
    """What the devices of a course are asked for."""
    return {
        "seed": table.seed,
        "length_m": table.length_m,
        "scan_share": table.scan_share,
        "weather": table.weather,
        "drive_seed": table.drive_seed,
        "map": str(config.path(config.map)),
        "script": table.script,
        "faults": table.faults,
    }


@contextmanager
def devices(config: "RuntimeConfig", spec: dict[str, Any], folder: Path) -> Iterator[dict[str, str]]:
    """The simulated devices, for as long as the block lasts: addresses of their lines.

    Args:
        config: of the run.
        spec: what they are asked for.
        folder: where their truth and their messages go.

    Raises:
        InputError: they did not come up.
    """
    spec = {**spec, "ports": str(folder / "ports.json"), "truth": str(folder / "truth.npz")}
    file = folder / "devices.json"
    file.write_text(json.dumps(spec, indent=1), encoding="utf-8")
    told = folder / "devices.log"
    environment = {**os.environ, "XLA_FLAGS": "--xla_cpu_multi_thread_eigen=false", "OMP_NUM_THREADS": "1"}
    if config.cache is not None:
        environment["JAX_COMPILATION_CACHE_DIR"] = str(config.path(config.cache))
        environment["JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS"] = "0"
    # The world waits for nobody: where it is permitted its devices run before the runtime.
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
    """Whether this process may give another a real-time priority."""
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
    raise InputError(told, "devices", "the simulated devices to come up", lines[-1])
