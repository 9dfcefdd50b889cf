"""A drive in closed loop, and the operator's page: pictures of both, the page drawn by headless Chromium."""

import io
import json
import sys
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

import jax.numpy as jnp
import numpy as np
from jaxtyping import Float
from matplotlib import colormaps
from matplotlib.collections import LineCollection
from PIL import Image

from benchmarks.course_drive import CONDITIONS, as_result
from lgprjax.batch.chance import chance_of
from lgprjax.formats import MapFile
from lgprjax.mapping import build_map
from lgprjax.navigation import RouteSpeeds
from lgprjax.registration import Code, RegisterOptions
from lgprjax.report import DrivenResult, draw_driven_course
from lgprjax.simulation.loop import (
    LoopSpec,
    LoopVehicle,
    OffRoad,
    drive_course,
    loop_setup,
    make_course,
    route_of_map,
)
from pictures.style import FAINT, INK, chart, mark_simulated

if TYPE_CHECKING:
    from pictures.demo import DemoSite
    from runtime.display.browser import Tab
    from runtime.display.served_page import ServedPage

LENGTH_M = 120.0
_SEED, _CONDITION = 4, "clear"
_TESTS = str(Path(__file__).parents[1] / "tests")
SIZE = (1024, 600)


@dataclass(frozen=True)
class Driven:
    """A drive.

    Attributes:
        result: for its picture.
        yaw_rad, to_go_m: true yaw and the way left, at every tick.
        ok_share: of the scans.
        fix_m, score: distance driven and score (correlation times the root of the overlap) of every ok fix.
    """

    result: DrivenResult
    yaw_rad: Float[np.ndarray, " tick"]
    to_go_m: Float[np.ndarray, " tick"]
    ok_share: float
    fix_m: Float[np.ndarray, " fix"]
    score: Float[np.ndarray, " fix"]


