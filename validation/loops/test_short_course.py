"""A short course with full registration in the loop: every scan rendered, searched, fused and steered by."""

from pathlib import Path

import numpy as np
import pytest

from benchmarks.accuracy import labels_of
from benchmarks.course_drive import as_result, figures_of
from canon.map import of_many_grounds
from lgprjax.formats import DriveLog, MapFile
from lgprjax.mapping import build_map
from lgprjax.navigation import RouteSpeeds
from lgprjax.registration import Code, RegisterOptions
from lgprjax.report import draw_driven_course
from lgprjax.scene import WEATHER
from lgprjax.simulation.loop import (
    DrivenCourse,
    LoopSpec,
    LoopVehicle,
    OffRoad,
    drive_course,
    loop_setup,
    make_course,
    route_of_map,
)
from refusals import refused

_SPEC = LoopSpec()


def _drive(folder: Path, spec: OffRoad, seed: int) -> tuple[DrivenCourse, dict[str, float], float]:
    """A course made, mapped and driven; its figures, and the steering's limit a tick."""
    course = make_course(spec, folder)
    database = folder / "course.map.h5"
    build_map([course.baseline], database, measure=of_many_grounds)
    with MapFile.open(database) as source, DriveLog.open(course.baseline) as log:
        setup = loop_setup(_SPEC, LoopVehicle(), course.terrain)
        route = route_of_map(source, setup, RouteSpeeds(float(setup.set_speed_mps)))
        labels = labels_of([log], source.description.frame)
        options = RegisterOptions(search_m=1.5)
        day = WEATHER["clear"](7919 * spec.seed + seed)
        driven = drive_course(course, source, _SPEC, setup, route, options, day=day, seed=seed)
    figures = figures_of(driven, spec.array_x_m, labels)
    return driven, figures, float(setup.autopilot.limiter.front_rate_radps) * _SPEC.tick_s


@pytest.fixture(scope="module")
def short(tmp_path_factory: pytest.TempPathFactory) -> tuple[DrivenCourse, dict[str, float], float]:
    return _drive(tmp_path_factory.mktemp("course"), OffRoad(7, 32.0, scan_share=3), 11)


def test_it_arrives_within_decimetres_and_no_wrong_fix_is_called_ok(
    short: tuple[DrivenCourse, dict[str, float], float], tmp_path: Path
) -> None:
    driven, figures, limit_rad = short
    assert driven.finished
    assert driven.engaged.any()
    assert figures["rms_m"] < 0.10
    assert figures["largest_m"] < 0.3048
    assert figures["largest_steering_step_rad"] <= 1.0001 * limit_rad
    assert figures["located_cross_rms_m"] < figures["gnss_ins_cross_rms_m"]
    assert figures["wrong_fixes"] == 0
    # After the first metres, in which the track filter has no mean yet, most scans are placed.
    assert np.mean(driven.codes[40:] == Code.OK) > 0.75
    assert np.sqrt(np.mean(driven.fix_error[:, 1] ** 2)) < 0.06
    path = tmp_path / "driven.png"
    draw_driven_course(as_result(driven, "a short course"), path)
    assert path.read_bytes().startswith(b"\x89PNG")
    with refused("output", "--force", file=path):
        draw_driven_course(as_result(driven, "a short course"), path)
