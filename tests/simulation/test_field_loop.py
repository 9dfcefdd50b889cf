"""Fields in closed loop: lines followed, GNSS gone and back, the threshold's swing and its cure; NEES by NumPy."""

import jax
import jax.numpy as jnp
import numpy as np
import pytest
from jaxtyping import Array, Bool, Float

from lgprjax.autopilot import pad_fence
from lgprjax.coverage import PatternSettings
from lgprjax.simulation.field_loop import (
    PIDS,
    THRESHOLD_MPS,
    FieldCourse,
    FieldLoopSpec,
    FieldMoment,
    FieldWorld,
    made_up_field_world,
    made_up_tool,
    rectangle_course,
    run_fields,
    threshold_world,
)
from lgprjax.tuning import find_limit_cycle, fit_threshold

INCH_M = 0.0254
SPEC = FieldLoopSpec(moments=4400)
FAR = pad_fence(np.array([[-60.0, -60.0], [180.0, -60.0], [180.0, 60.0], [-60.0, 60.0]]))


def settings(turning_room_m: float = 6.0) -> PatternSettings:
    return PatternSettings(1.2, 0.15, "boustrophedon", 1.5, turning_room_m, 1.2)


def driven(
    world: FieldWorld, course: FieldCourse, fence: Float[Array, "slot 2"], *, spec: FieldLoopSpec = SPEC, seed: int = 5
) -> FieldMoment:
    """Two lanes, as NumPy arrays."""
    kept = run_fields(spec, world, course.route, fence, jax.random.split(jax.random.key(seed), 2))
    return jax.tree.map(np.asarray, kept)  # type: ignore[no-any-return]


def errors(kept: FieldMoment) -> Float[np.ndarray, "moment lane 3"]:
    turned = np.angle(np.exp(1j * (np.asarray(kept.believed.yaw_rad, np.float64) - kept.yaw_rad)))
    return np.stack([kept.believed.x_m - kept.x_m, kept.believed.y_m - kept.y_m, turned], axis=-1)


def rms(values: Float[np.ndarray | Array, "..."]) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def mean_nees(kept: FieldMoment, chosen: Bool[np.ndarray | Array, "moment lane"]) -> float:
    """Of x, y and yaw, a degree of freedom."""
    wrong, spread = errors(kept)[chosen], np.asarray(kept.covariance, np.float64)[chosen]
    return float(np.mean(np.einsum("ti,tij,tj->t", wrong, np.linalg.inv(spread), wrong)) / 3.0)


def test_a_fix_that_comes_after_the_next_was_measured_is_refused() -> None:
    world = made_up_field_world()
    world = world._replace(sensors=world.sensors._replace(gnss_ticks=jnp.int32(10), late_ticks=jnp.int32(12)))
    course = rectangle_course(12.0, 6.0, settings(), made_up_tool())
    with pytest.raises(ValueError, match="late_ticks is less than gnss_ticks, 10, not 12"):
        driven(world, course, FAR)


@pytest.fixture(scope="module")
def small_field() -> FieldMoment:
    """12 x 6 m with GNSS off 30 s of every 90 s."""
    course = rectangle_course(12.0, 6.0, settings(), made_up_tool())
    return driven(made_up_field_world(off_s=30.0), course, course.fence)


def test_a_field_is_worked_to_its_end_with_gnss_off_a_third_of_the_time(small_field: FieldMoment) -> None:
    assert not small_field.stopping.any()
    assert (small_field.limited & 256 == 0).all()
    worked = small_field.engaged & ~small_field.done
    on_line = worked & (small_field.line >= 0)
    assert set(small_field.line[:, 0]) == set(range(-1, 6))
    assert small_field.done[-1].all()
    assert (worked & ~small_field.heard).sum() > 300
    assert rms(small_field.cross_m[on_line & small_field.heard]) < INCH_M
    assert rms(errors(small_field)[worked & small_field.heard][:, :2].sum(axis=-1) / 2**0.5) < INCH_M
    assert np.degrees(np.abs(errors(small_field)[worked][:, 2])).max() < 1.0
    assert 0.3 < mean_nees(small_field, worked) < 2.0
    # On along lines and nowhere else.
    np.testing.assert_array_equal(small_field.tool[worked] == 1.0, (small_field.line >= 0)[worked])
    assert (small_field.tool[~small_field.engaged] == 0.0).all()