class LoopDrive:
    """An off-road course driven by the autopilot with full registration, simulated.

    Args:
        folder: for its files.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder

    @cached_property
    def driven(self) -> Driven:
        """Make the course, map it, drive it."""
        condition, spec = CONDITIONS[_CONDITION], LoopSpec()
        course = make_course(OffRoad(_SEED, LENGTH_M, condition.share), self.folder)
        database = self.folder / "course.map.h5"
        build_map([course.baseline], database, force=True)
        with MapFile.open(database) as source:
            setup = loop_setup(spec, LoopVehicle(gnss_slow_m=condition.gnss_slow_m), course.terrain)
            setup = setup._replace(settled_s=jnp.float32(condition.settled_s))
            route = route_of_map(source, setup, RouteSpeeds(float(setup.set_speed_mps)))
            day = condition.day(7919 * _SEED + 100 + _SEED, LENGTH_M)
            options, chance = RegisterOptions(), chance_of(source)
            drive = drive_course(course, source, spec, setup, route, options, day=day, seed=100 + _SEED, chance=chance)
        return Driven(
            as_result(drive, f"{LENGTH_M:.0f} m off road, simulated"),
            np.asarray(drive.tick.yaw_rad, np.float64),
            np.asarray(drive.tick.to_go_m, np.float64),
            float(np.mean(drive.codes == Code.OK)),
            drive.fix_travel_m,
            drive.fix_match[:, 0],
        )


def draw_course(loop: LoopDrive, path: Path) -> None:
    """Draw the plan and the errors of the drive."""
    draw_driven_course(loop.driven.result, path, force=True)


# The operator's page, as its own process serves it.


class OperatorPage:
    """The display process and a browser on its page."""

    def __init__(self) -> None:
        if _TESTS not in sys.path:
            sys.path.append(_TESTS)

    def shoot(
        self,
        state: dict[str, Any],
        worked: dict[str, Any] | None = None,
        *,
        dark: bool = False,
        columns: list[list[int]] | None = None,
    ) -> Image.Image:
        """The page that shows a state, and the columns of a radargram."""
        from runtime.display.browser import open_tab
        from runtime.display.served_page import serve

        with TemporaryDirectory() as folder, serve(Path(folder)) as served, open_tab() as tab:
            return _shoot(served, tab, state, worked, dark, columns or [])


def _shoot(
    served: "ServedPage",
    tab: "Tab",
    state: dict[str, Any],
    worked: dict[str, Any] | None,
    dark: bool,
    columns: list[list[int]],
) -> Image.Image:
    if worked is not None:
        served.show_worked(worked)
    served.show(state)
    tab.open(served.url, *SIZE, dark=dark)
    tab.wait_for("!document.body.classList.contains('stale')")
    draws = "all.forEach((one) => page.drawColumn(document.getElementById('radargram'), one))"
    tab.evaluate(f"import('/record.js').then((page) => {{ const all = {json.dumps(columns)}; {draws}; }})")
    tab.evaluate("new Promise((done) => setTimeout(done, 1200))")
    return Image.open(io.BytesIO(tab.picture())).convert("RGB")


def _calibrating() -> dict[str, Any]:
    """In the middle of the pedal steps."""
    from lgprjax.tuning.studies.calibration import STEPS

    step = next(each for each in STEPS if each.name == "pedals")
    return {
        "mode": "SPEED",
        "manoeuvre": step.title,
        "prompt": step.prompt,
        "share": 5.0 / 12.0,
        "speed_mps": 2.6,
        "cap_mps": 3.5,
        "throttle": 0.36,
        "brake": 0.0,
        "pose": [0.0, 0.0, 0.4],
        "path": [],
        "warnings": [],
        "processes": dict.fromkeys(("control", "recorder", "display", "monitor"), "ready"),
        "monitor": {"free_mb": 48200.0, "memory_mb": 22616.0},
        "recording": {"lost": 0},
    }


def _states() -> dict[str, tuple[dict[str, Any], dict[str, Any] | None, bool]]:
    from runtime.display.served_page import DRIVING
    from validation.loops.browsed_page import ERROR, FIELD, PLACE, PLAN, WORKED

    swaths = [[30.0 * (line % 2), 0.6 + line, 30.0 * (1 - line % 2), 0.6 + line] for line in range(20)]
    return {
        "day": (DRIVING | PLACE, None, False),
        "night": (DRIVING | PLACE, None, True),
        "error": (ERROR, None, False),
        "calibrate": (_calibrating(), None, False),
        "field": (FIELD, WORKED | {"plan": PLAN | {"swaths": swaths, "reverse": [], "keep_outs": []}}, False),
    }


def draw_record(site: "DemoSite", page: OperatorPage, path: Path) -> None:
    """Draw the page of a run that only records, with the radargram of the demonstration's drive."""
    from lgprjax.formats import DriveLog
    from lgprjax.runtime.radargram import LiveColumns

    with DriveLog.open(site.live.log) as log:
        traces, _ = log.read_traces(0, 900)
    live, columns = LiveColumns(), []
    for trace in np.asarray(traces, np.float64)[:, traces.shape[1] // 2]:
        live.add(trace)
        column = live.column()
        columns += [] if column is None else [column.tolist()]
    rates = {"radar": 126.0, "gnss": 107.0, "drive_by_wire": 100.0}
    way = np.arange(0.0, 42.0, 0.5)
    track = np.stack([way, 6.0 * np.sin(way / 18.0)], axis=1)
    state = {
        "mode": "RECORD",
        "lines": {name: {"rate_hz": rate, "age_s": 0.02, "messages": 2600} for name, rate in rates.items()},
        "scans": 2646,
        "travel_m": 42.3,
        "odometer": True,
        "speed_mps": 2.0,
        "quality": "FIXED",
        "sigma_m": 0.014,
        "heading": True,
        "path": track.tolist(),
        "pose": [*track[-1].tolist(), float(np.arctan2(*(track[-1] - track[-2])[::-1]))],
        "warnings": [],
        "processes": dict.fromkeys(("control", "registration", "recorder", "display", "monitor"), "ready"),
        "monitor": {"free_mb": 48200.0, "memory_mb": 22616.0},
        "recording": {"lost": 0},
    }
    # Every third scan: the page draws ten a second, some 0.2 m apart.
    _write(page.shoot(state, columns=columns[::3]), path)


def draw_display(page: OperatorPage, name: str, path: Path) -> None:
    """Draw the page: by day or night, with an error, or in a field. The values shown are examples."""
    state, worked, dark = _states()[name]
    _write(page.shoot(state, worked, dark=dark), path)


def draw_closed_loop(loop: LoopDrive, page: OperatorPage, path: Path) -> None:
    """Draw the plan of the drive above the operator's page at one of its moments."""
    from runtime.display.served_page import DRIVING

    driven = loop.driven
    result = driven.result
    at = int(np.flatnonzero(result.engaged)[0] + 0.55 * np.sum(result.engaged))
    x, y = result.track_m[at]
    state = DRIVING | {
        "route": "course",
        "routes": [{"name": "course", "length_m": round(LENGTH_M), "problem": None}],
        "speed_mps": round(float(result.speed_mps[at]), 2),
        "set_speed_mps": round(float(result.limit_mps[at]), 2),
        "cap_mps": round(float(result.limit_mps[at]), 2),
        "cross_track_m": round(float(result.tracking_m[at]), 2),
        "to_go_m": round(float(driven.to_go_m[at])),
        "ok_share": driven.ok_share,
        "path": result.baseline_m[:: max(1, len(result.baseline_m) // 300)].tolist(),
        "pose": [float(x), float(y), float(driven.yaw_rad[at])],
        "gnss_pose": None,
        "correlation": float(np.interp(result.way_m[at], driven.fix_m, driven.score)),
    }
    shot = page.shoot(state)
    with TemporaryDirectory() as folder:
        plan = Path(folder) / "plan.png"
        _draw_plan(result, at, plan)
        drawn = Image.open(plan).convert("RGB")
    drawn = drawn.resize((SIZE[0], round(drawn.height * SIZE[0] / drawn.width)), Image.Resampling.LANCZOS)
    whole = Image.new("RGB", (SIZE[0], SIZE[1] + drawn.height), "white")
    whole.paste(drawn, (0, 0))
    whole.paste(shot, (0, drawn.height))
    whole.save(path, format="PNG", optimize=True)


def _draw_plan(result: DrivenResult, at: int, path: Path) -> None:
    with chart(path, 6.4) as figure:
        axes = figure.subplots()
        axes.plot(*result.baseline_m.T, color=FAINT, linewidth=11.0, solid_capstyle="round")
        on = result.engaged
        track = result.track_m[on]
        pieces = np.stack([track[:-1], track[1:]], axis=1)
        lines = LineCollection(list(pieces), cmap=colormaps["viridis"], linewidth=4.5)
        lines.set_array(100.0 * np.abs(result.tracking_m[on][:-1]))
        lines.set_clim(0.0, 20.0)
        axes.add_collection(lines)
        figure.colorbar(lines, ax=axes, label="off the path (cm)", aspect=20, ticks=[0, 5, 10, 15, 20])
        axes.plot(*result.track_m[at], "^", color=INK, markersize=20, markeredgecolor="white")
        axes.set_aspect("equal")
        axes.set_xlabel("east (m)")
        axes.set_ylabel("north (m)")
        rms = 100.0 * float(np.sqrt(np.mean(result.tracking_m[on] ** 2)))
        axes.set_title(f"Driven: {rms:.1f} cm RMS off the path")
        mark_simulated(axes, (0.99, 0.98))


def looks_alike(first: Path, second: Path) -> bool:
    """Whether two pictures differ by no more than the browser's painting does from run to run: shades of a corner."""
    one, other = (np.asarray(Image.open(path).convert("RGB"), np.int16) for path in (first, second))
    if one.shape != other.shape:
        return False
    apart = np.abs(one - other).max(axis=-1)
    return bool(apart.max() <= _SHADES and np.count_nonzero(apart) <= _PIXELS)


_SHADES, _PIXELS = 16, 200


def _write(image: Image.Image, path: Path) -> None:
    image.quantize(128, dither=Image.Dither.NONE).save(path, format="PNG", optimize=True)
