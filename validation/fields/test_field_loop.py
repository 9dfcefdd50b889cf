"""Fields in closed loop at length: PID and the threshold's swing, and the whole field of the source."""

from collections.abc import Callable

import jax
import numpy as np
import pytest

from lgprjax.coverage import PatternSettings
from lgprjax.simulation.field_loop import (
    PIDS,
    THRESHOLD_MPS,
    FieldLoopSpec,
    FieldMoment,
    made_up_field_world,
    made_up_tool,
    rectangle_course,
    run_fields,
    threshold_world,
)
from lgprjax.tuning import find_limit_cycle
from simulation.field_drives import FAR, INCH_M, driven, errors, mean_nees, rms, settings


@pytest.mark.parametrize("name", list(PIDS))
def test_no_pid_cures_the_swing_and_the_compensation_does(
    name: str, record_property: Callable[[str, object], None]
) -> None:
    line = rectangle_course(110.0, 1.2, settings(), made_up_tool())
    sizes = {}
    cases = {"obeys": (0.0, 0.0), "ignores": (THRESHOLD_MPS, 0.0), "made up for": (THRESHOLD_MPS, THRESHOLD_MPS)}
    for case, (threshold_mps, believed_mps) in cases.items():
        world = threshold_world(PIDS[name], threshold_mps=threshold_mps, believed_mps=believed_mps)
        kept = driven(world, line, FAR)
        for lane in range(2):
            late = (kept.line[:, lane] >= 0) & (kept.to_go_m[:, lane] < 90.0) & ~kept.done[:, lane]
            offset = np.asarray(kept.cross_m[late, lane], np.float64)
            found = find_limit_cycle(0.1 * np.arange(len(offset)), offset)
            sizes[case, lane] = found.peak_to_peak_m
            assert found.found == (case == "ignores")
    for (case, lane), size in sizes.items():
        record_property(f"swing_m {case} {lane}", size)
    for lane in range(2):
        assert 14.0 * INCH_M <= sizes["ignores", lane] <= 22.0 * INCH_M
        assert sizes["made up for", lane] < 0.05
        assert sizes["obeys", lane] < 0.05


@pytest.mark.parametrize("guidance", ["carrot", "pursuit"])
def test_the_whole_field_of_the_source(guidance: str, record_property: Callable[[str, object], None]) -> None:
    """30 x 20 m in Zamboni order, eight seeds, GNSS off 30 s of every 90 s."""
    whole = PatternSettings(1.2, 0.15, "zamboni", 1.5, 8.0, 1.2)
    course = rectangle_course(30.0, 20.0, whole, made_up_tool())
    spec = FieldLoopSpec(moments=26_000, guidance="carrot" if guidance == "carrot" else "pursuit")
    keys = jax.random.split(jax.random.key(11), 8)
    kept: FieldMoment = jax.tree.map(
        np.asarray, run_fields(spec, made_up_field_world(off_s=30.0), course.route, course.fence, keys)
    )
    worked = kept.engaged & ~kept.done
    on_line = worked & (kept.line >= 0)
    wrong = errors(kept)
    figures = {
        "cross_heard": rms(kept.cross_m[on_line & kept.heard]),
        "cross_off": rms(kept.cross_m[on_line & ~kept.heard]),
        "cross_turn": rms(kept.cross_m[worked & (kept.line < 0)]),
        "position_heard": rms(np.hypot(*wrong[worked & kept.heard][:, :2].T)),
        "position_off": rms(np.hypot(*wrong[worked & ~kept.heard][:, :2].T)),
        "heading_deg": float(np.degrees(rms(wrong[worked][:, 2]))),
        "heading_largest_deg": float(np.degrees(np.abs(wrong[worked][:, 2]).max())),
        "nees": mean_nees(kept, worked),
        "nees_heard": mean_nees(kept, worked & kept.heard),
        "nees_off": mean_nees(kept, worked & ~kept.heard),
    }
    for name, value in figures.items():
        record_property(name, value)
    assert kept.done[-1].all()
    assert not kept.stopping.any()
    assert figures["position_heard"] < INCH_M
    assert figures["heading_largest_deg"] < 1.0
    assert all(0.7 <= figures[name] <= 1.5 for name in ("nees", "nees_heard", "nees_off"))
    if guidance == "carrot":
        assert figures["cross_heard"] < INCH_M
