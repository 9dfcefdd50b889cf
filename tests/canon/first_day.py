"""A whole first day through verbs alone: record by hand, calibrate, map, route, drive by RTK, drive by LGPR in snow."""

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from canon.calibration import ARRAY_X_M, Kit, write_kit
from canon.commands import run, succeed

_PLUS = "".join(
    f'  {{ after = {{ mode = 4, for_s = {after_s:.1f} }}, do = "press", button = "plus" }},\n'
    for after_s in (1.0 + 0.7 * step for step in range(16))
)
_SCRIPT = f"""script = [
  {{ at_s = 0.5, do = "drive", speed_mps = 2.0 }},
  {{ at_way_m = 12.0, do = "press", button = "steering" }},
  {{ after = {{ mode = 3, for_s = 2.0 }}, do = "press", button = "plus" }},
{_PLUS}]
"""
_RADAR = 'radar = { url = "socket://127.0.0.1:1" }\n'
_RUN = """name = "{name}"
mode = "{mode}"
vehicle = "kit.vehicle.toml"
cache = "cache"
{work}
[ports]
drive_by_wire = {{ url = "/dev/null" }}
controller = {{ url = "/dev/null" }}
gnss = {{ url = "/dev/null" }}
{radar}[radar]
channel_pitch_m = 0.127
centre_frequency_mhz = 250.0
[sensors]
gnss_delay_s = 0.03
[recording]
folder = "{name}"
[supervision]
control_s = 5.0
others_s = 20.0
start_s = 300.0
[display]
port = 0
[simulation]
length_m = {metres}
scan_share = 3
gnss_slow_m = {slow_m}
weather = "{weather}"
drive_seed = {seed}
{more}
[simulation.vehicle]
{vehicle}"""


class Driven(NamedTuple):
    """Errors of a drive by simulated devices: of the array's centre across the baseline, and of accepted fixes, m."""

    rms_m: float
    largest_m: float
    metres: float
    modes: dict[str, int]


class FirstDay(NamedTuple):
    """A day: the folder with all files, and both drives."""

    folder: Path
    rtk: Driven
    lgpr: Driven


def first_day(
    folder: Path, kit: Kit, metres: float, *, calibrate: Callable[[Path], object] | None = None, pulled: bool = True
) -> FirstDay:
    """The verbs that a crew types, on a vehicle that nobody knows.

    Args:
        folder: empty; everything is written there.
        kit: the hidden vehicle.
        metres: length of the road.
        calibrate: in place of the command: puts a vehicle file into the folder that is calibrated already.
        pulled: the GNSS line falls silent while the vehicle drives by LGPR.
    """

    def write(
        name: str, mode: str, *, work: str = "", radar: bool, more: str, weather: str = "clear", seed: int
    ) -> Path:
        text = _RUN.format(
            name=name,
            mode=mode,
            work=work,
            radar=_RADAR if radar else "",
            metres=metres,
            slow_m=0.02,
            weather=weather,
            seed=seed,
            more=more,
            vehicle=kit.table,
        )
        path = folder / f"{name}.run.toml"
        path.write_text(text, encoding="utf-8")
        return path

    write_kit(folder, kit)
    by_hand = 'script = [{ at_s = 0.5, do = "drive", speed_mps = 3.0 }]'
    config = write("morning", "record", radar=True, more=by_hand, seed=101)
    succeed("run", config, "--simulate", "--lockstep", "--for-s", metres / 3.0 + 8.0)
    (baseline,) = (folder / "morning").iterdir()
    vehicle = folder / "kit.vehicle.toml"
    if calibrate is None:
        succeed("calibrate", vehicle, "--config", folder / "kit.run.toml", "--simulate")
    else:
        calibrate(folder)
    route = ("--vehicle", vehicle, "--cruise-mps", 4.47)
    succeed("route", "select", baseline, "morning", *route, "-o", folder / "noon.route.toml")
    noon = write("noon", "drive", work='routes = ["noon.route.toml"]', radar=False, more=_SCRIPT, seed=102)
    rtk = _drive(folder, noon)
    succeed("map", "build", baseline, "-o", folder / "road.map.h5")
    succeed("route", "select", folder / "road.map.h5", "morning", *route, "-o", folder / "evening.route.toml")
    faults = 'faults = [{ after = { mode = 4, for_s = 4.0 }, kind = "gnss_off", for_s = 10000.0 }]\n' if pulled else ""
    evening = write(
        "evening",
        "drive",
        work='map = "road.map.h5"\nroutes = ["evening.route.toml"]',
        radar=True,
        more=faults + _SCRIPT,
        weather="snow",
        seed=103,
    )
    return FirstDay(folder, rtk, _drive(folder, evening))


def _drive(folder: Path, config: Path) -> Driven:
    figures = folder / f"{config.name.split('.')[0]}.json"
    done = run("run", config, "--simulate", "--lockstep", "--json", figures)
    assert done.status == 0, (done.out[-1500:], done.err[-1500:])
    (folder / f"{config.name.split('.')[0]}.said").write_text(done.out, encoding="utf-8")
    found: dict[str, Any] = json.loads(figures.read_text(encoding="utf-8"))
    return Driven(found["tracking_rms_m"], found["tracking_largest_m"], found["engaged_way_m"], found["modes"])


def wrong_fixes(folder: Path, name: str, beyond_m: float = 0.3) -> tuple[int, int]:
    """Accepted fixes of a run that are farther than this from the truth, and accepted fixes in all."""
    from lgprjax.registration import Code
    from lgprjax.simulation.run_figures import read_records

    (made,) = (folder / name).iterdir()
    fixes = read_records(made).fixes
    good = fixes[fixes["code"] == int(Code.OK)]
    with np.load(made / "truth.npz") as truth:
        x, y, yaw = (
            np.interp(good["scan_ns"], truth["mono_ns"], values)
            for values in (truth["x_m"], truth["y_m"], np.unwrap(truth["yaw_rad"]))
        )
    # A fix is of the array's centre, the truth of the rear axle.
    x, y = x + ARRAY_X_M * np.cos(yaw), y + ARRAY_X_M * np.sin(yaw)
    off = np.hypot(good["pose"][:, 0] - x, good["pose"][:, 1] - y)
    return int(np.sum(off > beyond_m)), len(good)
