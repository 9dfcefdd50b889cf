"""Courses driven with full registration (``python -m benchmarks.course_drive OUT --condition NAME --seeds N ...``).

Each seed is a course of its own; what is compiled for the first serves all. OUT grows by a drive at a time.
"""

import argparse
import json
import tempfile
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import jax.numpy as jnp
import numpy as np

from benchmarks.accuracy import Labels, fit_fix_errors, labels_of, relative_error
from benchmarks.process import hold_to
from lgprjax.batch.register import HeldGround
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.navigation import RouteSpeeds
from lgprjax.registration import WRONG_M, Code, RegisterOptions
from lgprjax.report import DrivenResult, draw_driven_course
from lgprjax.scene import WEATHER, Day, Trench
from lgprjax.simulation.loop import (
    DrivenCourse,
    LoopSpec,
    LoopVehicle,
    OffRoad,
    cross_track_m,
    drive_course,
    loop_setup,
    make_course,
    route_of_map,
)


@dataclass(frozen=True)
class Condition:
    """What a mile is driven in.

    Attributes:
        day: from its seed and the length of the course.
        share: every so many-th of 126 scans a second.
        gnss_slow_m: how far GNSS wanders from the map, sigma an axis.
        gnss_lost_s: from this moment on there is no GNSS.
        settled_s: the driver engages once navigation has been sound for this long.
        rms_goal_m, speed_goal_mps: to be reached; no speed where something is wrong.
    """

    day: Callable[[int, float], Day]
    share: int = 3
    gnss_slow_m: float = 0.3
    gnss_lost_s: float = np.inf
    settled_s: float = 1.0
    rms_goal_m: float = 0.10
    speed_goal_mps: float | None = None


def _clear(seed: int, _: float) -> Day:
    return WEATHER["clear"](seed)


def _drifting_rain(seed: int, _: float) -> Day:
    """Travel times longer by 2.5 % in the mean, and by that and as much as 5.5 % more or less along the way."""
    return replace(
        WEATHER["rain"](seed), velocity_factor=1 / 1.025, moisture_rms=0.0275, moisture_wavelength_m=(100.0, 400.0)
    )


def _rebuilt(seed: int, length_m: float) -> Day:
    """Other ground, down to below what the radar sees, for an eighth of the way in its middle: 200 m of a mile."""
    return replace(WEATHER["clear"](seed), trenches=(Trench((0.44 * length_m, 0.565 * length_m), depth_m=4.0),))


CONDITIONS = {
    "clear, 126 Hz": Condition(_clear, share=1, speed_goal_mps=4.4),
    "clear": Condition(_clear, speed_goal_mps=4.4),
    "snow": Condition(lambda seed, _: WEATHER["snow"](seed), speed_goal_mps=4.4),
    "rain, drifting scale": Condition(_drifting_rain, rms_goal_m=0.14),
    "GNSS 2 m": Condition(_clear, gnss_slow_m=2.0),
    # Lost after 13 s, some 50 m with fixes; engaged a few seconds later, by LGPR alone.
    "GNSS off": Condition(_clear, gnss_lost_s=13.0, settled_s=12.0),
    "rebuilt road": Condition(_rebuilt),
}


def main() -> None:
    """The program."""
    parser = argparse.ArgumentParser(prog="benchmarks.course_drive")
    parser.add_argument("out", type=Path)
    parser.add_argument("--seeds", type=int, nargs="+", required=True)
    parser.add_argument("--condition", choices=CONDITIONS, required=True)
    parser.add_argument("--length-m", type=float, required=True)
    parser.add_argument("--picture", type=Path, help="of the first drive, a PNG")
    parser.add_argument("--threads", type=int, required=True)
    parser.add_argument("--search", choices=("exhaustive", "filter"), default="exhaustive")
    chosen = parser.parse_args()
    hold_to(chosen.threads)
    done: list[dict[str, Any]] = []
    condition = CONDITIONS[chosen.condition]
    options = RegisterOptions(filter="causal" if chosen.search == "filter" else None)
    for seed in chosen.seeds:
        picture = None if done else chosen.picture
        done.append({"seed": seed, **drive_one(condition, seed, chosen.length_m, picture, options)})
        chosen.out.write_text(json.dumps({"drives": done}), encoding="utf-8")


def drive_one(
    condition: Condition,
    seed: int,
    length_m: float,
    picture: Path | None = None,
    options: RegisterOptions | None = None,
) -> dict[str, Any]:
    """Make a course, map it, drive it; its figures."""
    spec = LoopSpec()
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        course = make_course(OffRoad(seed, length_m, condition.share), folder)
        database = folder / "course.map.h5"
        build_map([course.baseline], database)
        with MapFile.open(database) as source, DriveLog.open(course.baseline) as log:
            setup = loop_setup(spec, LoopVehicle(gnss_slow_m=condition.gnss_slow_m), course.terrain)
            setup = setup._replace(
                settled_s=jnp.float32(condition.settled_s),
                faults=setup.faults._replace(gnss_lost_s=jnp.asarray([condition.gnss_lost_s, np.inf], jnp.float32)),
            )
            route = route_of_map(source, setup, RouteSpeeds(float(setup.set_speed_mps)))
            labels = labels_of([log], source.description.frame)
            began = time.perf_counter()
            day = condition.day(7919 * seed + 100 + seed, length_m)
            options = options or RegisterOptions()
            held = HeldGround(source, options)
            likelihood = None if options.filter is None else held.likelihood_for(course.array, source)
            drive = drive_course(
                course,
                source,
                spec,
                setup,
                route,
                options,
                day=day,
                seed=100 + seed,
                chance=held.chance,
                likelihood=likelihood,
            )
            seconds = time.perf_counter() - began
    if picture is not None:
        # Whether a file may be replaced was asked before the drive.
        draw_driven_course(as_result(drive, f"{length_m:.0f} m off road, seed {seed}"), picture, force=True)
    figures = figures_of(drive, course.spec.array_x_m, labels)
    figures["engaged_without_gnss"] = bool(np.argmax(drive.engaged) * spec.tick_s > condition.gnss_lost_s)
    figures["engaged_share"] = figures["way_m"] / float(route.legs.length_m[0])
    figures["seconds"] = seconds
    figures["steering_limit_rad"] = float(setup.autopilot.limiter.front_rate_radps) * spec.tick_s
    return figures