def test_the_threshold_makes_it_swing_and_its_log_tells(small_field: FieldMoment) -> None:
    # A route of the same ladder as the small field's: nothing compiles anew.
    line = rectangle_course(110.0, 1.2, settings(), made_up_tool())
    assert line.route.rows.shape == rectangle_course(12.0, 6.0, settings(), made_up_tool()).route.rows.shape
    world = threshold_world(PIDS["P 3, D 2"], threshold_mps=THRESHOLD_MPS, believed_mps=0.0)
    swinging = driven(world, line, FAR)
    late = (swinging.line[:, 0] >= 0) & (swinging.to_go_m[:, 0] < 90.0) & ~swinging.done[:, 0]
    time_s = 0.1 * np.arange(len(late))[late]
    found = find_limit_cycle(time_s, np.asarray(swinging.cross_m[late, 0], np.float64))
    assert found.found
    assert 14.0 * INCH_M <= found.peak_to_peak_m <= 22.0 * INCH_M
    told = fit_threshold(
        time_s,
        np.asarray(swinging.believed.yaw_rad[late, 0], np.float64),
        np.asarray(swinging.turn_mps[late, 0], np.float64),
    )
    assert told.found
    assert told.threshold_mps.low <= THRESHOLD_MPS <= told.threshold_mps.high
    assert told.threshold_mps.value == pytest.approx(THRESHOLD_MPS, rel=0.1)
    assert small_field.x_m.shape == swinging.x_m.shape


@pytest.mark.campaign
@pytest.mark.parametrize("name", list(PIDS))
def test_no_pid_cures_the_swing_and_the_compensation_does(name: str) -> None:
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
    print({key: round(size, 3) for key, size in sizes.items()})
    for lane in range(2):
        assert 14.0 * INCH_M <= sizes["ignores", lane] <= 22.0 * INCH_M
        assert sizes["made up for", lane] < 0.05
        assert sizes["obeys", lane] < 0.05


@pytest.mark.campaign
@pytest.mark.parametrize("guidance", ["carrot", "pursuit"])
def test_the_whole_field_of_the_source(guidance: str) -> None:
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
    print(guidance, {name: round(value, 4) for name, value in figures.items()})
    assert kept.done[-1].all()
    assert not kept.stopping.any()
    assert figures["position_heard"] < INCH_M
    assert figures["heading_largest_deg"] < 1.0
    assert all(0.7 <= figures[name] <= 1.5 for name in ("nees", "nees_heard", "nees_off"))
    if guidance == "carrot":
        assert figures["cross_heard"] < INCH_M


def test_a_fence_on_the_way_stops_the_vehicle_before_it(small_field: FieldMoment) -> None:
    course = rectangle_course(12.0, 6.0, settings(), made_up_tool())
    wall = pad_fence(np.array([[-20.0, -20.0], [8.0, -20.0], [8.0, 30.0], [-20.0, 30.0]]))
    kept = driven(made_up_field_world(off_s=30.0), course, wall)
    assert kept.edge[-1].all()
    front = kept.x_m + 1.35 * np.cos(kept.yaw_rad) + 0.6 * np.abs(np.sin(kept.yaw_rad))
    assert front.max() < 8.0
    assert front[-1].min() > 7.0
    assert (kept.tool[kept.stopping & kept.engaged] == 0.0)[5:].all()
    assert np.abs(kept.speed_mps[-1]).max() < 1e-3
    assert small_field.x_m.shape == jnp.shape(kept.x_m)
