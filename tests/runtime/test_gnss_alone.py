"""A course driven by RTK GNSS/INS: without map and radar, and with LGPR that joins and leaves.

A mile of three vehicles: ``validation/drives/test_rtk.py``.
"""

from functools import partial
from pathlib import Path
from typing import Any

import numpy as np

from canon.course_loop import DRIVE, OnboardLoop
from lgprjax.autopilot import Mode
from lgprjax.navigation import Reason
from lgprjax.runtime.config import RuntimeConfig
from lgprjax.runtime.control.setup import load
from lgprjax.simulation.devices.course_stage import CourseSpec, CourseStage
from lgprjax.simulation.devices.world import CourseWorld
from refusals import refused

FASTER: list[dict[str, Any]] = [
    {"after": {"mode": 4, "for_s": 1.0 + 0.7 * number}, "do": "press", "button": "plus", "for_s": 0.3}
    for number in range(9)
]


def by_rtk(config: RuntimeConfig, folder: Path, *, with_map: bool, k: float = 0.6291658661973804) -> RuntimeConfig:
    """The course's configuration with a receiver that wanders by 2 cm, and a vehicle of that k."""
    text = config.path(config.vehicle).read_text(encoding="utf-8").partition("[found.")[0]
    text = text.replace("gnss_error_sigma_m = 0.3", "gnss_error_sigma_m = 0.02")
    text = text.replace("rear_ratio = 0.6291658661973804", f"rear_ratio = {k}")
    vehicle = folder / "rtk.vehicle.toml"
    vehicle.write_text(text, encoding="utf-8")
    changed: dict[str, Any] = {"vehicle": str(vehicle)}
    if not with_map:
        changed |= {"map": "", "ports": config.ports.model_copy(update={"radar": None})}
    return config.model_copy(update=changed)


def _tracking_m(loop: OnboardLoop) -> np.ndarray:
    """True distance of the array's centre from the baseline in every tick since engaging."""
    truth = loop.stage.truth.arrays()
    modes = np.array([row["mode"] for row in loop.rows])
    at = np.clip(np.searchsorted(loop.times_ns, truth["mono_ns"]) - 1, 0, len(modes) - 1)
    return np.asarray(truth["cross_m"][np.isin(modes[at], (Mode.STEERING, Mode.SPEED))])


def test_a_course_is_driven_by_rtk_alone_at_full_speed(
    world: CourseWorld, config: RuntimeConfig, tmp_path: Path
) -> None:
    """By a vehicle whose rear wheels do not steer."""
    alone = by_rtk(config, tmp_path, with_map=False, k=0.0)
    script = [*DRIVE, *FASTER]
    loop = OnboardLoop(world, alone, load(alone), script, [], fixes=False, gnss_slow_m=0.02, vehicle={"rear": 0.0})
    assert loop.run(80.0, until=lambda at: at.mode is Mode.MANUAL), loop.events
    rows = np.array(loop.rows)
    assert float(rows["to_go_m"][rows["mode"] == Mode.SPEED][-1]) < 0.5
    off_m = _tracking_m(loop)
    assert np.sqrt(np.mean(off_m**2)) < 0.10
    assert np.abs(off_m).max() < 0.3048
    drives = rows["mode"] == Mode.SPEED
    assert rows["speed_mps"][drives].max() > 4.0
    assert not any('"slow": ["' in event for _, event in loop.events)


def test_gnss_that_falls_silent_stops_a_vehicle_without_lgpr(
    world: CourseWorld, config: RuntimeConfig, tmp_path: Path
) -> None:
    alone = by_rtk(config, tmp_path, with_map=False)
    faults = [{"kind": "gnss_off", "at_way_m": 40.0}]
    loop = OnboardLoop(world, alone, load(alone), [*DRIVE, *FASTER], faults, fixes=False, gnss_slow_m=0.02)
    assert loop.run(50.0, until=lambda at: at.mode is Mode.MANUAL)
    assert any("STOP_CONTROLLED" in event for _, event in loop.events)
    reasons = np.array([int(row["reasons"]) for row in loop.rows])
    assert (reasons & Reason.POSITION_LOST.value).any()
    assert np.abs(_tracking_m(loop)).max() < 0.3048


def test_a_receiver_too_coarse_to_drive_by_is_refused(config: RuntimeConfig) -> None:
    alone = config.model_copy(update={"map": "", "ports": config.ports.model_copy(update={"radar": None})})
    with refused("navigation.gnss_error_sigma_m", 0.25, found="0.3"):
        load(alone)


def test_an_unknown_number_of_the_simulated_vehicle_is_refused(world: CourseWorld) -> None:
    spec = CourseSpec(seed=2, length_m=150.0, drive_seed=1, ports="", truth="", vehicle={"wheels": 4.0})
    with refused("vehicle.wheels", "wheelbase_m", file="spec.json"):
        CourseStage(spec, world, Path("spec.json"), 0)


def test_lgpr_joins_and_leaves_without_a_jolt(world: CourseWorld, config: RuntimeConfig, tmp_path: Path) -> None:
    """Map and receiver differ by 6 cm to the side: fixes come for ten seconds and go again."""
    apart_m = 0.06
    by_both = by_rtk(config, tmp_path, with_map=True)
    loaded, script = load(by_both), [*DRIVE, *FASTER]
    drive = partial(OnboardLoop, world, by_both, loaded, script, [], gnss_slow_m=0.02)
    joins_s, leaves_s = 24.0, 34.0
    loop = drive(
        fix_lost=lambda time_s: not joins_s <= time_s < leaves_s,
        fix_wrong=lambda _: (-np.sin(world.start(70.0).pose[2]) * apart_m, np.cos(world.start(70.0).pose[2]) * apart_m),
    )
    loop.run(42.0)
    without = drive(fixes=False)
    without.run(42.0)
    tables = [np.array(each.rows) for each in (loop, without)]
    time_s = 1e-9 * (np.array(loop.times_ns) - loop.times_ns[0])
    front = [table["command"][:, 0] for table in tables]
    steps = [np.abs(np.diff(each)) for each in front]
    near = ((time_s > joins_s) & (time_s < joins_s + 3.0)) | ((time_s > leaves_s) & (time_s < leaves_s + 3.0))
    largest_rad = [float(each[near[1:]].max()) for each in steps]
    assert largest_rad[0] < 1.2 * largest_rad[1], largest_rad
    rows = tables[0][time_s > joins_s - 2.0]
    assert set(rows["mode"]) == {Mode.SPEED}
    assert rows["wanted_mps"].min() > 0.95 * rows["wanted_mps"][0]
    taken = (time_s > leaves_s - 5.0) & (time_s < leaves_s)
    assert tables[0]["sigma_cross_m"][taken].max() < tables[1]["sigma_cross_m"][taken].min()
    assert np.abs(_tracking_m(loop)).max() < 0.3048