def as_result(drive: DrivenCourse, name: str) -> DrivenResult:
    """A drive as its picture shows it."""
    tick = drive.tick
    way = np.cumsum(np.hypot(*np.diff(drive.anchor_m, axis=0, prepend=drive.anchor_m[:1]).T))
    return DrivenResult(
        name=name,
        baseline_m=drive.baseline_m,
        track_m=drive.anchor_m,
        way_m=way,
        engaged=drive.engaged,
        tracking_m=cross_track_m(drive.anchor_m, drive.baseline_m),
        located_m=np.asarray(tick.error_m, np.float64)[:, 1],
        sigma_m=np.asarray(tick.sigma_cross_m, np.float64),
        switch_m=np.asarray(tick.switch_cross_m, np.float64),
        gnss_ins_m=np.asarray(tick.reckoned_cross_m, np.float64),
        speed_mps=np.asarray(tick.speed_mps, np.float64),
        limit_mps=np.asarray(tick.limit_mps, np.float64),
        front_rad=np.asarray(tick.front_rad, np.float64),
        fix=np.asarray(tick.fix, bool),
    )


def figures_of(drive: DrivenCourse, lead_m: float, labels: Labels) -> dict[str, Any]:
    """Figures of a drive, of what the autopilot drove.

    Args:
        drive: the drive.
        lead_m: array ahead of the rear axle.
        labels: of the map, see ``relative_error``.

    Raises:
        ValueError: the autopilot never drove.
    """
    on, tick = drive.engaged, drive.tick
    if not on.any():
        ok = float(np.mean(drive.codes == Code.OK))
        raise ValueError(f"navigation was never sound enough to engage the autopilot; {ok:.0%} of the scans ok")
    yaw = np.asarray(tick.yaw_rad, np.float64)[on]
    along, cross = (np.asarray(tick.error_m, np.float64)[on, column] for column in (0, 1))
    cross = cross + lead_m * np.asarray(tick.error_yaw_rad, np.float64)[on]
    offset = np.stack([np.cos(yaw) * along - np.sin(yaw) * cross, np.sin(yaw) * along + np.cos(yaw) * cross], axis=1)
    relative = relative_error(offset, drive.anchor_m[on], yaw, labels)
    tracking = drive.tracking
    ok = drive.codes == Code.OK
    figures: dict[str, Any] = {
        **tracking._asdict(),
        "relative_mean_m": relative.mean_m,
        "relative_cross_mean_m": relative.cross_mean_m,
        "located_cross_rms_m": float(np.sqrt(np.mean(cross**2))),
        "switch_cross_rms_m": float(np.sqrt(np.mean(np.asarray(tick.switch_cross_m, np.float64)[on] ** 2))),
        "gnss_ins_cross_rms_m": float(np.sqrt(np.mean(np.asarray(tick.reckoned_cross_m, np.float64)[on] ** 2))),
        "nees_position": float(np.mean(np.asarray(tick.nees_position, np.float64)[on]) / 2.0),
        "nees_yaw": float(np.mean(np.asarray(tick.nees_yaw, np.float64)[on])),
        "ok_share": float(ok.mean()),
        "wrong_fixes": int(np.sum(np.hypot(drive.fix_error[:, 0], drive.fix_error[:, 1]) > WRONG_M)),
        "degraded_share": float(np.mean(np.asarray(tick.reaction)[on] == 1)),
        "stopped": bool(np.any(np.asarray(tick.reaction)[on] == 2)),
        "finished": drive.finished,
        "speed_mps": float(np.mean(np.asarray(tick.speed_mps)[on])),
        "largest_steering_step_rad": float(np.abs(np.diff(np.asarray(tick.command_rad)[on])).max()),
        "ticks": len(on),
    }
    if ok.sum() >= 50:
        scan_travel = np.interp(np.arange(len(ok)), np.flatnonzero(ok), drive.fix_travel_m)
        errors = np.full((len(ok), 3), np.nan)
        errors[ok] = drive.fix_error
        strength, p_false = np.full((2, len(ok)), np.nan)
        strength[ok], p_false[ok] = drive.fix_match.T
        model = fit_fix_errors(scan_travel, ok, errors, strength, p_false)
        reported = np.median(drive.fix_sigma, axis=0).tolist()
        figures["fixes"] = {"reported_sigma": reported} | {
            key: np.asarray(value).tolist() for key, value in model._asdict().items()
        }
    return figures


if __name__ == "__main__":
    main()
